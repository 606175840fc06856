"""Blocks around satellite ranging: prior, known platforms, preview, ranging."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.geometry.visibility import EarthOccultation
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.sensors.platform_error import PlatformError
from quietfix.systems.sensors.preview import Preview
from quietfix.systems.sensors.prior import PriorEstimate
from quietfix.systems.sensors.ranging import Ranging
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import Constant, Draw, set_draw
from tests.systems.ranging_scene import EARTH, OBSERVER, PRIOR, SIGMAS, TARGET, arc, sensor

CLOCK = Periodic(10.0)


def build(trials, feedback=None, error=None, mask=None, epochs=4):
    builder = DiagramBuilder()
    observer = builder.AddSystem(DenseOrbit(OBSERVER[None], 3000.0, EARTH, False, "observer"))
    target = builder.AddSystem(DenseOrbit(TARGET[None], 3000.0, EARTH, False, "target"))
    eye = builder.AddSystem(Sensor(sensor(), CLOCK, trials, 1, mask=mask, name="sensor"))
    builder.Connect(target.GetOutputPort("inertial"), eye.GetInputPort("target"))
    builder.Connect(observer.GetOutputPort("inertial"), eye.GetInputPort("platforms"))
    known = observer.GetOutputPort("inertial")
    if error is not None:
        builder.AddSystem(error)
        builder.Connect(known, error.GetInputPort("platforms"))
        known = error.GetOutputPort("platforms")
    ranging = builder.AddSystem(
        Ranging(sensor(), trials, platform_trials=1 if error is None else trials, feedback=feedback is not None)
    )
    builder.Connect(eye.GetOutputPort("measurement"), ranging.GetInputPort("measurement"))
    builder.Connect(known, ranging.GetInputPort("platforms"))
    if feedback is not None:
        constant = builder.AddSystem(Constant("prediction", feedback))
        builder.Connect(constant.GetOutputPort("state"), ranging.GetInputPort("prediction"))
    preview = builder.AddSystem(
        Preview(eye, lambda t: target.at(t), lambda t: observer.at(t), CLOCK, epochs, error, "preview")
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), Draw(4, 2))
    simulator.Initialize()

    def value(block, port, size):
        return block.GetOutputPort(port).Eval(block.GetMyContextFromRoot(simulator.get_context())).reshape(-1, size)

    return simulator, eye, ranging, preview, value


@pytest.mark.parametrize("uncertain", [False, True])
def test_the_preview_is_what_will_be_measured(uncertain):
    error = PlatformError(3, 1, 100.0, 0.1, name="navigation") if uncertain else None
    simulator, eye, _, preview, value = build(3, error=error)
    ahead = value(preview, "preview", 48).reshape(3, 4, 12)
    for k in range(4):
        simulator.AdvanceTo(10.0 * k)
        np.testing.assert_array_equal(ahead[:, k, :6], value(eye, "measurement", 6))
        if error is None:
            there = np.tile(arc(times=np.array([10.0 * k]))[0], (3, 1))
            np.testing.assert_allclose(ahead[:, k, 6:], there, rtol=1e-12)
        else:
            np.testing.assert_array_equal(ahead[:, k, 6:], value(error, "platforms", 6))


def test_the_preview_needs_so_many_ticks():
    eye = Sensor(sensor(), CLOCK, 1, 1)
    with pytest.raises(ValueError, match="5 epochs are asked for, the sensor has 2"):
        Preview(eye, lambda t: TARGET[None], lambda t: OBSERVER[None], Times([0.0, 10.0]), 5)


def test_ranging_block():
    trials = 5
    prediction = np.tile(TARGET + np.array([1e5, -1e5, 5e4, 0, 0, 0]), (trials, 1))
    _, eye, ranging, _, value = build(trials, feedback=prediction)
    measured, equation = value(eye, "measurement", 6), ranging.position.equation
    ranges = value(ranging, "ranges", 3)
    np.testing.assert_array_equal(ranges, equation.ranges(measured, OBSERVER))
    partials = equation.range_partials(ranges, measured[:, None], OBSERVER)
    np.testing.assert_allclose(value(ranging, "range_sigmas", 3), np.sqrt(((partials * SIGMAS) ** 2).sum(axis=-1)))
    np.testing.assert_allclose(value(ranging, "naive_range", 1)[:, 0], equation.naive_range(measured, OBSERVER))
    position = value(ranging, "measurement", 3)
    off = np.linalg.norm(position - TARGET[:3], axis=-1)
    assert np.all(off < 5 * 125e3)  # sigma is 121 km at t = 0; false roots are 6000 km away
    noise = value(ranging, "noise_covariance", 9).reshape(trials, 3, 3)
    np.testing.assert_allclose(noise, ranging.position.noise_covariance_at(prediction, OBSERVER[None, None]))
    assert np.all(np.linalg.eigvalsh(noise) > 0)
    # hyperbolic third roots are gated, so the block offers two at most
    assert np.all(np.isfinite(value(ranging, "positions", 9)).reshape(trials, 3, 3).all(axis=-1).sum(axis=-1) <= 2)


def test_an_occulted_epoch_has_no_range():
    simulator, eye, ranging, _, value = build(2, mask=EarthOccultation(EARTH.radius))
    simulator.AdvanceTo(1850.0)
    assert np.isfinite(value(eye, "measurement", 6)).all()
    simulator.AdvanceTo(1860.0)
    assert np.isnan(value(eye, "measurement", 6)).all() and np.isnan(value(ranging, "ranges", 3)).all()


def test_the_prior_is_drawn_per_trial_and_constant():
    builder = DiagramBuilder()
    target = builder.AddSystem(Constant("target", TARGET))
    prior = builder.AddSystem(PriorEstimate(PRIOR, 4000))
    builder.Connect(target.GetOutputPort("state"), prior.GetInputPort("target"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(1, 0))

    def draws():
        return prior.GetOutputPort("initial_estimate").Eval(prior.GetMyContextFromRoot(context)).reshape(-1, 6) - TARGET

    scaled = draws() / np.sqrt(np.diag(PRIOR))
    assert np.abs(scaled.mean(axis=0)).max() < 5 / np.sqrt(4000)
    assert np.abs(scaled.T @ scaled / 4000 - np.eye(6)).max() < 5 * np.sqrt(2 / 4000)
    first = draws()
    context.SetTime(50.0)
    np.testing.assert_array_equal(draws(), first)
    set_draw(diagram, context, Draw(1, 100))
    np.testing.assert_allclose(draws()[:10], first[100:110], rtol=0, atol=1e-9)


def test_platform_error_has_the_spread_it_says():
    error = PlatformError(4000, 2, 100.0, 0.5)
    scaled = error.error(Draw(3, 0)) / np.array([100.0] * 3 + [0.5] * 3)
    assert scaled.shape == (4000, 2, 6) and abs(scaled.std() - 1) < 0.02
    np.testing.assert_array_equal(PlatformError(10, 2, 100.0, 0.5).error(Draw(3, 7)), error.error(Draw(3, 0))[7:17])
    with pytest.raises(ValueError, match=r"sigma of the platform's position: -1\.0 is not allowed"):
        PlatformError(1, 1, -1.0)
