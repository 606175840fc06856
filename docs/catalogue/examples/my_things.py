"""Classes of one's own for own_classes.yaml: a target, a measurement, a motion, a filter and a part."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import LeafSystem

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.signals import Constant


class Circle(LeafSystem):
    """A target that flies a circle about the origin, 900 m high."""

    def __init__(self, radius_m=1000.0, speed_mps=50.0):
        super().__init__()
        self.radius, self.speed = radius_m, speed_mps
        self.DeclareVectorOutputPort("state", 6, self._state)

    def _state(self, context, output):
        angle = self.speed / self.radius * context.get_time()
        c, s = np.cos(angle), np.sin(angle)
        place = [self.radius * c, self.radius * s, 900.0]
        output.SetFromVector([*place, -self.speed * s, self.speed * c, 0.0])


class SlantRange(MeasurementModel):
    """The distance to one platform; its Jacobian is made by central differences."""

    def __init__(self, row, sigma_m=10.0):
        self.names, self.units, self.sigma = (row,), ("m",), sigma_m

    def predict(self, target, platforms):
        """Return the range."""
        return np.linalg.norm(target[..., :3] - platforms[..., 0, :3], axis=-1)[..., None]

    def noise_covariance(self):
        """Return R."""
        return np.eye(1) * self.sigma**2


class Calm(WhiteNoiseAcceleration):
    """A motion of one's own."""


@dataclass(frozen=True)
class Cautious(IteratedExtendedKalman):
    """An iterated filter that believes every measurement to be a bit worse than it is said to be."""

    inflation: float = 1.1

    def update(self, mean, covariance, observation, model):
        """Update with a noise covariance that is larger by the factor."""
        wider = observation.with_noise(self.inflation * observation.noise_covariance)
        return super().update(mean, covariance, wider, model)


def count_rows(bus):
    """Put a block on the bus that says how many rows the measurement has."""
    bus.add(Constant("counted", [float(bus.shape("measurement")[1])]))
