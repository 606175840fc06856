from itertools import pairwise

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.library.models.three_satellite import satellite_states, target_state
from quietfix.diagrams.statistics.bounds import BoundSums, StudyBounds, bound_squares
from quietfix.diagrams.statistics.posterior_bound import posterior_bound
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.counting import counting
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import course_speed, geodetic_state, up
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories.great_circle import straight_line


class Linear(MeasurementModel):
    """z = H x with correlated noise."""

    def __init__(self, rows, covariance):
        self.rows, self.covariance = np.array(rows, dtype=float), np.array(covariance, dtype=float)
        self.names = tuple(f"row_{i}" for i in range(len(self.rows)))
        self.units = ("m",) * len(self.rows)

    def predict(self, target, platforms):
        return np.einsum("mi,...i->...m", self.rows, target)

    def jacobian(self, target, platforms):
        return np.broadcast_to(self.rows, (*target.shape[:-1], *self.rows.shape))

    def noise_covariance(self):
        return self.covariance


def bound_curves(covariance, truth):
    """Square root of the mean over the trials (trials, time, n, n), by quantity."""
    sums = BoundSums(covariance.shape[1])
    sums.add(np.moveaxis(bound_squares(covariance, truth), 1, -1), covariance.shape[0])
    return {name: curve for name, curve in sums.curves().items() if name != "bias"}


def linear_case(seed=2, rows=3):
    rng = np.random.default_rng(seed)
    spread = rng.standard_normal((rows, rows))
    root = rng.standard_normal((6, 6)) * np.array([100.0] * 3 + [5.0] * 3)[:, None]
    return Linear(rng.standard_normal((rows, 6)), spread @ spread.T + np.eye(rows)), root @ root.T


def textbook(times, model, motion, start, first_epoch_used, keep=None):
    """Kalman's covariance equations in extended precision, one trial, rows `keep[k]` only."""
    p, found = start.astype(np.longdouble), []
    for k in range(len(times)):
        if k > 0:
            phi = motion.transition(np.zeros(6), times[k] - times[k - 1]).astype(np.longdouble)
            p = phi @ p @ phi.T + motion.process_noise(np.zeros(6), times[k] - times[k - 1])
        if k > 0 or not first_epoch_used:
            rows = list(range(model.size)) if keep is None else list(np.flatnonzero(keep[k]))
            # decorrelated, so that rows come one after the other and nothing has to be inverted
            unit = np.linalg.inv(np.linalg.cholesky(model.covariance[np.ix_(rows, rows)])) if rows else None
            for h in unit @ model.rows[rows] if rows else []:
                gain = p @ h
                p = p - np.outer(gain, gain) / (h @ gain + 1)
        found.append(p)
    return np.array(found, dtype=float)


@pytest.mark.parametrize("first_epoch_used", [True, False])
@pytest.mark.parametrize("acceleration", [0.0, 0.3])
def test_linear_bound_is_the_kalman_covariance(first_epoch_used, acceleration):
    model, start = linear_case()
    motion, times = ConstantVelocity(acceleration), np.array([0.0, 1.0, 2.0, 4.5, 5.0, 9.0])
    truth = np.random.default_rng(1).standard_normal((4, 6, 6))
    found = posterior_bound(truth, np.zeros((1, 6, 1, 6)), times, model, motion, start, first_epoch_used)
    assert found.shape == (4, 6, 6, 6)
    expected = textbook(times, model, motion, start, first_epoch_used)
    scale = np.sqrt(np.einsum("kii->ki", expected))
    error = (found - expected) / (scale[:, :, None] * scale[:, None, :])
    assert np.abs(error).max() < 1e-10


