r"""How much longer a signal takes through air.

Along a straight ray through spherical layers whose refractivity is a sum of exponentials of the height,
:math:`N = \sum_k (Z_k/H_k)\,e^{-h/H_k}`, each adds from height h on outwards at an elevation of sine :math:`\mu`

.. math:: F_k = Z_k\,e^{-h/H_k}\,\frac{\mathrm{erfcx}(\mu\sqrt{R/2H_k})}{\mathrm{erfcx}(\sqrt{R/2H_k})},

Chapman's grazing incidence function (*Proceedings of the Physical Society* 43, 1931, p. 483) in the approximation for
layers that are thin against the Earth, whose expansion is the continued fraction of Marini (*Radio Science* 7, 1972,
p. 223), from which mapping functions down to low elevations descend. It is not only a mapping function: as
:math:`dF/ds = -N` along a ray, the excess path between any two places is a difference of two such columns, between two
receivers on the ground, to an aircraft, or to a satellite.

A ray that first goes down, to a perigee at :math:`h_p`, passes it twice:
:math:`F(h, \mu) = 2 F(h_p, 0) - F(h, -\mu)` for :math:`\mu < 0`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx

from quietfix.systems.atmosphere.columns import EARTH_RADIUS, Column

__all__ = ["Troposphere", "saastamoinen_hydrostatic", "saastamoinen_wet", "vapour_pressure"]

Array = NDArray[np.float64]

_HYDROSTATIC = ((-0.375, 4000.0), (1.375, 6500.0))
"""Shares and scale heights [m]: the U.S. Standard Atmosphere 1976, see `Troposphere`."""

_LOWEST = -10e3  # m; no ray that anybody receives is deeper
_THINNEST = 200.0  # scale heights; e^-200 is nothing
_SLOPE = 2 / math.sqrt(math.pi)


def saastamoinen_hydrostatic(pressure: float) -> float:
    """Return the zenith delay of dry air at mid latitudes [m] of the surface pressure [hPa].

    Saastamoinen, in *The Use of Artificial Satellites for Geodesy*, AGU Monograph 15, 1972, p. 247, as in Davis and
    others, *Radio Science* 20, 1985, p. 1593; its factor of latitude and height is within 0.3 % of 1 and left out.
    """
    return 0.0022768 * pressure


def saastamoinen_wet(temperature: float, vapour: float) -> float:
    """Return the zenith delay of water vapour [m] of temperature [K] and vapour pressure [hPa]; reference as above."""
    return 0.002277 * (1255.0 / temperature + 0.05) * vapour


def vapour_pressure(temperature: float, humidity: float) -> float:
    """Return the pressure of water vapour [hPa] at a temperature [K] and relative humidity 0 to 1.

    Magnus' formula with the coefficients of the WMO (*Guide to Instruments*, annex 4.B).
    """
    celsius = temperature - 273.15
    return humidity * 6.112 * math.exp(17.62 * celsius / (243.12 + celsius))


@dataclass(frozen=True)
class Troposphere:
    r"""Air of a surface pressure, temperature and humidity, the same everywhere.

    The zenith delays at sea level are Saastamoinen's. That of dry air falls with the height as the pressure of the
    U.S. Standard Atmosphere 1976 does, to 0.9 % of the sea level's:
    :math:`-0.375\,e^{-h/4\,km} + 1.375\,e^{-h/6.5\,km}`, by least squares of pressure and density. That of vapour has
    the scale height that follows from its delay and its refractivity at the surface, :math:`0.373\,e/T^2` (Smith and
    Weintraub, *Proceedings of the IRE* 41, 1953, p. 1035).

    The ray is straight, which makes it longer than the bent one: against Niell's mapping function of mid latitudes
    (*Journal of Geophysical Research* 101, 1996, p. 3227) 0.2 % at 10 degrees, 0.7 % at 5 and 1.4 % at 3. The layers
    are of a sphere, and the heights those above the ellipsoid: where the two ends are at the same height, which is the
    lower one is open, and the excess jumps by less than 1e-3 of itself.

    Parameters
    ----------
    pressure : float
        At sea level [hPa].
    temperature : float
        At sea level [K].
    humidity : float
        Relative, 0 to 1.
    """

    pressure: float = 1013.25
    temperature: float = 288.15
    humidity: float = 0.5

    phase_sign = 1.0
    bottom = -math.inf

    @cached_property
    def layers(self) -> tuple[tuple[float, float], ...]:
        """Zenith delay at sea level and scale height of each exponential [m]."""
        vapour = vapour_pressure(self.temperature, self.humidity)
        dry = saastamoinen_hydrostatic(self.pressure)
        found = [(share * dry, scale) for share, scale in _HYDROSTATIC]
        if vapour > 0:
            wet = saastamoinen_wet(self.temperature, vapour)
            found.append((wet, wet / (0.373 * vapour / self.temperature**2)))
        return tuple(found)

    def column(self, height: Array, sine: Array) -> Column:
        """See `quietfix.systems.atmosphere.columns.Medium`."""
        found = [_exponential(zenith, scale, height, sine) for zenith, scale in self.layers]
        total = found[0]
        for one in found[1:]:
            total = total + one
        return total


def _exponential(zenith: float, scale: float, height: Array, sine: Array) -> Column:
    """Return the column of one exponential."""
    down = sine < 0
    steep = math.sqrt(EARTH_RADIUS / (2 * scale))
    x = steep * np.abs(sine)
    # w' = 2 x w - 2/sqrt(pi), and once more
    w = erfcx(x)
    first = 2 * x * w - _SLOPE
    second = 2 * (w + x * first)
    deep = height < _LOWEST
    amount = zenith / float(erfcx(steep)) * np.exp(-np.minimum(np.maximum(height, _LOWEST) / scale, _THINNEST))
    slope = np.where(deep, 0.0, -1.0 / scale)
    sign = np.where(down, -1.0, 1.0)
    value, by_u = amount * w, amount * first * steep
    up = Column(
        sign * value,
        sign * value * slope,
        by_u,
        sign * value * slope**2,
        by_u * slope,
        sign * amount * second * steep**2,
    )
    return up + _twice(zenith, scale, steep, height, sine) if down.any() else up


def _twice(zenith: float, scale: float, steep: float, height: Array, sine: Array) -> Column:
    """Return twice the column from the perigee outwards, of rays that go down first; nothing of others."""
    level = np.sqrt(np.maximum(1.0 - sine * sine, 1e-12))
    radius = EARTH_RADIUS + height
    perigee = radius * level - EARTH_RADIUS
    passed = (sine < 0) & (perigee > _LOWEST)
    among = np.minimum(np.maximum(perigee, _LOWEST) / scale, _THINNEST)
    amount = np.where(sine < 0, 2 * zenith / float(erfcx(steep)), 0.0) * np.exp(-among)
    per = np.where(passed, -1.0 / scale, 0.0) * amount
    by_h, by_u = level, -radius * sine / level
    return Column(
        amount,
        per * by_h,
        per * by_u,
        -per * by_h * by_h / scale,
        per * (-sine / level - by_h * by_u / scale),
        per * (-radius / level**3 - by_u * by_u / scale),
    )
