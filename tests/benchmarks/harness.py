"""Timing of peers against each other: round by round, so that a busy machine slows all of them alike."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Peer", "Size", "Timing", "race", "ratios"]


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Parameters
    ----------
    tiny : bool
        Smallest sizes: shows that the benchmarks work, and nothing about speed.
    rounds : int
        Interleaved rounds, >= 1; a published table has at least 5.
    """

    tiny: bool = False
    rounds: int = 5

    @property
    def trials(self) -> int:
        """Trials of an ensemble."""
        return 4 if self.tiny else 100

    @property
    def duration(self) -> float:
        """Length of the pass [s]."""
        return 6.0 if self.tiny else 150.0

    @property
    def seconds(self) -> float:
        """A peer is repeated within a round until it has run this long [s]."""
        return 0.0 if self.tiny else 1.0


@dataclass(frozen=True)
class Peer:
    """One way of doing the work.

    Parameters
    ----------
    name : str
        As in the table.
    run : callable
        Does all of the work once and returns its result.
    work : int
        Trials times steps in one run.
    """

    name: str
    run: Callable[[], Any]
    work: int


@dataclass
class Timing:
    """What `race` found out about one peer.

    Attributes
    ----------
    result : Any
        What the peer returned from the untimed run that came first.
    costs : list of float
        Seconds per trial and step, one number per round.
    """

    result: Any
    costs: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Median cost [s] per trial and step."""
        return statistics.median(self.costs)


def race(peers: Sequence[Peer], size: Size) -> dict[str, Timing]:
    """Time the peers in interleaved rounds.

    Every peer first runs once untimed: caches fill, and its result can be held against the others'. In each round
    every peer runs for at least ``size.seconds``; the order rotates from round to round. The garbage collector
    stays on, as it is for users, but starts every measurement with nothing to do.

    Returns
    -------
    dict of str to Timing
        By the peers' names.
    """
    timings = {peer.name: Timing(peer.run()) for peer in peers}
    for turn in range(size.rounds):
        for i in range(len(peers)):
            peer = peers[(turn + i) % len(peers)]
            gc.collect()
            runs, begun = 0, time.perf_counter()
            while runs == 0 or time.perf_counter() - begun < size.seconds:
                peer.run()
                runs += 1
            timings[peer.name].costs.append((time.perf_counter() - begun) / (runs * peer.work))
    return timings


def ratios(one: Timing, other: Timing) -> list[float]:
    """Return how many times `one` costs what `other` costs, round by round."""
    return [a / b for a, b in zip(one.costs, other.costs, strict=True)]
