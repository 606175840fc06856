"""Received power by the logarithmic law of path loss."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["ReceivedPower"]

Array = NDArray[np.float64]

_PER_NEPER = 10.0 / math.log(10.0)


class ReceivedPower(CompiledModel):
    r"""Received power at stations, in dBm, of an emitter whose power is known.

    .. math:: z_i = P_0 - 10\,n\,\log_{10}\frac{r_i}{1\,\mathrm m}, \qquad
              \frac{\partial z_i}{\partial p} = -\frac{10\,n}{\ln 10}\,\frac{u_i}{r_i}

    with u the unit vector from station to target: the log-distance law with log-normal shadowing, independent at the
    stations (Rappaport, *Wireless Communications*, 2nd ed. 2002, eq. (4.69)).

    Parameters
    ----------
    sigma : float
        Standard deviation of the shadowing [dB].
    power : float
        P0: power received at 1 m, extrapolated from the far field [dBm].
    exponent : float
        n; 2 in free space.
    stations : sequence of int
        Platforms that measure.
    """

    def __init__(self, sigma: float, power: float, exponent: float, stations: Sequence[int]) -> None:
        self.sigma = positive(sigma, "sigma_power", "dB")
        self.exponent = positive(exponent, "exponent", "")
        if not math.isfinite(power):
            raise ValueError(f"power: {power} is not allowed; it must be a finite number of dBm")
        self.power = float(power)
        self.stations = list(stations)
        if not self.stations or len(set(self.stations)) < len(self.stations):
            raise ValueError(f"stations: {self.stations} is not allowed; at least one, none of them twice")
        self.names = tuple(f"rss_{i}" for i in self.stations)
        self.units = ("dBm",) * len(self.names)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        parameters = [self.power, self.exponent, *self.stations]
        return of_kernel("ranges:received_power", parameters, self.size, states=3, platforms=self.stations)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used
