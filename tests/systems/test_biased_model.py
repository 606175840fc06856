"""Biases of measurements: what turned axes do, compiled and by NumPy, and as they are turned in the truth."""

import numpy as np
import pytest

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.biases.bias import Bias, Turn
from quietfix.systems.biases.biased import BiasedModel
from quietfix.systems.biases.walking import WithBiases
from quietfix.systems.geometry.body_frame import NadirAxes
from quietfix.systems.geometry.misalignment import left_jacobian, rotation_matrix, seen_from_turned_axes
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.equations import of_kernel, program
from quietfix.systems.measurement.base import CompiledModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from tests.laws.cases import GEOMETRIES, kinematics, six, tdoa, turned

CLOCK = Bias("clock", "s", 20e-9, rows={"tdoa_10": -1.0, "tdoa_20": -1.0})


class Plain(BiasedModel):
    """The same without its kernel."""

    def equations(self):
        return None


def cases():
    """Models with biases, their kind without a kernel, and states (k, n) and platforms to hold them against."""
    satellites, aircraft, orbits = (GEOMETRIES[name] for name in ("satellites", "aircraft", "orbits"))
    phases = turned("phase_a", "phase_b", body=NadirAxes())
    both = Stack([Bearing(0.03, 0.02), tdoa()])
    mixed = turned("azimuth", "elevation", "azimuth_rate", "elevation_rate")
    return {
        "six rows": (six(), [CLOCK, *phases], satellites),
        "one axis": (six(), [phases[2]], satellites),
        "bearing": (Bearing(0.03, 0.02), turned("azimuth", "elevation"), aircraft),
        "bearing and delays": (both, [*turned("azimuth", "elevation"), CLOCK], satellites),
        # one kernel makes rows of both sorts: NumPy goes on
        "kinematics": (kinematics(), mixed, orbits),
    }


def states(biases, geometry):
    drawn = np.random.default_rng(3).normal(size=(len(geometry.targets), len(biases)))
    return np.concatenate([geometry.targets, drawn * [bias.sigma for bias in biases]], axis=-1)


@pytest.mark.parametrize("name", cases())
def test_kernel_and_numpy_agree(name):
    model, biases, geometry = cases()[name]
    biased, plain = BiasedModel(model, 6, biases), Plain(model, 6, biases)
    assert program(plain) is None and (program(biased) is not None) == (name != "kinematics")
    target = states(biases, geometry)
    before = target.copy()
    value, jacobian = biased.linearize(target, geometry.platforms)
    np.testing.assert_array_equal(target, before)  # the kernel of turned axes has put the state back
    expected, derivative = plain.linearize(target, geometry.platforms)
    scale = np.abs(derivative).max(axis=(0, 2), keepdims=True)[0]
    np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12 * biased.sigmas.min())
    np.testing.assert_allclose(jacobian / scale, derivative / scale, atol=1e-12)
    np.testing.assert_array_equal(biased.predict(target, geometry.platforms), value)


@pytest.mark.parametrize("name", cases())
def test_jacobian(name):
    model, biases, geometry = cases()[name]
    biased, target = BiasedModel(model, 6, biases), states(biases, geometry)
    jacobian = biased.jacobian(target, geometry.platforms)
    steps = [10.0] * 3 + [0.1] * 3 + [1e-3 * bias.sigma for bias in biases]
    for k, step in enumerate(steps):
        move = np.zeros(len(steps))
        move[k] = step
        after, before = (biased.predict(target + sign * move, geometry.platforms) for sign in (1, -1))
        change = biased.residual(after, before) / (2 * step)
        # of the largest derivative of the row: differences of 1e-3 sigma keep six digits
        np.testing.assert_allclose(change, jacobian[..., k], atol=1e-6 * max(np.abs(jacobian[..., k]).max(), 1e-30))


def test_turned_axes_are_those_of_the_truth():
    """`seen_from_turned_axes`, by which `AttitudeError` turns what a sensor reads."""
    geometry, biases = GEOMETRIES["satellites"], turned("phase_a", "phase_b", body=NadirAxes())
    target, platform = states(biases, geometry), geometry.platforms[:, 0]
    seen = seen_from_turned_axes(target[:, :6], platform, rotation_matrix(target[:, 6:]), NadirAxes()(platform))
    value = BiasedModel(six(), 6, biases).predict(target, geometry.platforms)
    # rad of a phase of up to 190: rounding
    np.testing.assert_allclose(value[:, 4:], six().predict(seen, geometry.platforms)[:, 4:], atol=1e-11)
    np.testing.assert_array_equal(value[:, :4], six().predict(target[:, :6], geometry.platforms)[:, :4])


