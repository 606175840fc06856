"""An aircraft that ranges four ground beacons: a packaged system in one file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.movers import ModelTarget, Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.documented import documented, number
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.measurement.distance import Range
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.signals import Constant
from quietfix.systems.starts.start import GivenStart

__all__ = ["SYSTEM", "Scenario", "declare"]

_BEACONS = np.pad([[0.0, 0, 0], [9e3, -1e3, 0], [2e3, 9e3, 50], [-5e3, 4e3, 900]], [(0, 0), (0, 3)])
_MEAN, _COVARIANCE = np.array([3e3, 4e3, 1e3, 20, -15, 0]), np.diag([1e4, 1e4, 1e4, 25, 25, 25.0])


@dataclass
class Scenario:
    """Four beacons and an aircraft."""

    sigma_m: float = number("standard deviation of a range [m]", 10.0, above=0)
    duration_s: float = number("length of a run [s]", 20.0, above=0)
    period_s: float = number("time between ranges [s]", 1.0, above=0)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=lambda: {"iekf": Iekf()})


def declare(scenario: Scenario) -> Model:
    """Return beacons, aircraft and what the estimators are given."""
    clock, motion, ranges = Periodic(scenario.period_s), ConstantVelocity(0.1), Range(scenario.sigma_m, range(4))
    parts = [
        Platforms(lambda: Constant("beacons", _BEACONS.reshape(1, -1))),
        ModelTarget(motion, clock, _MEAN, _COVARIANCE),
        TargetSensor("sensor", ranges, clock, gives=["measurement"]),
    ]

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        return Assumed(ranges, motion, GivenStart(_MEAN, _COVARIANCE), ranges.names)

    names = ["centre", "east", "north", "west"]
    return Model(clock, scenario.duration_s, 1e4, parts, assume, truth_motion=motion, platforms=names, frame="local")


SYSTEM = System(
    name="radio_beacons",
    title="an aircraft ranges four ground beacons",
    scenario=Scenario,
    declare=declare,
    variants={"noisy": {"sigma_m": 50.0}},
)
