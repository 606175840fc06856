"""Timing of peers against each other: round by round, so that a busy machine slows all of them alike."""

from __future__ import annotations

import gc
import statistics
import time
from collections import Counter
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
    def slices(self) -> int:
        """Turns that every peer has in a round."""
        return 1 if self.tiny else 10

    @property
    def seconds(self) -> float:
        """A peer repeats its work within one turn until it has run this long [s]."""
        return 0.0 if self.tiny else 0.1


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
    parts : sequence of callable
        The same work in as many parts as a round has turns, for a peer whose run is too long for one turn.
    """

    name: str
    run: Callable[[], Any]
    work: int
    parts: Sequence[Callable[[], Any]] = ()


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

    Every peer first runs once untimed: caches fill, and its result can be held against the others'. A round is
    ``size.slices`` turns of every peer, one peer after the other, so that what else the machine does within a
    second or so falls on all of them; the order rotates from turn to turn. What counts is processor time: all peers
    run in one thread. The garbage collector stays on, as it is
    for users, but starts every turn with nothing to do.

    Returns
    -------
    dict of str to Timing
        By the peers' names.
    """
    timings = {peer.name: Timing(peer.run()) for peer in peers}
    for round_ in range(size.rounds):
        seconds, runs = Counter[str](), Counter[str]()
        for turn in range(size.slices):
            for i in range(len(peers)):
                peer = peers[(round_ + turn + i) % len(peers)]
                elapsed, done = _turn(peer, turn, size)
                seconds[peer.name] += elapsed
                runs[peer.name] += done
        for peer in peers:
            timings[peer.name].costs.append(seconds[peer.name] / (runs[peer.name] * peer.work))
    return timings


def _turn(peer: Peer, turn: int, size: Size) -> tuple[float, float]:
    """Return the seconds of one turn, and how much of a whole run was done in it."""
    gc.collect()
    begun = time.process_time()
    if peer.parts:
        peer.parts[turn]()
        return time.process_time() - begun, 1 / size.slices
    runs = 0
    while runs == 0 or time.process_time() - begun < size.seconds:
        peer.run()
        runs += 1
    return time.process_time() - begun, runs


def ratios(one: Timing, other: Timing) -> list[float]:
    """Return how many times `one` costs what `other` costs, round by round."""
    return [a / b for a, b in zip(one.costs, other.costs, strict=True)]
