"""The rocket: printed states of an independent prototype, an independent integration, its events."""

import math
from itertools import pairwise

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.integrate import solve_ivp

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.parts.launch import rocket_model
from quietfix.systems.clocks import Periodic
from quietfix.systems.plants.rocket import Rocket
from quietfix.systems.recorder import record
from quietfix.systems.trajectories.rocket import LaunchSite, RocketModel, Stage


@pytest.fixture(scope="module")
def model():
    return rocket_model(load_scenario("beacon_rocket"))


@pytest.fixture(scope="module")
def plant(model):
    return Rocket(model, 310.0)


PRINTED = [  # t, h km, X km, |v| m/s, |a|: as many digits as the prototype printed
    (50.0, 4.66, 1.2, 238, 8.50, (6.26, 5.74, -0.08)),
    (100.0, 23.3, 19.0, 903, 20.64, (19.10, 7.83, -0.21)),
    (149.9, 62.7, 86.4, 2425, 46.12, (44.00, 13.82, -0.45)),
    (200.0, 114.1, 212.7, 3054, 18.71, None),
    (250.0, 163.5, 385.4, 4146, 29.18, None),
    (261.9, 175.6, 436.1, 4506, 33.48, None),
    (300.0, 211.4, 608.6, 4641, 9.81, None),
]


@pytest.mark.parametrize("row", PRINTED, ids=lambda row: f"{row[0]:g} s")
def test_states_are_the_printed_ones(row, plant, model):
    time, height, down, speed, size, acceleration = row
    state, a = plant.at(time)
    digits = {4.66: 0.005}.get(height, 0.05)
    assert abs(model.site.height(state[:3]) / 1e3 - height) <= digits + 1e-3  # half of the last digit, and 1 m
    assert abs(state[0] / 1e3 - down) <= 0.05 + 1e-3
    assert abs(np.linalg.norm(state[3:]) - speed) <= 0.5 + 0.01
    assert abs(np.linalg.norm(a) - size) <= 0.005 + 1e-3
    if acceleration is not None:
        np.testing.assert_allclose(a, acceleration, atol=0.006)


def test_jumps_are_the_printed_ones(plant):
    np.testing.assert_allclose(plant.at(150.5)[1], [-0.11, -9.66, 0.32], atol=0.006)
    np.testing.assert_allclose(plant.at(152.5)[1], [12.89, -2.88, 0.09], atol=0.006)
    np.testing.assert_allclose(plant.at(263.0)[1][:2], [-0.59, -9.34], atol=0.006)
    np.testing.assert_allclose(plant.at(266.0)[1][:2], [4.82, -8.22], atol=0.006)


@pytest.mark.parametrize("method", ["Radau", "LSODA"])
def test_an_independent_integration_agrees(method, model, plant):
    """Another method, written here from event to event, with other equations of motion: inertial, not rotating."""
    site = model.site
    omega = site.rotation
    spin = np.linalg.norm(omega)
    axis = omega / spin

    def turn(vector, angle):
        c, s = math.cos(angle), math.sin(angle)
        return vector * c + np.cross(axis, vector) * s + axis * (axis @ vector) * (1 - c)

    def motion(t, x, middle):
        # x: inertial position from the centre, and velocity, in the launch axes at t = 0
        d, v = turn(x[:3], -spin * t), turn(x[3:] - np.cross(omega, x[:3]), -spin * t)
        r = np.linalg.norm(d)
        h, speed = r - site.radius, np.linalg.norm(v)
        i = model.stage(middle)
        stage = model.stages[i]
        thrust = model.throttle(t, middle) * (stage.thrust - 101325 * math.exp(-h / 7000) * stage.nozzle_area)
        cd = 0.3 + 0.35 * math.exp(-(((speed / 300 - 1.1) / 0.35) ** 2))
        drag = 0.5 * 1.225 * math.exp(-h / 7200) * speed * cd * 8.8
        force = (thrust * model.direction(t) - drag * v) / model.mass(t, middle)
        return np.concatenate([x[3:], turn(force, spin * t) - 3.986004418e14 * x[:3] / r**3])

    start = np.array([0.0, site.radius, 0.0])
    x = np.concatenate([start, np.cross(omega, start)])
    knots = [0.0, *(t for t in model.events() if 0 < t < 300), 300.0]
    for a, b in pairwise(knots):
        x = solve_ivp(motion, (a, b), x, method=method, rtol=1e-9, atol=1e-4, args=(0.5 * (a + b),)).y[:, -1]
    position = turn(x[:3], -spin * 300.0) - [0.0, site.radius, 0.0]
    velocity = turn(x[3:] - np.cross(omega, x[:3]), -spin * 300.0)
    state = plant.at(300.0)[0]
    assert np.linalg.norm(position - state[:3]) < 0.1
    assert np.linalg.norm(velocity - state[3:]) < 1e-3


