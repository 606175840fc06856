"""The runs that a study is made of: a batch of trials, or one recorded track after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.assembly.model import Model
from quietfix.systems.clocks import Clock, Stepped, Times
from quietfix.systems.playback.tracks import play_track
from quietfix.systems.recorder import Recorder
from quietfix.systems.signals import Draw, set_draw

__all__ = ["Run", "Running", "effort", "longest", "padded", "runs", "simulate", "size_of_chunk", "thinned"]

Array = NDArray[np.float64]

_OVERHEAD = 30  # trials: what a batch costs whatever its width
_TOGETHER = 256  # tracks that are handed on at once: a chunk on disk costs as much as many short tracks


@dataclass(frozen=True)
class Run:
    """Trials that are simulated at once.

    Attributes
    ----------
    done : int
        How many trials of the study come before.
    first : int
        Number of the first one; of a track: which it is.
    size : int
        How many they are.
    clock : Clock, optional
        When a track is played; None: at the epochs of the model.
    times : ndarray, optional
        The same in the time of the recording [s].
    """

    done: int
    first: int
    size: int
    clock: Clock | None = None
    times: Array | None = None


@dataclass(frozen=True)
class Running:
    """A diagram that is built for batches of a width, and what reads it."""

    width: int
    wired: Assembly
    diagram: Diagram
    recorders: Sequence[Recorder]


def effort(count: int, width: int, chunk: int | None = None) -> int:
    """Return what so many trials cost in batches of a width, in trials; of each only a chunk may be of use."""
    return math.ceil(count / (chunk or width)) * (width + _OVERHEAD)


def runs(model: Model, first: int, trials: int, width: int) -> Iterator[list[Run]]:
    """Yield the runs of a study, those together whose results make one chunk.

    Parameters
    ----------
    model : Model
    first, trials : int
        Number of the first trial, and how many there are.
    width : int
        Trials at once.
    """
    recorded = model.recorded
    if recorded is None or not recorded.clocks:
        for done in range(0, trials, width):
            yield [Run(done, first + done, min(width, trials - done))]
        return
    every = [Run(k, first + k, 1, recorded.clocks[first + k], recorded.times[first + k]) for k in range(trials)]
    for begin in range(0, trials, _TOGETHER):
        yield every[begin : begin + _TOGETHER]


def longest(model: Model, trials: int, first: int, every: int) -> int:
    """Return how many epochs of a track are kept at most, of those that are run; 0: there are no tracks."""
    if model.recorded is None or not model.recorded.clocks:
        return 0
    most = max(len(clock.ticks(math.inf)) for clock in model.recorded.clocks[first : first + trials])
    return math.ceil((most - 1) / every) + 1


def thinned(clock: Clock, duration: float, every: int) -> Clock:
    """Return a clock of every so many ticks, and the last."""
    if every == 1:
        return clock
    ticks = clock.ticks(duration)
    kind = Stepped if isinstance(clock, Stepped) else Times
    return kind(np.union1d(ticks[::every], ticks[-1:]))


def size_of_chunk(model: Model, trials: int, width: int) -> int:
    """Return how many trials of a study make one chunk; arguments as of `runs`."""
    recorded = model.recorded
    return width if recorded is None or not recorded.clocks else min(_TOGETHER, trials)


def simulate(
    simulator: Simulator, diagram: Diagram, model: Model, run: Run, seed: int, tell: Callable[[float], None]
) -> Context:
    """Do a run in a context of its own, and return that.

    Parameters
    ----------
    simulator : Simulator
        Of the diagram; it may be used again.
    diagram : Diagram
    model : Model
        What the diagram was built from.
    run : Run
    seed : int
        Of all noise.
    tell : callable
        Gets, again and again, which share of the run is done.
    """
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(seed, run.first))
    if run.clock is None:
        # rounding may put the last tick a bit after the end: 3 * 0.1 > 0.3
        end = max(model.duration, *model.clock.ticks(model.duration)[-1:])
    else:
        end = play_track(diagram, context, run.first)
    stops = [end]
    if isinstance(model.clock, Stepped):
        context.SetTime(0.0)  # where a start that is given holds, and a prior is drawn
        stops = [float(tick) for tick in (run.clock or model.clock).ticks(end) if tick > 0]
    begin = context.get_time()
    simulator.reset_context(context)

    def monitor(root: Context) -> EventStatus:
        tell((root.get_time() - begin) / max(end - begin, 1e-9))
        return EventStatus.DidNothing()

    simulator.set_monitor(monitor)
    try:
        simulator.Initialize()
        for stop in stops:
            simulator.AdvanceTo(stop)
    finally:
        simulator.clear_monitor()
    return context


def padded(
    logs: Sequence[tuple[Array, Mapping[str, Array]]], together: Sequence[Run], epochs: int, every: int
) -> tuple[Array, dict[str, Array]]:
    """Return the logs of tracks side by side.

    Parameters
    ----------
    logs : sequence of (times, signals)
        Of each track: ticks, and signals (ticks, 1, size).
    together : sequence of Run
        The tracks; ticks that are not of their clock are left out.
    epochs : int
        So many there are room for.
    every : int
        Keep every so many of them, and the last.

    Returns
    -------
    times : ndarray, shape (tracks, epochs)
        NaN beyond the end of a track.
    signals : dict of str to ndarray, shape (epochs, tracks, size)
        Likewise.
    """
    times = np.full((len(logs), epochs), np.nan)
    signals = {name: np.full((epochs, len(logs), v.shape[-1]), np.nan) for name, v in logs[0][1].items()}
    for k, ((ticks, log), run) in enumerate(zip(logs, together, strict=True)):
        assert run.clock is not None and run.times is not None
        of = run.clock
        own = np.flatnonzero([of.index(tick) is not None for tick in ticks])
        kept = np.union1d(np.arange(own.size)[::every], own.size - 1)
        times[k, : kept.size] = run.times[kept]
        for name, values in log.items():
            signals[name][: kept.size, k] = values[own[kept], 0]
    return times, signals
