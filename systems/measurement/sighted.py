"""Measurement models that are functions of lines of sight, which a stack computes once for all of them."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.geometry.lines_of_sight import LineOfSight, line_of_sight
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["SightedModel"]

Array = NDArray[np.float64]


class SightedModel(MeasurementModel):
    """A model whose `predict` and `jacobian` follow from `LineOfSight`.

    Attributes
    ----------
    shares_sight : bool
        False where this instance needs more than the geometry of one instant; a stack then calls `linearize`.
    """

    shares_sight: bool = True

    @abstractmethod
    def predict_from(self, sight: LineOfSight, platforms: Array) -> Array:
        """Return the noise-free measurement, shape (..., m)."""

    @abstractmethod
    def linearize_from(self, sight: LineOfSight, platforms: Array, size: int) -> tuple[Array, Array]:
        """Return measurement and Jacobian, (..., m) and (..., m, size)."""

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self.predict_from(line_of_sight(target, platforms), platforms)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        return self.linearize_from(line_of_sight(target, platforms), platforms, target.shape[-1])
