"""Frames against pymap3d, against numerical differentiation, and against what defines them."""

import numpy as np
import pymap3d
import pytest

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth import frames, geodetic

RATE = EARTH_RATE
RNG = np.random.default_rng(20240501)


def places(shape=(5, 40)):
    lat = np.arcsin(RNG.uniform(-1, 1, shape))
    lon = RNG.uniform(-np.pi, np.pi, shape)
    return lat, lon, RNG.uniform(-100, 20e3, shape)


def low_orbits(shape=(4, 3)):
    p = RNG.normal(size=(*shape, 3))
    p *= 7e6 / np.linalg.norm(p, axis=-1, keepdims=True)
    return np.concatenate([p, RNG.normal(0, 5e3, (*shape, 3))], axis=-1)


def test_geodetic_agrees_with_pymap3d():
    lat, lon, h = places()
    p = geodetic.geodetic_to_ecef(lat, lon, h)
    # the same code underneath: equal
    np.testing.assert_array_equal(p, np.stack(pymap3d.geodetic2ecef(lat, lon, h, deg=False), axis=-1))
    got = geodetic.ecef_to_geodetic(p)
    want = pymap3d.ecef2geodetic(p[..., 0], p[..., 1], p[..., 2], deg=False)
    # below 20 km pymap3d's closed form is good to 1e-12 rad (6 um) and to rounding in height
    np.testing.assert_allclose(got[0], want[0], atol=1e-12)
    np.testing.assert_allclose(got[1], want[1], atol=1e-15)
    np.testing.assert_allclose(got[2], want[2], atol=1e-8)


@pytest.mark.parametrize("height", [-5e3, 0.0, 1e4, 7e5, 2e7])
def test_geodetic_round_trip(height):
    lat, lon, _ = places()
    back = geodetic.ecef_to_geodetic(geodetic.geodetic_to_ecef(lat, lon, height))
    # rounding of coordinates of 1e7 m is 2e-9 m; pymap3d alone is 30 m out at 20 000 km
    assert np.max(np.abs(back[0] - lat)) < 2e-15 and np.max(np.abs(back[1] - lon)) < 2e-15
    assert np.max(np.abs(back[2] - height)) < 2e-8


def test_geodetic_at_poles_and_equator():
    lat, _, h = geodetic.ecef_to_geodetic([[0, 0, 6400e3], [0, 0, -6400e3], [6400e3, 0, 0], [0, -6400e3, 0]])
    np.testing.assert_allclose(lat, [np.pi / 2, -np.pi / 2, 0, 0], atol=1e-15)
    # semi-axes of WGS-84 as published (NIMA TR8350.2), printed to 0.1 mm
    np.testing.assert_allclose(h, 6400e3 - np.array([6356752.3142] * 2 + [6378137.0] * 2), atol=1e-4)


def test_geodetic_keeps_shape_and_nan_to_itself():
    p = geodetic.geodetic_to_ecef(*places((2, 3)))
    p[1, 2, 0] = np.nan
    lat, lon, h = geodetic.ecef_to_geodetic(p)
    assert lat.shape == lon.shape == h.shape == (2, 3)
    for value in (lat, lon, h):
        assert np.isnan(value).sum() == 1 and np.isnan(value[1, 2])
    assert geodetic.ecef_to_geodetic(p[0, 0])[2].shape == ()
    # one alone is bit-equal to the same one in a batch
    assert geodetic.ecef_to_geodetic(p[0, 1:2])[2][0] == h[0, 1]


def test_up_is_the_gradient_of_the_height():
    p = geodetic.geodetic_to_ecef(*places())
    step = 10.0  # m: truncation (h/r)^2 ~ 2e-12, rounding 2e-9/20 = 1e-10
    for axis in range(3):
        d = step * np.eye(3)[axis]
        slope = (geodetic.ecef_to_geodetic(p + d)[2] - geodetic.ecef_to_geodetic(p - d)[2]) / (2 * step)
        np.testing.assert_allclose(geodetic.up(p)[..., axis], slope, atol=1e-9)


def test_enu_agrees_with_pymap3d():
    lat, lon, _ = places()
    v = RNG.normal(size=(*lat.shape, 3))
    got = (geodetic.enu_rotation(lat, lon) @ v[..., None])[..., 0]
    want = pymap3d.ecef2enuv(v[..., 0], v[..., 1], v[..., 2], lat, lon, deg=False)
    np.testing.assert_allclose(got, np.stack(want, axis=-1), atol=1e-14)  # rounding of unit numbers


def test_offsets_agree_with_pymap3d():
    origin = np.radians(48.0), np.radians(11.0), 500.0
    centre = geodetic.geodetic_to_ecef(*origin)
    points = centre + np.random.default_rng(0).normal(size=(2, 5, 3)) * 1e5
    want = pymap3d.ecef2enu(points[..., 0], points[..., 1], points[..., 2], *origin, deg=False)
    # rounding of 6e6 m, and of the origin's latitude, which is found again from the Earth-fixed place
    np.testing.assert_allclose(geodetic.enu_offset(points, centre), np.stack(want, axis=-1), atol=1e-8)


def test_course_and_speed():
    lat, lon, h = places()
    course, speed = RNG.uniform(0, 2 * np.pi, lat.shape), RNG.uniform(1, 400, lat.shape)
    x = geodetic.geodetic_state(lat, lon, h, course, speed, 3.0)
    got = geodetic.course_speed(x[..., :3], x[..., 3:])
    # rounding of 400 m/s is 6e-14, turned into an angle at 1 m/s
    np.testing.assert_allclose(got[0], course, atol=1e-12)
    np.testing.assert_allclose(got[1], speed, atol=1e-12)
    np.testing.assert_allclose(got[2], 3.0, atol=1e-12)
    # 60 degrees clockwise from north at (0, 0): north is z, east is y
    np.testing.assert_allclose(geodetic.course_velocity(0, 0, np.radians(60), 2), [0, np.sqrt(3), 1], atol=1e-15)


