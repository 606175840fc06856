"""Rows in blocks of as many seconds, whose medians are what is fitted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.identification.candidates import passes_of
from quietfix.diagrams.identification.fit import fitted
from quietfix.diagrams.identification.priors import Priors
from quietfix.diagrams.readers.doppler.received import Received
from quietfix.diagrams.schema.errors import UserError

__all__ = ["MUCH", "Blocks", "blocks_of", "gain_of_more", "smooth_part", "system_of"]

Array = NDArray[np.float64]

MUCH = 3.3
"""Logarithm of a likelihood ratio (27) that is told: of noise alone one in 100 recordings gains it by a parameter."""

_BLOCKS = 100  # per pass
_LEAST = 8  # blocks in all


@dataclass(frozen=True, eq=False)
class Blocks:
    """Used rows in blocks of as many seconds.

    Attributes
    ----------
    parts : list of ndarray of int
        Numbers of the rows of each block.
    basis : ndarray, shape (rows, passes * order)
        Oscillators' polynomials at the rows.
    order : int
        States of one.
    """

    parts: list[NDArray[np.int64]]
    basis: Array
    order: int

    def priors(self, priors: Priors) -> Array:
        """Return standard deviations of all oscillators' states, shape (passes * order,)."""
        return np.tile(priors.oscillator, self.basis.shape[1] // self.order)

    def medians(self, values: Array) -> Array:
        """Return medians, shape (blocks,)."""
        return np.array([np.median(values[part]) for part in self.parts])

    def means(self, values: Array) -> Array:
        """Return means, shape (blocks, ...)."""
        return np.array([values[part].mean(axis=0) for part in self.parts])


def blocks_of(received: Received, used: NDArray[np.bool_], order: int) -> Blocks:
    """Return the used rows of a recording in about a hundred blocks per pass.

    Raises
    ------
    UserError
        If they are too few.
    """
    times = received.times
    number = passes_of(times)
    parts: list[NDArray[np.int64]] = []
    count = int(number[-1]) + 1
    basis = np.zeros((times.size, count * order))
    for k in range(count):
        mine = np.flatnonzero((number == k) & used)
        if not mine.size:
            continue
        span = times[mine[-1]] - times[mine[0]]
        which = np.floor((times[mine] - times[mine[0]]) / max(span / _BLOCKS, 1e-9) * (1 - 1e-12))
        parts += np.split(mine, np.flatnonzero(np.diff(which)) + 1)
        since = times - 0.5 * (times[mine[0]] + times[mine[-1]])
        for i in range(order):
            basis[number == k, k * order + i] = (since**i / math.factorial(i))[number == k]
    if len(parts) < _LEAST:
        raise UserError(f"{received.path.name}: {len(parts)} blocks of rows are not allowed; at least {_LEAST}")
    return Blocks(parts, basis, order)


def system_of(blocks: Blocks, measured: Array, rate: Array, columns: Array) -> tuple[Array, Array]:
    """Return design, the oscillators and more columns (rows, k), and measured less predicted, by blocks."""
    design = np.concatenate([blocks.basis, columns], axis=1)
    return blocks.means(design), blocks.medians(measured - rate)


def gain_of_more(
    received: Received,
    used: NDArray[np.bool_],
    system: tuple[Array, Array],
    prior: Array,
    center: Array,
    priors: Priors,
    noise: tuple[float, float],
) -> float:
    """Return the logarithm of the ratio of likelihoods with one more state of the oscillators and without, at best.

    Parameters
    ----------
    received : Received
    used : ndarray of bool, shape (rows,)
    system : (ndarray, ndarray)
        Design and values of the best object or place.
    prior, center : ndarray
        Of its parameters.
    priors : Priors
    noise : (float, float)
        Scale, and how many blocks count as one.
    """
    wider = replace(priors, order=priors.order + 1)
    more = blocks_of(received, used, wider.order)
    own = more.basis.shape[1] // wider.order * priors.order
    design, value = system
    longer = np.concatenate([more.means(more.basis), design[:, own:]], axis=1)
    first = more.priors(wider)
    there = np.concatenate([first, prior[own:]]), np.concatenate([0 * first, center[own:]])
    return fitted(longer, value, *there, *noise).peak - fitted(design, value, prior, center, *noise).peak


def smooth_part(rest: Array) -> float:
    """Return the robust size of residuals over that of their distance from a smooth curve, of order 7."""
    place = np.linspace(-1, 1, rest.size)
    basis = np.polynomial.legendre.legvander(place, min(7, rest.size // 4))
    weight = np.ones_like(rest)
    left = rest
    for _ in range(20):
        left = rest - basis @ np.linalg.lstsq(weight[:, None] * basis, weight * rest, rcond=None)[0]
        weight = 1 / np.sqrt(1 + (left / (2 * max(float(np.median(np.abs(left))), 1e-9))) ** 2)
    return float(np.median(np.abs(rest)) / max(float(np.median(np.abs(left))), 1e-9))