def test_in_the_plane():
    bearing, geometry = Bearing(0.03), GEOMETRIES["aircraft"]
    yaw = Bias("yaw", "rad", 0.01, rows={"azimuth": 1.0}, turn=Turn(0, 2, axes=2))
    flat = geometry.targets[:, [0, 1, 3, 4]]
    target = np.concatenate([flat, np.full((len(flat), 1), 0.02)], axis=-1)
    value, jacobian = BiasedModel(bearing, 4, [yaw]).linearize(target, geometry.platforms)
    # turned to the left by 0.02, the sensor sees everything further to the right
    np.testing.assert_allclose(value, bearing.predict(flat, geometry.platforms) - 0.02, atol=1e-14)
    np.testing.assert_allclose(jacobian[:, 0, -1], -1.0, atol=1e-14)
    with pytest.raises(ValueError, match="in the plane 2 alone"):
        Turn(0, 1, axes=2)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.0099, 0.0101, 1.0, 3.0])
def test_left_jacobian(size):
    vector = size * np.array([0.6, -0.48, 0.64])
    u, h = np.array([0.3, -2.0, 1.1]), 1e-6
    cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    expected = rotation_matrix(-vector) @ cross @ left_jacobian(vector)
    for k in range(3):
        move = h * np.eye(3)[k]
        change = (rotation_matrix(-(vector + move)) - rotation_matrix(-(vector - move))) @ u / (2 * h)
        np.testing.assert_allclose(change, expected[:, k], atol=1e-9)  # of 2: rounding over the step


def test_mixed_axes_of_a_platform_are_refused():
    with pytest.raises(ValueError, match="as about the other axes"):
        BiasedModel(six(), 6, [turned("phase_a")[0], turned("phase_a", "phase_b")[1]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sigma": -1.0}, "sigma -1.0 is not allowed"),
        ({"sigma": np.nan}, "sigma nan is not allowed"),
        ({"walk": -1.0}, "walk -1.0 is not allowed"),
        ({"rows": {}}, "no row has this bias"),
    ],
)
def test_numbers_that_are_not_allowed(changes, message):
    with pytest.raises(ValueError, match=message):
        Bias(**{"name": "b", "unit": "m", "sigma": 1.0, "rows": {"a": 1.0}, **changes})


def test_a_name_twice_is_refused():
    with pytest.raises(ValueError, match="no name twice"):
        WithBiases(WhiteNoiseAcceleration(1.0), [Bias("vx", "m", 1.0, rows={"a": 1.0})])


@kernel
def sum_of_all(state, platforms, parameters, value, jacobian):
    for i in range(state.shape[0]):
        value[0] += state[i]
        if jacobian.shape[0] > 0:
            jacobian[0, i] = 1.0


@kernel
def raising(state, platforms, parameters, value, jacobian):
    if state[0] > parameters[0]:
        raise ValueError("too far")


class Own(CompiledModel):
    """A user's model, whose kernel goes through all of the state."""

    names, units = ("sum",), ("m",)

    def __init__(self, function):
        self.function = function

    def equations(self):
        return of_kernel(self.function, [5.0], 1)

    def noise_covariance(self):
        return np.eye(1)


def test_a_users_kernel_does_not_see_the_biases():
    model = BiasedModel(Own(sum_of_all), 2, [Bias("b", "m", 1.0, rows={"sum": 1.0}), CLOCK])
    value, jacobian = model.linearize(np.array([[1.0, 2.0, 10.0, 100.0]]), np.zeros((1, 1, 6)))
    np.testing.assert_array_equal(value, [[13.0]])
    np.testing.assert_array_equal(jacobian, [[[1.0, 1.0, 1.0, 0.0]]])


def test_a_users_kernel_that_raises_is_told():
    model = BiasedModel(Own(raising), 2, [Bias("b", "m", 1.0, rows={"sum": 1.0})])
    with pytest.raises(ValueError, match="for a target at"):
        model.predict(np.array([[6.0, 2.0, 10.0]]), np.zeros((1, 1, 6)))
