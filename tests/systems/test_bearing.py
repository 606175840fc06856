"""Bearings, their modified gain, crossings and fits, without a diagram."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

from quietfix.systems.angles.bearing import Bearing, from_compass, to_compass
from quietfix.systems.estimators.range_parameterised import intervals
from quietfix.systems.fixes.bearing_likelihood import BearingHistory, QuadraticPrior, fold, maximum_likelihood
from quietfix.systems.fixes.crossing import Lines, crossing, crossing_covariance, crossing_sigma, instrumental_variable
from quietfix.systems.fixes.von_mises import concentration, robust_fix, von_mises_fix
from quietfix.systems.starts.bearing_start import BearingStart
from quietfix.systems.trajectories.waypoints import WaypointPath

DEGREE = np.radians(1.0)
TARGET = np.array([10e3, 50e3])
TRACK = np.stack([600 / 3.6 * np.arange(1001.0), np.zeros(1001)], axis=-1)


def bearings(trials=200, sigma=2.0, track=TRACK, seed=5):
    offset = TARGET - track
    noise = np.random.default_rng(seed).standard_normal((trials, len(track)))
    return np.arctan2(offset[:, 1], offset[:, 0]) + sigma * DEGREE * noise


def test_compass_is_clockwise_from_north():
    np.testing.assert_allclose(from_compass(np.array([0.0, 90.0, 180.0, 45.0])) / DEGREE, [90, 0, -90, 45], atol=1e-12)
    np.testing.assert_allclose(
        to_compass(from_compass(np.arange(0.0, 360.0, 7.0))), np.arange(0.0, 360.0, 7.0), atol=1e-9
    )


def test_under_the_observer_there_is_no_azimuth():
    model = Bearing(2 * DEGREE, DEGREE)
    value, jacobian = model.linearize(np.array([[3.0, 4.0, 0.0], [30.0, 4.0, 0.0]]), np.array([[[3.0, 4.0, 5.0]]]))
    assert np.isnan(value[0, 0]) and not np.isfinite(jacobian[0]).all()
    assert np.isfinite(value[1]).all() and np.isfinite(jacobian[1]).all()


@pytest.mark.parametrize("model", [Bearing(0.1), Bearing(0.1, 0.1)], ids=["azimuth", "and elevation"])
def test_modified_gain_is_exact(model):
    """h(x) - h(x_hat) = g(z, x_hat) (x - x_hat) for a noise-free z = h(x), however far x_hat is; that is its point."""
    rng = np.random.default_rng(1)
    truth, guess = rng.uniform(-50e3, 50e3, (2, 500, 6))
    platform = rng.uniform(-50e3, 50e3, (1, 1, 6))
    measured = model.predict(truth, platform)
    left = model.residual(measured, model.predict(guess, platform))
    right = np.einsum("...mn,...n->...m", model.modified_gain(measured, guess, platform), truth - guess)
    # beyond a right angle between plane and bearing the elevation runs over the pole
    turned = np.abs(left[:, 0]) < np.pi / 2
    np.testing.assert_allclose(right[:, 0], left[:, 0], rtol=1e-9)
    np.testing.assert_allclose(right[turned], left[turned], rtol=1e-7, atol=1e-9)
    # and at the measurement of the guess itself it is the Jacobian
    own = model.modified_gain(model.predict(guess, platform), guess, platform)
    np.testing.assert_allclose(own, model.jacobian(guess, platform), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("turn", np.arange(0, 360, 15.0))
def test_crossing_has_no_special_direction(turn):
    c, s = np.cos(turn * DEGREE), np.sin(turn * DEGREE)
    rotation = np.array([[c, -s], [s, c]])
    a, b, x = (rotation @ p for p in ([1e3, -2e3], [21e3, 5e3], [10e3, 50e3]))
    azimuths = [np.arctan2(*(x - p)[::-1]) for p in (a, b)]
    np.testing.assert_allclose(crossing(a, azimuths[0], b, azimuths[1]), x, rtol=1e-12, atol=1e-7)


def test_what_does_not_cross_is_nan_in_its_trial_alone():
    a, b = np.zeros((4, 2)), np.array([[1e3, 0.0], [1e3, 0.0], [0.0, 0.0], [1e3, 0.0]])
    first, second = np.array([1.0, 1.0, 1.0, np.nan]), np.array([2.0, 1.0, 2.0, 2.0])
    x = crossing(a, first, b, second)
    assert np.isfinite(x[0]).all() and np.isnan(x[1:]).all()
    lines = Lines.none((2,)).add(np.zeros(2), np.array([1.0, 1.0]), 1e-3)
    lines = lines.add(np.array([1e3, 0.0]), np.array([1.0, 2.0]), 1e-3)
    assert np.isnan(lines.fix()[0][0]).all() and np.isfinite(lines.fix()[0][1]).all()


def test_formula_3_is_the_trace_and_the_derivative():
    """The three forms of (3): ranges, base and angles, and the linearised covariance; then Monte Carlo at 0.1 deg."""
    a, b, sigma, sigma_xy = np.zeros(2), np.array([30e3, 0.0]), 0.1 * DEGREE, 20.0
    formula = crossing_sigma(a, b, TARGET, sigma, sigma_xy)
    covariance = crossing_covariance(TARGET, a, b, sigma**2, sigma**2, sigma_xy)
    assert np.sqrt(np.trace(covariance)) == pytest.approx(formula, rel=1e-12)
    angle_a = np.arctan2(TARGET[1], TARGET[0])
    angle_b = np.pi - np.arctan2(TARGET[1], TARGET[0] - 30e3)
    sine = np.sin(angle_a + angle_b)
    paper = 30e3**2 * sigma**2 * (np.sin(angle_a) ** 2 + np.sin(angle_b) ** 2) / sine**2 + 2 * sigma_xy**2
    assert np.sqrt(paper) / sine == pytest.approx(formula, rel=1e-12)

    rng, n = np.random.default_rng(0), 40_000
    places = [p + sigma_xy * rng.standard_normal((n, 2)) for p in (a, b)]
    angles = [np.arctan2(*(TARGET - p)[::-1]) + sigma * rng.standard_normal(n) for p in (a, b)]
    # the crossing is computed from where the observer believes to be
    error = crossing(places[0], angles[0], places[1], angles[1]) - TARGET
    # 40 000 trials: 0.4 % per standard deviation; the linearisation is good to 0.3 % at 0.1 deg
    assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) == pytest.approx(formula, rel=0.015)


@pytest.mark.parametrize(
    ("seconds", "formula", "low", "high"), [(200, 4.43, 0.97, 1.06), (800, 5.07, 0.97, 1.04), (60, 12.73, 1.2, 3.0)]
)
def test_formula_3_at_two_degrees(seconds, formula, low, high):
    """Good to 3 % above 35 deg of crossing angle (200 s: 32 deg); at 11 deg tails are heavy. Reference, section 1."""
    b = TRACK[seconds]
    predicted = crossing_sigma(TRACK[0], b, TARGET, 2 * DEGREE, 100.0)
    assert predicted / 1e3 == pytest.approx(formula, abs=0.01)
    rng, n = np.random.default_rng(2), 100_000
    places = [p + 100.0 * rng.standard_normal((n, 2)) for p in (TRACK[0], b)]
    angles = [np.arctan2(*(TARGET - p)[::-1]) + 2 * DEGREE * rng.standard_normal(n) for p in (TRACK[0], b)]
    error = np.linalg.norm(crossing(places[0], angles[0], places[1], angles[1]) - TARGET, axis=-1)
    assert low < np.sqrt(np.mean(np.minimum(error, 300e3) ** 2)) / predicted < high


def test_lines_are_the_least_squares_point():
    azimuth = bearings(3)
    lines = Lines.none((3,))
    for k in range(0, 1001, 10):
        lines = lines.add(TRACK[k], azimuth[:, k], 1e-3)
    n = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=-1)[:, ::10]
    for i in range(3):
        expected = np.linalg.lstsq(n[i], np.einsum("kj,kj->k", n[i], TRACK[::10]), rcond=None)[0]
        np.testing.assert_allclose(lines.fix()[0][i], expected, rtol=1e-9)
        # the covariance from the sums equals the one with the ranges written out
        r2 = np.sum((expected - TRACK[::10]) ** 2, axis=-1)
        a = np.linalg.inv(n[i].T @ n[i])
        np.testing.assert_allclose(lines.fix()[1][i], a @ (n[i].T * (r2 * 1e-3)) @ n[i] @ a, rtol=1e-6)
    np.testing.assert_array_equal(Lines.unflatten(lines.flatten()).moment, lines.moment)


def test_maximum_likelihood_is_what_scipy_finds():
    azimuth, model = bearings(4)[:, ::20], Bearing(2 * DEGREE)
    history = BearingHistory.of(azimuth[..., None], TRACK[None, ::20])
    fit = maximum_likelihood(history, model, np.tile([20e3, 30e3], (4, 1)), converged=1e-9)
    for i in range(4):

        def cost(p, i=i):
            off = p * 1e3 - TRACK[::20]
            return np.sum((azimuth[i] - np.arctan2(off[:, 1], off[:, 0])) ** 2) / (2 * model.sigma**2)

        best = minimize(cost, TARGET / 1e3, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10})
        # the cost is flat: 1e-9 of it is 1e-4 standard deviations, 0.1 m
        np.testing.assert_allclose(fit.state[i], best.x * 1e3, atol=0.5)
        assert fit.cost[i] == pytest.approx(best.fun, rel=1e-8)


def test_maximum_likelihood_reaches_the_bound_and_its_covariance_is_right():
    azimuth, model = bearings(400), Bearing(2 * DEGREE)
    rows = slice(0, 1001, 10)
    history = BearingHistory.of(azimuth[:, rows, None], TRACK[None, rows])
    fit = maximum_likelihood(history, model, np.tile([20e3, 30e3], (400, 1)))
    jacobian = model.jacobian(TARGET, TRACK[rows, None])[:, 0]
    bound = np.linalg.inv(jacobian.T @ jacobian / model.sigma**2)
    error = fit.state - TARGET
    # 400 trials of two components: 3.5 % per standard deviation
    assert np.sqrt(np.mean(np.sum(error**2, axis=-1)) / np.trace(bound)) == pytest.approx(1.0, abs=0.12)
    nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(fit.covariance), error)
    assert chi2.ppf(0.001, 800) < nees.sum() < chi2.ppf(0.999, 800)
    lines = Lines.none((400,))
    for k in range(0, 1001, 10):
        lines = lines.add(TRACK[k], azimuth[:, k], model.sigma**2)
    start = lines.fix()[0]
    iv = instrumental_variable(azimuth[:, rows], model.sigma**2, TRACK[None, rows], start)[0]
    biased, unbiased = np.linalg.norm(np.mean(start - TARGET, axis=0)), np.linalg.norm(np.mean(iv - TARGET, axis=0))
    assert unbiased < 0.35 * biased  # least squares is nearly all bias here, the instruments take it away


def test_missing_bearings_are_no_bearings():
    azimuth, model = bearings(2)[:, ::10], Bearing(2 * DEGREE)
    track = TRACK[::10]
    azimuth[0, 20:60] = np.nan
    kept = np.r_[0:20, 60:101]
    guess = np.tile([20e3, 30e3], (2, 1))
    whole = maximum_likelihood(BearingHistory.of(azimuth[..., None], track[None]), model, guess)
    alone = maximum_likelihood(BearingHistory.of(azimuth[:1, kept, None], track[None, kept]), model, guess[:1])
    np.testing.assert_allclose(whole.state[0], alone.state[0], rtol=1e-10)
    np.testing.assert_allclose(whole.covariance[0], alone.covariance[0], rtol=1e-9)
    place = instrumental_variable(azimuth, model.sigma**2, track[None], alone.state[0] * np.ones((2, 1)))
    short = instrumental_variable(azimuth[:1, kept], model.sigma**2, track[None, kept], alone.state)
    np.testing.assert_allclose(place[0][0], short[0][0], rtol=1e-10)
    np.testing.assert_allclose(place[1][0], short[1][0], rtol=1e-9)


def test_folding_bearings_into_a_prior_loses_little():
    azimuth, model = bearings(50), Bearing(2 * DEGREE)
    whole = maximum_likelihood(
        BearingHistory.of(azimuth[..., None], TRACK[None]), model, np.tile(TARGET, (50, 1)), converged=1e-9
    )
    early = maximum_likelihood(
        BearingHistory.of(azimuth[:, :500, None], TRACK[None, :500]), model, np.tile(TARGET, (50, 1)), converged=1e-9
    )
    nothing = QuadraticPrior(np.tile([20e3, 30e3], (50, 1)), np.zeros((50, 2)), np.zeros((50, 2, 2)))
    old = BearingHistory.of(azimuth[:, :500, None], TRACK[None, :500])
    prior = fold(nothing, early.state, old, model)
    both = maximum_likelihood(
        BearingHistory.of(azimuth[:, 500:, None], TRACK[None, 500:]), model, early.state, prior, converged=1e-9
    )
    sigma = np.sqrt(np.trace(whole.covariance, axis1=-2, axis2=-1))
    # linearised within 0.3 km at 40 km: second order in 0.7 %, times a hundred of its own standard deviations
    assert np.all(np.linalg.norm(both.state - whole.state, axis=-1) < 0.05 * sigma)


def test_start_from_one_bearing():
    model = Bearing(2 * DEGREE)
    start = BearingStart(model, model.names, 4, 60e3, 30e3, 15.0)
    mean, covariance = start.begin(np.array([[np.pi / 2], [np.nan]]), np.array([[[1e3, 2e3, 0, 0, 0, 0]]]), {})
    np.testing.assert_allclose(mean[0], [1e3, 62e3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(np.diag(covariance[0]), [(60e3**2 + 30e3**2) * model.sigma**2, 30e3**2, 225, 225])
    assert np.isnan(mean[1]).all()
    middle, sigma = intervals(5e3, 150e3, 8)
    np.testing.assert_allclose(sigma / middle, (sigma / middle)[0])  # one coefficient of variation for all
    with pytest.raises(ValueError, match="3 states"):
        BearingStart(model, model.names, 3, 60e3, 30e3)


LENTH = np.array(
    [
        (9, 3.2, 234), (9.4, 5.5, 215), (9.95, 9.05, 196), (8.7, 8.7, 193),
        (8.07, 9.7, 188), (5.6, 9, 250), (4.4, 8.9, 160), (1.85, 5.25, 118),
    ]
)  # fmt: skip


def test_lenths_published_example():
    """Lenth (1981): towers, bearings, and what he found; three digits are printed."""
    place, azimuth = LENTH[:, :2], from_compass(LENTH[:, 2])
    without = np.delete(np.arange(8), 5)
    fix = von_mises_fix(place[without], azimuth[without])
    np.testing.assert_allclose(fix.position, [7.23, 1.98], atol=0.02)
    sigma = np.sqrt(np.diag(fix.covariance))
    np.testing.assert_allclose(sigma, 0.156, atol=0.01)
    assert fix.covariance[0, 1] / sigma.prod() == pytest.approx(0.66, abs=0.02)
    np.testing.assert_allclose(von_mises_fix(place, azimuth).position, [5.87, 1.13], atol=0.02)
    robust = robust_fix(place, azimuth)
    assert np.linalg.norm(robust.position - [7.21, 1.97]) < 0.15
    assert robust.weights[5] == 0 and np.delete(robust.weights, 5).min() > 0.7
    assert concentration(0.0) == 0.0 and concentration(0.9) == pytest.approx(5.305, abs=0.01)


def test_waypoint_path():
    path = WaypointPath([[0, 0], [50e3, 0], [50e3, 60e3], [0, 60e3]], 160.0, 3 * DEGREE, height=8e3)
    t = np.linspace(0.0, 1000.0, 200_001)
    state = path.at(t)
    np.testing.assert_allclose(np.linalg.norm(state[:, 3:], axis=-1), 160.0, rtol=1e-12)
    # velocity is the derivative of position everywhere, also where a turn begins: central differences at 5 ms
    numeric = np.gradient(state[:, :3], t, axis=0)[1:-1]
    assert np.abs(numeric - state[1:-1, 3:]).max() < 0.05  # 160 m/s times 3 deg/s times half a step of 5 ms
    turning = np.diff(np.arctan2(state[:, 4], state[:, 3])) > 1e-9
    assert turning.sum() * 0.005 == pytest.approx(2 * 30.0, abs=0.02)  # twice 90 deg at 3 deg/s
    np.testing.assert_allclose(path.at(0.0)[:3], [0, 0, 8e3])
    assert path.at(600.0)[0] == pytest.approx(50e3) and path.at(600.0)[3] == pytest.approx(0.0, abs=1e-9)
    for points, words in (
        ([[0, 0], [0, 0]], "equal"),
        ([[0, 0]], "at least two"),
        ([[0, 0], [9e3, 0], [9e3, 1e3]], "short"),
    ):
        with pytest.raises(ValueError, match=words):
            WaypointPath(points, 160.0, 3 * DEGREE)
