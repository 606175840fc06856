"""The information about the initial state against cases that are known on paper."""

import numpy as np
import pytest

from quietfix.diagrams.statistics.fisher_information import information_roots, spectrum
from quietfix.diagrams.statistics.posterior_bound import posterior_bound
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.motion.known_flight import KnownFlight
from quietfix.systems.motion.stationary import Stationary

TIMES = np.arange(0.0, 200.0, 2.0)
BEARING = Bearing(np.radians(0.1))


def observer(turn=None, speed=150.0):
    """Straight to the east, and to the north from `turn` on; (1, time, 1, 6)."""
    velocity = np.zeros((TIMES.size, 3))
    late = np.zeros(TIMES.size, dtype=bool) if turn is None else turn <= TIMES
    velocity[~late, 0] = speed
    velocity[late, 1] = speed
    place = np.concatenate([np.zeros((1, 3)), np.cumsum(velocity[:-1] * np.diff(TIMES)[:, None], axis=0)])
    return np.concatenate([place, velocity], axis=-1)[None, :, None]


def moving(start=(10e3, 40e3, -5.0, 12.0)):
    state = np.array(start)
    return np.stack([ConstantVelocity(0.0, 2).propagate(state, float(t)) for t in TIMES])[None]


SCALE = np.array([20e3, 20e3, 15.0, 15.0])


def test_bearings_of_a_straight_flight_leave_the_scale_of_the_picture_open():
    """Range and relative velocity grow together and no bearing tells.

    Nardone and Aidala, *Observability criteria for bearings-only target motion analysis*, IEEE Trans. Aerospace and
    Electronic Systems 17 (1981) 162-166.
    """
    truth, platforms = moving(), observer()
    found = spectrum(information_roots(truth, platforms, TIMES, BEARING, ConstantVelocity(0.0, 2), SCALE)[0])
    np.testing.assert_array_equal(found.rank, np.minimum(np.arange(TIMES.size) + 1, 3))
    assert np.isinf(found.sigma[:, -1]).all() and np.isinf(found.condition).all()
    relative = truth[0, 0] - np.concatenate([platforms[0, 0, 0, :2], platforms[0, 0, 0, 3:5]])
    expected = relative / SCALE
    expected /= np.linalg.norm(expected)
    # rounding of a direction whose information is exactly 0, against others of 1e2 to 1e6
    assert abs(found.directions[-1, -1] @ expected) == pytest.approx(1.0, abs=1e-8)


def test_the_observers_turn_makes_the_range_observable():
    turn = 100.0
    truth, platforms = moving(), observer(turn)
    found = spectrum(information_roots(truth, platforms, TIMES, BEARING, ConstantVelocity(0.0, 2), SCALE)[0])
    # the position of the sample after the turn is the first that differs from the straight path
    before = turn >= TIMES
    assert (found.rank[3:][before[3:]] == 3).all() and (found.rank[~before] == 4).all()
    assert found.known[-1] == 4 and np.isfinite(found.condition[-1])
    # information only grows
    assert (np.diff(found.sigma[~before], axis=0) <= 0).all()


