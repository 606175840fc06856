"""Satellites that are ahead of their elements: the rows that see them, and the state that starts anew in every pass."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from quietfix.systems.along_track.ahead import Ahead
from quietfix.systems.along_track.anew import Anew
from quietfix.systems.measurement.distance import Range
from quietfix.systems.measurement.frequency import Frequency
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.drifting_bias import DriftingBias
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration

EARTH = GravityConstants()
STATION = np.array([4.0e6, 3.5e5, 4.94e6, 0.0, 0.0, 0.0])


def falling(state, turning):
    """Derivative of a state in axes that turn or not, by the textbook: a - 2 w x v - w x (w x r)."""
    w = np.array([0.0, 0.0, EARTH.earth_rate if turning else 0.0])
    pull = acceleration(state[:3], EARTH) - 2 * np.cross(w, state[3:]) - np.cross(w, np.cross(w, state[:3]))
    return np.concatenate([state[3:], pull])


PLATFORMS = np.array([[4.6e6, 9e5, 5.2e6, -4.4e3, -1.0e3, 6.0e3], [5.6e6, -9e5, 4.2e6, -4.0e3, 2.0e3, 5.8e3]])


def model(turning=True):
    """Two satellites, of which the second is ahead by the eighth state, and the first by the ninth."""
    rows = Stack([Frequency(1.0, 145e6, [0, 1], bias=6), Range(5.0, [1])])
    return Ahead(rows, {1: 7, 0: 8}, 2, EARTH, turning)


@pytest.mark.parametrize("turning", [True, False])
@pytest.mark.parametrize(("time", "range_off", "rate_off"), [(1.0, 0.01, 0.02), (-5.0, 0.6, 0.4)])
def test_it_is_where_it_would_be(turning, time, range_off, rate_off):
    """Against the orbit integrated; the errors are those that the module states, with some room for the geometry."""
    target = np.concatenate([STATION, [0.0, time, 0.0]])
    found = model(turning).predict(target, PLATFORMS)
    later = solve_ivp(lambda t, x: falling(x, turning), (0, time), PLATFORMS[1], rtol=1e-11, atol=1e-6).y[:, -1]
    exact = model(turning).predict(np.concatenate([STATION, np.zeros(3)]), np.stack([PLATFORMS[0], later]))
    assert abs(found[2] - exact[2]) < range_off
    assert abs(found[1] - exact[1]) < rate_off * 145e6 / 299792458.0
    assert found[0] == exact[0]
    nominal = model(turning).predict(np.concatenate([STATION, np.zeros(3)]), PLATFORMS)
    assert abs(nominal[1] - exact[1]) > 1  # what it is good for


@pytest.mark.parametrize("turning", [True, False])
def test_jacobian(turning):
    target = np.concatenate([STATION + np.array([3e5, -2e5, 1e4, 10, 20, -5]), [30.0, 0.7, -0.4]])
    both = np.stack([target, target + np.array([1e5, 0, 0, 0, 0, 0, 5.0, 1.0, 0.2])])
    value, jacobian = model(turning).linearize(both, PLATFORMS)
    assert_array_equal(value, model(turning).predict(both, PLATFORMS))
    # central differences of functions that are smooth over hundreds of kilometres and minutes: relative (1e-3)^2
    for j, step in enumerate([100.0] * 3 + [1.0] * 3 + [1.0, 1e-2, 1e-2]):
        move = step * np.eye(9)[j]
        numeric = (model(turning).predict(both + move, PLATFORMS) - model(turning).predict(both - move, PLATFORMS)) / (
            2 * step
        )
        assert_allclose(jacobian[..., j], numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max() + 1e-12)


def test_rows_of_several_platforms_are_refused():
    with pytest.raises(ValueError, match="tdoa_10: a row of several platforms is not allowed"):
        Ahead(Tdoa(1e-8, [1]), {1: 6}, 2, EARTH, True)
    plain = Ahead(Range(1.0, [0]), {1: 6}, 2, EARTH, True)
    target = np.concatenate([STATION, [2.0]])
    assert_array_equal(plain.predict(target, PLATFORMS), Range(1.0, [0]).predict(target, PLATFORMS))


def test_anew_after_a_pause():
    within = DriftingBias(1e-2, 1e-6)
    motion = Anew(within, [300.0, 0.5], 100.0)
    state = np.array([[20.0, 0.2], [-10.0, 0.1]])
    assert_array_equal(motion.propagate(state, 100.0), within.propagate(state, 100.0))
    assert_array_equal(motion.process_noise(state, 100.0), within.process_noise(state, 100.0))
    assert_array_equal(motion.propagate(state, 100.1), 0 * state)
    assert_array_equal(motion.process_noise(state, 100.1), np.diag([9e4, 0.25]))
    assert not motion.transition(state, 100.1).any() and motion.names == within.names
    for sigmas, pause in (([1.0], 1.0), ([1.0, 0.0], 1.0), ([1.0, 1.0], 0.0)):
        with pytest.raises(ValueError, match=r"(is|are) not allowed"):
            Anew(within, sigmas, pause)
