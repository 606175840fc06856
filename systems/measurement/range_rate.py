"""Range rates at stations: one-way from a beacon, two-way by way of a transponder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from systems.measurement.base import MeasurementModel, positive

__all__ = ["RangeRate", "common_part"]

Array = NDArray[np.float64]


class RangeRate(MeasurementModel):
    r"""Range rates at stations, all with the same unknown addition.

    .. math:: z_i = u_i^T (v - v_i) + \delta, \qquad u_i = (p - p_i)/|p - p_i|

    delta is the beacon's oscillator error (eq. (14) of Shang, Xing and Gan, Control Theory & Applications 29 (2012)
    59) or, where the stations receive a transponder, the range rate from the uplink station: eq. (16) minus (17).

    Parameters
    ----------
    sigma : float
        Standard deviation of one range rate [m/s].
    stations : sequence of int
        Platforms that receive.
    bias : int, optional
        Index of delta in the state; without it delta is taken to be zero.
    at_rest : bool
        The target stands still in the axes of the platforms and has no velocity in its state (a station that listens to
        satellites: the platforms then are the satellites).
    """

    def __init__(self, sigma: float, stations: Sequence[int], bias: int | None = None, at_rest: bool = False) -> None:
        self.sigma = positive(sigma, "sigma_range_rate", "m/s")
        self.stations = list(stations)
        if not self.stations or len(set(self.stations)) < len(self.stations):
            raise ValueError(f"stations: {self.stations} is not allowed; at least one, none of them twice")
        first = 3 if at_rest else 6
        if bias is not None and bias < first:
            raise ValueError(f"bias: index {bias} is not allowed; the first {first} states are the target's own")
        self.bias, self.at_rest = bias, at_rest
        self.names = tuple(f"range_rate_{i}" for i in self.stations)
        self.units = ("m/s",) * len(self.names)

    def _geometry(self, target: Array, platforms: Array) -> tuple[list[Array], list[Array], Array, Array]:
        """Return offset and velocity axis by axis, distance, range rate; each (..., rows).

        Axis by axis and not as vectors: an unscented filter spends most of its time here, and three sums over whole
        arrays take a third of the time of a sum over a last axis of three.
        """
        used = platforms[..., self.stations, :]
        offset = [target[..., None, k] - used[..., k] for k in range(3)]
        if self.at_rest:
            velocity = [-used[..., 3 + k] for k in range(3)]
        else:
            velocity = [target[..., None, 3 + k] - used[..., 3 + k] for k in range(3)]
        (x, y, z), (vx, vy, vz) = offset, velocity
        distance = np.sqrt(x * x + y * y + z * z)
        return offset, velocity, distance, (x * vx + y * vy + z * vz) / distance

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        rates = self._geometry(target, platforms)[3]
        return rates if self.bias is None else rates + target[..., self.bias, None]

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        offset, velocity, distance, rates = self._geometry(target, platforms)
        jacobian = np.zeros((*rates.shape, target.shape[-1]))
        for k in range(3):
            along = offset[k] / distance
            jacobian[..., k] = (velocity[k] - rates * along) / distance
            if not self.at_rest:
                jacobian[..., 3 + k] = along
        if self.bias is None:
            return rates, jacobian
        jacobian[..., self.bias] = 1.0
        return rates + target[..., self.bias, None], jacobian

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used


def common_part(rates: Array, bias: Array, mode: Array, uplink: int) -> Array:
    """Return what each station's measurement has beside its own downlink range rate [m/s], shape (..., p).

    Parameters
    ----------
    rates : ndarray, shape (..., p)
        Range rates to all stations [m/s].
    bias : ndarray, shape (..., 1)
        The beacon's oscillator error [m/s].
    mode : ndarray, shape (..., p)
        0: the station receives the beacon; 1: it receives the transponder.
    uplink : int
        Station whose signal the transponder returns.
    """
    return np.where(mode > 0.5, rates[..., uplink, None], bias)
