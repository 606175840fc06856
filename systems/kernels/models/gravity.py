"""Gravity of the Earth at one place; the formulae of `quietfix.systems.trajectories.gravity`."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import inlined

__all__ = ["gradient", "pull"]


@inlined
def pull(x: float, y: float, z: float, mu: float, bulge_scale: float) -> Any:
    """Return the acceleration of gravity; `bulge_scale` is 1.5 J2 R^2, 0 without the flattening."""
    square = x * x + y * y + z * z
    scale = -mu / (square * math.sqrt(square))
    if bulge_scale == 0.0:
        return scale * x, scale * y, scale * z
    bulge = bulge_scale / square
    round_ = scale * (1.0 + bulge * (1.0 - 5.0 * (z * z) / square))
    return round_ * x, round_ * y, round_ * z + 2.0 * scale * bulge * z


@inlined
def gradient(x: float, y: float, z: float, mu: float, bulge_scale: float) -> Any:
    """Return xx, xy, xz, yy, yz, zz of the derivative of `pull`."""
    square = x * x + y * y + z * z
    radius = math.sqrt(square)
    pull = mu / (square * radius)
    a, b, c = x / radius, y / radius, z / radius
    xx, yy, zz = pull * (3.0 * (a * a) - 1.0), pull * (3.0 * (b * b) - 1.0), pull * (3.0 * (c * c) - 1.0)
    xy, xz, yz = pull * (3.0 * (a * b)), pull * (3.0 * (a * c)), pull * (3.0 * (b * c))
    if bulge_scale == 0.0:
        return xx, xy, xz, yy, yz, zz
    scale = bulge_scale * pull / square
    even, outer, mixed = 5.0 * (c * c) - 1.0, 5.0 - 35.0 * (c * c), 10.0 * c
    return (
        xx + scale * (even + outer * (a * a)),
        xy + scale * (outer * (a * b)),
        xz + scale * (outer * (a * c) + mixed * a),
        yy + scale * (even + outer * (b * b)),
        yz + scale * (outer * (b * c) + mixed * b),
        zz + scale * (even + outer * (c * c) + mixed * (c + c) - 2.0),
    )
