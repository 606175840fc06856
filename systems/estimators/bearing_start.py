"""Start from the first bearing alone, and what is known of the range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from systems.estimators.start import Start
from systems.measurement.base import positive
from systems.measurement.bearing import Bearing

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
        self.model = model
        self.size = size
        self.axes = axes
        self.distance = positive(distance, "distance", "m")
        self.sigma_distance = positive(sigma_distance, "sigma_distance", "m")
        self.sigma_velocity = sigma_velocity if size == axes else positive(sigma_velocity, "sigma_velocity", "m/s")
        self._rows = [list(stream).index(row) for row in model.names]

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        return self.belief(measurement[:, self._rows], platforms)

    def belief(
        self, angles: Array, platforms: Array, distance: float | None = None, sigma_distance: float | None = None
    ) -> tuple[Array, Array]:
        """Return mean and covariance for one bearing.

        Parameters
        ----------
        angles : ndarray, shape (trials, m)
            Azimuth, and elevation where it is measured [rad]; NaN gives NaN.
        platforms : ndarray, shape (1 or trials, p, >= axes)
            Known carriers.
        distance, sigma_distance : float, optional
            Instead of the start's own [m].

        Returns
        -------
        mean : ndarray, shape (trials, n)
        covariance : ndarray, shape (trials, n, n)
        """
        distance = self.distance if distance is None else distance
        spread = self.sigma_distance if sigma_distance is None else sigma_distance
        axes, trials = self.axes, angles.shape[0]
        c, s = np.cos(angles[:, 0]), np.sin(angles[:, 0])
        square = distance**2 + spread**2
        if axes == 2:
            along = np.stack([c, s], axis=-1)
            across = [(np.stack([-s, c], axis=-1), square * self.model.sigma**2)]
        else:
            ce, se, zero = np.cos(angles[:, 1]), np.sin(angles[:, 1]), np.zeros_like(c)
            along = np.stack([ce * c, ce * s, se], axis=-1)
            assert self.model.sigma_elevation is not None
            across = [
                (np.stack([-ce * s, ce * c, zero], axis=-1), square * self.model.sigma**2),
                (np.stack([-se * c, -se * s, ce], axis=-1), square * self.model.sigma_elevation**2),
            ]
        covariance = np.zeros((trials, self.size, self.size))
        covariance[:, :axes, :axes] = sum(
            variance * direction[:, :, None] * direction[:, None, :]
            for direction, variance in [(along, spread**2), *across]
        )
        covariance[:, range(axes, self.size), range(axes, self.size)] = self.sigma_velocity**2
        mean = np.where(np.isfinite(angles).all(axis=-1)[:, None], 0.0, np.nan) * np.ones((trials, self.size))
        mean[:, :axes] += platforms[:, self.model.platform, :axes] + distance * along
        return mean, covariance

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the start for a target at `target` (trials, n), shape (trials, n, n)."""
        angles = self.model.predict(target, platforms)
        return self.belief(angles, platforms)[1]
