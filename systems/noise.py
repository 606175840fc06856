"""Counter-based noise: a pure function of (seed, name, trial, sample).

Nothing random is kept in a block. The draws of trial 37 are the same whether it runs alone, in a batch of a
hundred or in the thirty-eighth chunk, and adding a block to a diagram changes no other block's draws.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from quietfix.systems.kernels.loading import ready

__all__ = ["generators", "many_normal", "normal", "uniform"]

_WORDS_PER_BLOCK = 4  # one Philox 4x64 block


def _key(seed: int, name: str) -> NDArray[np.uint64]:
    digest = hashlib.blake2b(f"{seed}:{name}".encode(), digest_size=16).digest()
    return np.frombuffer(digest, dtype="<u8")


def uniform(seed: int, name: str, first_trial: int, trials: int, sample: int, size: int) -> NDArray[np.float64]:
    """Draw uniform numbers strictly inside (0, 1).

    Parameters
    ----------
    seed : int
        Seed of the study.
    name : str
        Name of the block that draws; part of the key, so that blocks are independent.
    first_trial, trials : int
        The rows are trials ``first_trial ... first_trial + trials - 1``.
    sample : int
        Index of the sample, >= 0.
    size : int
        Numbers per trial.

    Returns
    -------
    ndarray, shape (trials, size)

    Notes
    -----
    Raw words of the Philox 4x64-10 generator (Salmon et al., *Parallel random numbers: as easy as 1, 2, 3*,
    SC'11); every trial owns whole blocks of four words at counter (trial * blocks, sample). 52 bits are used,
    because with 53 bits adding one half can round to exactly 1.
    """
    if sample < 0 or first_trial < 0:
        raise ValueError(f"sample and first_trial must be >= 0, got {sample} and {first_trial}")
    if size == 0 or trials == 0:
        return np.empty((trials, size))
    blocks = -(-size // _WORDS_PER_BLOCK)
    counter = np.array([first_trial * blocks, sample, 0, 0], dtype=np.uint64)
    words = np.random.Philox(key=_key(seed, name), counter=counter).random_raw(trials * blocks * _WORDS_PER_BLOCK)
    words = words.reshape(trials, blocks * _WORDS_PER_BLOCK)[:, :size]
    return ((words >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52


def normal(seed: int, name: str, first_trial: int, trials: int, sample: int, size: int) -> NDArray[np.float64]:
    """Draw standard normal numbers by the inverse of the normal distribution; see `uniform`.

    The inverse, not a ziggurat: it uses exactly one word per number, so that any row can be drawn alone.
    """
    return ndtri(uniform(seed, name, first_trial, trials, sample, size))


def many_normal(
    seed: int, name: str, trials: Iterable[int], sample: int, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Draw many standard normal numbers per trial, as a cloud of particles needs them.

    Like `normal` a pure function of (seed, name, trial, sample), and any trial can be drawn alone; but every trial has
    a generator of its own, which pays from some thousand numbers on: a tenth of the time of `normal`. They are those of
    ``numpy.random.Generator(SFC64(key)).standard_normal``.

    Parameters
    ----------
    seed : int
        Seed of the study.
    name : str
        Name of the block that draws, and of what for.
    trials : iterable of int
        Numbers of the trials, >= 0, in any order.
    sample : int
        Index of the sample, >= 0.
    shape : tuple of int
        Numbers per trial.

    Returns
    -------
    ndarray, shape (trials, *shape)
    """
    states = generators(seed, name, trials, sample)
    drawn, fill = np.empty((len(states), *shape)), ready("particles.normals:fill")
    for row, state in zip(drawn, states, strict=True):
        fill(state, row.reshape(-1))
    return drawn


def generators(seed: int, name: str, trials: Iterable[int], sample: int) -> NDArray[np.uint64]:
    """Return the states (trials, 4) of the generators from which `many_normal` draws."""
    if sample < 0:
        raise ValueError(f"sample must be >= 0, got {sample}")
    numbers = list(trials)
    states = np.empty((len(numbers), 4), dtype=np.uint64)
    for row, trial in zip(states, numbers, strict=True):
        entropy = int.from_bytes(_key(seed, f"many:{name}:{trial}:{sample}").tobytes(), "little")
        state: Any = np.random.SFC64(entropy).state
        row[:] = state["state"]["state"]
    return states
