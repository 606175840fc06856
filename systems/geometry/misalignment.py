"""A sensor whose axes are not where they are believed to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["rotation_matrix", "seen_from_turned_axes"]

Array = NDArray[np.float64]


def rotation_matrix(vector: ArrayLike) -> Array:
    r"""Return the rotation by a rotation vector, shape (..., 3, 3).

    .. math:: R = I + \frac{\sin\theta}{\theta}[v]_\times + \frac{1-\cos\theta}{\theta^2}[v]_\times^2,
              \qquad \theta = \|v\|

    Rodrigues' formula; R x is x turned about v by :math:`\theta`, right-handed.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
        [rad].
    """
    v = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
    # sinc keeps small angles exact: sin(t)/t, and (1 - cos t)/t^2 = (sin(t/2)/(t/2))^2 / 2
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + first * cross + second * (cross @ cross)


def seen_from_turned_axes(
    target: Array, platform: Array, turn: Array, body: Array | None = None, axes: int = 3
) -> Array:
    r"""Return the target that a well-aligned sensor would have to see to read what a misaligned one reads.

    .. math:: x' = x_c + B^T R^T B\,(x - x_c)

    The misaligned sensor's axes are the believed ones, the rows of B, turned by R (given in those axes). Position and
    velocity relative to the platform are turned alike, which is exact for directions and for their rates where R is
    constant; what depends on where the target really is (gravity) must not be read from it.

    Parameters
    ----------
    target : ndarray, shape (..., n)
        Position, and velocity if there is one.
    platform : ndarray, shape (..., 6)
        Position and velocity, three numbers each.
    turn : ndarray, shape (..., 3, 3)
        R.
    body : ndarray, shape (..., 3, 3), optional
        B; by default the axes of the states.
    axes : int
        Space dimensions of the target's state; with 2, R must be about z.

    Returns
    -------
    ndarray, shape (..., n)
    """
    back = np.swapaxes(turn, -1, -2)
    if body is not None:
        back = np.swapaxes(body, -1, -2) @ back @ body
    back = back[..., :axes, :axes]
    leading = np.broadcast_shapes(target.shape[:-1], platform.shape[:-1], back.shape[:-2])
    seen = np.broadcast_to(target, (*leading, target.shape[-1])).copy()
    for first, own in ((0, 0), (axes, 3)):
        if target.shape[-1] >= first + axes:
            offset = target[..., first : first + axes] - platform[..., own : own + axes]
            seen[..., first : first + axes] = platform[..., own : own + axes] + (back @ offset[..., None])[..., 0]
    return seen
