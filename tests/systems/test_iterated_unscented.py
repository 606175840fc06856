"""A sigma-point update, linearised again over its own posterior: exact where linear, not over-sure where wide."""

from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.options.ukf import Ukf
from tests.laws.rig import Linear, Scene, assert_same, with_gaps

SATELLITES = (Path(__file__).parents[1] / "own" / "three_satellite.yaml").as_posix()
PRIOR = "start=!Prior {sigma_position_m: %g, sigma_velocity_mps: 400}"
TWICE = "estimators.twice=!Ukf {iterations: 2}"


@pytest.mark.parametrize("iterations", [2, 5])
def test_is_the_textbooks(iterations):
    """Of a linear measurement nothing bends, and every linearisation is the same one."""
    rng = np.random.default_rng(3)
    h, root = rng.normal(size=(3, 6)), rng.normal(size=(5, 6, 6))
    mean, covariance, noise = rng.normal(size=(5, 6)), root @ np.swapaxes(root, -1, -2), np.diag([1.0, 0.3, 2.0])
    value = rng.normal(size=(5, 3))
    value[1, 2] = np.nan
    observation = Observation(value, np.zeros((1, 1, 6)), Whitener(noise))
    found = Ukf(iterations=iterations).update(mean, covariance, observation, Linear(h, noise))
    for i in range(5):
        there = np.isfinite(value[i])
        own, r = h[there], noise[np.ix_(there, there)]
        s = own @ covariance[i] @ own.T + r
        gain, nu = covariance[i] @ own.T @ np.linalg.inv(s), value[i, there] - own @ mean[i]
        np.testing.assert_allclose(found.mean[i], mean[i] + gain @ nu, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.covariance[i], covariance[i] - gain @ s @ gain.T, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.innovation[i, there], nu, rtol=1e-9)
        assert found.nis[i] == pytest.approx(nu @ np.linalg.inv(s) @ nu, rel=1e-9) and found.nis_dof[i] == there.sum()


def test_a_trial_alone_and_gaps():
    """Bit for bit, and a trial of which nothing is measured changes no other."""
    scene = Scene(7, 12)
    scene.measurement = with_gaps(scene.measurement)
    batch = scene.run("ukf", Ukf(iterations=3))
    for trial in (0, 6):
        alone = scene.only(slice(trial, trial + 1)).run("ukf", Ukf(iterations=3))
        assert_same(alone, {port: values[:, trial : trial + 1] for port, values in batch.items()})


@pytest.mark.parametrize("sigma", [3e3, 20e3])
def test_a_wide_prior_does_not_make_it_over_sure(sigma):
    """NEES of 200 trials at every second of the first five: 6 +- 4 sqrt(2 / 6 / 200) 6 = 6 +- 1; once: 10 and 130."""
    settings = ["duration_s=5", PRIOR % sigma, TWICE]
    study = run_study(SATELLITES, estimators=["ukf", "twice"], trials=200, set=settings)
    nees = study["nees"].mean("trial")
    assert np.abs(nees.sel(estimator="twice").values - 6).max() < 1.0
    assert nees.sel(estimator="ukf").values.min() > 9


@pytest.mark.parametrize("value", ["0", "-1", "1.5", ".nan", "two", "101"])
def test_refused(value):
    with pytest.raises(UserError, match=r"estimators\.u\.iterations"):
        setting = f"estimators.u=!Ukf {{iterations: {value}}}"
        run_study("three_satellite", estimators=["u"], trials=1, set=["duration_s=2", setting])
