"""Recorded I/Q samples of several receivers, compared pair by pair in one diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from systems.ambiguity.differences import Flag, Window
from systems.ambiguity.estimate import CrossAmbiguity
from systems.clocks import Clock, Periodic, Times
from systems.iq.block import IqBlock
from systems.recorder import Recorder
from systems.sensors.cross_ambiguity import QUALITY, CrossAmbiguitySensor
from systems.sensors.recorded_iq import RecordedIq

__all__ = ["PairResult", "Pairs", "Piece", "add_pairs", "pair_result", "pieces", "simulate"]

Array = NDArray[np.float64]


class Piece(NamedTuple):
    """A time that all recordings have in common without a gap: from, to [s], and the part of each recording."""

    begin: float
    end: float
    parts: tuple[IqBlock, ...]

    @property
    def duration(self) -> float:
        """How long it is [s]."""
        return self.end - self.begin


def pieces(recordings: Sequence[Sequence[IqBlock]]) -> list[Piece]:
    """Return what recordings have in common, in the order of time.

    Parameters
    ----------
    recordings : sequence of sequence of IqBlock
        The parts of each recording, which do not overlap.
    """
    found = [Piece(-np.inf, np.inf, ())]
    for parts in recordings:
        found = [
            Piece(begin, end, (*piece.parts, part))
            for piece in found
            for part in parts
            if (begin := max(piece.begin, float(part.start_time[0])))
            < (end := min(piece.end, float(part.start_time[0]) + part.size / part.sample_rate))
        ]
    return sorted(found, key=lambda piece: piece.begin)


@dataclass(frozen=True)
class Pairs:
    """The blocks of a comparison.

    Attributes
    ----------
    sensors : mapping of (int, int) to CrossAmbiguitySensor
        By pair: main receiver, auxiliary receiver.
    clock : Clock
        The middle of each window.
    end : float
        The last of them [s].
    short : int
        Pieces in common that are shorter than the integration time.
    """

    sensors: Mapping[tuple[int, int], CrossAmbiguitySensor]
    clock: Clock
    end: float
    short: int = 0

    def ports(self) -> dict[str, object]:
        """Return what is worth recording, by name."""
        return {
            f"{port}_{j}{i}": sensor.GetOutputPort(port)
            for (i, j), sensor in self.sensors.items()
            for port in ("measurement", "noise_covariance", "quality")
        }


def add_pairs(
    builder: DiagramBuilder,
    recordings: Mapping[str, Sequence[IqBlock]],
    pairs: Sequence[tuple[int, int]],
    function: CrossAmbiguity,
    window: Window,
    length: float,
    every: float,
) -> Pairs:
    """Add a block for each recording and one for each pair, and connect them.

    Parameters
    ----------
    builder : DiagramBuilder
        The diagram under construction.
    recordings : mapping of str to sequence of IqBlock
        By the receiver's name; of one sample rate, in one time, beginning at 0 or later. Several parts where a
        recording has gaps: what is compared lies in one part of each.
    pairs : sequence of (int, int)
        Main and auxiliary receiver, by their places in `recordings`.
    function : CrossAmbiguity
        How they are compared.
    window : Window
        Where the peak is sought.
    length : float
        Integration time [s].
    every : float
        Time from one comparison to the next [s].

    Raises
    ------
    ValueError
        If the recordings have not even one integration time in common.
    """
    blocks = list(recordings.values())
    rate = blocks[0][0].sample_rate
    samples = round(length * rate)
    margin = int(np.ceil(np.max(np.abs(window.delay) + np.asarray(window.half_delay)) * rate)) + 8
    common = pieces(blocks)
    # as much before the first as the auxiliary receivers need, but a short piece is not lost for that
    spare = [min(margin / rate, max(0.0, 0.5 * (piece.duration - length))) for piece in common]
    counts = [
        int(np.floor((piece.duration - length - 2 * less) / every + 1e-9)) + 1 if piece.duration >= length else 0
        for piece, less in zip(common, spare, strict=True)
    ]
    if samples < 64 or not any(counts):
        longest = max((piece.duration for piece in common), default=0.0)
        raise ValueError(
            f"recordings: {longest:.4g} s in common are not allowed; at least the {length:.4g} s that "
            "are integrated, and 64 samples"
        )
    used = [
        (Periodic(every, piece.begin + less + 0.5 * length), count)
        for piece, less, count in zip(common, spare, counts, strict=True)
        if count
    ]
    ends = [one.offset + (count - 1) * every for one, count in used]
    clock: Clock = used[0][0]
    if len(used) > 1:
        clock = Times(np.concatenate([one.ticks(end)[:count] for (one, count), end in zip(used, ends, strict=True)]))
    sources: dict[tuple[int, int], RecordedIq] = {}
    names = list(recordings)
    sensors = {}
    for i, j in pairs:
        sensor = builder.AddSystem(
            CrossAmbiguitySensor(function, window, clock, 1, name=f"caf {names[j]} - {names[i]}")
        )
        for port, which, extra in (("main", i, 0), ("auxiliary", j, margin)):
            if (which, extra) not in sources:
                name = names[which] + (" with margin" if extra else "")
                sources[which, extra] = builder.AddSystem(RecordedIq(blocks[which], clock, samples, extra, name))
            builder.Connect(sources[which, extra].GetOutputPort("iq"), sensor.GetInputPort(port))
        sensors[i, j] = sensor
    return Pairs(sensors, clock, ends[-1], counts.count(0))


def simulate(diagram: Diagram, recorder: Recorder, end: float) -> tuple[Array, dict[str, Array]]:
    """Run a diagram; return times (samples,) and signals (samples, trials, size) of its recorder."""
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(simulator.get_context())


@dataclass(frozen=True, eq=False)
class PairResult:
    """TDOA and FDOA of a pair against time; NaN where flagged.

    Attributes
    ----------
    main, auxiliary : str
        Names of the receivers; the differences are auxiliary minus main.
    tdoa, fdoa, sigma_tdoa, sigma_fdoa : ndarray, shape (samples,)
        [s], [Hz], and the standard deviations that the samples let expect.
    peak, coherence : ndarray, shape (samples,)
        See `systems.ambiguity.differences.Differences`.
    flag : ndarray of int, shape (samples,)
        Sum of `Flag`.
    """

    main: str
    auxiliary: str
    tdoa: Array
    fdoa: Array
    sigma_tdoa: Array
    sigma_fdoa: Array
    peak: Array
    coherence: Array
    flag: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """Where there is a measurement, shape (samples,)."""
        return np.isfinite(self.tdoa)

    def reasons(self) -> str:
        """Return what was flagged and how often, in words; empty if nothing was."""
        found = [(flag, int(np.count_nonzero(self.flag & flag))) for flag in Flag if flag]
        return ", ".join(f"{str(flag.name).lower().replace('_', ' ')} {count}" for flag, count in found if count)


def pair_result(names: Sequence[str], pair: tuple[int, int], logs: Mapping[str, Array]) -> PairResult:
    """Return the result of one pair from what `Pairs.ports` recorded."""
    i, j = pair
    measured, noise, quality = (logs[f"{port}_{j}{i}"][:, 0] for port in ("measurement", "noise_covariance", "quality"))
    column = {name: quality[:, k] for k, name in enumerate(QUALITY)}
    return PairResult(
        names[i],
        names[j],
        measured[:, 0],
        measured[:, 1],
        np.sqrt(noise[:, 0]),
        np.sqrt(noise[:, 3]),
        column["peak_to_noise"],
        column["coherence"],
        column["flag"].astype(np.int64),
    )
