"""The drone of drone.yaml, in Python: the same blocks under the same names, and so the same numbers."""

from dataclasses import dataclass, field

import numpy as np

from quietfix.diagrams import System
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.parts.movers import Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.clocks import Merged, Periodic
from quietfix.systems.measurement.component import Component
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.plants.joined import Joined
from quietfix.systems.plants.path import Path
from quietfix.systems.registry import estimator_options
from quietfix.systems.sensors.prior import PriorEstimate
from quietfix.systems.signals import Constant
from quietfix.systems.starts.start import PortStart
from quietfix.systems.trajectories.waypoints import WaypointPath

NAMES = ("alpha", "bravo", "charlie", "delta")
PLACES = np.array([[-8e3, -5e3, 30], [9e3, -4e3, 120], [1e3, 9e3, 60], [0, 0, 5]])
POINTS = np.array([[-5e3, 2e3], [0, 3e3], [2e3, -6e3]])
STATES = ("x", "y", "z", "vx", "vy", "vz")


@dataclass
class Scenario:
    sigma_tdoa_ns: float = 30.0
    sigma_bearing_deg: float = 0.5
    sigma_height_m: float = 30.0
    density_m2ps3: float = 1.0
    sigma_position_m: float = 800.0
    sigma_velocity_mps: float = 30.0
    duration_s: float = 200.0
    estimators: dict[str, estimator_options()] = field(
        default_factory=lambda: {"ekf": Ekf(), "iekf": Iekf(), "ukf": Ukf()}
    )


def sensors_of(scenario):
    tdoa = Tdoa(scenario.sigma_tdoa_ns * 1e-9, receivers=[0, 1, 2], reference=3)
    tdoa.names = tuple(f"tdoa_{name}_delta" for name in NAMES[:3])
    bearing = Bearing(np.radians(scenario.sigma_bearing_deg), None, 0)
    bearing.names = ("azimuth_alpha",)
    height = Component(2, scenario.sigma_height_m, "altitude", "m")
    return {
        "tdoa": (tdoa, Periodic(1.0)),
        "bearing": (bearing, Periodic(4.0, 2.0)),
        "barometer": (height, Periodic(5.0)),
    }


def flight(bus):
    way = WaypointPath(POINTS, 45.0, np.radians(3.0), 900.0)
    bus.add(Path(way.at, "target"), gives={"target": "state", "truth": "state"})


def together(bus):
    shapes = {name: bus.shape(name) for name in ("tdoa", "bearing", "barometer")}
    bus.add(Joined(shapes, "measurements"), gives={"measurement": "state"})


def declare(scenario):
    sensors = sensors_of(scenario)
    stack = Stack([model for model, _ in sensors.values()])
    clock = Merged([ticks for _, ticks in sensors.values()])
    motion = WhiteNoiseAcceleration(scenario.density_m2ps3)
    spread = np.diag(np.square([scenario.sigma_position_m] * 3 + [scenario.sigma_velocity_mps] * 3))

    def prior(bus):
        block = PriorEstimate(spread, bus.trials, bus.shape("target")[0])
        bus.add(block, gives={"initial_estimate": "initial_estimate"})

    stations = np.pad(PLACES, [(0, 0), (0, 3)]).reshape(1, -1)
    parts = [Platforms(lambda: Constant("carriers", stations)), flight]
    parts += [TargetSensor(name, model, ticks) for name, (model, ticks) in sensors.items()]
    parts += [together, prior]

    def assume(bus, name, options):
        return Assumed(stack, motion, PortStart(spread), stack.names)

    return Model(
        clock,
        scenario.duration_s,
        5000.0,
        parts,
        assume,
        platforms=NAMES,
        frame="local",
        truth_states=STATES,
        rows=stack.names,
    )


DRONE = System("drone", "four stations, a direction finder and a barometer hear a drone", Scenario, declare)
