r"""Heights and elevations at the two ends of straight lines of sight, with what a delay's derivatives need of them.

A delay is a function of the height h of an end and of the sine :math:`\mu` of the elevation of the line there, so that
gradient and rate of a delay follow by the chain rule from those of the two. To second order:

.. math::

    \nabla L = L_h\nabla h + L_\mu\nabla\mu, \qquad \dot L = L_h\dot h + L_\mu\dot\mu, \qquad
    \nabla\dot L = \frac{d}{dt}\nabla L

with the gradient with respect to the target's position; the last equation holds as second derivatives commute and both
ends move straight on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import WGS84_AXIS, WGS84_FLATTENING

__all__ = ["End", "Sights", "sights"]

Array = NDArray[np.float64]

_SHAPE = 1.0 / np.array([1.0, 1.0, 1.0 - WGS84_FLATTENING]) ** 2 / WGS84_AXIS**2


@dataclass(frozen=True)
class End:
    """One end of every line; gradients are with respect to the target's position, rates along the motion of both.

    Attributes
    ----------
    height, sine : ndarray, shape (..., p) or (..., 1)
        Above the ellipsoid, along the radius [m]; of the elevation of the direction from the target to the platform.
    height_rate, sine_rate : ndarray, the same shapes
        [m/s], [1/s].
    height_gradient, sine_gradient : ndarray, with an axis of 3 behind
        [1], [1/m].
    height_gradient_rate, sine_gradient_rate : ndarray, with an axis of 3 behind
        [1/s], [1/m/s].
    """

    height: Array
    sine: Array
    height_rate: Array
    sine_rate: Array
    height_gradient: Array
    sine_gradient: Array
    height_gradient_rate: Array
    sine_gradient_rate: Array


@dataclass(frozen=True)
class Sights:
    """Lines of sight from a target to platforms.

    Attributes
    ----------
    target, platform : End
    """

    target: End
    platform: End


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)[..., None]


@dataclass(frozen=True)
class _Vertical:
    """Height and vertical of a place, how they change with it and with time; scalars have an axis of 1 behind."""

    height: Array
    gradient: Array
    gradient_rate: Array
    normal: Array
    normal_rate: Array
    length: Array
    length_rate: Array


def _vertical(position: Array, velocity: Array) -> _Vertical:
    r"""Return them of the ellipsoid :math:`p^T Q p = 1`.

    :math:`h = r(1 - 1/s)`, :math:`s^2 = p^T Q p`: the height along the radius, 6e-6 of itself less than that along the
    vertical; :math:`n = Qp/|Qp|`: the vertical of the point of the ellipsoid below, 5e-6 rad off at 10 km.
    """
    e, de = position * _SHAPE, velocity * _SHAPE
    r, s, length = np.sqrt(_dot(position, position)), np.sqrt(_dot(position, e)), np.sqrt(_dot(e, e))
    dr, ds = _dot(position, velocity) / r, _dot(e, velocity) / s
    outward, inside = position / r, 1.0 - 1.0 / s
    gradient = inside * outward + (r / s**3) * e
    gradient_rate = (
        (ds / s**2) * outward
        + inside * (velocity - outward * dr) / r
        + (dr / s**3 - 3 * r * ds / s**4) * e
        + (r / s**3) * de
    )
    normal = e / length
    length_rate = _dot(normal, de)
    return _Vertical(
        r * inside, gradient, gradient_rate, normal, (de - normal * length_rate) / length, length, length_rate
    )


def sights(target: Array, platforms: Array) -> Sights:
    """Return the lines of sight from targets (..., n >= 6) to platforms (..., p, 6), Earth-fixed."""
    here, there = target[..., None, :6], platforms[..., :6]
    low, high = _vertical(here[..., :3], here[..., 3:]), _vertical(there[..., :3], there[..., 3:])
    offset, motion = there[..., :3] - here[..., :3], there[..., 3:] - here[..., 3:]
    d = np.sqrt(_dot(offset, offset))
    u = offset / d
    dd = _dot(u, motion)
    du = (motion - u * dd) / d

    def turning(of: _Vertical) -> tuple[Array, Array, Array, Array]:
        """Sine and rate; its gradient and rate of that, as far as the direction of the line makes them."""
        sine = _dot(of.normal, u)
        sine_rate = _dot(of.normal_rate, u) + _dot(of.normal, du)
        across = of.normal - u * sine
        across_rate = of.normal_rate - du * sine - u * sine_rate
        return sine, sine_rate, -across / d, (across * (dd / d) - across_rate) / d

    sine, rate, gradient, gradient_rate = turning(low)
    tilt = u - low.normal * sine
    tilt_rate = du - low.normal_rate * sine - low.normal * rate
    gradient = gradient + tilt * _SHAPE / low.length
    gradient_rate = gradient_rate + (tilt_rate - tilt * (low.length_rate / low.length)) * _SHAPE / low.length
    near = End(
        low.height[..., 0],
        sine[..., 0],
        _dot(low.gradient, here[..., 3:])[..., 0],
        rate[..., 0],
        low.gradient,
        gradient,
        low.gradient_rate,
        gradient_rate,
    )
    sine, rate, gradient, gradient_rate = turning(high)
    fixed = np.zeros_like(high.gradient)
    far = End(
        high.height[..., 0],
        sine[..., 0],
        _dot(high.gradient, there[..., 3:])[..., 0],
        rate[..., 0],
        fixed,
        gradient,
        fixed,
        gradient_rate,
    )
    return Sights(near, far)
