"""The compiled loops over particles, called with arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program, Step
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.updating import NO_INPUT, fit, plain, raised

__all__ = [
    "chosen_by",
    "gather",
    "likelihoods",
    "moved",
    "moved_by_kernel",
    "residuals",
    "systematic_counts",
    "weighted_moments",
]

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


def moved(cloud: Array, phi: Array, offset: Array, root: Array, white: Array, out: Array | None = None) -> Array:
    """Return Phi x + offset + L e for every particle of clouds (trials, n, N).

    Phi is (n, n) or (trials, n, n), `offset` (trials, n), `root` L (n, r) or (trials, n, r), `white` e (trials, r, N);
    `out` shares no memory with the cloud.
    """
    n, found = cloud.shape[1], np.empty(cloud.shape) if out is None else out
    ready("particles.moving:by_matrix")(
        plain(cloud),
        plain(phi.reshape(-1, n, n)),
        plain(offset),
        plain(root if root.ndim == 3 else root[None]),
        plain(white),
        found,
    )
    return found


def moved_by_kernel(step: Step, held: Array | None, cloud: Array, root: Array, white: Array, out: Array) -> None:
    """Write what a motion's kernel, whose input is `held` (trials, k), makes of every particle, plus L e; see `moved`.

    Raises
    ------
    ValueError
        Where a user's kernel raised.
    """
    n = cloud.shape[1]
    inputs = NO_INPUT if held is None else plain(held[..., None, :].reshape(-1, 1, held.shape[-1]))
    noise = plain(root if root.ndim == 3 else root[None])
    code = ready("particles.moving:by_kernel")(
        plain(cloud), inputs, step.parts, step.parameters, noise, plain(white), np.empty((0, n)), out
    )
    if code >= 0:
        raise ValueError(f"motion: its kernel raised for a particle of trial {code} of these {len(cloud)}")


def residuals(program: Program, cloud: Array, measured: Array, platforms: Array) -> Array:
    """Return measured (trials, m) minus predicted for every particle of clouds (trials, n, N), shape (trials, m, N).

    Raises
    ------
    ValueError
        For platforms (1 or trials, p, 6) that are too few, or where a user's kernel raised.
    """
    trials, n, count = cloud.shape
    fit(program, n, platforms)
    whole, seen = plain(cloud), plain(platforms)
    found = np.empty((trials, measured.shape[-1], count))
    code = ready("particles.weighing:residuals")(
        whole,
        plain(measured),
        seen,
        program.parts,
        program.chosen,
        program.parameters,
        program.moduli,
        np.empty(n + program.rows),
        np.empty((0, n)),
        found,
    )
    if code >= 0:
        trial, particle = divmod(code >> 8, count)
        raised(program, code & 255, whole[trial, :, particle].copy(), seen[trial if len(seen) > 1 else 0])
    return found


def likelihoods(residual: Array, missing: NDArray[np.bool_], weight: Array) -> tuple[Array, Array]:
    """Return whitened residuals (trials, m, N) and log likelihoods (trials, N) without their constant.

    `weight` W is (m, m) or (trials, m, m); see `quietfix.systems.kernels.particles.weighing.likelihoods`.
    """
    trials, m, count = residual.shape
    white, logarithm = np.empty((trials, m, count)), np.empty((trials, count))
    ready("particles.weighing:likelihoods")(
        plain(residual), missing.astype(float), plain(weight.reshape(-1, m, m)), white, logarithm
    )
    return white, logarithm


def weighted_moments(cloud: Array, weight: Array | None) -> tuple[Array, Array]:
    """Return mean (trials, n) and covariance (trials, n, n) of clouds (trials, n, N); no weights: all count alike."""
    trials, n, count = cloud.shape
    mean, covariance = np.empty((trials, n)), np.empty((trials, n, n))
    share = np.empty((0, count)) if weight is None else plain(weight)
    ready("particles.weighing:moments")(plain(cloud), share, np.empty((n + 1, 512)), mean, covariance)
    return mean, covariance


def systematic_counts(weights: Array, uniform: Array) -> Counts:
    """Return how often each particle is taken, for weights (..., N) and numbers (..., 1)."""
    counts = np.empty(weights.shape, dtype=np.int64)
    n = weights.shape[-1]
    own = np.broadcast_to(uniform, (*weights.shape[:-1], 1))
    ready("particles.choosing:systematic")(
        plain(weights.reshape(-1, n)), plain(own.reshape(-1, 1)), counts.reshape(-1, n)
    )
    return counts


def chosen_by(counts: Counts) -> Counts:
    """Return which particle each new one comes from, rising, for counts (..., N) that sum to N."""
    n = counts.shape[-1]
    rows = np.array(counts.reshape(-1, n), dtype=np.int64, order="C")
    chosen = np.empty(rows.shape, dtype=np.int64)
    ready("particles.choosing:parents")(rows, chosen)
    return chosen.reshape(counts.shape)


def gather(cloud: Array, ancestor: Array, chosen: Counts, out: Array, out_ancestor: Array) -> None:
    """Copy the chosen (trials, N) particles (trials, n, N) and their ancestors (trials, N) into others."""
    ready("particles.choosing:gather")(plain(cloud), plain(ancestor), chosen, out, out_ancestor)
