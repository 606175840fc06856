r"""How much longer a group takes through the ionosphere, and by how much a phase is ahead.

.. math:: \Delta = \frac{40.3\,\mathrm{TEC}}{f^2}\,M, \qquad
          M = \left[1 - \left(\frac{R + h}{R + h_s}\,\cos E\right)^2\right]^{-1/2}

with the electrons in a thin shell at :math:`h_s`, and E the elevation at the lower end of the ray, at height h
(Klobuchar, *IEEE Transactions on Aerospace and Electronic Systems* 23, 1987, p. 325; Hofmann-Wellenhof and others,
*GNSS*, 2008, section 5.3.2). Positive for groups, the same negative for phases and so for Doppler shifts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.atmosphere.columns import EARTH_RADIUS, Column

__all__ = ["ThinShell"]

Array = NDArray[np.float64]

_ELECTRONS = 40.3e16  # m Hz^2 per TECU
_GRAZING = 0.01  # square of the cosine at the shell; beyond it a shell is not thin


@dataclass(frozen=True)
class ThinShell:
    """Electrons in a thin shell, the same everywhere and at all times.

    A ray between two places above it passes it twice or not at all; M is at most 10.

    Parameters
    ----------
    tec : float
        Vertical total electron content [TECU = 1e16 / m^2].
    shell : float
        Its height [m].
    carrier : float
        Frequency of the signal [Hz].
    """

    tec: float
    shell: float
    carrier: float

    phase_sign = -1.0

    @property
    def bottom(self) -> float:
        """See `quietfix.systems.atmosphere.columns.Medium`."""
        return self.shell

    @property
    def zenith(self) -> float:
        """Excess path of a group straight up [m]."""
        return _ELECTRONS * self.tec / self.carrier**2

    def column(self, height: Array, sine: Array) -> Column:
        """See `quietfix.systems.atmosphere.columns.Medium`."""
        around = EARTH_RADIUS + self.shell
        share = (EARTH_RADIUS + height) / around
        level = 1.0 - sine * sine
        reach = share * share * level
        below = height < self.shell
        passes = np.where(below, 1.0, np.where((sine < 0) & (reach < 1), 2.0, 0.0)) * self.zenith
        rest = 1.0 - reach
        inside = rest > _GRAZING
        rest = np.where(rest < _GRAZING, _GRAZING, rest)  # keeps a NaN
        value = passes / np.sqrt(rest)
        first = np.where(inside, 0.5 * value / rest, 0.0)
        second = np.where(inside, 0.75 * value / rest**2, 0.0)
        by_h, by_u = 2 * share * level / around, -2 * share * share * sine
        return Column(
            value,
            first * by_h,
            first * by_u,
            second * by_h * by_h + first * (2 * level / around**2),
            second * by_h * by_u - first * (4 * share * sine / around),
            second * by_u * by_u - first * (2 * share * share),
        )
