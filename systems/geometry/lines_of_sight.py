"""Lines of sight from platforms to a target; what TDOA, FDOA, phase and range rate have in common."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["LineOfSight", "line_of_sight", "pad"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineOfSight:
    """Range, direction and relative velocity; the leading axes are those of target and platforms broadcast.

    Attributes
    ----------
    distance : ndarray, shape (..., p)
        Range from platform to target [m].
    direction : ndarray, shape (..., p, 3)
        Unit vector from platform to target.
    relative_velocity : ndarray, shape (..., p, 3)
        Velocity of the target minus that of the platform [m/s].
    """

    distance: Array
    direction: Array
    relative_velocity: Array

    @cached_property
    def range_rate(self) -> Array:
        """Rate of change of the range [m/s], shape (..., p)."""
        return np.einsum("...i,...i->...", self.direction, self.relative_velocity)

    @cached_property
    def range_rate_gradient(self) -> Array:
        r"""Derivative of the range rate with respect to the target's position [1/s], shape (..., p, 3).

        :math:`\partial\dot r/\partial p = (I - u u^T)\,(v - v_s)/r`; with respect to its velocity it is u.
        """
        along = self.range_rate[..., None] * self.direction
        return (self.relative_velocity - along) / self.distance[..., None]


def line_of_sight(target: Array, platforms: Array) -> LineOfSight:
    """Return the `LineOfSight` of target (..., n >= 6) from platforms (..., p, 6)."""
    difference = target[..., None, :6] - platforms
    offset = difference[..., :3]
    distance = np.sqrt(np.einsum("...i,...i->...", offset, offset))
    return LineOfSight(distance, offset / distance[..., None], difference[..., 3:])


def pad(jacobian: Array, size: int) -> Array:
    """Append zero columns up to `size`: the model does not depend on further states (biases, drifts)."""
    missing = size - jacobian.shape[-1]
    if missing == 0:
        return jacobian
    return np.concatenate([jacobian, np.zeros((*jacobian.shape[:-1], missing))], axis=-1)