def test_inertial_round_trip_with_times_per_row():
    x = low_orbits()
    t = RNG.uniform(0, 1e4, (4, 1))
    there = frames.inertial_to_earth_fixed(x, t)
    # a few roundings of 7e6 m and 1e4 m/s
    np.testing.assert_allclose(frames.earth_fixed_to_inertial(there, t), x, rtol=1e-14, atol=1e-8)
    np.testing.assert_array_equal(there[2, 1], frames.inertial_to_earth_fixed(x[2, 1], t[2, 0]))
    np.testing.assert_array_equal(frames.inertial_to_earth_fixed(x, 0.0)[..., :3], x[..., :3])


def test_earth_turns_eastwards():
    # a point at rest in inertial axes moves westwards over the turning Earth: from +x towards -y
    p = frames.inertial_to_earth_fixed([7e6, 0, 0, 0, 0, 0], 100.0)
    assert p[1] < 0 and p[4] < 0
    # a geostationary satellite stands still
    geo = np.array([42164e3, 0, 0, 0, 42164e3 * RATE, 0])
    np.testing.assert_allclose(frames.inertial_to_earth_fixed(geo, 0.0)[3:], 0, atol=1e-12)


def curve(t):
    """A smooth inertial motion with velocity and acceleration known in closed form."""
    r, w = 7e6, 1.05e-3
    c, s = np.cos(w * t), np.sin(w * t)
    tilt = np.array([[1, 0, 0], [0, 0.5, -np.sqrt(0.75)], [0, np.sqrt(0.75), 0.5]])
    p, v = np.array([c, s, 0 * t]) * r, np.array([-s, c, 0 * t]) * r * w
    return np.concatenate([tilt @ p, tilt @ v]), tilt @ (-(w**2) * p)


def test_velocity_and_acceleration_are_derivatives_of_the_earth_fixed_position():
    t, d = 1234.5, 1.0
    x, a = curve(t)
    before, now, after = (frames.inertial_to_earth_fixed(curve(s)[0], s) for s in (t - d, t, t + d))
    # central differences over 1 s: truncation w^2 v/6 = 1.5e-3 m/s and w^2 a/6 = 1.5e-6 m/s^2 with w = 1.1e-3
    np.testing.assert_allclose(now[3:], (after - before)[:3] / (2 * d), atol=2e-3)
    got = frames.acceleration_to_earth_fixed(a, x, t)
    np.testing.assert_allclose(got, (after - before)[3:] / (2 * d), atol=2e-6)
    np.testing.assert_allclose(frames.acceleration_to_inertial(got, now, t), a, rtol=1e-13, atol=1e-14)


def test_nadir_frame():
    x = low_orbits()
    c = frames.nadir_frame(x)
    np.testing.assert_allclose(c @ np.swapaxes(c, -1, -2), np.broadcast_to(np.eye(3), c.shape), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(c), 1, atol=1e-14)
    p, v = (c @ x[..., i : i + 3, None] for i in (0, 3))
    np.testing.assert_allclose(p[..., :2, 0], 0, atol=1e-8)  # rounding of 7e6 m
    assert np.all(p[..., 2, 0] < 0)
    np.testing.assert_allclose(v[..., 1, 0], 0, atol=1e-11)  # rounding of 1e4 m/s
    assert np.all(v[..., 0, 0] > 0)


def test_nadir_frame_of_an_earth_fixed_state_is_the_inertial_one_turned():
    x, t = low_orbits(), 777.0
    fixed = frames.inertial_to_earth_fixed(x, t)
    c, s = np.cos(RATE * t), np.sin(RATE * t)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    got = frames.nadir_frame_earth_fixed(fixed[..., :3], fixed[..., 3:])
    np.testing.assert_allclose(got @ turn, frames.nadir_frame(x), atol=1e-14)


def test_vertical_is_the_normal_and_the_height_of_pymap3d():
    """Everywhere from the poles to the equator, from under the sea to the geostationary ring, also beside a NaN."""
    latitude = np.concatenate([np.linspace(-np.pi / 2, np.pi / 2, 181), [1e-12, -1e-9, np.pi / 2 - 1e-9]])
    longitude = np.linspace(-np.pi, np.pi, latitude.size)
    normal = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=-1
    )
    for height in (-10e3, 0.0, 12e3, 700e3, 36000e3):
        position = geodetic.geodetic_to_ecef(latitude, longitude, height)
        up_, above = geodetic.vertical(position)
        np.testing.assert_allclose(up_, normal, rtol=0, atol=1e-15)
        np.testing.assert_allclose(above, height, rtol=0, atol=4 * np.spacing(7e6 + abs(height)))
        np.testing.assert_allclose(
            above, geodetic.ecef_to_geodetic(position)[2], rtol=0, atol=8 * np.spacing(7e6 + abs(height))
        )
    position[7] = np.nan
    alone, height = geodetic.vertical(position)
    assert np.isnan(alone[7]).all() and np.isnan(height[7])
    others = np.arange(latitude.size) != 7
    np.testing.assert_array_equal(alone[others], up_[others])
    np.testing.assert_array_equal(geodetic.vertical(position[3])[0], alone[3])
