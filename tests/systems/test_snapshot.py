"""Snapshot least squares and the start that uses it."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_state
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.snapshot import (
    snapshot_fix,
    starts_around,
    under_ground,
    under_ground_level,
)
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.snapshot_start import SnapshotStart

SIGMA = 40.0 / SPEED_OF_LIGHT  # s, of one difference
TDOA = Tdoa(SIGMA, (1, 2, 3, 4), correlated=True)
MODEL = Stack([TDOA, Altitude(150.0)])
R = MODEL.noise_covariance()


def scene(seed, trials):
    """Targets at 3 to 12 km above stations that are scattered over 200 km."""
    rng = np.random.default_rng(seed)

    def states(shape, lowest, highest):
        latitude, longitude = rng.uniform(47, 49, shape), rng.uniform(8, 11, shape)
        return geodetic_state(
            np.radians(latitude), np.radians(longitude), rng.uniform(lowest, highest, shape), 0.0, 0.0
        )

    return states((trials,), 3e3, 12e3), states((trials, 5), 200.0, 1500.0), rng


def fix_of(measurement, platforms, noise=R, model=MODEL, **more):
    return snapshot_fix(measurement, platforms, model, noise, starts_around(platforms, measurement[..., -1]), **more)


def distance(fix, target):
    return np.linalg.norm(fix.position - target[..., :3], axis=-1)


def test_exact_measurements_give_the_place():
    target, platforms, _ = scene(1, 400)
    fix = fix_of(MODEL.predict(target, platforms), platforms)
    # 1e-4 standard deviations is where the iteration stops
    assert np.all(distance(fix, target) <= 1e-3 * np.sqrt(np.trace(fix.covariance, axis1=1, axis2=2)))
    assert np.all(fix.cost < 1e-6) and np.all(fix.dof == 2)


def test_one_start_is_not_enough():
    target, platforms, _ = scene(2, 2000)
    measurement = MODEL.predict(target, platforms)
    starts = starts_around(platforms, measurement[:, -1])
    missed = [
        np.count_nonzero(~(distance(snapshot_fix(measurement, platforms, MODEL, R, starts[:, [k]]), target) < 100))
        for k in range(starts.shape[1])
    ]
    assert min(missed) >= 3  # 8 of 2000 from the middle, some 80 from each place on the circle
    assert np.all(distance(fix_of(measurement, platforms), target) < 100)


def test_it_is_least_squares_on_arrival_times_with_an_unknown_time_of_emission():
    target, platforms, rng = scene(3, 8)
    s = SIGMA / np.sqrt(2)
    arrivals = np.linalg.norm(target[:, None, :3] - platforms[..., :3], axis=-1) / SPEED_OF_LIGHT
    arrivals += s * rng.normal(size=arrivals.shape) + 0.3
    altitude = ecef_to_geodetic(target[:, :3])[2] + 150 * rng.normal(size=8)
    fixes = {}
    for reference in (0, 3):
        others = [i for i in range(5) if i != reference]
        model = Stack([Tdoa(SIGMA, others, reference, correlated=True), Altitude(150.0)])
        rows = np.concatenate([arrivals[:, others] - arrivals[:, [reference]], altitude[:, None]], axis=1)
        fixes[reference] = fix_of(rows, platforms, model.noise_covariance(), model)
    for i in range(8):

        def misfit(x, i=i):
            ranges = np.linalg.norm(platforms[i, :, :3] - x[:3] * 1e6, axis=-1)
            late = (arrivals[i] - 0.3) * SPEED_OF_LIGHT - ranges - x[3] * 1e3
            return np.append(late / (s * SPEED_OF_LIGHT), (altitude[i] - ecef_to_geodetic(x[:3] * 1e6)[2]) / 150)

        begin = np.append(target[i, :3] / 1e6, 0.0)
        oracle = least_squares(misfit, begin, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        for fix in fixes.values():
            # metres of 6e6: SciPy's finite differences are good to 1e-9 relative
            np.testing.assert_allclose(fix.position[i], oracle.x[:3] * 1e6, atol=0.05)
            np.testing.assert_allclose(fix.cost[i], 2 * oracle.cost, rtol=1e-4)


def test_covariance_and_cost_are_right():
    target, platforms, rng = scene(4, 1)
    target, platforms = np.tile(target, (4000, 1)), np.tile(platforms, (4000, 1, 1))
    noisy = MODEL.predict(target, platforms) + np.einsum("ij,tj->ti", np.linalg.cholesky(R), rng.normal(size=(4000, 5)))
    fix = fix_of(noisy, platforms)
    error = fix.position - target[:, :3]
    nees = np.einsum("ti,tij,tj->t", error, np.linalg.inv(fix.covariance), error)
    # chi-square means 3 and 2; 4 standard deviations of the mean of 4000 are 0.15 and 0.13
    assert abs(nees.mean() - 3) < 0.16
    assert abs(fix.cost.mean() - 2) < 0.13
    assert np.linalg.eigvalsh(fix.covariance).min() > 0


def test_rows_and_trials_that_are_missing():
    target, platforms, rng = scene(5, 6)
    measurement = MODEL.predict(target, platforms)
    measurement[:, :4] += SIGMA * rng.normal(size=(6, 4))
    whole = fix_of(measurement, platforms)
    holed, absent = measurement.copy(), platforms.copy()
    holed[1, 2] = np.nan  # a row
    absent[2, 2] = np.nan  # a receiver: its row goes with it
    holed[3] = np.nan  # everything
    holed[4, 1:4] = np.nan  # two rows are left
    with np.errstate(all="raise"):
        got = fix_of(holed, absent)
    for trial, gone in ((1, 3), (2, 2)):
        kept = [i for i in range(1, 5) if i != gone]
        model = Stack([Tdoa(SIGMA, kept, correlated=True), Altitude(150.0)])
        rows = measurement[[trial]][:, [*(i - 1 for i in kept), 4]]
        want = fix_of(rows, platforms[[trial]], model.noise_covariance(), model)
        # the starts differ where a receiver is unknown: equal to the stop tolerance
        np.testing.assert_allclose(
            got.position[trial], want.position[0], atol=1e-3 * np.sqrt(np.trace(want.covariance[0]))
        )
        assert got.dof[trial] == 1
    for trial in (3, 4):
        assert np.isnan(got.position[trial]).all() and np.isnan(got.covariance[trial]).all()
        assert np.isnan(got.cost[trial])
    for trial in (0, 5):
        for part, same in zip(got, whole, strict=True):
            np.testing.assert_array_equal(part[trial], same[trial])


def test_a_trial_alone_is_the_trial_in_a_batch():
    target, platforms, rng = scene(6, 100)
    measurement = MODEL.predict(target, platforms) + np.sqrt(np.diagonal(R)) * rng.normal(size=(100, 5))
    batch = fix_of(measurement, platforms)
    for trial in (0, 37, 99):
        alone = fix_of(measurement[[trial]], platforms[[trial]])
        # the stop is the same step of the same iteration; BLAS may round differently
        np.testing.assert_allclose(alone.position[0], batch.position[trial], rtol=0, atol=1e-6)


def test_places_that_the_rows_do_not_determine():
    target, platforms, _ = scene(7, 1)
    together = platforms.copy()
    together[:, 1:] = platforms[:, 1:2]  # four receivers in one place: two equations for three unknowns
    fix = fix_of(MODEL.predict(target, together), together)
    assert np.isnan(fix.position).all() and np.isnan(fix.cost).all()


def test_leading_axes_broadcast():
    target, platforms, _ = scene(8, 3)
    measurement = MODEL.predict(target, platforms)
    rows = np.where(np.eye(5, dtype=bool)[:2], np.nan, measurement[:, None])
    fix = snapshot_fix(
        rows, platforms[:, None], MODEL, np.stack([R, 2 * R]), starts_around(platforms, measurement[:, -1])[:, None]
    )
    assert fix.position.shape == (3, 2, 3) and fix.covariance.shape == (3, 2, 3, 3) and fix.cost.shape == (3, 2)
    assert np.all(np.linalg.norm(fix.position - target[:, None, :3], axis=-1) < 1.0)


def test_with_a_prior_it_is_the_iterated_filter():
    target, platforms, rng = scene(9, 50)
    covariance = np.tile(np.diag([300.0**2, 500.0**2, 200.0**2, 1.0, 1.0, 1.0]), (50, 1, 1))
    mean = target + np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * rng.normal(size=(50, 6))
    measurement = MODEL.predict(target, platforms) + np.sqrt(np.diagonal(R)) * rng.normal(size=(50, 5))
    mean[7], covariance[8, 0, 0] = np.nan, np.nan
    prior = mean[:, :3], covariance[:, :3, :3]
    fix = snapshot_fix(measurement, platforms, MODEL, R, target[:, None, :3], prior)
    assert np.all(fix.dof == np.where(np.isin(np.arange(50), (7, 8)), 2, 5))
    known = fix.dof == 5
    want = IteratedExtendedKalman(50, 1e-6).update(
        mean[known], covariance[known], Observation(measurement[known], platforms[known], Whitener(R)), MODEL
    )
    # 1e-4 standard deviations of some 20 m
    np.testing.assert_allclose(fix.position[known], want.mean[:, :3], atol=0.02)
    np.testing.assert_allclose(fix.covariance[known], want.covariance[:, :3, :3], rtol=1e-2, atol=1.0)
    alone = fix_of(measurement[[7]], platforms[[7]])
    np.testing.assert_allclose(fix.position[7], alone.position[0], atol=0.02)


def test_starts_lie_above_and_around_the_platforms():
    _, platforms, _ = scene(10, 2)
    platforms[1, 3:] = np.nan
    starts = starts_around(platforms, np.array([9e3, 4e3]), directions=4)
    assert starts.shape == (2, 5, 3)
    np.testing.assert_allclose(ecef_to_geodetic(starts)[2], [[9e3] * 5, [4e3] * 5], atol=1e-6)
    middle = platforms[1, :3, :3].mean(axis=0)
    reach = np.linalg.norm(platforms[1, :3, :3] - middle, axis=-1).max()
    # the circle is drawn in the tangent plane, and lifted: a few kilometres in a hundred
    np.testing.assert_allclose(np.linalg.norm(starts[1, 1:] - starts[1, 0], axis=-1), reach, rtol=0.03)
    assert np.isnan(starts_around(np.full((1, 3, 6), np.nan), np.zeros(1))).all()


# ----------------------------------------------------------------------------------------------------- start


def test_an_image_below_the_ground_counts_only_where_nothing_else_does():
    """Stations that stand within 300 m of a plane: the image of an aircraft costs as little as the aircraft itself."""
    target, _, rng = scene(17, 400)
    lat, lon = np.radians([48.0, 47.5, 48.5, 48.1, 47.9]), np.radians([9.5, 9.0, 9.2, 10.3, 8.6])
    platforms = geodetic_state(lat, lon, np.array([250.0, 220.0, 520.0, 290.0, 230.0]), 0.0, 0.0)
    noise = TDOA.noise_covariance()
    measurement = TDOA.predict(target, platforms) + rng.multivariate_normal(np.zeros(4), noise, 400)
    starts = starts_around(platforms, np.zeros(400))
    free, chosen = (snapshot_fix(measurement, platforms, TDOA, noise, starts, buried=b) for b in (None, under_ground))
    below, now = ecef_to_geodetic(free.position)[2] < -500, ecef_to_geodetic(chosen.position)[2]
    # a coin is tossed: far from none of the 400 are buried, and their errors are of kilometres
    assert np.count_nonzero(below) > 60 and np.count_nonzero(now < -500) < 12
    kept = ~below & np.isfinite(free.cost)
    np.testing.assert_array_equal(chosen.position[kept], free.position[kept])
    # all starts under the ground end there: a place that nothing else can be in is still told
    only = snapshot_fix(measurement[below], platforms, TDOA, noise, free.position[below, None, :], buried=under_ground)
    assert np.all(ecef_to_geodetic(only.position)[2] < -500)


def test_level_axes_have_a_ground_too():
    platforms = np.array([[0, 0, 5.0], [9e3, 0, 120], [0, 9e3, -700], [np.nan] * 3])
    places = np.array([[0, 0, -600.0], [0, 0, -1100], [0, 0, -1300], [np.nan] * 3])
    # below the lowest of them, the one at -700 m, by more than 500 m
    assert under_ground_level(places, platforms).tolist() == [False, False, True, False]
    assert under_ground_level(places, platforms[:2]).tolist() == [True, True, True, False]


def test_start_is_the_fix_with_an_unknown_velocity():
    target, platforms, rng = scene(11, 5)
    measurement = MODEL.predict(target, platforms) + np.sqrt(np.diagonal(R)) * rng.normal(size=(5, 5))
    measurement[2] = np.nan
    stream = ["other", *MODEL.names]
    start = SnapshotStart(MODEL, stream, 200.0, "altitude")
    assert start.uses_measurement and not start.inputs
    mean, covariance = start.begin(np.concatenate([np.ones((5, 1)), measurement], axis=1), platforms, {})
    want = fix_of(measurement, platforms)
    np.testing.assert_array_equal(mean[:, :3], want.position)
    np.testing.assert_array_equal(covariance[:, :3, :3], want.covariance)
    assert np.isnan(mean[2]).all() and np.isnan(covariance[2]).all()
    good = [0, 1, 3, 4]
    assert np.all(mean[good, 3:] == 0) and np.all(covariance[good, :3, 3:] == 0)
    np.testing.assert_array_equal(covariance[good, 3:, 3:], np.tile(4e4 * np.eye(3), (4, 1, 1)))


def test_start_takes_r_from_the_port_and_a_height_by_value():
    target, platforms, rng = scene(12, 3)
    measurement = MODEL.predict(target, platforms) + np.sqrt(np.diagonal(R)) * rng.normal(size=(3, 5))
    noise = np.array([1.0, 4.0, 9.0])[:, None, None] * R
    start = SnapshotStart(MODEL, MODEL.names, 200.0, 5e3, noise_port=True)
    assert start.inputs == {"start_noise_covariance": 25}
    mean, covariance = start.begin(measurement, platforms, {"start_noise_covariance": noise.reshape(3, 25)})
    plain = fix_of(measurement, platforms)
    # R times a number moves nothing and multiplies P
    np.testing.assert_allclose(mean[:, :3], plain.position, atol=0.1)
    np.testing.assert_allclose(covariance[1, :3, :3], 4 * plain.covariance[1], rtol=1e-2, atol=1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((MODEL, ["tdoa_10"], 200.0), "not measured"),
        ((MODEL, MODEL.names, 0.0), "sigma_velocity"),
        ((TDOA, TDOA.names, 200.0, "altitude"), "not measured"),
    ],
)
def test_start_checks_its_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        SnapshotStart(*arguments)