def test_velocity_and_acceleration_are_the_derivatives(plant):
    for time in (20.0, 66.6, 149.0, 150.6, 151.5, 199.5, 230.0, 262.1, 280.0):
        h = 1e-3
        before, after = plant.at(time - h)[0], plant.at(time + h)[0]
        np.testing.assert_allclose((after - before)[:3] / (2 * h), plant.at(time)[0][3:], atol=2e-4)
        np.testing.assert_allclose((after - before)[3:] / (2 * h), plant.at(time)[1], atol=5e-3)


def test_acceleration_jumps_where_masses_are_dropped_and_bends_elsewhere(plant):
    step = plant.at(200.0)[1] - plant.at(200.0 - 1e-9)[1]
    assert 0.5 < np.linalg.norm(step) < 2.0  # the fairing, 1.5 t of 30 t under 27 m/s^2 of thrust
    for time in (150.0, 150.2, 152.0, 262.0, 265.2):
        np.testing.assert_allclose(plant.at(time)[1], plant.at(time - 1e-9)[1], atol=1e-4)


def test_the_sample_grid_changes_nothing(model):
    """Jumps are exact whatever the grid: 0.05 s and 7 s give the same states, bit for bit."""
    seen = {}
    for period in (0.05, 7.0):
        builder = DiagramBuilder()
        plant = builder.AddSystem(Rocket(model, 300.0))
        recorder = record(builder, {p: plant.GetOutputPort(p) for p in ("state", "stage")}, Periodic(period, 147.0))
        diagram = builder.Build()
        simulator = Simulator(diagram)
        simulator.Initialize()
        simulator.AdvanceTo(210.0)
        times, log = recorder.result(simulator.get_context())
        rows = zip(times, log["state"][:, 0], log["stage"][:, 0, 0], strict=True)
        seen[period] = {round(t, 6): (s, g) for t, s, g in rows}
    for time, (state, stage) in seen[7.0].items():
        np.testing.assert_allclose(seen[0.05][time][0], state, rtol=0, atol=1e-6)  # the clocks' ticks differ by ulps
        assert seen[0.05][time][1] == stage == (time >= 151.0)


def test_mass_and_staging(model):
    assert model.mass(0.0) == pytest.approx(239010.0)
    assert model.mass(150.0) == pytest.approx(239010.0 - 174000.0)
    assert model.mass(151.0) == pytest.approx(4500 + 29810 + 2000 + 14200 + 2000 + 1500)
    assert model.mass(201.0) == pytest.approx(model.mass(199.0) - 1500 - 2 * 271)
    assert [model.stage(t) for t in (0.0, 150.9, 151.0, 262.9, 263.0)] == [0, 0, 1, 1, 2]


def test_launch_frame():
    site = LaunchSite(math.radians(38.85), math.radians(111.61), math.radians(190.0))
    np.testing.assert_allclose(site.axes @ site.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(site.axes) == pytest.approx(1.0)
    np.testing.assert_allclose(site.from_geodetic(site.latitude, site.longitude, 0.0), 0.0, atol=1e-8)
    place = site.from_track(300e3, -40e3, 500.0)
    assert site.height(place) == pytest.approx(500.0)
    assert place[0] > 0 > place[2]
    # 190 deg is a little west of south, and +Z to the right of it: west
    south = site.from_geodetic(site.latitude - 0.01, site.longitude, 0.0)
    west = site.from_geodetic(site.latitude, site.longitude - 0.01, 0.0)
    assert south[0] > 0 and west[2] > 0
    np.testing.assert_allclose(np.linalg.norm(site.rotation), site.earth_rate)
    np.testing.assert_allclose(site.rotation[1], site.earth_rate * math.sin(site.latitude))


FIRST = Stage(11e3, 174e3, 3.255e6, 1160.0, 0.0, 150.0, 2.9)
SECOND = Stage(4.5e3, 29.81e3, 0.79e6, 271.0, 152.0, 262.0)


@pytest.mark.parametrize(
    ("stages", "message"),
    [
        ([], "none is given"),
        ([FIRST, Stage(4.5e3, 29.81e3, 0.79e6, 271.0, 149.0, 255.0)], "overlap"),
        ([Stage(11e3, 174e3, 3.255e6, 1160.0, 0.0, 151.0)], "propellant"),
        ([Stage(11e3, 174e3, 1e6, 1160.0, 0.0, 150.0)], "less than gravity"),
        ([Stage(-1.0, 174e3, 3.255e6, 1160.0, 0.0, 150.0)], "dry_mass"),
        ([FIRST, Stage(4.5e3, 29.81e3, 0.79e6, 271.0, 152.0, 151.0)], "not after ignition"),
    ],
)
def test_what_is_not_allowed(stages, message):
    with pytest.raises(ValueError, match=message):
        RocketModel(LaunchSite(0.6, 0.0, 0.0), stages, 2e3, 1.5e3, 200.0, [0.0, 400.0], np.radians([90.0, 0.0]))


def test_a_rocket_that_falls_back_is_refused():
    model = RocketModel(
        LaunchSite(0.6, 0.0, 0.0), [FIRST], 2e3, 1.5e3, 200.0, [0.0, 20.0, 400.0], np.radians([90.0, -30.0, -30.0])
    )
    with pytest.raises(ValueError, match="falls back"):
        Rocket(model, 140.0)
