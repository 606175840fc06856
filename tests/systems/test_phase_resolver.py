"""Whole cycles of wrapped phases: from the TDOA fix at the predicted height, or from a chain of baselines."""

import math

import numpy as np
import pytest

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.estimators.phase_resolver import PhaseResolver, resolve
from quietfix.systems.measurement.stack import Stack
from tests.laws.cases import PASS, PLACES, WAVELENGTH, fdoa, phase, place, satellites, tdoa
from tests.laws.packaged import Packaged

SIGMA = np.radians(15.0)


def chain_probability(ratio, sigma):
    r"""Return the probability that one stage of a baseline chain finds the right integer.

    .. math:: P = \mathrm{erf}\left(\frac{\pi}{\sqrt 2\,\sigma\sqrt{1 + r^2}}\right)

    The longer baseline's phase is predicted as r times the shorter one's; the prediction error is
    :math:`\sigma\sqrt{1 + r^2}` and must stay below half a cycle.

    Parameters
    ----------
    ratio
        r, longer over shorter baseline.
    sigma
        Standard deviation of every phase [rad].
    """
    return math.erf(math.pi / (math.sqrt(2) * sigma * math.sqrt(1 + ratio**2)))


def test_resolve():
    """Whole cycles, so that what comes out is within half a cycle of what was predicted."""
    rng = np.random.default_rng(0)
    true = rng.uniform(-200, 200, (50, 2))
    predicted = true + rng.uniform(-3.1, 3.1, (50, 2))
    phases, integers = resolve(wrap(true), predicted)
    np.testing.assert_allclose(phases, true, atol=1e-12)
    np.testing.assert_array_equal(integers, np.round(integers))
    np.testing.assert_allclose(wrap(true) + 2 * np.pi * integers, phases, atol=1e-12)
    off, _ = resolve(wrap(true), predicted + 2 * np.pi)
    np.testing.assert_allclose(off, true + 2 * np.pi, atol=1e-12)
    gone, integer = resolve(np.array([1.0, np.nan]), np.array([np.nan, 1.0]))
    assert np.isnan(gone).all() and np.isnan(integer).all()


# ------------------------------------------------------------------------------------------------- block alone

STREAM = Stack([tdoa(), fdoa(), phase(wrapped=True)])
MIDDLE = satellites(PASS / 2)


def resolved(measurement, prediction, platforms=None):
    """Return what the block makes of given inputs: measurement and integers."""
    trials = len(measurement)
    platforms = np.broadcast_to(MIDDLE, (1, 3, 6)) if platforms is None else platforms
    block = PhaseResolver(STREAM.names, phase(), tdoa(), trials, 3, platform_trials=len(platforms))
    context = block.CreateDefaultContext()
    for port, value in (("measurement", measurement), ("platforms", platforms), ("prediction", prediction)):
        block.GetInputPort(port).FixValue(context, np.ravel(value))
    outputs = {port: block.GetOutputPort(port).Eval(context) for port in ("measurement", "integers")}
    assert block.stream == list(STREAM.names)
    return outputs["measurement"].reshape(trials, 6), outputs["integers"].reshape(trials, 2)


def scene(trials, where="(0,300)", height_error=0.0):
    """Targets at a place, exact delays, and a prediction with another height and a poor place and velocity."""
    rng = np.random.default_rng(1)
    target = np.broadcast_to(place(*PLACES[where]), (trials, 6))
    measurement = STREAM.represent(STREAM.predict(target, MIDDLE[None]))
    prediction = place(*PLACES[where], height=10e3 + height_error) + np.zeros((trials, 6))
    prediction[:, :3] += np.cross(rng.normal(size=(trials, 3)), target[:, :3] / 6.4e6) * 20e3
    prediction[:, 3:] += 400.0 * rng.normal(size=(trials, 3))
    return target, measurement, prediction


@pytest.mark.parametrize("height_error", [0.0, 5e3, -8e3, 60e3])
@pytest.mark.parametrize("where", PLACES)
def test_a_wrong_height_hardly_moves_the_phase(where, height_error):
    """The triangle knows the direction from the delays: the integers are right 60 km off (reference b)."""
    target, measurement, prediction = scene(5, where, height_error)
    value, integers = resolved(measurement, prediction)
    exact = phase().predict(target, MIDDLE[None])
    np.testing.assert_allclose(value[:, 4:], exact, atol=1e-9)
    np.testing.assert_array_equal(value[:, :4], measurement[:, :4])
    np.testing.assert_array_equal(integers, np.round((exact - measurement[:, 4:]) / (2 * np.pi)))
    assert np.abs(integers).max() >= 1  # or nothing was wrapped


