"""The monitor for jumps of a shared bias: its statistics by hand, its reset, its gate."""

import numpy as np
import pytest

from quietfix.systems.filters.common_mode import CommonModeMonitor, common_mode_statistics
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.range_rate import RangeRate

SIGMA = 0.03


@pytest.fixture
def scene():
    rng = np.random.default_rng(5)
    stations = np.concatenate([rng.uniform(-3e5, 3e5, (8, 3)) * [1, 0.001, 1], np.zeros((8, 3))], axis=-1)[None]
    truth = np.array([5e4, 4e4, 1e3, 1500.0, 900.0, -10.0, 20.0, 5.0, 0.0, 100.0])
    mean = truth + rng.normal(size=(4, 10)) * [5, 5, 5, 0.3, 0.3, 0.3, 1, 1, 1, 1]
    covariance = np.broadcast_to(np.diag(np.square([5, 5, 5, 0.3, 0.3, 0.3, 1, 1, 1, 1.0])), (4, 10, 10))
    model = RangeRate(SIGMA, range(8), bias=9)
    z = model.predict(truth, stations) + SIGMA * rng.normal(size=(4, 8))
    return model, stations, mean, covariance, z


def statistics(model, stations, mean, covariance, z):
    value, jacobian = model.linearize(mean, stations)
    return common_mode_statistics(covariance, z - value, jacobian, Whitener(model.noise_covariance()), 9)


def test_statistics_are_the_textbook_ones(scene):
    model, stations, mean, covariance, z = scene
    g, n, jump = statistics(model, stations, mean, covariance, z)
    for i in range(len(mean)):
        h = model.jacobian(mean[i], stations[0])
        s = h @ covariance[i] @ h.T + SIGMA**2 * np.eye(8)
        nu, one = z[i] - model.predict(mean[i], stations[0]), np.ones(8)
        w = np.linalg.solve(s, np.stack([nu, one], axis=1))
        np.testing.assert_allclose(g[i], (one @ w[:, 0]) ** 2 / (one @ w[:, 1]), rtol=1e-6)
        np.testing.assert_allclose(g[i] + n[i], nu @ w[:, 0], rtol=1e-6)
        np.testing.assert_allclose(jump[i], nu.mean(), rtol=1e-9)


def test_a_common_jump_does_not_show_in_the_rest(scene):
    model, stations, mean, covariance, z = scene
    _, before, _ = statistics(model, stations, mean, covariance, z)
    g, after, jump = statistics(model, stations, mean, covariance, z + 3000.0)
    np.testing.assert_allclose(after, before, rtol=1e-4, atol=1e-3)
    assert np.all(g > 1e6)
    np.testing.assert_allclose(jump, 3000.0, atol=10.0)


def test_missing_rows_are_as_if_they_were_not_there(scene):
    model, stations, mean, covariance, z = scene
    z = z.copy()
    z[:, [2, 5]] = np.nan
    kept = [0, 1, 3, 4, 6, 7]
    less = RangeRate(SIGMA, kept, bias=9)
    with_gaps = statistics(model, stations, mean, covariance, z)
    without = statistics(less, stations, mean, covariance, z[:, kept])
    for a, b in zip(with_gaps, without, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7)
    z[1] = np.nan
    g, n, jump = statistics(model, stations, mean, covariance, z)
    assert g[1] == n[1] == jump[1] == 0.0


def update(filter_, scene, z):
    model, stations, mean, covariance, _ = scene
    return filter_.update(mean, covariance, Observation(z, stations, Whitener(model.noise_covariance())), model)


def test_without_a_jump_it_is_the_filter_itself(scene):
    plain, watched = (update(f, scene, scene[4]) for f in (UnscentedKalman(), CommonModeMonitor(state=9)))
    for a, b in zip(plain, watched, strict=True):
        np.testing.assert_array_equal(a, b)


def test_after_a_switch_position_and_velocity_are_as_without_it(scene):
    """The bias is given up, the other states keep what they know."""
    z = scene[4].copy()
    z[2] += 2500.0
    watched = update(CommonModeMonitor(state=9), scene, z)
    quiet = update(UnscentedKalman(), scene, scene[4])
    np.testing.assert_array_equal(watched.mean[[0, 1, 3]], quiet.mean[[0, 1, 3]])
    moved = np.abs(watched.mean[2] - quiet.mean[2])
    assert moved[9] == pytest.approx(2500.0, abs=1.0)
    assert moved[:3].max() < 5.0 and moved[3:6].max() < 1.0
    naive = update(UnscentedKalman(), scene, z)
    assert np.abs(naive.mean[2] - quiet.mean[2])[3:6].max() > 5.0  # what happens without the monitor


def test_a_sample_in_which_some_rows_have_switched_is_left_out(scene):
    z = scene[4].copy()
    z[1, :7] += 2500.0
    z[3, 4] += 2500.0
    watched = update(CommonModeMonitor(state=9), scene, z)
    _, _, mean, covariance, _ = scene
    for i in (1, 3):
        np.testing.assert_allclose(watched.mean[i], mean[i])
        np.testing.assert_allclose(watched.covariance[i], covariance[i], atol=1e-12)
        assert watched.nis_dof[i] == 0 and np.isnan(watched.nis[i])
    assert watched.nis_dof[0] == watched.nis_dof[2] == 8


def test_staging_is_no_switch(scene):
    """A velocity that is off by a sample's worth of 50 m/s^2 shows in the plain NIS, not in g, and passes the gate."""
    model, stations, mean, covariance, z = scene
    jumped = mean + np.array([0, 0, 0, 2.5, 0, 0, 0, 0, 0, 0])
    tight = covariance.copy()
    tight[:, 3:6, 3:6] *= 1e-4
    tight[:, 9, 9] = 1.0
    g, n, _ = statistics(model, stations, jumped, tight, z)
    assert np.all(g < 100) and np.all(n < 1e6) and np.all(n > 100)


@pytest.mark.parametrize("name", ["switch", "gate", "reset_sigma"])
def test_what_is_not_allowed(name):
    with pytest.raises(ValueError, match=name):
        CommonModeMonitor(**{name: 0.0})
