"""Start from a prior position that arrives on a port, velocity zero with a wide spread."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.measurement.base import positive
from quietfix.systems.starts.start import Start

__all__ = ["PriorPositionStart"]

Array = NDArray[np.float64]

_PORT = "prior_position"


class PriorPositionStart(Start):
    r"""Belief N([prior position, 0], diag(sigma_position^2, sigma_velocity^2)).

    The prior comes on the port ``prior_position``: connect a sensor with a `Position` model.

    .. math:: x_0 = (\bar p,\ 0), \qquad P_0 = \mathrm{diag}(\sigma_p^2 I,\ \sigma_v^2 I)

    Parameters
    ----------
    sigma_position : float
        Standard deviation of the prior position per axis [m].
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].
    again : Start, optional
        See `Start`.
    """

    def __init__(self, sigma_position: float, sigma_velocity: float, again: Start | None = None) -> None:
        sigmas = [positive(sigma_position, "sigma_position", "m")] * 3
        sigmas += [positive(sigma_velocity, "sigma_velocity", "m/s")] * 3
        self._covariance = np.diag(np.square(sigmas))
        self.again = again

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {_PORT: 3, **(self.again.inputs if self.again else {})}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        position = inputs[_PORT]
        mean = np.concatenate([position, 0.0 * position], axis=-1)
        return mean, np.broadcast_to(self._covariance, (mean.shape[0], 6, 6))

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the start, shape (..., 6, 6)."""
        return np.broadcast_to(self._covariance, (*target.shape[:-1], 6, 6))