@pytest.mark.parametrize("side", [300e3, -300e3])
def test_the_side_is_the_predictions(side):
    """Delays along one line do not tell left from right of the track; the filter does."""
    line = satellites(PASS / 2, "line")[None]
    target = place(50e3, side)[None]
    measurement = STREAM.represent(STREAM.predict(target, line))
    prediction = place(60e3, 1.1 * side)[None]
    value, _ = resolved(measurement, prediction, line)
    np.testing.assert_allclose(value[:, 4:], phase().predict(target, line), atol=1e-6)


def test_every_trial_for_itself():
    _, measurement, prediction = scene(6)
    clean, _ = resolved(measurement, prediction)
    measurement[1, 0] = np.nan  # no fix
    prediction[2] = np.nan  # no height
    measurement[3, 4] = np.nan  # one phase not heard
    own = np.tile(MIDDLE, (6, 1, 1))
    own[4, 2] = np.nan
    value, integers = resolved(measurement, prediction, own)
    np.testing.assert_array_equal(value[[0, 5]], clean[[0, 5]])
    for i in (1, 2, 4):
        assert np.isnan(value[i, 4:]).all() and np.isnan(integers[i]).all()
        np.testing.assert_array_equal(value[i, :4], measurement[i, :4])
    assert np.isnan(value[3, 4]) and value[3, 5] == clean[3, 5]


# ---------------------------------------------------------------------------------------------------- in a loop


def right_integers(packaged, signals):
    """Share of epochs with both integers right, from the first that the filter predicts."""
    exact = phase().predict(signals["truth"], packaged.platforms(signals))
    error = signals["measurement"][1:, :, 4:] - exact[1:]
    assert np.isfinite(error).all()
    # a right one leaves the noise of 15 degrees; beyond half a cycle that would be twelve sigma
    right = np.abs(error) < np.pi
    np.testing.assert_array_equal(np.round(error / (2 * np.pi)) == 0, right)
    # and the port says the number that was added
    integers = signals["integers"][1:]
    np.testing.assert_array_equal(integers, np.round(integers))
    return np.all(right, axis=-1).mean()


def loop(where, sigma_km, trials, duration=150, **settings):
    along, cross = PLACES[where]
    changes = {
        "truth.along_km": along / 1e3,
        "truth.cross_km": cross / 1e3,
        "truth.sigma_assumed_height_km": sigma_km,
        "duration_s": duration,
    }
    return Packaged("three_satellite", trials, changes | settings, ["iekf"])


@pytest.mark.parametrize("where", ["(0,50)", "(-300,700)"])
def test_integers_are_right_in_the_triangle(where):
    packaged = loop(where, 15, 10)
    assert right_integers(packaged, packaged.run()[1]) >= 0.999


@pytest.mark.slow
@pytest.mark.parametrize("sigma_km", [3, 6, 10, 15])
@pytest.mark.parametrize("where", PLACES)
def test_integers_are_right_in_the_triangle_at_every_place(where, sigma_km):
    packaged = loop(where, sigma_km, 100)
    assert right_integers(packaged, packaged.run()[1]) >= 0.999


def test_the_line_formation_resolves_wrong():
    """So that the test above could fail: 80 km in one line and a height 6 km off give wrong integers (reference b).

    Left of the track, because a fix from two delays along one line cannot tell the sides, and takes that one here.
    """
    changes = {"truth.cross_km": -300, "truth.sigma_assumed_height_km": 6, "duration_s": 20}
    packaged = Packaged("three_satellite:coplanar", 60, changes, ["iekf"])
    # 59 % of the trials right at (0, 300) in the reference; 60 trials scatter by 6 %
    assert 0.4 < right_integers(packaged, packaged.run()[1]) < 0.8


# ----------------------------------------------------------------------------------------------------- the chain


