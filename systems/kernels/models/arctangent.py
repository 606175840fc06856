"""The angle of an offset by arithmetic alone, without a call or a branch: loops over it are done several at a time."""

from __future__ import annotations

import math

from quietfix.systems.kernels.compiling import inlined

__all__ = ["angle"]

_EIGHTH = 0.25 * math.pi
_QUARTER = 0.5 * math.pi
_EIGHTH_REST, _QUARTER_REST, _HALF_REST = 3.061616997868383e-17, 6.123233995736766e-17, 1.2246467991473532e-16


@inlined
def angle(y: float, x: float) -> float:
    """Return atan2(y, x) within 2 units in the last place; NaN for NaN, 0 for an offset of 0.

    The rational function of Moshier, *Cephes Mathematical Library* (atan.c, for arguments up to 0.66), after the offset
    has been turned into the first half of the first quadrant, and by an eighth of a circle where it is then steeper
    than 0.66.
    """
    across, along = math.fabs(y), math.fabs(x)
    steep = across > along
    low, high = (along if steep else across), (across if steep else along)
    turned = low > 0.66 * high
    # what is chosen from is worked out before, both ways: otherwise the compiler makes a branch of the choice
    less, more = low - high, low + high
    above, below = (less if turned else low), (more if turned else high)
    t = above / (1.0 if below == 0.0 else below)
    z = t * t
    p = -8.750608600031904122785e-1
    p = p * z - 1.615753718733365076637e1
    p = p * z - 7.500855792314704667340e1
    p = p * z - 1.228866684490136173410e2
    p = p * z - 6.485021904942025371773e1
    q = z + 2.485846490142306297962e1
    q = q * z + 1.650270098316988542046e2
    q = q * z + 4.328810604912902668951e2
    q = q * z + 4.853903996359136964868e2
    q = q * z + 1.945506571482613964425e2
    found = t * (z * (p / q)) + t
    other = _EIGHTH + (found + _EIGHTH_REST)
    found = other if turned else found
    other = _QUARTER - (found - _QUARTER_REST)
    found = other if steep else found
    other = math.pi - (found - _HALF_REST)
    found = other if x < 0.0 else found
    other = -found
    return other if y < 0.0 else found
