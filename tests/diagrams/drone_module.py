"""A user's own system, in Python: a drone ranged by four stations. Tests copy this file and break it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from quietfix.diagrams import System
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.parts.movers import ModelTarget, Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.registry import estimator_options
from quietfix.systems.signals import Constant
from quietfix.systems.starts.start import GivenStart

PLACES = [[0.0, 0, 0], [9e3, -1e3, 0], [2e3, 9e3, 50], [-5e3, 4e3, 900]]
Estimators = estimator_options()


class Ranges(MeasurementModel):
    """Distances to the stations."""

    names = ("range_0", "range_1", "range_2", "range_3")
    units = ("m",) * 4

    def __init__(self, sigma):
        self.sigma = sigma

    def predict(self, target, platforms):
        return np.linalg.norm(target[..., None, :3] - platforms[..., :3], axis=-1)

    def jacobian(self, target, platforms):
        offset = target[..., None, :3] - platforms[..., :3]
        along = offset / np.linalg.norm(offset, axis=-1, keepdims=True)
        return np.concatenate([along, np.zeros_like(along)], axis=-1)

    def noise_covariance(self):
        return self.sigma**2 * np.eye(4)


@dataclass
class Scenario:
    """What is simulated."""

    sigma_m: float = 10.0
    duration_s: float = 4.0
    period_s: float = 1.0
    estimators: dict[str, Estimators] = field(default_factory=lambda: {"iekf": Iekf(), "ekf": Ekf()})


def declare(scenario):
    """Return stations, drone and sensor, and what the estimators are given."""
    clock, motion, model = Periodic(scenario.period_s), ConstantVelocity(0.1), Ranges(scenario.sigma_m)
    mean, covariance = np.array([3e3, 4e3, 1e3, 20, -15, 0.0]), np.diag([1e4, 1e4, 1e4, 25, 25, 25.0])
    stations = np.pad(PLACES, [(0, 0), (0, 3)]).reshape(1, -1)

    def assume(bus, name, options):
        return Assumed(model, motion, GivenStart(mean, covariance), model.names)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=1e4,
        parts=[
            Platforms(lambda: Constant("stations", stations)),
            ModelTarget(motion, clock, mean, covariance),
            TargetSensor("sensor", model, clock, gives=["measurement"]),
        ],
        assume=assume,
        truth_motion=motion,
        frame="local",
    )


DRONE = System("drone", "a drone ranged by four stations", Scenario, declare, variants={"noisy": {"sigma_m": 50.0}})
