"""Emitters on prescribed paths."""

import numpy as np
import pytest

from quietfix.systems.earth.geodetic import course_speed, ecef_to_geodetic, geodetic_state
from quietfix.systems.plants.emitter import GreatCircle, StraightLine
from quietfix.systems.trajectories.great_circle import great_circle, straight_line

START = geodetic_state(
    np.radians([40.0, -75.0, 0.0, 89.9]), np.radians([10.0, 170.0, 0.0, 20.0]), 10e3,
    np.radians([60.0, 200.0, 90.0, 0.0]), [300.0, 250.0, 300.0, 100.0],
)  # fmt: skip
BLOCKS = [StraightLine, GreatCircle]


def ports(block, time):
    context = block.CreateDefaultContext()
    context.SetTime(time)
    return [
        block.GetOutputPort(name).Eval(context).reshape(block.output_size(name)) for name in ("state", "acceleration")
    ]


@pytest.mark.parametrize("block", BLOCKS)
def test_starts_where_it_is_told(block):
    state, acceleration = ports(block(START), 0.0)
    assert state.shape == (4, 6) and acceleration.shape == (4, 3)
    np.testing.assert_allclose(state[:, :3], START[:, :3], atol=1e-8)  # rounding of 6e6 m, some operations
    np.testing.assert_allclose(state[:, 3:], START[:, 3:], atol=1e-10)
    assert ports(block(START[0]), 3.0)[0].shape == (1, 6)


@pytest.mark.parametrize("block", BLOCKS)
def test_velocity_and_acceleration_are_derivatives(block):
    moving, t, d = block(START), 500.0, 1.0
    before, _ = ports(moving, t - d)
    state, acceleration = ports(moving, t)
    after, _ = ports(moving, t + d)
    # rounding 1e-9 m over 2 s; truncation v (v/r)^2/6 = 1e-7 m/s
    np.testing.assert_allclose(state[:, 3:], (after - before)[:, :3] / (2 * d), atol=2e-7)
    np.testing.assert_allclose(acceleration, (after - before)[:, 3:] / (2 * d), atol=1e-9)


@pytest.mark.parametrize("block", BLOCKS)
def test_one_trial_alone_is_bit_equal(block):
    for a, b in zip(ports(block(START), 150.0), ports(block(START[2:3]), 150.0), strict=True):
        np.testing.assert_array_equal(a[2], b[0])


def test_straight_line_is_straight():
    t = np.array([0.0, 1.5, 150.0])
    x = straight_line(START[0], t)
    np.testing.assert_array_equal(x[:, 3:], np.broadcast_to(START[0, 3:], (3, 3)))
    np.testing.assert_array_equal(x[:, :3], START[0, :3] + t[:, None] * START[0, 3:])
    assert not ports(StraightLine(START), 9.0)[1].any()


def test_great_circle_keeps_its_height_and_its_plane():
    path = great_circle(START[:, None])
    t = np.linspace(0, 40_000, 201)  # a quarter of the way round the Earth and more, over a pole
    x = path.state(t)
    lat, lon, height = ecef_to_geodetic(x[..., :3])
    np.testing.assert_allclose(height, 10e3, atol=1e-7)  # rounding only: the height is in the formula
    _, speed, climb = course_speed(x[..., :3], x[..., 3:])
    np.testing.assert_allclose(climb, 0, atol=1e-9)
    # meridian radii of curvature are 6335 km at the equator and 6400 km at the poles: 1 %
    np.testing.assert_allclose(speed / speed[:, :1], 1, atol=0.0102)
    normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    axis = np.cross(normal[:, :1], normal[:, 20:21])
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    np.testing.assert_allclose((axis * normal).sum(axis=-1), 0, atol=1e-12)


def test_great_circle_round_the_equator():
    # exact: a circle of radius a + h at 300 m/s
    t, r = 1000.0, 6378137.0 + 10e3
    angle = 300.0 * t / r
    want = [r * np.cos(angle), r * np.sin(angle), 0, -300 * np.sin(angle), 300 * np.cos(angle), 0]
    np.testing.assert_allclose(ports(GreatCircle(START[2]), t)[0][0], want, atol=1e-7)
    want = -(300.0**2) / r * np.array([np.cos(angle), np.sin(angle), 0])
    np.testing.assert_allclose(ports(GreatCircle(START[2]), t)[1][0], want, atol=1e-14)


def test_a_body_at_rest_stays():
    still = geodetic_state(0.7, 0.1, 0.0, 0.0, 0.0)
    state, acceleration = ports(GreatCircle(still), 1e4)
    np.testing.assert_allclose(state[0], still, atol=1e-8)
    assert not acceleration.any()


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize(
    ("start", "message"),
    [
        (START[0, :3], "shape"),
        (np.empty((0, 6)), "shape"),
        (START * [1, 1, np.nan, 1, 1, 1], "trial 0 has a number that is not finite"),
        (START * 1e-3, "trial 0 starts below the Earth's surface"),
    ],
)
def test_bad_starts(block, start, message):
    with pytest.raises(ValueError, match=message):
        block(start)


def test_a_great_circle_does_not_climb():
    with pytest.raises(ValueError, match=r"climbs at 5 m/s"):
        GreatCircle(geodetic_state(0.5, 0.5, 1e4, 1.0, 300.0, climb=5.0))
