"""Start from the first bearing alone, and what is known of the range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.measurement.base import positive
from quietfix.systems.starts.start import Start

__all__ = ["BearingStart"]

Array = NDArray[np.float64]


class BearingStart(Start):
    r"""A target on the first line of bearing, at a range r0 +- sigma_r; velocity zero with a spread.

    .. math:: P = \sigma_r^2\,u u^T + (r_0^2 + \sigma_r^2)
              (\sigma_\theta^2 \cos^2\varepsilon\, e_\theta e_\theta^T + \sigma_\varepsilon^2\, e_\varepsilon
              e_\varepsilon^T)

    u points along the bearing, :math:`e_\theta, e_\varepsilon` across it; derived from p = p_0 + r u with independent
    errors of range and angles.

    Parameters
    ----------
    model : Bearing
        What the estimator believes of the sensor.
    stream : sequence of str
        Names of the rows on the measurement port.
    size : int
        Number of states: position, or position and velocity.
    distance, sigma_distance : float
        r0 and sigma_r [m].
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s]; only where it is a state.
    """

    uses_measurement = True

    def __init__(
        self,
        model: Bearing,
        stream: Sequence[str],
        size: int,
        distance: float,
        sigma_distance: float,
        sigma_velocity: float = 0.0,
    ) -> None:
        axes = model.size + 1
        if size not in (axes, 2 * axes):
            raise ValueError(f"start: {size} states are not allowed with {model.size} angles; {axes} or {2 * axes}")
        self.model = self.uses = model
        self.size = size
        self.axes = axes
        self.distance = positive(distance, "distance", "m")
        self.sigma_distance = positive(sigma_distance, "sigma_distance", "m")
        self.sigma_velocity = sigma_velocity if size == axes else positive(sigma_velocity, "sigma_velocity", "m/s")
        self.rows = [list(stream).index(row) for row in model.names]

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        return self.belief(measurement[:, self.rows], platforms)

    def belief(
        self, angles: Array, platforms: Array, distance: float | None = None, sigma_distance: float | None = None
    ) -> tuple[Array, Array]:
        """Return mean and covariance for one bearing.

        Parameters
        ----------
        angles : ndarray, shape (trials, m)
            Azimuth, and elevation where it is measured [rad]; NaN gives NaN.
        platforms : ndarray, shape (1 or trials, p, >= axes)
            Known platforms.
        distance, sigma_distance : float, optional
            Instead of the start's own [m].

        Returns
        -------
        mean : ndarray, shape (trials, n)
        covariance : ndarray, shape (trials, n, n)
        """
        distance = self.distance if distance is None else distance
        spread = self.sigma_distance if sigma_distance is None else sigma_distance
        along, _ = self._directions(angles)
        trials = angles.shape[0]
        mean = np.zeros((trials, self.size))
        mean[:, : self.axes] = platforms[:, self.model.platform, : self.axes] + distance * along
        mean[~np.isfinite(mean).all(axis=-1)] = np.nan
        square = np.full(trials, distance**2 + spread**2)
        return mean, self._covariance(angles, square, spread)

    def covariance_at(self, target: Array, platforms: Array, sigma_distance: float | None = None) -> Array:
        """Return the inverse of what the first bearing and the assumed range tell of a target at `target` (trials, n).

        Parameters
        ----------
        target : ndarray, shape (trials, n)
        platforms : ndarray, shape (1 or trials, p, >= axes)
        sigma_distance : float, optional
            Instead of the start's own [m].

        Returns
        -------
        ndarray, shape (trials, n, n)
        """
        offset = target[:, : self.axes] - platforms[:, self.model.platform, : self.axes]
        square = np.einsum("...i,...i->...", offset, offset)
        spread = self.sigma_distance if sigma_distance is None else sigma_distance
        return self._covariance(self.model.predict(target, platforms), square, spread)

    def _directions(self, angles: Array) -> tuple[Array, list[tuple[Array, float]]]:
        """Return the unit vector along a bearing, and those across it with the variance of their angle."""
        c, s = np.cos(angles[:, 0]), np.sin(angles[:, 0])
        variances = np.square(self.model.sigmas)
        if self.axes == 2:
            return np.stack([c, s], axis=-1), [(np.stack([-s, c], axis=-1), variances[0])]
        ce, se = np.cos(angles[:, 1]), np.sin(angles[:, 1])
        sideways = np.stack([-ce * s, ce * c, np.zeros_like(c)], axis=-1)
        upwards = np.stack([-se * c, -se * s, ce], axis=-1)
        return np.stack([ce * c, ce * s, se], axis=-1), [(sideways, variances[0]), (upwards, variances[1])]

    def _covariance(self, angles: Array, square: Array, spread: float) -> Array:
        along, across = self._directions(angles)
        axes = self.axes
        covariance = np.zeros((angles.shape[0], self.size, self.size))
        place = spread**2 * along[:, :, None] * along[:, None, :]
        for direction, variance in across:
            place = place + (square * variance)[:, None, None] * direction[:, :, None] * direction[:, None, :]
        covariance[:, :axes, :axes] = place
        covariance[:, range(axes, self.size), range(axes, self.size)] = self.sigma_velocity**2
        return covariance
