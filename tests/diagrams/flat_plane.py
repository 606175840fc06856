"""Stations on a plane and an emitter at rest near it, ranged ten times: the height enters by its square."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.movers import ModelTarget, Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.signals import Constant
from quietfix.systems.starts.start import GivenStart

POSITION = (3e3, 4e3)
STATIONS = np.array([[[0.0, 0, 0, 0, 0, 0], [9e3, -1e3, 0, 0, 0, 0], [2e3, 9e3, 0, 0, 0, 0]]])


class Ranges3(MeasurementModel):
    """Distances in space."""

    names = tuple(f"range_{i}" for i in range(STATIONS.shape[1]))
    units = ("m",) * len(names)

    def predict(self, target, platforms):
        return np.linalg.norm(target[..., None, :3] - platforms[..., :3], axis=-1)

    def jacobian(self, target, platforms):
        offset = target[..., None, :3] - platforms[..., :3]
        return offset / np.linalg.norm(offset, axis=-1, keepdims=True)

    def noise_covariance(self):
        return 10.0**2 * np.eye(self.size)


@dataclass
class Scenario:
    height_m: float = 20.0
    prior: Any = None
    duration_s: float = 10.0
    period_s: float = 1.0
    estimators: dict[str, Any] = field(default_factory=lambda: {"iekf": Iekf()})


def declare(scenario):
    clock, motion, model = Periodic(scenario.period_s), Stationary(3), Ranges3()
    prior = np.diag([1e3**2, 1e3**2, 30.0**2]) if scenario.prior is None else scenario.prior
    mean = np.array([*POSITION, scenario.height_m])
    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=1e4,
        parts=[
            Platforms(lambda: Constant("stations", STATIONS.reshape(1, -1))),
            ModelTarget(motion, clock, mean, np.zeros((3, 3)), shared=True),
            TargetSensor("sensor", model, clock, gives=["measurement"]),
        ],
        assume=lambda bus, name, options: Assumed(model, motion, GivenStart(mean, prior), model.names),
        truth_motion=motion,
        frame="local",
    )


SYSTEM = System("flat_plane", "ranges along the ground", Scenario, declare)
