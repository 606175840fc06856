"""The laws of every estimator, for those that work with the six rows of satellite ranging only."""

from dataclasses import replace

import numpy as np
import pytest

from quietfix.systems.angles.relative_kinematics import ROWS
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.registry import ESTIMATORS, object_at
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import OWN_SENSOR
from tests.laws.rig import PORTS, assert_same, run, with_gaps
from tests.systems.ranging_scene import EARTH, PRIOR, TARGET, measurements, sensor

TRIALS, EPOCHS = 100, 32
CLOCK = Periodic(10.0)
PARTS = {"1": slice(37, 38), "7": slice(20, 27)}


def estimators():
    """Options by name; those that can look ahead do not, since a feed cannot."""
    options = {name: object_at(ESTIMATORS[name])() for name in OWN_SENSOR}
    return {
        name: replace(one, look_ahead=False) if hasattr(one, "look_ahead") else one for name, one in options.items()
    }


@pytest.fixture(scope="module")
def scene():
    measured, observer, _ = measurements(TRIALS, EPOCHS, 21)
    prior = TARGET + np.random.default_rng(22).standard_normal((TRIALS, 6)) * np.sqrt(np.diag(PRIOR))
    return measured, np.tile(observer, (TRIALS, 1, 1)), prior


def play(name, measured, observer, prior, stream=tuple(ROWS)):
    trials = len(prior)
    wiring = Wiring(trials, stream, CLOCK, 1, trials)
    block = estimators()[name].make(name, sensor(), OrbitalMotion(EARTH, False), GivenStart(prior, PRIOR), wiring)
    end = 10.0 * (measured.shape[1] - 1)
    return run(block, measured.swapaxes(0, 1), observer.swapaxes(0, 1), CLOCK, end=end)[1]


@pytest.fixture(scope="module")
def batches(scene):
    return {name: play(name, *scene) for name in estimators()}


@pytest.mark.parametrize("size", PARTS)
@pytest.mark.parametrize("name", OWN_SENSOR)
def test_a_trial_alone_is_the_same_as_in_a_batch(scene, batches, name, size):
    part = play(name, *(array[PARTS[size]] for array in scene))
    assert_same(part, {port: values[:, PARTS[size]] for port, values in batches[name].items()})


@pytest.mark.parametrize("name", OWN_SENSOR)
def test_so_it_is_with_gaps(scene, name):
    measured, observer, prior = (array[:12] for array in scene)
    measured = with_gaps(measured.swapaxes(0, 1), 0.1).swapaxes(0, 1)
    batch = play(name, measured, observer, prior)
    for rows in (slice(7, 8), slice(3, 10)):
        part = play(name, measured[rows], observer[rows], prior[rows])
        assert_same(part, {port: values[:, rows] for port, values in batch.items()})


@pytest.mark.parametrize("name", OWN_SENSOR)
def test_covariances_are_symmetric_and_positive_definite(batches, name):
    covariance = batches[name]["covariance"]
    scale = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    correlation = covariance / (scale[..., None] * scale[..., None, :])
    assert np.abs(correlation - correlation.swapaxes(-1, -2)).max() < 1e-9
    assert np.linalg.eigvalsh(correlation).min() > 0


@pytest.mark.parametrize("name", OWN_SENSOR)
def test_twenty_epochs_without_a_row_are_predicted(scene, name):
    prior = scene[2][:7]
    longer, own, _ = measurements(7, 60, 23)
    longer[:, 24:44] = np.nan
    values = play(name, longer, np.tile(own, (7, 1, 1)), prior)
    motion, x, p = OrbitalMotion(EARTH, False), values["estimate"][23], values["covariance"][23]
    for k in range(24, 44):
        phi = motion.transition(x, 10.0)
        x, p = motion.propagate(x, 10.0), phi @ p @ phi.swapaxes(-1, -2)
        sigma = np.sqrt(np.diagonal(p, axis1=-2, axis2=-1))
        # a mixture of two orbits does not move as its mean does: by then every trial has one
        assert np.abs((values["estimate"][k] - x) / sigma).max() < 1e-3
        assert np.isnan(values["nis"][k]).all() and not values["nis_dof"][k].any()
    assert values["nis_dof"][44:].any(axis=0).all() and np.isfinite(values["estimate"][44:]).all()


@pytest.mark.parametrize("what", ["measurement", "platforms", "start"])
@pytest.mark.parametrize("name", OWN_SENSOR)
def test_a_trial_that_is_nan_changes_no_other(scene, name, what):
    parts = [array[:6].copy() for array in scene]
    clean = play(name, *parts)
    parts[("measurement", "platforms", "start").index(what)][3] = np.nan
    values = play(name, *parts)
    others = [0, 1, 2, 4, 5]
    for port in PORTS:
        np.testing.assert_allclose(values[port][:, others], clean[port][:, others], rtol=1e-9, equal_nan=True)
    if what != "start" or name != "bank":  # the bank has no use for a start
        assert not values["nis_dof"][:, 3].any() and np.isnan(values["nis"][:, 3]).all()


@pytest.mark.parametrize("name", OWN_SENSOR)
def test_rows_are_found_by_name(scene, name):
    measured, observer, prior = (array[:5] for array in scene)
    order = [3, 0, 5, 1, 4, 2]
    stream = tuple(list(ROWS)[i] for i in order)
    a = play(name, measured, observer, prior)
    b = play(name, measured[..., order], observer, prior, stream)
    np.testing.assert_array_equal(a["estimate"], b["estimate"])
