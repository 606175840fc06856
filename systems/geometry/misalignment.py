"""A sensor whose axes are not where they are believed to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["left_jacobian", "rotation_matrix", "seen_from_turned_axes", "turned_derivatives"]

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


def left_jacobian(vector: ArrayLike) -> Array:
    r"""Return how a rotation changes with its rotation vector, shape (..., 3, 3).

    .. math:: J_l = I + \frac{1-\cos\theta}{\theta^2}[v]_\times + \frac{\theta-\sin\theta}{\theta^3}[v]_\times^2,
              \qquad \frac{\partial\,R(-v)\,u}{\partial v} = R(-v)\,[u]_\times\,J_l(v)

    Sola, Deray and Atchuthan, *A micro Lie theory for state estimation in robotics*, arXiv:1812.01537, eq. (145), and
    the derivative from their (143) and (180) at :math:`-v`, for :math:`J_r(-v) = J_l(v)`.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
        [rad].
    """
    v = np.asarray(vector, dtype=float)
    square = np.sum(v * v, axis=-1)[..., None, None]
    angle = np.sqrt(square)
    cross = _cross(v)
    small = angle < 1e-2  # the next term of the series is 2e-16 of the first
    safe = np.where(small, 1.0, angle)
    series = 1 / 6 - square / 120 + square**2 / 5040
    second = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross + second * (cross @ cross)


def turned_derivatives(
    target: Array, platform: Array, vector: Array, body: Array | None = None, axes: int = 3
) -> tuple[Array, Array]:
    r"""Return the derivatives of `seen_from_turned_axes` for R of a rotation vector v.

    .. math:: \frac{\partial x'}{\partial x} = B^T R^T B, \qquad
              \frac{\partial x'}{\partial v} = B^T R^T\,[B (x - x_c)]_\times\,J_l(v)

    Parameters
    ----------
    target, platform, body, axes
        See `seen_from_turned_axes`.
    vector : ndarray, shape (..., 3)
        v [rad].

    Returns
    -------
    by_state : ndarray, shape (..., axes, axes)
        Of the position by the position; of the velocity by the velocity it is the same.
    by_vector : ndarray, shape (..., n, 3)
        Of the whole state; zero where it is neither position nor velocity.
    """
    back, jacobian = np.swapaxes(rotation_matrix(vector), -1, -2), left_jacobian(vector)
    frame = np.eye(3) if body is None else body
    home = np.swapaxes(frame, -1, -2) @ back
    leading = np.broadcast_shapes(target.shape[:-1], platform.shape[:-1], home.shape[:-2])
    by_vector = np.zeros((*leading, target.shape[-1], 3))
    for first, own in ((0, 0), (axes, 3)):
        if target.shape[-1] >= first + axes:
            offset = np.zeros((*leading, 3))
            offset[..., :axes] = target[..., first : first + axes] - platform[..., own : own + axes]
            seen = (frame @ offset[..., None])[..., 0]
            by_vector[..., first : first + axes, :] = (home @ _cross(seen) @ jacobian)[..., :axes, :]
    return (home @ frame)[..., :axes, :axes], by_vector


def _cross(v: Array) -> Array:
    """Return the matrix of the cross product with a vector, shape (..., 3, 3)."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape, 3)
