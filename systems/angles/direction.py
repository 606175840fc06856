"""Direction of arrival at a platform that points to nadir: azimuth and depression, or direction cosines."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.geometry.body_frame import body_frame
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["BodyDirection", "Direction", "DirectionCosines"]

Array = NDArray[np.float64]


class BodyDirection(CompiledModel):
    """What the direction models share: the line of sight of one platform in its body frame."""

    units = ("rad", "rad")

    def __init__(self, platform: int, earth_rate: float) -> None:
        self.platform = platform
        self.earth_rate = earth_rate

    @abstractmethod
    def unit_vector(self, measured: Array, platforms: Array) -> Array:
        """Return the Earth-fixed direction (..., 3) that a measurement (..., 2) means; NaN where there is none."""

    def _earth_fixed(self, body: Array, platforms: Array) -> Array:
        frame = body_frame(platforms, self.platform, self.earth_rate)
        return np.einsum("...ij,...i->...j", frame, body)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Only the platform that takes the direction."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.platform] = True
        return used


class Direction(BodyDirection):
    r"""Azimuth and depression of a target in the body frame of a platform that points to nadir.

    .. math:: \alpha = \operatorname{atan2}(y_b, x_b), \qquad \varepsilon = \operatorname{atan2}(z_b, \rho_b), \qquad
              \rho_b = \sqrt{x_b^2 + y_b^2}

    with x along the inertial velocity, z to nadir, y = z x x (to the right of the track). Straight below the platform,
    where there is no azimuth, that row is NaN; above 85 deg of depression use `DirectionCosines`.

    Parameters
    ----------
    sigma : float
        Standard deviation of the azimuth [rad].
    sigma_depression : float, optional
        Standard deviation of the depression [rad]; by default that of the azimuth.
    platform : int
        The platform that takes the direction.
    earth_rate : float
        Earth rotation [rad/s], to turn Earth-fixed into inertial velocity.
    """

    names = ("azimuth", "depression")

    def __init__(
        self,
        sigma: float,
        sigma_depression: float | None = None,
        platform: int = 0,
        earth_rate: float = EARTH_RATE,
    ) -> None:
        super().__init__(platform, earth_rate)
        self.sigma = positive(sigma, "sigma_azimuth", "rad")
        self.sigma_depression = (
            self.sigma if sigma_depression is None else positive(sigma_depression, "sigma_depression", "rad")
        )

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        parameters = [self.earth_rate, self.platform]
        return of_kernel(
            "angles:direction", parameters, 2, modulus=(2 * np.pi, 0.0), states=3, platforms=[self.platform]
        )

    def unit_vector(self, measured: Array, platforms: Array) -> Array:
        """Return the Earth-fixed direction (..., 3) that azimuth and depression (..., 2) mean."""
        azimuth, depression = measured[..., 0], measured[..., 1]
        level = np.cos(depression)
        body = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(depression)], axis=-1)
        return self._earth_fixed(body, platforms)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.diag([self.sigma**2, self.sigma_depression**2])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """Return the difference; that of the azimuth in [-pi, pi). The depression goes from -pi/2 to pi/2."""
        difference = measured - predicted
        azimuth = difference[..., 0]
        azimuth -= 2 * np.pi * np.floor((azimuth + np.pi) / (2 * np.pi))
        return difference

    def represent(self, value: Array) -> Array:
        """Return the angles in [-pi, pi)."""
        return wrap(value)


class DirectionCosines(BodyDirection):
    r"""Direction cosines along and across the track: what azimuth and depression cannot say near nadir.

    .. math:: c_x = x_b/r, \qquad c_y = y_b/r

    Near nadir a cosine is the angle from it, so its standard deviation is that of the angle.

    Parameters
    ----------
    sigma : float
        Standard deviation of a cosine, as an angle at nadir [rad].
    platform, earth_rate
        See `Direction`.
    """

    names = ("cosine_along", "cosine_across")
    units = ("1", "1")

    def __init__(self, sigma: float, platform: int = 0, earth_rate: float = EARTH_RATE) -> None:
        super().__init__(platform, earth_rate)
        self.sigma = positive(sigma, "sigma_cosine", "rad")

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        parameters = [self.earth_rate, self.platform]
        return of_kernel("angles:direction_cosines", parameters, 2, states=3, platforms=[self.platform])

    def unit_vector(self, measured: Array, platforms: Array) -> Array:
        """Return the Earth-fixed direction (..., 3), downwards, of cosines (..., 2); NaN where they are impossible."""
        down = 1 - np.sum(measured * measured, axis=-1, keepdims=True)
        down = np.sqrt(np.where(down >= 0, down, np.nan))
        return self._earth_fixed(np.concatenate([measured, down], axis=-1), platforms)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(2)
