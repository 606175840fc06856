"""Azimuth and elevation over the horizon of an Earth-fixed platform."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation
from quietfix.systems.kernels.equations import Equations, of_kernel

__all__ = ["HorizonBearing"]

Array = NDArray[np.float64]


class HorizonBearing(Bearing):
    r"""A `Bearing` in the platform's own east, north and up, of Earth-fixed states.

    With R the rotation to east-north-up at the platform (`quietfix.systems.earth.geodetic.enu_rotation`),
    :math:`\Delta = R\,(p - p_i)`; azimuth counter-clockwise from east and elevation are those of `Bearing` for
    :math:`\Delta`, and :math:`\partial z/\partial p = (\partial z/\partial\Delta)\,R`. R is the platform's: it does not
    depend on the target.

    Parameters
    ----------
    sigma, sigma_elevation, platform
        See `Bearing`.
    """

    def __init__(self, sigma: float, sigma_elevation: float | None = None, platform: int = 0) -> None:
        super().__init__(sigma, sigma_elevation, platform)

    def _turned(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """Return the offset in east, north, up (..., 3) and the rotation (..., 3, 3)."""
        place = platforms[..., self.platform, :3]
        latitude, longitude, _ = ecef_to_geodetic(place)
        rotation = enu_rotation(latitude, longitude)
        return (rotation @ (target[..., :3] - place)[..., None])[..., 0], rotation

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel(
            "angles:horizon_bearing",
            [self.platform],
            self.size,
            modulus=2 * np.pi,
            states=3,
            platforms=[self.platform],
            coordinates=3,
        )

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.modified_gain`; that of `Bearing`, turned."""
        offset, rotation = self._turned(target, platforms)
        here = np.zeros((*offset.shape[:-1], self.platform + 1, 3))
        rows = np.zeros((*np.broadcast_shapes(measured.shape[:-1], offset.shape[:-1]), self.size, target.shape[-1]))
        rows[..., :3] = super().modified_gain(measured, offset, here) @ rotation
        return rows