def test_a_target_at_rest_needs_two_bearings_and_a_flight_that_is_not_towards_it():
    still = np.tile([10e3, 40e3], (1, TIMES.size, 1))
    found = spectrum(information_roots(still, observer(), TIMES, BEARING, Stationary(2), [20e3, 20e3])[0])
    np.testing.assert_array_equal(found.rank, np.minimum(np.arange(TIMES.size) + 1, 2))
    ahead = np.tile([40e3, 0.0], (1, TIMES.size, 1))
    found = spectrum(information_roots(ahead, observer(), TIMES, BEARING, Stationary(2), [20e3, 20e3])[0])
    assert (found.rank == 1).all()
    np.testing.assert_allclose(np.abs(found.directions[-1, -1]), [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.unknown()[-1], [1.0, 0.0], atol=1e-12)


def test_two_time_differences_leave_a_line():
    """Two hyperboloids cross in a curve: the direction across both gradients."""
    satellites = np.array([[7e6, 0, 0], [6.99e6, 1e5, 0], [6.98e6, 0, 1.5e5]])
    platforms = np.concatenate([satellites, np.zeros((3, 3))], axis=-1)[None, None]
    target, model, scale = np.array([[[6.3e6, 2e5, 3e5, 0, 0, 0]]]), Tdoa(20e-9), [1e3] * 3 + [100.0] * 3
    found = spectrum(information_roots(target, platforms, [0.0], model, ConstantVelocity(0.0), scale)[0, 0])
    assert found.rank == 2 and found.condition == np.inf
    gradients = model.jacobian(target[0, 0], platforms[0, 0])[:, :3]
    line = np.cross(gradients[0], gradients[1])
    line /= np.linalg.norm(line)
    known = found.directions[np.isfinite(found.sigma)]
    np.testing.assert_allclose(known[:, :3] @ line, 0.0, atol=1e-10)
    # that line and the velocity are open, nothing else is
    np.testing.assert_allclose(found.unknown()[:3], line**2, atol=1e-10)
    np.testing.assert_allclose(found.unknown()[3:], 1.0, atol=1e-12)


def test_a_shared_bias_is_not_told_from_motion_along_the_axis_of_a_cone_of_stations():
    angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    stations = 40e3 * np.stack([np.cos(angle), np.zeros(6), np.sin(angle)], axis=-1)
    platforms = np.concatenate([stations, np.zeros((6, 3))], axis=-1)[None, None]
    state = np.zeros((1, 1, 10))
    state[..., 1] = 30e3  # at rest above the middle: the lines of sight are a cone about y with cosine 0.6
    scale = [50.0] * 3 + [1.0] * 3 + [5.0] * 3 + [10.0]
    model, motion = RangeRate(0.03, range(6), 9), KnownFlight([0.0])
    found = spectrum(information_roots(state, platforms, [0.0], model, motion, scale)[0, 0])
    assert found.rank == 3
    # velocity y of -b/0.6 hides a bias b
    hidden = np.zeros(10)
    hidden[4], hidden[9] = -1.0 / 0.6, 1.0
    hidden /= np.array(scale)
    known = found.directions[np.isfinite(found.sigma)]
    assert np.abs(known @ hidden).max() < 1e-12
    share = found.unknown()
    np.testing.assert_allclose(share[:3], 1.0)  # at rest no range rate depends on the place
    np.testing.assert_allclose(share[[3, 5]], 0.0, atol=1e-12)
    assert share[4] + share[9] == pytest.approx(1.0)
    # one station that is not on the cone tells them apart
    more = np.concatenate([platforms, np.zeros((1, 1, 1, 6))], axis=2)
    full = spectrum(information_roots(state, more, [0.0], RangeRate(0.03, range(7), 9), motion, scale)[0, 0])
    assert full.rank == 4


def test_roots_are_the_sum_that_the_definition_says():
    truth, platforms = moving(), observer(100.0)
    motion = ConstantVelocity(0.3, 2)  # its process noise must not matter
    present = np.random.default_rng(2).random((1, TIMES.size, 1)) < 0.6
    roots = information_roots(truth, platforms, TIMES, BEARING, motion, SCALE, present)[0]
    total, sigma = np.zeros((4, 4)), BEARING.sigma
    for k, t in enumerate(TIMES):
        if present[0, k, 0]:
            row = BEARING.jacobian(truth[0, k], platforms[0, k]) @ motion.transition(truth[0, 0], float(t)) * SCALE
            total = total + row.T @ row / sigma**2
        np.testing.assert_allclose(roots[k].T @ roots[k], total, rtol=1e-9, atol=1e-9 * np.abs(total).max())


def test_it_is_what_the_bound_becomes_without_prior_and_process_noise():
    truth, platforms, motion = moving(), observer(100.0), ConstantVelocity(0.0, 2)
    root = information_roots(truth, platforms, TIMES, BEARING, motion, SCALE)[0, -1]
    start = SCALE[:, None] * np.linalg.inv(root.T @ root) * SCALE
    phi = motion.transition(truth[0, 0], float(TIMES[-1]))
    bound = posterior_bound(truth, platforms, TIMES, BEARING, motion, np.diag((1e4 * SCALE) ** 2), False)[0, -1]
    # the prior's share of the information is 1e-8 of the scale's, whose sigma the weakest direction has a tenth of
    np.testing.assert_allclose(phi @ start @ phi.T, bound, rtol=1e-6)


def test_trials_do_not_touch_each_other():
    truth = np.concatenate([moving(), moving((-8e3, 25e3, 3.0, 4.0)), moving((5e3, 60e3, 9.0, 0.0))])
    platforms = observer(100.0)
    torn = truth.copy()
    torn[1, 40] = np.nan
    motion = ConstantVelocity(0.0, 2)
    together = information_roots(torn, platforms, TIMES, BEARING, motion, SCALE)
    for trial in (0, 2):
        alone = information_roots(truth[[trial]], platforms, TIMES, BEARING, motion, SCALE)
        np.testing.assert_array_equal(together[trial], alone[0])
    assert np.isfinite(together).all()
    present = np.ones((1, TIMES.size, 1), dtype=bool)
    present[0, 40] = False
    gap = information_roots(truth[[1]], platforms, TIMES, BEARING, motion, SCALE, present)
    np.testing.assert_array_equal(together[1], gap[0])


def test_what_does_not_fit_is_refused():
    truth, platforms, motion = moving(), observer(), ConstantVelocity(0.0, 2)
    with pytest.raises(ValueError, match="epochs"):
        information_roots(truth, platforms[:, :-1], TIMES, BEARING, motion, SCALE)
    with pytest.raises(ValueError, match="states"):
        information_roots(truth, platforms, TIMES, BEARING, Stationary(2), SCALE)
    for scale in (0 * SCALE, SCALE * np.nan):
        with pytest.raises(ValueError, match="scale"):
            information_roots(truth, platforms, TIMES, BEARING, motion, scale)
    with pytest.raises(ValueError, match="trials"):
        information_roots(np.repeat(truth, 3, 0), np.repeat(platforms, 2, 0), TIMES, BEARING, motion, SCALE)