def test_rows_that_were_not_measured_do_not_count():
    model, start = linear_case()
    motion, times = ConstantVelocity(0.1), np.arange(8.0)
    present = np.random.default_rng(4).random((3, 8, 3)) < 0.5
    present[0, 3] = False
    found = posterior_bound(
        np.zeros((1, 8, 6)), np.zeros((1, 8, 1, 6)), times, model, motion, start, True, present=present
    )
    for trial in range(3):
        expected = textbook(times, model, motion, start, True, present[trial])
        np.testing.assert_allclose(found[trial], expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


def test_a_prior_of_nearly_rank_one_keeps_its_digits_without_process_noise():
    # 3 km along one line, 1 cm across it: a condition number of 1e11, 200 updates, no process noise
    along = np.array([0.6, -0.48, 0.64])
    start = np.zeros((6, 6))
    start[:3, :3] = 3000.0**2 * np.outer(along, along) + 0.01**2 * np.eye(3)
    start[3:, 3:] = 400.0**2 * np.eye(3)
    model, _ = linear_case(seed=9, rows=2)
    motion, times = ConstantVelocity(0.0), np.arange(200.0)
    found = posterior_bound(np.zeros((1, 200, 6)), np.zeros((1, 200, 1, 6)), times, model, motion, start, True)[0]
    expected = textbook(times, model, motion, start, True)
    scale = np.sqrt(np.einsum("kii->ki", expected))
    # the Cholesky factor of the start itself loses condition number x 1e-16
    assert np.abs((found - expected) / (scale[:, :, None] * scale[:, None, :])).max() < 1e-5
    assert (np.linalg.eigvalsh(found / scale[:, :, None] / scale[:, None, :]) > 0).all()


# --------------------------------------------------------------------------------------------- three satellites


def passing(trials=1, epochs=31, step=5.0, acceleration=0.0, seed=0, side=300.0):
    """Satellites of the packaged scenario, and targets that move by the motion model."""
    scenario = load_scenario("three_satellite", settings=[f"truth.cross_km={side}"])
    times = step * np.arange(epochs)
    orbit = DenseOrbit(satellite_states(scenario), 150.0, name="satellites")
    platforms = inertial_to_earth_fixed(orbit.at(times), times[:, None])[None]
    start = target_state(scenario, orbit)
    if acceleration == 0 and trials == 1:
        return times, straight_line(start, times)[None], platforms
    rng, motion = np.random.default_rng(seed), ConstantVelocity(acceleration)
    state = np.tile(start, (trials, 1))
    state[:, 3:] = 100 * rng.standard_normal((trials, 3))
    states = [state]
    for _ in times[1:]:
        kick = acceleration * rng.standard_normal((trials, 3))
        state = motion.propagate(state, step) + np.concatenate([kick * step**2 / 2, kick * step], axis=-1)
        states.append(state)
    return times, np.stack(states, axis=1), platforms


def six_rows(scale=1.0):
    return Stack(
        [
            Tdoa(scale * 20e-9),
            Fdoa(scale * 1.0, 3e9),
            InterferometerPhase(scale * np.radians(15.0), 3.0, 0.1),
        ]
    )


def test_iterated_filter_reaches_the_bound_where_noise_is_small():
    trials, acceleration = 300, 0.5
    times, truth, platforms = passing(trials, epochs=16, acceleration=acceleration, seed=3)
    model, motion = six_rows(0.1), ConstantVelocity(acceleration)
    start = np.diag([50.0**2] * 3 + [20.0**2] * 3)
    bound = posterior_bound(truth, platforms, times, model, motion, start, True)
    rng, whitener = np.random.default_rng(8), Whitener(model.noise_covariance())
    mean = truth[:, 0] + np.einsum("ij,tj->ti", np.sqrt(start), rng.standard_normal((trials, 6)))
    covariance = np.broadcast_to(start, (trials, 6, 6))
    filter_ = IteratedExtendedKalman()
    for k in range(1, times.size):
        mean, covariance = filter_.predict(mean, covariance, motion, times[k] - times[k - 1])
        noise = model.sigmas * rng.standard_normal((trials, 6))
        measured = model.predict(truth[:, k], platforms[:, k]) + noise
        posterior = filter_.update(mean, covariance, Observation(measured, platforms[:, k], whitener), model)
        mean, covariance = posterior.mean, posterior.covariance
    gap = mean - truth[:, -1]
    # Chi-square with 6 degrees of freedom per trial: mean 6, standard deviation sqrt(12/300) = 0.2; 4 of them.
    statistic = np.einsum("ti,ti->t", gap, np.linalg.solve(bound[:, -1], gap[..., None])[..., 0])
    assert 5.2 < statistic.mean() < 6.8
    ratio = np.sqrt((gap[:, :3] ** 2).sum(-1).mean()) / bound_curves(bound, truth)["position"][-1]
    # one weak direction: a relative standard deviation of 1/sqrt(2 x 300) = 4 %; 4 of them
    assert 0.84 < ratio < 1.16


def test_curves_average_the_covariance_not_the_information():
    times, truth, platforms = passing(5, epochs=4, acceleration=0.5)
    start = np.diag([3e3**2] * 3 + [400.0**2] * 3)
    found = posterior_bound(truth, platforms, times, six_rows(), ConstantVelocity(0.5), start, True)
    curves = bound_curves(found, truth)
    position = np.sqrt(np.mean([[np.trace(p[:3, :3]) for p in trial] for trial in found], axis=0))
    np.testing.assert_allclose(curves["position"], position, rtol=1e-12)
    normal = up(truth[..., :3])
    height = np.sqrt(np.mean((normal[..., None, :] @ found[..., :3, :3] @ normal[..., None])[..., 0, 0], axis=0))
    np.testing.assert_allclose(curves["height"], height, rtol=1e-12)
    velocity = np.sqrt(np.mean(np.trace(found[..., 3:, 3:], axis1=-2, axis2=-1), axis=0))
    np.testing.assert_allclose(curves["velocity"], velocity, rtol=1e-12)


def test_speed_and_course_bounds_are_the_spread_of_small_errors():
    truth = passing(1, epochs=2)[1]
    rng = np.random.default_rng(6)
    root = np.diag([1.0] * 3 + [0.3] * 3) + 0.1 * np.tril(rng.standard_normal((6, 6)))
    covariance = np.broadcast_to(root @ root.T, (1, 2, 6, 6))
    curves = bound_curves(covariance, truth)
    draws = truth[0, 0] + np.einsum("ij,tj->ti", root, rng.standard_normal((20_000, 6)))
    course, speed, _ = course_speed(draws[:, :3], draws[:, 3:])
    # 20 000 draws know a standard deviation to 0.5 %; 4 of them
    assert np.std(speed) == pytest.approx(curves["speed"][0], rel=0.02)
    assert np.degrees(np.std(course)) == pytest.approx(curves["course"][0], rel=0.02)


def test_a_target_at_rest_has_no_course_and_hides_no_other_trial():
    times, truth, platforms = passing(3, epochs=3, acceleration=0.5)
    start = np.diag([3e3**2] * 3 + [400.0**2] * 3)
    found = posterior_bound(truth, platforms, times, six_rows(), ConstantVelocity(0.5), start, True)
    still = truth.copy()
    still[1, :, 3:] = 0
    curves, whole = bound_curves(found, still), bound_curves(found, truth)
    np.testing.assert_array_equal(curves["position"], whole["position"])
    expected = bound_curves(found[[0, 2]], truth[[0, 2]])
    for name in ("speed", "course"):
        np.testing.assert_allclose(curves[name], expected[name], rtol=1e-12)


def test_a_trial_alone_equals_the_same_trial_among_others():
    times, truth, platforms = passing(7, epochs=12, acceleration=0.5)
    start = np.diag([3e3**2] * 3 + [400.0**2] * 3)
    together = posterior_bound(truth, platforms, times, six_rows(), ConstantVelocity(0.5), start, True)
    for trial in (0, 3, 6):
        alone = posterior_bound(truth[[trial]], platforms, times, six_rows(), ConstantVelocity(0.5), start, True)
        np.testing.assert_array_equal(alone[0], together[trial])


def test_missing_numbers_stay_in_their_trial():
    times, truth, platforms = passing(4, epochs=12, acceleration=0.5)
    start = np.tile(np.diag([3e3**2] * 3 + [400.0**2] * 3), (4, 1, 1))
    whole = posterior_bound(truth, platforms, times, six_rows(), ConstantVelocity(0.5), start, True)
    torn, bad = truth.copy(), start.copy()
    torn[1, 4] = np.nan
    bad[2, 0, 0] = np.nan
    found = posterior_bound(torn, platforms, times, six_rows(), ConstantVelocity(0.5), bad, True)
    np.testing.assert_array_equal(found[[0, 3]], whole[[0, 3]])
    assert np.isnan(found[2]).all()
    # no truth, no Jacobian: as if nothing had been measured there
    present = np.ones((4, 12, 6), dtype=bool)
    present[1, 4] = False
    gap = posterior_bound(truth, platforms, times, six_rows(), ConstantVelocity(0.5), start, True, present)
    np.testing.assert_array_equal(found[1], gap[1])
    curves = bound_curves(found, torn)
    kept = [0, 1, 3]
    expected = np.sqrt(np.trace(gap[kept, -1, :3, :3], axis1=-2, axis2=-1).mean())
    np.testing.assert_allclose(curves["position"][-1], expected, rtol=1e-12)
    assert all(np.isfinite(curve).all() for curve in curves.values())


def test_shapes_that_do_not_fit_are_refused():
    times, truth, platforms = passing(3, epochs=4, acceleration=0.5)
    model, motion, start = six_rows(), ConstantVelocity(0.5), np.eye(6)
    with pytest.raises(ValueError, match="trials"):
        posterior_bound(truth, np.repeat(platforms, 2, axis=0), times, model, motion, start, True)
    with pytest.raises(ValueError, match="epochs"):
        posterior_bound(truth, platforms, times[:-1], model, motion, start, True)
    with pytest.raises(ValueError, match="states"):
        posterior_bound(truth, platforms, times, model, motion, np.eye(7), True)


# -------------------------------------------------------------------------------------------------- of a study


def wired(settings=(), trials=1):
    scenario = load_scenario("three_satellite", settings=settings)
    return find("three_satellite").system.build(DiagramBuilder(), scenario, list(scenario.estimators), trials)


def test_bounds_of_the_packaged_scenario_are_those_of_the_reference():
    """Position, height [m] and velocity [m/s] at 50 and 150 s, as an independent prototype has them."""
    times, truth, platforms = passing(epochs=151, step=1.0)
    study = StudyBounds(wired(), times)
    study.add(truth, platforms)
    found = {name: values for name, (_, values) in study.variables().items()}
    names = list(study.wired.estimators)
    reference = {
        "iekf": ((2155, 1818, 19), (1313, 945, 10.0)),
        "iekf_tdoa_fdoa_phase": ((2821, 2379, 24), (1645, 1184, 12.5)),
        "iekf_tdoa_phase": ((3489, 2942, 31), (2850, 2056, 21.3)),
    }
    for name, rows in reference.items():
        for epoch, values in zip((50, 150), rows, strict=True):
            bound = [found[f"bound_{what}"][names.index(name), epoch] for what in ("position", "height", "velocity")]
            # The reference is printed to 1 m and to 1 or 0.1 m/s.
            np.testing.assert_allclose(bound[:2], values[:2], rtol=1e-3)
            np.testing.assert_allclose(bound[2], values[2], atol=0.55)
    # A straight line has no process noise, so the truth's own bound is lower; alike before it can matter.
    assert (found["bound_truth_position"][:, -1] < 0.9 * found["bound_position"][:, -1]).all()
    np.testing.assert_allclose(found["bound_truth_position"][:, 1], found["bound_position"][:, 1], rtol=1e-6)


def test_work_is_shared_by_estimators_that_are_alike():
    times, truth, platforms = passing(epochs=3, step=1.0)
    moving = ["truth.motion={_tag: '!RandomAcceleration', acceleration_mps2: 0.1}"]
    # iekf, ekf and ukf are one; three stacks of rows, each with the belief's and the truth's motion
    for settings, recursions in ((), 6), (moving, 3):
        study = StudyBounds(wired(settings), times)
        with counting() as counts:
            study.add(truth, platforms)
        assert len(study.wired.estimators) == 5 and counts["bounded"] == recursions


@pytest.mark.parametrize("sizes", [(3, 4), (1,) * 7, (6, 1)])
def test_chunks_change_no_number(sizes):
    times, truth, platforms = passing(7, epochs=5, step=1.0, acceleration=0.5)
    whole, cut = StudyBounds(wired(), times), StudyBounds(wired(), times)
    whole.add(truth, platforms)
    ends = np.cumsum((0, *sizes))
    for a, b in pairwise(ends):
        cut.add(truth[a:b], platforms)
    shared, pieces = StudyBounds(wired(), times), StudyBounds(wired(), times)
    shared.add(truth[:1], platforms, trials=7)
    for size in sizes:
        pieces.add(truth[:1], platforms, trials=size)
    for one, other in ((whole, cut), (shared, pieces)):
        for name, (_, values) in one.variables().items():
            np.testing.assert_array_equal(other.variables()[name][1], values)


def test_a_satellite_out_of_sight_raises_the_bound():
    times, truth, platforms = passing(2, epochs=31)
    study = StudyBounds(wired(), times)
    present = np.ones((2, 31, len(study.wired.estimators["iekf"].wiring.stream)), dtype=bool)
    study.add(truth, platforms, present=present)
    hidden = StudyBounds(wired(), times)
    some = present.copy()
    some[1, 10:, 1] = False
    hidden.add(truth, platforms, present=some)
    full, less = (s.variables()["bound_position"][1] for s in (study, hidden))
    np.testing.assert_array_equal(full[:, :10], less[:, :10])
    assert (less[:, 10:] > full[:, 10:]).all()


def test_a_low_target_and_its_normal():
    """The height bound is the variance along the ellipsoid's normal, not along the radius."""
    state = geodetic_state(np.radians(45.0), 0.3, 0.0, 0.0, 0.0)
    normal = up(state[:3])
    start = np.zeros((6, 6))
    start[:3, :3] = 100.0 * np.outer(normal, normal) + 1e-6 * np.eye(3)
    start[3:, 3:] = np.eye(3)
    found = posterior_bound(
        state[None, None], np.zeros((1, 1, 1, 6)), [0.0], Linear(np.eye(6), np.eye(6)), ConstantVelocity(0), start, True
    )
    assert bound_curves(found, state[None, None])["height"][0] == pytest.approx(10.0, rel=1e-6)


def test_chunks_that_share_truth_and_measurements_share_their_bounds_and_no_others():
    times, truth, platforms = passing(epochs=3, step=1.0)
    study = StudyBounds(wired(()), times)
    study.add(truth, platforms, 2)
    first = study.take()
    with counting() as counts:
        study.add(truth.copy(), platforms.copy(), 2)
    assert counts["bounded"] == 0
    np.testing.assert_array_equal(study.take(), first)
    elsewhere = truth + np.array([30e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    present = np.ones(
        (1, times.size, len(study.wired.stream or next(iter(study.wired.estimators.values())).wiring.stream)),
        dtype=bool,
    )
    present[:, 1] = False
    for changed in ((elsewhere, platforms, 2), (truth, platforms, 2, present)):
        with counting() as counts:
            study.add(*changed)
        assert counts["bounded"] == 6
        assert (study.take()[:, 0, 0, 0, 1] != first[:, 0, 0, 0, 1]).all()
