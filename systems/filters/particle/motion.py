"""A cloud moved from one instant to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import are_own
from quietfix.systems.kernels.particles.calls import moved, moved_by_kernel
from quietfix.systems.motion.base import MotionModel

__all__ = ["propagate"]

Array = NDArray[np.float64]


def propagate(
    motion: MotionModel,
    mean: Array,
    cloud: Array,
    dt: float,
    root: Array,
    white: Array | NDArray[np.uint64],
    out: Array,
) -> None:
    """Write the cloud `dt` seconds later, shaken by process noise.

    Parameters
    ----------
    motion : MotionModel
        With its input held, if it has one.
    mean : ndarray, shape (trials, n)
        Of the clouds.
    cloud, out : ndarray, shape (trials, n, N)
        Before and after; they share no memory.
    root : ndarray, shape (n, r) or (trials, n, r)
        Square root of the covariance of the noise.
    white : ndarray, shape (trials, r, N) or, of uint64, (trials, 4)
        Standard normal, or the states of the generators from which it is drawn.
    """
    step = motion.equations(dt) if are_own(type(motion)) else None
    if step is not None:
        moved_by_kernel(step, motion.held, cloud, root, white, out)
        return
    if motion.linear and not motion.input_size:
        moved(cloud, motion.transition(mean, dt), np.zeros_like(mean), root, white, out)
        return
    held = motion.held
    alone = motion if held is None else motion.driven(held[..., None, :])
    here = alone.propagate(cloud.swapaxes(1, 2), dt).swapaxes(1, 2)
    moved(here, np.eye(mean.shape[-1]), np.zeros_like(mean), root, white, out)
