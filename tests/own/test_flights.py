"""Movers that fly by a rule of their own: waypoints over the ellipsoid, and the rocket, alone and in a study."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.own.system import own_system
from quietfix.diagrams.paths.functions import path_of
from quietfix.diagrams.paths.movers import GreatCircle, Rocket, Waypoints
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import load, read_yaml
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw
from quietfix.systems.trajectories.gravity import GravityConstants

HERE = Path(__file__).parent
CONSTANTS = GravityConstants()
SYSTEM = own_system(HERE / "rocket.yaml")
SCENARIO = load(SYSTEM.scenario, [read_yaml(HERE / "rocket.yaml")])
ROCKET = SCENARIO.target
WAY = [[47.0, 10.0], [47.3, 10.1], [47.35, 10.6], [47.1, 10.7]]


def path(mover, frame, duration=300.0):
    return path_of(mover, frame, Setting(duration, None, HERE), CONSTANTS, "target")


# ------------------------------------------------------------------------------------------------- !Waypoints


def test_waypoints_on_the_ellipsoid():
    """It keeps its height, speed and turn rate, touches its legs, and passes what lies on a straight way exactly."""
    mover = Waypoints(points_deg=WAY, height_m=9000, speed_mps=200, turn_rate_degps=1.5)
    at = path(mover, "earth_fixed", duration=600.0)
    times = np.arange(0.0, 600.0, 1.0)
    states = np.array([at(t) for t in times])
    assert np.abs(ecef_to_geodetic(states[:, :3])[2] - 9000).max() < 1e-6
    speed = np.linalg.norm(states[:, 3:], axis=-1)
    assert abs(speed[0] - 200) < 1e-9 and np.abs(speed / 200 - 1).max() < 0.01
    place = ecef_to_geodetic(states[0, :3])
    np.testing.assert_allclose(np.degrees(place[:2]), WAY[0], atol=1e-9)
    # the rate of the course in a turn, from the velocities in level axes: 1.5 deg/s but for 1 % and the frame's own
    # turning (speed / radius times the tangent of the latitude, 0.002 deg/s)
    latitude, longitude, _ = ecef_to_geodetic(states[:, :3])
    level = np.einsum("kij,kj->ki", enu_rotation(latitude, longitude), states[:, 3:])
    course = np.unwrap(np.arctan2(level[:, 0], level[:, 1]))
    rate = np.degrees(np.diff(course))
    turning = np.abs(rate) > 1.4
    assert turning.sum() > 40 and np.abs(np.abs(rate[turning]) - 1.5).max() < 0.02
    assert np.abs(rate[~turning & (np.abs(rate) < 0.1)]).max() < 0.01
    # fly-by: every waypoint is missed to the inside by no more than radius (1 / cos(turn / 2) - 1)
    radius = 200 / math.radians(1.5)
    for point in WAY[1:-1]:
        gap = np.hypot(
            (latitude - math.radians(point[0])) * 6.37e6, (longitude - math.radians(point[1])) * 4.33e6
        ).min()
        assert gap < 0.5 * radius
    # no jump of place or velocity where segments meet
    assert np.abs(np.diff(states, axis=0)[:, 3:]).max() < 1.01 * 200 * math.radians(1.5)


def test_waypoints_on_one_great_circle_are_a_great_circle():
    circle_ = path(GreatCircle(47, 10, 3000, 60, 250), "earth_fixed", duration=2000.0)
    places = [ecef_to_geodetic(circle_(t)[:3]) for t in (0.0, 700.0, 1500.0)]
    mover = Waypoints(points_deg=[np.degrees(p[:2]).tolist() for p in places], height_m=3000, speed_mps=250)
    way = path(mover, "earth_fixed", duration=2000.0)
    for t in (0.0, 650.0, 705.0, 1900.0):
        np.testing.assert_allclose(way(t), circle_(t), atol=1e-3)


@pytest.mark.parametrize(
    ("mover", "frame", "said"),
    [
        (
            Waypoints(points_km=[[0, 0], [1, 1]]),
            "earth_fixed",
            "target.points_km: it is not allowed in frame earth_fixed",
        ),
        (Waypoints(points_deg=WAY), "local", "target.points_deg: it is not allowed in frame local; points_km"),
        (Waypoints(points_deg=WAY[:1]), "earth_fixed", "target.points_deg: 1 are given; at least 2 are needed"),
        (Waypoints(points_deg=[[91, 0], [0, 0]]), "earth_fixed", "target.points_deg.0: latitude 91 is not allowed"),
        (Waypoints(points_deg=[[1, 2, 3], [0, 0]]), "earth_fixed", "target.points_deg.0: [1, 2, 3] is not allowed"),
        (Waypoints(points_deg=[WAY[0], WAY[0]]), "earth_fixed", "target: waypoints: 0 and 1 are equal"),
        (Waypoints(points_deg=[[0, 0], [0, 180]]), "earth_fixed", "target: waypoints: 0 and 1 are equal or opposite"),
        (
            Waypoints(points_deg=[[0, 0], [0, 1], [0, 0]]),
            "earth_fixed",
            "target: waypoints: at 1 the course is reversed",
        ),
        (ROCKET, "local", "target: !Rocket is not allowed in frame local; !Fixed, !Straight, !Waypoints, !Platform"),
    ],
)
def test_bad_waypoints_are_refused_in_one_line(mover, frame, said):
    with pytest.raises(UserError) as caught:
        path(mover, frame)
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


# ---------------------------------------------------------------------------------------------------- !Rocket


def test_rocket_obeys_newton_about_the_earths_centre():
    """It starts on the ellipsoid; coasting above the air its inertial acceleration is that of a point mass."""
    at = path(ROCKET, "earth_fixed")
    latitude, longitude, height = ecef_to_geodetic(at(0.0)[:3])
    np.testing.assert_allclose(np.degrees([latitude, longitude]), [38.85, 111.61], atol=1e-9)
    assert abs(height) < 1e-6 and np.abs(at(0.0)[3:]).max() < 1e-9
    inertial, t, step = path(ROCKET, "inertial"), 263.7, 0.2  # between cut-off and the next ignition, over 100 km up
    pull = (inertial(t + step)[3:] - inertial(t - step)[3:]) / (2 * step)
    place = inertial(t)[:3]
    gravity = -CONSTANTS.mu * place / np.linalg.norm(place) ** 3
    # air at 130 km: below 1e-4 m/s^2
    np.testing.assert_allclose(pull, gravity, atol=1e-3)
    np.testing.assert_allclose(inertial_to_earth_fixed(inertial(t), t), at(t), atol=1e-6)
    east, north, _ = enu_rotation(latitude, longitude) @ (at(60.0)[:3] - at(0.0)[:3])
    assert north < 0 and abs(math.degrees(math.atan2(east, north)) % 360 - 190) < 3  # yaw and Coriolis


def test_a_rocket_that_falls_is_refused_in_one_line():
    for change, said in [
        ({"stages": []}, "target.stages"),
        (
            {"pitch_times_s": [0.0, 20.0, 400.0], "pitch_deg": [90.0, -30.0, -30.0]},
            "target: it falls back to the ground",
        ),
        ({"payload_t": 500.0}, "target.stages.0.thrust_kn: 3.255e+06 N is not allowed"),
    ]:
        mover = Rocket(**{**{name: getattr(ROCKET, name) for name in vars(ROCKET)}, **change})
        with pytest.raises(UserError) as caught:
            path(mover, "earth_fixed")
        assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


def test_seven_stations_follow_a_rocket_by_its_beacon():
    """Range rates alone, the oscillator's error and its drift among the unknowns."""
    builder, trials = DiagramBuilder(), 20
    built = SYSTEM.build(builder, SCENARIO, ["ukf"], trials)
    ukf = built.estimators["ukf"]
    ports = {"truth": built.truth, "estimate": ukf.GetOutputPort("estimate")}
    ports["covariance"] = ukf.GetOutputPort("covariance")
    recorder = record(builder, ports, built.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(1, 0))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(SCENARIO.duration_s)
    times, logs = recorder.result(context)
    error = logs["estimate"] - logs["truth"]
    assert np.isfinite(logs["estimate"]).all() and times[-1] == 380.0
    rms = np.sqrt((error[..., :3] ** 2).sum(-1).mean(1))
    told = np.sqrt(
        np.trace(logs["covariance"].reshape(len(times), trials, 7, 7)[..., :3, :3], axis1=2, axis2=3).mean(1)
    )
    late = times > 150
    # Thrust is not white noise: of the covariance's order, but for the ignitions not far from it.
    ratio = np.median((rms / told)[late])
    assert 0.4 < ratio < 1.6 and (rms / told)[late].max() < 3
    assert rms[late].max() < 60
    bias = np.abs(error[late, :, 6]).mean()
    assert bias < 1.0 < abs(logs["truth"][-1, :, 6]).mean()
