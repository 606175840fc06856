r"""How much longer a signal takes through air than through vacuum.

The refractive index is :math:`1 + N`, with the exponential reference atmosphere of Recommendation ITU-R P.453:
:math:`N(h) = 315\cdot10^{-6}\,e^{-h/7350\,\mathrm m}`, the mean of the Earth; it changes by some 10 % with weather
and place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["mean_refractivity"]

Array = NDArray[np.float64]

_SURFACE = 315e-6
_SCALE_HEIGHT = 7350.0  # m


def mean_refractivity(lower: ArrayLike, upper: ArrayLike) -> Array:
    r"""Return the mean of N along a straight path between two heights.

    .. math:: \bar N = N_0\,\frac{H}{h_2 - h_1}\left(e^{-h_1/H} - e^{-h_2/H}\right)

    The height is taken as linear along the path: the Earth's curvature is neglected. A signal then takes
    :math:`(1 + \bar N)\,r/c`: 0.17 m more per kilometre between the ground and an airliner.

    Parameters
    ----------
    lower, upper : array_like, shape (...)
        Heights of the two ends above sea level [m]; they broadcast, and may be in either order.

    Returns
    -------
    ndarray, shape (...)
        Dimensionless, about 2e-4.
    """
    h1, h2 = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    climb = (h2 - h1) / _SCALE_HEIGHT
    # (1 - exp(-x)) / x, whose limit at x = 0 is 1
    level = climb == 0
    shape = np.where(level, 1.0, -np.expm1(-climb) / np.where(level, 1.0, climb))
    return _SURFACE * np.exp(-h1 / _SCALE_HEIGHT) * shape
