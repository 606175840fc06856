"""The table of frames: what heights, courses and the ground are in each, and names that are none."""

from dataclasses import replace

import numpy as np
import pytest

from quietfix.diagrams.figures.ground import draw_ground, has_ground
from quietfix.diagrams.quantities.frame import EARTH_FIXED, FRAMES, INERTIAL, LAUNCH, LOCAL, as_frame, frame_of
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise
from quietfix.systems.earth.geodetic import geodetic_state, geodetic_to_ecef
from tests.diagrams import flat_plane
from tests.diagrams.results import result

PLACE, MOVING = ("x", "y", "z"), ("x", "y", "z", "vx", "vy", "vz")


def test_a_frame_goes_by_its_name():
    for name, frame in FRAMES.items():
        assert as_frame(name) is as_frame(frame) is frame
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())
    assert model.axes is LOCAL and replace(model, frame=INERTIAL).axes is INERTIAL
    assert str(EARTH_FIXED) == "earth-fixed"


@pytest.mark.parametrize("name", ["galactic", "", None, 3])
def test_a_frame_that_is_none_is_refused_in_one_line(name):
    words = r"frame: .* is not allowed; one of earth_fixed, local, inertial, launch$"
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())
    with pytest.raises(UserError, match=words) as caught:
        replace(model, frame=name)
    assert "\n" not in str(caught.value)
    data = result()
    data.attrs["frame"] = name
    with pytest.raises(UserError, match=words):
        summarise(data)
    assert frame_of(result().drop_attrs()) is EARTH_FIXED


@pytest.mark.parametrize(
    ("frame", "names", "told"),
    [
        (EARTH_FIXED, MOVING, "position height velocity speed course"),
        (EARTH_FIXED, PLACE, "position height"),
        (EARTH_FIXED, MOVING[:5], "position height velocity"),
        (LOCAL, ("vy", "x", "vx", "y"), "position velocity speed course"),
        (LOCAL, (*MOVING, "bias"), "position height velocity speed course bias"),
        (INERTIAL, MOVING, "position velocity"),
        (LAUNCH, (*MOVING, "bias"), "position velocity bias"),
        (LAUNCH, ("bearing",), ""),
    ],
)
def test_what_is_told_of_a_state(frame, names, told):
    units = {"position": "m", "height": "m", "velocity": "m/s", "speed": "m/s", "course": "deg", "bias": "m/s"}
    assert frame.quantities(names) == {what: units[what] for what in told.split()}


def test_height_course_and_speed_are_those_of_the_geodetic_state_that_was_made():
    state = geodetic_state(np.radians([10.0, -60.0]), np.radians([179.0, 20.0]), 9e3, np.radians([75.0, 300.0]), 210.0)
    place, velocity = state[:, :3], state[:, 3:]
    # a nanometre of height in 6.4e6 m is an ulp; courses and speeds are a few ulps of their own size
    np.testing.assert_allclose(EARTH_FIXED.height(place), 9e3, atol=1e-7)
    course, speed = EARTH_FIXED.course_and_speed(place, velocity)
    np.testing.assert_allclose(np.degrees(course), [75.0, 300.0], rtol=1e-12)
    np.testing.assert_allclose(speed, 210.0, rtol=1e-12)
    raised = geodetic_to_ecef(np.radians([10.0, -60.0]), np.radians([179.0, 20.0]), 9e3 + 100.0) - place
    np.testing.assert_allclose(raised, 100.0 * EARTH_FIXED.up(place), atol=1e-7)


def test_local_axes_are_east_north_up():
    place, velocity = np.array([[1e3, 2e3, 30.0]]), np.array([[3.0, 4.0, -1.0]])
    course, speed = LOCAL.course_and_speed(place, velocity)
    np.testing.assert_allclose([np.degrees(course[0]), speed[0]], [np.degrees(np.arctan2(3, 4)), 5.0], rtol=1e-15)
    assert LOCAL.height(place) == [30.0] and LOCAL.up(place).tolist() == [[0.0, 0.0, 1.0]]
    np.testing.assert_array_equal(LOCAL.ground.places(place, place[0]), [[1.0, 2.0]])


def test_offsets_along_the_ground():
    place = geodetic_to_ecef(np.radians([48.0]), np.radians([11.0]), 500.0)
    east = geodetic_to_ecef(np.radians([48.0]), np.radians([11.001]), 500.0) - place
    # 0.001 deg of longitude at 48 deg north is 74.6 m on WGS-84; the parallel bends away by d^2 tan(48)/2a = 0.5 mm
    offset = EARTH_FIXED.ground.offsets(place, east)[0]
    np.testing.assert_allclose(offset, [74.63, 0.0], atol=0.01)
    np.testing.assert_array_equal(LAUNCH.ground.offsets(place, np.array([[1.0, 2.0, 3.0]])), [[1.0, 3.0]])


def test_tracks_across_the_date_line_stay_together():
    longitude = np.radians([179.5, 179.9, -179.7])
    track = geodetic_to_ecef(np.zeros(3), longitude, 0.0)
    around = geodetic_to_ecef(0.0, np.radians(-179.0), 0.0)
    drawn = EARTH_FIXED.ground.places(track, around)
    np.testing.assert_allclose(drawn[:, 0], [-180.5, -180.1, -179.7], rtol=1e-12)


def test_axes_without_a_ground_have_no_picture_of_it():
    data = result()
    assert has_ground(data)
    data.attrs["frame"] = "inertial"
    assert not has_ground(data)
    with pytest.raises(ValueError, match="in inertial axes have none"):
        draw_ground(data)
