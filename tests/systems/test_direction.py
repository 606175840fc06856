"""Direction of arrival in the body frame, and where a ray reaches a height; the laws are in tests/laws."""

import numpy as np
import pytest

from quietfix.systems.angles.direction import Direction, DirectionCosines
from quietfix.systems.earth.frames import earth_fixed_to_inertial, nadir_frame
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef
from quietfix.systems.fixes.ray_height import ray_at_height
from tests.laws.cases import PASS, place, satellites

EAST = np.array([[7.078e6, 0.0, 0.0, 0.0, 7.0e3, 0.0]])
"""A satellite over the equator, flying east; in inertial axes the faster."""


def at(*position):
    return np.array([*position, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("target", "azimuth", "depression"),
    [
        (at(6.978e6, 1e5, 0.0), 0.0, 45.0),  # ahead
        (at(6.978e6, 0.0, -1e5), 90.0, 45.0),  # flying east, south is to the right
        (at(6.978e6, 0.0, 1e5), -90.0, 45.0),
        (at(6.978e6, -1e5, 0.0), 180.0, 45.0),  # behind
        (at(6.978e6, 1e5, -1e5), 45.0, np.degrees(np.arctan(1 / np.sqrt(2)))),
        (at(7.178e6, 1e5, 0.0), 0.0, -45.0),  # above the satellite
    ],
)
def test_angles(target, azimuth, depression):
    angles = np.degrees(Direction(0.01).predict(target, EAST))
    assert abs(np.mod(angles[0] - azimuth + 180, 360) - 180) < 1e-9
    assert angles[1] == pytest.approx(depression, abs=1e-9)


def test_the_frame_follows_the_inertial_velocity():
    """At 60 deg inclination the Earth-fixed velocity is up to 3.6 deg off the inertial one."""
    carrier = satellites(PASS / 2)[:1]
    inertial = earth_fixed_to_inertial(carrier[0], 0.0)
    ahead = carrier[0, :3] + 1e5 * inertial[3:] / np.linalg.norm(inertial[3:])
    azimuth = Direction(0.01).predict(np.concatenate([ahead, np.zeros(3)]), carrier)[0]
    assert abs(azimuth) < 1e-9
    moving = carrier[0, :3] + 1e5 * carrier[0, 3:] / np.linalg.norm(carrier[0, 3:])
    assert np.radians(2) < abs(Direction(0.01).predict(np.concatenate([moving, np.zeros(3)]), carrier)[0])


@pytest.mark.parametrize("model", [Direction(0.01), DirectionCosines(0.01), Direction(0.01, platform=2)])
def test_unit_vector_undoes_the_angles(model):
    targets = place(*np.random.default_rng(0).uniform(-8e5, 8e5, (2, 50)))
    carriers = satellites(PASS / 2)[None]
    u = targets[:, :3] - carriers[0, model.platform, :3]
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    np.testing.assert_allclose(model.unit_vector(model.predict(targets, carriers), carriers), u, atol=1e-12)


def test_cosines_are_those_of_the_body_axes():
    target, carriers = place(1e5, -2e5), satellites(PASS / 2)
    inertial = earth_fixed_to_inertial(carriers[0], 0.0)
    u = target[:3] - carriers[0, :3]
    expected = (nadir_frame(inertial) @ u)[:2] / np.linalg.norm(u)
    np.testing.assert_allclose(DirectionCosines(0.01).predict(target, carriers), expected, atol=1e-14)


def test_straight_below():
    """No azimuth there: that row is NaN and no other; cosines are smooth."""
    carriers = np.array([[7.078e6, 0.0, 0.0, 0.0, 7.0e3, 0.0]])
    below = at(6.378e6, 0.0, 0.0)
    value, jacobian = Direction(0.01).linearize(below, carriers)
    assert np.isnan(value[0]) and value[1] == pytest.approx(np.pi / 2)
    assert not np.isfinite(jacobian[0]).all()
    value, jacobian = DirectionCosines(0.01).linearize(below, carriers)
    np.testing.assert_allclose(value, 0, atol=1e-15)
    # a metre along or across is 1/700 km
    np.testing.assert_allclose(np.abs(jacobian).sum(axis=-1), 1 / 700e3, rtol=1e-6)


def test_cosines_that_are_impossible():
    assert np.isnan(DirectionCosines(0.01).unit_vector(np.array([0.9, 0.9]), EAST)).all()


def test_residual_of_the_azimuth_is_wrapped_and_that_of_the_depression_is_not():
    model = Direction(0.01)
    residual = model.residual(np.array([np.pi - 0.1, 1.5]), np.array([-np.pi + 0.1, -1.5]))
    np.testing.assert_allclose(residual, [-0.2, 3.0])


def test_same_numbers_in_clouds_stored_either_way():
    """By particles or by components: the layout that a particle filter uses changes nothing but rounding."""
    model, carriers = Direction(0.01), satellites(PASS / 2)[None, None]
    cloud = place(1e5, 2e5) + np.random.default_rng(0).normal(size=(3, 50, 6)) * 1e3
    by_components = np.ascontiguousarray(cloud.swapaxes(1, 2)).swapaxes(1, 2)
    np.testing.assert_allclose(model.predict(by_components, carriers), model.predict(cloud, carriers), rtol=1e-13)


@pytest.mark.parametrize("height", [0.0, 10e3, -100.0])
def test_ray_at_height(height):
    """From 350 km and more above it, up to 350 km aside: the place that was looked at, within rounding of 7e6 m."""
    rng = np.random.default_rng(1)
    place_ = geodetic_to_ecef(rng.uniform(-1.4, 1.4, 200), rng.uniform(-3, 3, 200), height)
    origin = place_ * (1 + 700e3 / 6.378e6) + rng.uniform(-2e5, 2e5, size=place_.shape)
    direction = (place_ - origin) / np.linalg.norm(place_ - origin, axis=-1, keepdims=True)
    found = ray_at_height(origin, direction, np.full(200, height))
    np.testing.assert_allclose(found, place_, rtol=0, atol=1e-5)
    np.testing.assert_allclose(ecef_to_geodetic(found)[2], height, atol=1e-6)


def test_a_ray_that_misses_the_earth():
    up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isnan(ray_at_height(np.tile([7.078e6, 0, 0], (2, 1)), up, np.zeros(2))).all()
