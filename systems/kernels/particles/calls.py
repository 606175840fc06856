"""The compiled loops over particles, called with arrays."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program, Step
from quietfix.systems.kernels.evaluating import values
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.updating import NO_INPUT, fit, plain, raised

__all__ = [
    "Difference",
    "Look",
    "chosen_by",
    "gather",
    "likelihoods",
    "look",
    "moved",
    "moved_by_kernel",
    "residuals",
    "systematic_counts",
    "told",
    "weighted_moments",
]

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Draw = NDArray[np.float64] | NDArray[np.uint64]

_BLOCK = 512  # as in quietfix.systems.kernels.particles.weighing


_UNDRAWN = np.empty((0, 4), dtype=np.uint64)


class Difference(NamedTuple):
    """Measured minus predicted of every particle (trials, m, N), and how many of each row (trials, m) are finite."""

    rows: Array
    there: Counts


class Look(NamedTuple):
    """What a measurement says of clouds.

    Attributes
    ----------
    logarithm : ndarray, shape (trials, N)
        Of the likelihoods, without their constant; -inf for a particle for which the model has no value.
    highest : ndarray, shape (trials,)
        The largest of each trial.
    residual, innovation : ndarray, shape (trials, m)
        Mean residual, and that of the whitened ones.
    spread : ndarray, shape (trials, m, m)
        Covariance of the whitened residuals.
    """

    logarithm: Array
    highest: Array
    residual: Array
    innovation: Array
    spread: Array


def moved(cloud: Array, phi: Array, offset: Array, root: Array, white: Draw, out: Array | None = None) -> Array:
    """Return Phi x + offset + L e for every particle of clouds (trials, n, N).

    Phi is (n, n) or (trials, n, n), `offset` (trials, n), `root` L (n, r) or (trials, n, r), `white` e (trials, r, N)
    or, of uint64, states (trials, 4) of generators from which e is drawn; `out` shares no memory with the cloud.
    """
    n, found = cloud.shape[1], np.empty(cloud.shape) if out is None else out
    noise = plain(root if root.ndim == 3 else root[None])
    given = plain(phi.reshape(-1, n, n)), plain(offset), noise, *_white(white, noise, cloud)
    ready("particles.moving:by_matrix")(plain(cloud), *given, found)
    return found


def moved_by_kernel(step: Step, held: Array | None, cloud: Array, root: Array, white: Draw, out: Array) -> None:
    """Write what a motion's kernel, whose input is `held` (trials, k), makes of every particle, plus L e; see `moved`.

    Raises
    ------
    ValueError
        Where a user's kernel raised.
    """
    inputs = NO_INPUT if held is None else plain(held[..., None, :].reshape(-1, 1, held.shape[-1]))
    noise = plain(root if root.ndim == 3 else root[None])
    given = step.loop(cloud.shape[1]), step.parameters[step.parts[0, 3] : step.parts[0, 4]], noise
    code = ready("particles.moving:by_kernel")(plain(cloud), inputs, *given, *_white(white, noise, cloud), out)
    if code >= 0:
        raise ValueError(f"motion: its kernel raised for a particle of trial {code} of these {len(cloud)}")


def _white(white: Draw, root: Array, cloud: Array) -> tuple[Array, NDArray[np.uint64]]:
    """Return normal numbers and no states, or room for those of one trial and the states of the generators."""
    if white.dtype == np.uint64:
        return np.empty((1, root.shape[-1], cloud.shape[-1])), cast(NDArray[np.uint64], white)
    return plain(cast(Array, white)), _UNDRAWN


def residuals(program: Program, cloud: Array, measured: Array, platforms: Array) -> Difference:
    """Return measured (trials, m) minus predicted for every particle of clouds (trials, n, N).

    Raises
    ------
    ValueError
        For platforms (1 or trials, p, 6) that are too few, or where a user's kernel raised.
    """
    trials, n, count = cloud.shape
    fit(program, n, platforms)
    whole, seen = plain(cloud), plain(platforms)
    found, there = np.empty((trials, measured.shape[-1], count)), np.empty(measured.shape, dtype=np.int64)
    space = np.empty((program.rows, _BLOCK))
    code = ready("particles.weighing:residuals")(whole, plain(measured), seen, *_coded(program), space, found, there)
    if code >= 0:
        _raised(program, code, whole, seen)
    return Difference(found, there)


def _coded(program: Program) -> tuple[Any, ...]:
    return program.parts, program.loops, program.chosen, program.parameters, program.moduli


def _raised(program: Program, code: int, cloud: Array, platforms: Array) -> None:
    """Say what a kernel raised, for the first particle for which it did."""
    trial = code >> 8
    seen = platforms[trial if len(platforms) > 1 else 0]
    values(program, cloud[trial].T, seen)
    raised(program, code & 255, cloud[trial, :, 0].copy(), seen)


def told(
    program: Program,
    cloud: Array,
    which: Counts,
    measured: Array,
    platforms: Array,
    missing: NDArray[np.bool_],
    weight: Array,
) -> tuple[Array, Array]:
    """Return log likelihoods (k, N) of the clouds of `which` (k,) of all trials, and the largest; see `look`."""
    k, count, seen = len(which), cloud.shape[-1], plain(platforms)
    logarithm, highest = np.empty((k, count)), np.empty(k)
    space = np.empty((program.rows + 2 * measured.shape[-1], _BLOCK))
    given = plain(measured), seen, *_coded(program), missing.astype(float), _matrices(weight), space
    code = ready("particles.weighing:told")(cloud, which, *given, logarithm, highest)
    if code >= 0:
        _raised(program, code, cloud, seen)
    return logarithm, highest


def _matrices(weight: Array) -> Array:
    return plain(weight.reshape(-1, *weight.shape[-2:]))


def look(residual: Array, missing: NDArray[np.bool_], weight: Array, share: Array, alike: NDArray[np.bool_]) -> Look:
    """Return what residuals (trials, m, N) say of particles with weights `share` (trials, N), unless all are `alike`.

    `weight` W is (m, m) or (trials, m, m); see `quietfix.systems.kernels.particles.weighing.look`.
    """
    trials, m, count = residual.shape
    row = (trials, m)
    found = Look(np.empty((trials, count)), np.empty(trials), np.empty(row), np.empty(row), np.empty((*row, m)))
    given = plain(residual), missing.astype(float), _matrices(weight), share, alike
    ready("particles.weighing:look")(*given, np.empty((m, count)), np.empty((m + 1, _BLOCK)), *found)
    return found


def likelihoods(residual: Array, missing: NDArray[np.bool_], weight: Array) -> tuple[Array, Array]:
    """Return whitened residuals (trials, m, N) and log likelihoods (trials, N) without their constant.

    `weight` W is (m, m) or (trials, m, m); see `quietfix.systems.kernels.particles.weighing.look`.
    """
    trials, m, count = residual.shape
    white, logarithm = np.empty((trials, m, count)), np.empty((trials, count))
    given = plain(residual), missing.astype(float), _matrices(weight)
    ready("particles.weighing:likelihoods")(*given, white, logarithm)
    return white, logarithm


def weighted_moments(cloud: Array, weight: Array | None) -> tuple[Array, Array]:
    """Return mean (trials, n) and covariance (trials, n, n) of clouds (trials, n, N); no weights: all count alike."""
    trials, n, count = cloud.shape
    mean, covariance = np.empty((trials, n)), np.empty((trials, n, n))
    share = np.empty((0, count)) if weight is None else plain(weight)
    ready("particles.weighing:moments")(plain(cloud), share, np.empty((n + 1, _BLOCK)), mean, covariance)
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
