"""Range rates at stations: one-way from a beacon, two-way by way of a transponder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import MeasurementModel, positive

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

    scale: float = 1.0
    """Of a row, per m/s."""

    def __init__(self, sigma: float, stations: Sequence[int], bias: int | None = None, at_rest: bool = False) -> None:
        self.sigma = positive(sigma, "sigma_range_rate", "m/s")
        self.stations = list(stations)
        if not self.stations or len(set(self.stations)) < len(self.stations):
            raise ValueError(f"stations: {self.stations} is not allowed; at least one, none of them twice")
        # a view instead of a copy where all of the first ones receive
        in_order = self.stations == list(range(len(self.stations)))
        self._received = slice(len(self.stations)) if in_order else self.stations
        first = 3 if at_rest else 6
        if bias is not None and bias < first:
            raise ValueError(f"bias: index {bias} is not allowed; the first {first} states are the target's own")
        self.bias, self.at_rest = bias, at_rest
        self.names = tuple(f"range_rate_{i}" for i in self.stations)
        self.units = ("m/s",) * len(self.names)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        bias, states = (-1, 0) if self.bias is None else (self.bias, self.bias + 1)
        parameters = [self.scale, bias, self.at_rest, *self.stations]
        states = max(states, 3 if self.at_rest else 6)
        return of_kernel("ranges:range_rates", parameters, self.size, states=states, platforms=self.stations)

    def _geometry(self, target: Array, platforms: Array) -> tuple[Array, Array, Array, Array]:
        """Return offset and velocity (3, rows, ...), distance and range rate (rows, ...).

        An unscented filter spends most of its time here. Axes and rows first: the innermost loop of every operation
        then runs over trials and sigma points, not over three axes or a handful of stations.
        """
        used = np.moveaxis(platforms[..., self._received, :], (-1, -2), (0, 1))
        state = np.ascontiguousarray(np.moveaxis(target[..., : 3 if self.at_rest else 6], -1, 0))[:, None]
        # broadcast from the right, as everywhere, behind the rows
        leading = max(state.ndim, used.ndim) - 2
        state, used = (
            part.reshape(*part.shape[:2], *(1,) * (leading - part.ndim + 2), *part.shape[2:]) for part in (state, used)
        )
        offset = state[:3] - used[:3]
        velocity = -used[3:] if self.at_rest else state[3:] - used[3:]
        distance = np.sqrt(_over_axes(offset * offset))
        return offset, velocity, distance, _over_axes(offset * velocity) / distance

    def _with_bias(self, rates: Array, target: Array) -> Array:
        """Return the measurement (..., rows) for range rates (rows, ...)."""
        return np.moveaxis(rates if self.bias is None else rates + target[..., self.bias], 0, -1)

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self._with_bias(self._geometry(target, platforms)[3], target)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        offset, velocity, distance, rates = self._geometry(target, platforms)
        jacobian = np.zeros((*rates.shape[1:], len(rates), target.shape[-1]))
        rows_first = np.moveaxis(jacobian, -2, 0)
        for k in range(3):
            along = offset[k] / distance
            rows_first[..., k] = (velocity[k] - rates * along) / distance
            if not self.at_rest:
                rows_first[..., 3 + k] = along
        if self.bias is not None:
            jacobian[..., self.bias] = 1.0
        return self._with_bias(rates, target), jacobian

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used


def _over_axes(parts: Array) -> Array:
    """Return the sum over the first of three axes, formed in place: no reduction that could depend on the others."""
    total: Array = parts[0]
    total += parts[1]
    total += parts[2]
    return total


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
