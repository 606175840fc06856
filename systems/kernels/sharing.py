"""Trials shared among threads: contiguous pieces of a batch, each in one compiled call that holds no lock.

What a trial becomes depends on no other trial, so that however many threads there are, no bit changes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

__all__ = ["Parts", "call", "pieces", "side_by_side", "threads"]

_WORTH = 100.0  # us of work in a piece, at least: handing it to another thread costs some 30 us
_threads: ContextVar[int] = ContextVar("threads", default=1)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Share trials among so many threads in what this block runs, where a batch is large enough to pay."""
    before = _threads.set(count)
    try:
        yield
    finally:
        _threads.reset(before)


@dataclass(frozen=True)
class Parts:
    """How the arguments of a compiled function are cut into pieces of trials.

    Attributes
    ----------
    by_trial : tuple of int
        Numbers of the arguments whose first axis is the trials; one of length 1 belongs to all of them.
    space : int
        Number of the argument that is room to work in: each piece has its own; -1: there is none.
    each : float
        About how long a trial takes [us].
    unit : int
        By what the function's answer grows from one trial to the next.
    good : int
        The answer where nothing went wrong.
    """

    by_trial: tuple[int, ...]
    space: int
    each: float
    unit: int = 0
    good: int = 0


def pieces(trials: int, each: float) -> list[slice]:
    """Return contiguous pieces of so many trials that take so long [us] each; a single one where more do not pay."""
    count = _threads.get()
    if count > 1:
        count = min(count, trials, int(trials * each / _WORTH) if _WORTH > 0 else trials)
    if count < 2:
        return [slice(0, trials)]
    ends = [trials * k // count for k in range(count + 1)]
    return [slice(a, b) for a, b in pairwise(ends)]


def call(code: Any, arguments: Sequence[Any], trials: int, parts: Parts, states: int = 1) -> int:
    """Call a compiled function for all trials, in one piece or in several at once; return its answer.

    Where several pieces went wrong it is the answer of the first of them, as if all were one. `states` is how many each
    trial has.
    """
    if _threads.get() == 1:
        answer: int = code(*arguments)
        return answer
    cut = pieces(trials, parts.each * states)
    if len(cut) == 1:
        return int(code(*arguments) or 0)
    each = []
    for piece in cut:
        own = list(arguments)
        for k in parts.by_trial:
            own[k] = own[k] if own[k].shape[0] == 1 else own[k][piece]
        if parts.space >= 0:
            own[parts.space] = np.empty(own[parts.space].shape)
        each.append((code, own))
    for piece, found in zip(cut, side_by_side(each), strict=True):
        if found is not None and found != parts.good:
            return int(found) + piece.start * states * parts.unit
    return parts.good


def side_by_side(calls: Sequence[tuple[Any, Sequence[Any]]]) -> list[Any]:
    """Call functions with arguments at once, the last of them in this thread; return their answers in this order."""
    begun = [_pool(len(calls) - 1).submit(code, *arguments) for code, arguments in calls[:-1]]
    try:
        last = calls[-1][0](*calls[-1][1])
    finally:
        found = [one.result() for one in begun]  # what they write into must not be let go before
    return [*found, last]


@cache
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, "quietfix-trials")


os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of its parent's threads
