"""Received frequency of an emitter whose oscillator is off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.range_rate import RangeRate

__all__ = ["Frequency"]

Array = NDArray[np.float64]


class Frequency(RangeRate):
    r"""Received frequency minus the nominal one, of one instant.

    .. math:: z_i = -\frac{f}{c}\,(\dot r_i + \delta)

    :math:`\delta` is the oscillator's error as a range rate: an emitter that is `offset` hertz too high has
    :math:`\delta = -c\,\mathrm{offset}/f`. To first order in v/c.

    Parameters
    ----------
    sigma : float
        Standard deviation of one frequency [Hz].
    carrier : float
        Nominal carrier frequency f [Hz].
    stations, bias
        See `RangeRate`; `bias` is the index of delta [m/s].
    """

    def __init__(self, sigma: float, carrier: float, stations: Sequence[int], bias: int | None = None) -> None:
        self.carrier = positive(carrier, "carrier", "Hz")
        self.scale = -self.carrier / SPEED_OF_LIGHT
        super().__init__(positive(sigma, "sigma_frequency", "Hz"), stations, bias)
        self.names = tuple(f"frequency_{i}" for i in self.stations)
        self.units = ("Hz",) * len(self.names)