def linked(baselines, trials, rng, along=60e3, cross=-40e3):
    """Wrapped phases of a chain of baselines with noise, as the block gets them; the exact phases; the block."""
    models = [InterferometerPhase(SIGMA, length, WAVELENGTH, wrapped=True) for length in baselines]
    long, chain = models[-1], models[:-1]
    plain = InterferometerPhase(SIGMA, baselines[-1], WAVELENGTH)
    names = [*tdoa().names, *plain.names]
    for i in range(len(chain)):
        names += PhaseResolver.link_names(plain, i)
    target = np.broadcast_to(place(along, cross), (trials, 6))
    parts = [np.zeros((trials, 2))]
    for model in (long, *chain):
        exact = model.predict(target, MIDDLE[None])
        parts.append(wrap(exact + SIGMA * rng.normal(size=exact.shape)))
    block = PhaseResolver(names, plain, tdoa(), trials, 3, chain)
    context = block.CreateDefaultContext()
    block.GetInputPort("measurement").FixValue(context, np.hstack(parts).ravel())
    block.GetInputPort("platforms").FixValue(context, MIDDLE.ravel())
    value = block.GetOutputPort("measurement").Eval(context).reshape(trials, 4)
    assert block.stream == [*tdoa().names, *plain.names]
    assert not block.HasInputPort("prediction")
    return np.abs(value[:, 2:] - plain.predict(target, MIDDLE[None])) < np.pi


@pytest.mark.parametrize("ratio", [2, 4, 6, 10])
def test_probability_of_one_stage(ratio):
    """Monte Carlo over 2 x 50 000 phases against erf(pi / (sqrt 2 sigma sqrt(1 + r^2))) at 15 degrees."""
    right = linked([0.45 * WAVELENGTH, 0.45 * WAVELENGTH * ratio], 50000, np.random.default_rng(ratio))
    p = chain_probability(ratio, SIGMA)
    scatter = math.sqrt(max(p * (1 - p), 1e-6) / right.size)
    assert abs(right.mean() - p) < 4 * scatter
    reference = {2: 1.0, 4: 0.99639, 6: 0.9515, 10: 0.7675}
    assert abs(p - reference[ratio]) < 1e-4


def test_four_stages_from_half_a_wavelength_to_thirty():
    """Ratio 60 in four stages of 2.78: each right with probability 0.9999; in one stage three of four are wrong."""
    shortest = WAVELENGTH / 2
    ratio = (3.0 / shortest) ** 0.25
    rng = np.random.default_rng(3)
    right = linked([shortest * ratio**k for k in range(5)], 20000, rng)
    p = chain_probability(ratio, SIGMA) ** 4
    assert p > 0.9995 and abs(right.mean() - p) < 4 * math.sqrt(p * (1 - p) / right.size)
    at_once = linked([shortest, 3.0], 20000, rng).mean()
    assert abs(at_once - chain_probability(ratio**4, SIGMA)) < 0.02 and at_once < 0.3


@pytest.mark.parametrize("system", ["three_satellite", "three_satellite:coplanar"])
def test_a_chain_in_the_diagram_needs_no_feedback(system):
    """Four shorter baselines: right integers from the first epoch, also where the TDOA fix gives wrong ones."""
    chain = [0.04996, 0.1391, 0.3872, 1.0779]
    changes = {
        "truth.chain_m": f"[{', '.join(map(str, chain))}]",
        "truth.sigma_assumed_height_km": 15,
        "duration_s": 20,
    }
    packaged = Packaged(system, 40, changes, ["iekf"])
    names = {
        (source[0].get_name(), target[0].get_name()) for target, source in packaged.diagram.connection_map().items()
    }
    assert ("sensor", "phase_resolver") in names and ("iekf", "phase_resolver") not in names
    signals = packaged.run()[1]
    exact = phase().predict(signals["truth"], packaged.platforms(signals))
    right = np.all(np.abs(signals["measurement"][..., 4:] - exact) < np.pi, axis=-1)
    assert right.mean() > 0.997  # two axes of four stages: 0.9992


@pytest.mark.parametrize(
    ("chain", "message"),
    [
        ([0.04, 4.0], "must increase"),
        ([0.3, 0.04], "must increase"),
        ([0.06, 0.3], "at most half a wavelength"),
    ],
)
def test_bad_chain(chain, message):
    links = [InterferometerPhase(SIGMA, length, WAVELENGTH, wrapped=True) for length in chain]
    names = [*STREAM.names, *(row for i in range(2) for row in PhaseResolver.link_names(phase(), i))]
    with pytest.raises(ValueError, match=message):
        PhaseResolver(names, phase(), tdoa(), 1, 3, links)


def test_with_feedback_the_diagram_builds_without_a_loop():
    """prediction -> resolver -> estimator -> prediction: no algebraic loop, because the prediction is known before."""
    packaged = loop("(0,300)", 3, 2, duration=5)
    names = {
        (source[0].get_name(), target[0].get_name()) for target, source in packaged.diagram.connection_map().items()
    }
    assert {("iekf", "phase_resolver"), ("phase_resolver", "iekf")} <= names
