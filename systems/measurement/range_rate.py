"""Range rates at stations: one-way from a beacon, two-way by way of a transponder."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["RangeRate", "common_part"]

Array = NDArray[np.float64]


class RangeRate(CompiledModel):
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
