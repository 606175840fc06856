"""Bearings from a moving platform in a local Cartesian frame: azimuth, and elevation where there is one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["Bearing", "from_compass", "to_compass"]

Array = NDArray[np.float64]


def from_compass(degrees: Array | float) -> Array:
    """Return the azimuth [rad], counter-clockwise from east, in [-pi, pi), of a bearing clockwise from north [deg]."""
    return wrap(np.pi / 2 - np.radians(degrees))


def to_compass(azimuth: Array | float) -> Array:
    """Return the bearing clockwise from north [deg], in [0, 360), of an azimuth counter-clockwise from east [rad]."""
    return np.mod(90.0 - np.degrees(azimuth), 360.0)


class Bearing(CompiledModel):
    r"""Direction of a target: azimuth counter-clockwise from x (east), and elevation above the x-y plane.

    .. math:: \theta = \operatorname{atan2}(\Delta y, \Delta x), \qquad
              \varepsilon = \operatorname{atan2}(\Delta z, \rho), \qquad \rho = \sqrt{\Delta x^2 + \Delta y^2}

    The target's state begins with its position; platforms carry theirs first, and as many coordinates as the target
    has (further ones are not read). Under or over the platform, where there is no azimuth, the row is NaN.

    Parameters
    ----------
    sigma : float
        Standard deviation of the azimuth [rad].
    sigma_elevation : float, optional
        Standard deviation of the elevation [rad]; the state then needs x, y and z.
    platform : int
        Which platform takes the bearing.
    """

    def __init__(self, sigma: float, sigma_elevation: float | None = None, platform: int = 0) -> None:
        self.sigma = positive(sigma, "sigma_bearing", "rad")
        self.sigma_elevation = None if sigma_elevation is None else positive(sigma_elevation, "sigma_elevation", "rad")
        self.platform = platform
        self.names = ("azimuth",) if sigma_elevation is None else ("azimuth", "elevation")
        self.units = ("rad",) * len(self.names)
        self._axes = 2 if sigma_elevation is None else 3

    def _offset(self, target: Array, platforms: Array) -> Array:
        return target[..., : self._axes] - platforms[..., self.platform, : self._axes]

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel(
            "angles:bearing",
            [self.platform],
            self.size,
            modulus=2 * np.pi,
            states=self._axes,
            platforms=[self.platform],
            coordinates=self._axes,
        )

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        r"""Return the modified gain g: for a measurement without noise it makes the linear relation exact.

        .. math:: h(x) - h(\hat x) = g(z, \hat x)\,(x - \hat x) \quad\text{for}\quad z = h(x).

        Song and Speyer, *A stochastic analysis of a modified gain extended Kalman filter with applications to
        estimation with bearings only measurements*, IEEE Trans. Automatic Control 30 (1985) 940-949. Derived here:
        with :math:`n = [-\sin\theta, \cos\theta]` one has :math:`n\,(p - \hat p) = \hat\rho\sin(\theta - \hat\theta)`.

        Parameters
        ----------
        measured : ndarray, shape (..., m)
            z; a missing row gives NaN.
        target : ndarray, shape (..., n)
            :math:`\hat x`.
        platforms : ndarray, shape (..., p, >= 2)

        Returns
        -------
        ndarray, shape (..., m, n)
        """
        offset = self._offset(target, platforms)
        x, y = offset[..., 0], offset[..., 1]
        ground = np.hypot(x, y)
        azimuth = measured[..., 0]
        turned = wrap(azimuth - np.arctan2(y, x))
        rows = np.zeros((*np.broadcast_shapes(azimuth.shape, x.shape), self.size, target.shape[-1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (ground * _sinc(turned))
            rows[..., 0, 0] = -np.sin(azimuth) * scale
            rows[..., 0, 1] = np.cos(azimuth) * scale
            if self.size == 2:
                # First turned into the vertical plane of the measured azimuth, then raised in it.
                z, elevation = offset[..., 2], measured[..., 1]
                along = ground * np.cos(turned)
                middle = np.arctan2(z, along)
                raised = wrap(elevation - middle)
                scale = 1 / (np.hypot(along, z) * _sinc(raised))
                rows[..., 1, 0] = -np.sin(elevation) * np.cos(azimuth) * scale
                rows[..., 1, 1] = -np.sin(elevation) * np.sin(azimuth) * scale
                rows[..., 1, 2] = np.cos(elevation) * scale
                sideways = middle - np.arctan2(z, ground)
                slope = np.where(np.abs(turned) > 1e-8, sideways / np.where(turned == 0, 1.0, turned), 0.0)
                rows[..., 1, :2] += slope[..., None] * rows[..., 0, :2]
        return rows

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        sigmas = [self.sigma] if self.sigma_elevation is None else [self.sigma, self.sigma_elevation]
        return np.diag(np.square(sigmas))

    def residual(self, measured: Array, predicted: Array) -> Array:
        """Return the difference, in [-pi, pi)."""
        return wrap(measured - predicted)

    def represent(self, value: Array) -> Array:
        """Return the angles in [-pi, pi)."""
        return wrap(value)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Only the platform that takes the bearing."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.platform] = True
        return used


def _sinc(angle: Array) -> Array:
    return np.sinc(angle / np.pi)
