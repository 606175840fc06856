"""Sample clocks that drift: TDOA that FDOA does not explain."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.systems.ambiguity.clock_drift import ClockDrift, clock_drift

CARRIER, SIGMA, SPREAD = 400e6, 20e-9, 2.0


def scene(rng, drift, count=60, moving=True):
    t = np.sort(rng.uniform(0, 30, count))
    bend = (2e-9, 3e-9) if moving else (0.0, 0.0)  # 0.6 m/s, and 0.9 m/s^2, of range difference
    true = 3e-6 + bend[0] * t + 0.5 * bend[1] * t**2
    rate = bend[0] + bend[1] * t
    tdoa = true + drift * t + SIGMA * rng.standard_normal(count)
    fdoa = -CARRIER * rate + SPREAD * rng.standard_normal(count)
    return t, tdoa, np.full(count, SIGMA), fdoa, np.full(count, SPREAD)


@pytest.mark.parametrize("drift", [0.0, 1e-6, -3e-9])
def test_the_drift_and_its_sigma(drift):
    """400 draws: unbiased, and the errors over their sigmas have a standard deviation of 1 (10 %: 2.8 of its own)."""
    rng = np.random.default_rng(4)
    found = [clock_drift(*scene(rng, drift), CARRIER) for _ in range(400)]
    score = np.array([(one.rate - drift) / one.sigma for one in found])
    assert abs(score.mean()) < 0.15 and abs(score.std() - 1) < 0.1
    assert np.median([one.sigma for one in found]) < 1e-9


def test_motion_is_no_drift_only_where_fdoa_says_so():
    rng = np.random.default_rng(5)
    t, tdoa, sigma, *_ = scene(rng, 0.0)
    blind = clock_drift(t, tdoa, sigma)
    assert blind.rate > 5 * blind.sigma
    still = clock_drift(*scene(rng, 0.0, moving=False)[:3])
    assert abs(still.rate) < 4 * still.sigma and still.sigma < 0.6e-9


def test_larger_scatter_and_outliers():
    """Scatter three times as large as believed makes sigma so; one wild value is left out."""
    rng = np.random.default_rng(6)
    t, tdoa, sigma, fdoa, spread = scene(rng, 1e-6, moving=False)
    plain = clock_drift(t, tdoa, sigma, fdoa, spread, CARRIER)
    loud = clock_drift(t, tdoa, sigma / 3, fdoa, spread / 3, CARRIER)
    assert_allclose(loud.sigma, plain.sigma, rtol=0.2)
    tdoa[7] += 1e-3
    tdoa[8] = np.nan
    wild = clock_drift(t, tdoa, sigma, fdoa, spread, CARRIER)
    assert_allclose(wild.rate, 1e-6, atol=5 * wild.sigma)
    assert wild.sigma < 1.5 * plain.sigma


def test_too_few_are_nothing():
    few = np.arange(3.0)
    assert np.isnan(clock_drift(few, few, few + 1).rate)
    assert np.isnan(clock_drift(np.zeros(9), np.zeros(9), np.ones(9)).sigma)


def test_what_is_taken_away_is_in_all_errors():
    """Of a line fitted to equal errors the value at its beginning has four times the variance of the mean."""
    t = np.linspace(0, 1, 1000)
    sigma = np.full(1000, 2.0)
    drift = ClockDrift(0.0, 2.0 * np.sqrt(12 / 1000))
    assert_allclose(drift.inflation(t, sigma), 2.0, rtol=2e-3)
    assert drift.inflation(t, np.full(1000, np.nan)) == 1.0
