"""What is measured of the state alone: components of it, and the height over the ellipsoid."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.constants import WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED, WGS84_FLATTENING
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined

__all__ = ["altitude", "components", "vertical"]


@kernel
def components(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Components of the state; parameters: which."""
    for k in range(value.shape[0]):
        value[k] = state[int(parameters[k])]
        if jacobian.shape[0] > 0:
            jacobian[k, int(parameters[k])] = 1.0


@inlined
def vertical(x: float, y: float, z: float) -> Any:
    """Return the ellipsoid's outward normal and the height; see `quietfix.systems.earth.geodetic.vertical`."""
    a, e2 = WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED
    b = a * (1.0 - WGS84_FLATTENING)
    rho = math.sqrt(x * x + y * y)
    cosine, sine = (1.0 - WGS84_FLATTENING) * rho, z
    level, axial = rho, z
    for _ in range(2):
        size = math.sqrt(cosine * cosine + sine * sine)
        cosine, sine = cosine / size, sine / size
        level = rho - (e2 * a) * (cosine * cosine * cosine)
        axial = z + (e2 / (1.0 - e2) * b) * (sine * sine * sine)
        cosine, sine = level, (1.0 - WGS84_FLATTENING) * axial
    size = math.sqrt(level * level + axial * axial)
    cosine, sine = level / size, axial / size
    scale = cosine / (1.0 if rho == 0.0 else rho)
    height = rho * cosine + z * sine - a * math.sqrt(1.0 - e2 * (sine * sine))
    return x * scale, y * scale, sine, height


@kernel
def altitude(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Height above the ellipsoid."""
    x, y, z, height = vertical(state[0], state[1], state[2])
    value[0] = height
    if jacobian.shape[0] > 0:
        jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = x, y, z
