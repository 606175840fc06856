"""Cone angles as a kind of measurement: what a line array along its carrier's course hears."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.kinds.by_platform import AtStations
from quietfix.diagrams.paths.places import Places
from quietfix.systems.documented import number
from quietfix.systems.geometry.lines_of_sight import LineOfSight
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.measurement.sighted import SightedModel

__all__ = ["ConeAngle", "ConeAngleModel"]

Array = NDArray[np.float64]


class ConeAngleModel(SightedModel):
    r"""Angle between the line of sight u and the direction v of a platform's velocity, in the axes of the states.

    .. math:: \theta = \operatorname{atan2}(|w|,\ u \cdot v), \qquad w = v - (u \cdot v)\,u, \qquad
              \frac{\partial\theta}{\partial p} = -\frac{w}{|w|\,r}

    for :math:`\cos\theta = u \cdot v` and :math:`\partial u/\partial p = (I - u u^T)/r`. Dead ahead and astern
    :math:`w = 0` and there is no derivative: such a row is missing, and so is that of a platform at rest.

    Parameters
    ----------
    sigma : float
        Standard deviation [rad].
    stations : sequence of int
        Platforms that measure.
    """

    def __init__(self, sigma: float, stations: Sequence[int]) -> None:
        self.sigma = positive(sigma, "sigma_cone_angle", "rad")
        self.stations = list(stations)
        self.names = tuple(f"cone_angle_{i}" for i in self.stations)
        self.units = ("rad",) * len(self.names)

    def predict_from(self, sight: LineOfSight, platforms: Array) -> Array:
        """See `SightedModel.predict_from`."""
        return self.linearize_from(sight, platforms, 3)[0]

    def linearize_from(self, sight: LineOfSight, platforms: Array, size: int) -> tuple[Array, Array]:
        """See `SightedModel.linearize_from`."""
        velocity = platforms[..., self.stations, 3:]
        with np.errstate(invalid="ignore", divide="ignore"):
            course = velocity / np.linalg.norm(velocity, axis=-1, keepdims=True)
            direction = sight.direction[..., self.stations, :]
            cosine = np.einsum("...i,...i->...", direction, course)
            across = course - cosine[..., None] * direction
            sine = np.linalg.norm(across, axis=-1)
            gradient = -across / (sine * sight.distance[..., self.stations])[..., None]
        jacobian = np.zeros((*gradient.shape[:-1], size))
        jacobian[..., :3] = gradient
        return np.arctan2(sine, cosine), jacobian

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used


@dataclass
class ConeAngle(AtStations):
    """Angles between the line of sight and a platform's course, as a line array along it hears them; not the side."""

    row = "cone_angle"

    sigma_deg: float = number("standard deviation [deg]", 1.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``cone_angle_PLATFORM`` [rad]."""
        return ConeAngleModel(math.radians(self.sigma_deg), self.numbers(places, where))
