"""A particle filter that has lost its target: the flag, and beginning again from a measurement alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.angles.direction import Direction
from quietfix.systems.clocks import Periodic
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.pf import Pf
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw
from quietfix.systems.starts.direction_start import DirectionStart
from quietfix.systems.starts.prior_position_start import PriorPositionStart
from tests.laws.cases import PASS, fdoa, place, satellites, tdoa
from tests.laws.rig import Feed, make

TRIALS, EPOCHS, JUMP = 3, 30, 8
PORTS = ("estimate", "covariance", "diverged", "restarts", "recent_evidence", "nis_dof", "ancestors")


def scene():
    """Trials 0 and 1 fly on; at `JUMP` what is measured in trial 2 is another emitter, 60 km away."""
    rng = np.random.default_rng(4)
    direction, delay, doppler = Direction(np.radians(0.5)), tdoa(receivers=(1,)), fdoa(receivers=(1,))
    model = Stack([direction, delay, doppler])
    times = PASS / 2 + np.arange(EPOCHS)
    start = np.stack([place(0, 300e3), place(50e3, 250e3), place(0, 300e3)])
    move = np.concatenate([start[:, 3:], np.zeros((TRIALS, 3))], axis=-1)
    truth = start + np.arange(EPOCHS)[:, None, None] * move
    other = place(60e3, 330e3)
    truth[JUMP:, 2] = other + np.arange(EPOCHS - JUMP)[:, None] * np.concatenate([other[3:], np.zeros(3)])
    platforms = satellites(times)[:, None]
    measured = model.predict(truth, platforms) + rng.normal(size=(EPOCHS, TRIALS, 4)) * model.sigmas
    again = DirectionStart(direction, delay, doppler, model.names, 3e3, 200.0)
    begin = PriorPositionStart(5e3, 200.0, again)
    inputs = {
        "prior_position": start[None, :, :3] + 5e3 * rng.normal(size=(1, TRIALS, 3)),
        "assumed_height": 10e3 + 3e3 * rng.normal(size=(EPOCHS, TRIALS, 1)),
    }
    inputs["prior_position"] = np.repeat(inputs["prior_position"], EPOCHS, axis=0)
    return model, begin, truth, platforms.reshape(EPOCHS, 1, 18), measured, inputs


@pytest.fixture(scope="module")
def runs():
    model, begin, truth, platforms, measured, inputs = scene()
    found = {}
    for restart in (True, False):
        clock = Periodic(1.0)
        block = make("pf", Pf(particles=3000, restart=restart), model, ConstantVelocity(0.1), begin, TRIALS, clock)
        builder = DiagramBuilder()
        builder.AddSystem(block)
        for port, values in {"measurement": measured, "platforms": platforms, **inputs}.items():
            feed = builder.AddSystem(Feed(values, clock, port))
            builder.Connect(feed.GetOutputPort("value"), block.GetInputPort(port))
        recorder = record(builder, {port: block.GetOutputPort(port) for port in PORTS}, clock)
        diagram = builder.Build()
        simulator = Simulator(diagram)
        set_draw(diagram, simulator.get_mutable_context(), Draw(seed=2))
        simulator.Initialize()
        simulator.AdvanceTo(EPOCHS - 1.0)
        found[restart] = recorder.result(simulator.get_context())[1]
    return truth, found


def distance(truth, values):
    """In standard deviations of the filter's own covariance, position only, (epochs, trials)."""
    error = (values["estimate"] - truth)[..., :3]
    covariance = values["covariance"].reshape(*error.shape[:2], 6, 6)[..., :3, :3]
    return np.sqrt(np.einsum("kti,kti->kt", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def test_without_restart_the_flag_goes_up_and_stays(runs):
    _, found = runs
    diverged = found[False]["diverged"][..., 0]
    assert not diverged[:, :2].any() and not diverged[:JUMP, 2].any()
    assert np.all(diverged[JUMP + 2 :, 2] == 1)
    assert not found[False]["restarts"].any()


def test_with_restart_the_trial_comes_back(runs):
    """One or two epochs after the jump it begins again, once, and is then as far off as it says."""
    truth, found = runs
    restarts = found[True]["restarts"][..., 0]
    assert not restarts[:, :2].any() and not restarts[:JUMP, 2].any()
    assert np.all(restarts[JUMP + 2 :, 2] == 1)
    assert not found[True]["diverged"][JUMP + 3 :, 2].any()
    # chi-square with three degrees of freedom passes 25 once in 60,000
    assert distance(truth, found[True])[JUMP + 3 :, 2].max() < 5


def test_the_other_trials_are_as_if_nothing_had_happened(runs):
    _, found = runs
    for port in PORTS:
        np.testing.assert_array_equal(found[True][port][:, :2], found[False][port][:, :2])
