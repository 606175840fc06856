"""A system whose estimators have other states than the truth: in another order, larger, smaller."""

from dataclasses import dataclass, field

import numpy as np

from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.movers import ModelTarget, Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.signals import Constant
from quietfix.systems.starts.start import GivenStart

TRUTH = ("x", "vx", "y", "vy")
STATES = {
    "usual": ("x", "y", "vx", "vy"),
    "turned": ("vy", "x", "vx", "y"),
    "biased": ("bias", "x", "y", "vx", "vy"),
    "still": ("y", "x"),
}
START = {"x": (3e3, 80.0), "y": (4e3, 120.0), "vx": (20.0, 6.0), "vy": (-15.0, 4.0), "bias": (0.0, 30.0)}
STATIONS = np.array([[[0.0, 0, 0, 0, 0, 0], [9e3, -1e3, 0, 0, 0, 0], [2e3, 9e3, 0, 0, 0, 0]]])
SIGMA = 10.0
WEIGHTS = {"x": 1.0, "y": 2.0, "vx": 3.0, "vy": 4.0, "bias": 5.0}


class Drift(MotionModel):
    """Constant velocities and a bias, as far as they are in the state; white noise on all of it."""

    linear = True

    def __init__(self, names, density):
        self.names, self.density = tuple(names), density
        self.units = tuple("m/s" if name.startswith("v") else "m" for name in names)

    def transition(self, state, dt):
        phi = np.eye(self.size)
        for axis in "xy":
            if {axis, "v" + axis} <= set(self.names):
                phi[self.names.index(axis), self.names.index("v" + axis)] = dt
        return phi

    def propagate(self, state, dt):
        return np.einsum("ij,...j->...i", self.transition(state, dt), state)

    def process_noise(self, state, dt):
        return np.diag([self.density * dt * WEIGHTS[name] for name in self.names])


class Ranges(MeasurementModel):
    """Distances in the plane, all with the bias that may be in the state."""

    names = tuple(f"range_{i}" for i in range(STATIONS.shape[1]))
    units = ("m",) * len(names)

    def __init__(self, states):
        self.states = list(states)
        self.place = [self.states.index(axis) for axis in "xy"]

    def linearize(self, target, platforms):
        offset = target[..., None, self.place] - platforms[..., :2]
        distance = np.linalg.norm(offset, axis=-1)
        jacobian = np.zeros((*distance.shape, target.shape[-1]))
        jacobian[..., self.place] = offset / distance[..., None]
        if "bias" in self.states:
            jacobian[..., self.states.index("bias")] = 1.0
            distance = distance + target[..., [self.states.index("bias")]]
        return distance, jacobian

    def predict(self, target, platforms):
        return self.linearize(target, platforms)[0]

    def jacobian(self, target, platforms):
        return self.linearize(target, platforms)[1]

    def noise_covariance(self):
        return SIGMA**2 * np.eye(self.size)


def belief(names):
    """Mean and covariance of the start, by names."""
    mean, sigma = np.array([START[name] for name in names]).T
    return mean, np.diag(sigma**2)


@dataclass
class Scenario:
    duration_s: float = 10.0
    period_s: float = 1.0
    density: float = 0.0
    speechless: bool = False
    estimators: dict[str, object] = field(default_factory=lambda: {name: Named(name) for name in STATES})


@dataclass
class Named:
    """Makes an estimator of the states of its name."""

    name: str

    def make(self, name, model, motion, start, wiring):
        return KalmanEstimator(name, IteratedExtendedKalman(1), model, motion, start, wiring)


def declare(scenario):
    clock, true = Periodic(scenario.period_s), Drift(TRUTH, scenario.density)

    def assume(bus, name, options):
        own = STATES[name]
        start = GivenStart(*belief(own))
        if scenario.speechless and name == "biased":
            start.covariance_at = lambda *_: None
        return Assumed(Ranges(own), Drift(own, 0.5), start, Ranges.names)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=1e4,
        parts=[
            Platforms(lambda: Constant("stations", STATIONS.reshape(1, -1))),
            ModelTarget(true, clock, *belief(TRUTH)),
            TargetSensor("sensor", Ranges(TRUTH), clock, gives=["measurement"]),
        ],
        assume=assume,
        truth_motion=true,
        frame="local",
    )


SYSTEM = System("named_states", "states by name", Scenario, declare)
