"""One filter per root, without any prior."""

import numpy as np
import pytest

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.options.ranging.bank import Bank, RootsStart
from quietfix.systems.starts.start import GivenStart
from tests.laws.rig import run
from tests.systems.ranging_scene import EARTH, PRIOR, SIGMAS, measurements, sensor

CLOCK = Periodic(10.0)


def make(trials, options=None):
    wiring = Wiring(trials, tuple(ROWS), CLOCK, 1)
    return (options or Bank()).make(
        "bank", sensor(), OrbitalMotion(EARTH, False), GivenStart(np.full(6, np.nan), PRIOR), wiring
    )


def play(measured, observer, options=None):
    block = make(measured.shape[0], options)
    end = 10.0 * (measured.shape[1] - 1)
    return run(block, measured.swapaxes(0, 1), observer[:, None], CLOCK, end=end)[1]


def test_it_begins_at_every_possible_root():
    measured, observer, _ = measurements(50, 1, 3)
    start = RootsStart(sensor(), tuple(ROWS))
    means, covariances, weights = start.hypotheses(measured[:, 0], observer[None, :1])
    alive = weights > 0
    assert np.all(np.isfinite(means[alive])) and np.all(np.isnan(means[~alive]))
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0)
    k, j = np.argwhere(alive)[0]
    distance = np.linalg.norm(means[k, j, :3] - observer[0, :3])
    expected = 4 * start._equation.state_covariance(distance, measured[k, 0], observer[0], SIGMAS)
    np.testing.assert_allclose(covariances[k, j], expected, rtol=1e-6)
    mixed = start.begin(measured[:, 0], observer[None, :1], {})[0]
    np.testing.assert_allclose(mixed, np.einsum("tk,tki->ti", weights, np.where(alive[..., None], means, 0.0)))


def test_the_estimate_is_the_mixture_until_the_data_have_spoken():
    measured, observer, truth = measurements(60, 31, 4)
    values = play(measured, observer)
    error = np.linalg.norm((values["estimate"] - truth[:, None])[..., :3], axis=-1)
    assert np.median(error[0]) > 2e6  # between two roots 6000 km apart
    sigma = np.sqrt(np.trace(values["covariance"][..., :3, :3], axis1=-2, axis2=-1))
    assert np.median(sigma[0]) > 2e6  # and says so
    assert np.mean(error[10] < 1e6) >= 0.90 and np.mean(error[20] < 1e6) >= 0.98
    assert np.median(error[30]) < 40e3


def test_a_trial_without_a_root_begins_later():
    measured, observer, truth = measurements(3, 30, 6)
    blank = measured.copy()
    blank[1, :4, 5] = -50.0
    blank[2, :3] = np.nan
    values, clean = play(blank, observer), play(measured, observer)
    assert np.isnan(values["estimate"][:4, 1]).all() and np.isfinite(values["estimate"][4:, 1]).all()
    assert np.isnan(values["estimate"][:3, 2]).all() and np.isfinite(values["estimate"][3:, 2]).all()
    np.testing.assert_allclose(values["estimate"][:, 0], clean["estimate"][:, 0], rtol=1e-9)
    assert np.linalg.norm((values["estimate"][-1, 1] - truth[-1])[:3]) < 200e3


def test_the_first_epoch_is_used_once():
    measured, observer, _ = measurements(2, 2, 8)
    values = play(measured, observer)
    assert not values["nis_dof"][0].any() and np.all(values["nis_dof"][1] == 6)


def test_it_needs_the_six_rows():
    with pytest.raises(ValueError, match="ranging needs all rows"):
        RootsStart(RelativeKinematics({"azimuth": 1e-3}, EARTH), ("azimuth",))
    with pytest.raises(ValueError, match=r"inflation: 0\.0 is not allowed"):
        RootsStart(sensor(), tuple(ROWS), 0.0)
