"""Measurements of one's own in the place of sensors: from the rows of a table to tracks that are played."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.own.fed.matching import Matched, matched
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.paths.functions import Path
from quietfix.diagrams.readers.ccsds.tdm_table import TDM_SUFFIXES, tdm_measurements
from quietfix.diagrams.readers.measurements import MeasurementTable, read_measurements
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Stepped, Times
from quietfix.systems.playback.track_paths import TrackPaths
from quietfix.systems.sensors.played_rows import PlayedRows, TableTrack

__all__ = ["Played", "played", "table_of"]

Array = NDArray[np.float64]

_SAME = 4e-12  # relative; rows as near to each other as this are of one instant, see `clocks.same_instant`
_LONG_GAP = 20.0  # medians of the steps, and seconds


@dataclass(frozen=True, eq=False)
class Played:
    """What was measured of each target, and what is known of it: a part of a diagram.

    Publishes ``measurement`` and ``raw``, ``noise_covariance`` where the table says sigmas of its own, ``target`` and
    ``truth``.

    Attributes
    ----------
    names : sequence of str
        Of the targets, in the order of the table.
    tracks : sequence of TableTrack
    noise_covariance : ndarray, shape (rows, rows)
        As the estimators believe it to be.
    paths : sequence of callable
        Where each target is; NaN where nobody knows.
    notes : sequence of str
        What a reader of the results must know.
    claimed : mapping of str to float
        Standard deviation of each row's values [SI], the median of what is believed of them or the table says.
    """

    names: Sequence[str]
    tracks: Sequence[TableTrack]
    noise_covariance: Array
    paths: Sequence[Path]
    notes: Sequence[str]
    claimed: Mapping[str, float]

    @property
    def scaled(self) -> bool:
        """Whether R comes with the measurement."""
        return any(track.scale is not None for track in self.tracks)

    @cached_property
    def clock(self) -> Stepped:
        """The ticks of all tracks together."""
        ticks = np.unique(np.concatenate([track.clock.ticks(np.inf) for track in self.tracks]))
        apart = np.diff(ticks, prepend=-np.inf) > _SAME * np.maximum(1.0, ticks)
        return Stepped(ticks[apart])

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return float(self.clock.ticks(np.inf)[-1])

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        block = bus.add(PlayedRows(self.tracks, self.noise_covariance))
        port = block.GetOutputPort("measurement")
        bus.publish(raw=port, measurement=port)
        if self.scaled:
            bus.publish(noise_covariance=block.GetOutputPort("noise_covariance"))
        target = TrackPaths([track.clock for track in self.tracks], self.paths)
        bus.add(target, gives={"target": "state", "truth": "state"})


def table_of(path: FilePath, two_way: str = "") -> MeasurementTable:
    """Return a table of measurements, read once for all that a command makes of it; `two_way` as `tdm_measurements`.

    Raises
    ------
    UserError
        As `read_measurements`.
    """
    try:
        status = path.stat()
        stamp = status.st_mtime_ns, status.st_size
    except (OSError, ValueError):
        stamp = 0, 0  # the reader says what is wrong
    return _read(path, stamp, two_way)


@lru_cache(maxsize=2)
def _read(path: FilePath, stamp: tuple[int, int], two_way: str) -> MeasurementTable:
    if path.suffix.lower() in TDM_SUFFIXES:
        return tdm_measurements(path, two_way)
    if two_way:
        raise UserError(f"measurements.two_way: {two_way} is for a Tracking Data Message only, not {path.name}")
    return read_measurements(path)


def played(
    table: MeasurementTable, seconds: Array, rows: Sequence[Row], noise_covariance: Array, duration: float
) -> Played:
    """Return what a table says of each target; where they are is unknown.

    Parameters
    ----------
    table : MeasurementTable
    seconds : ndarray, shape (rows of the table,)
        Times since t = 0 [s].
    rows : sequence of Row
        Of the stream of measurements.
    noise_covariance : ndarray, shape (m, m)
        As the estimators believe it to be.
    duration : float
        Length of the run [s].

    Raises
    ------
    UserError
        With file and line: rows that no sensor has, outside of the run, or there twice.
    """
    found = matched(table, rows)
    _check_times(table, seconds, duration)
    believed = np.sqrt(np.diagonal(noise_covariance))
    scale = np.where(np.isnan(found.sigma), 1.0, found.sigma / believed[found.row])
    scaled = bool(np.any(scale != 1.0))
    targets, of = _targets(table)
    order = np.lexsort((seconds, of))
    ends = np.searchsorted(of[order], np.arange(len(targets) + 1))
    tracks = [
        _track(table, found, seconds, scale if scaled else None, order[a:b], len(rows)) for a, b in pairwise(ends)
    ]
    notes = [*table.notes, *found.notes, *_jumps(table, seconds, of), *_gaps(table, seconds)]
    unknown = np.full(6, np.nan)
    sigma = believed[found.row] * scale
    claimed = {row.name: float(np.median(sigma[found.row == i])) for i, row in enumerate(rows) if i in found.row}
    return Played(targets, tracks, noise_covariance, [lambda t: unknown] * len(targets), notes, claimed)


def _targets(table: MeasurementTable) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the targets in the order of the table, and which of them each row is of."""
    names = list(dict.fromkeys(series.target for series in table.series))
    number = {name: i for i, name in enumerate(names)}
    of = np.array([number[series.target] for series in table.series])[table.which]
    if "" in number and len(names) > 1:
        row = int(np.argmax(of == number[""]))
        raise table.wrong(row, "target: nothing is not allowed beside rows that have one; the name of a target")
    return [name or "target" for name in names], of


def _check_times(table: MeasurementTable, seconds: Array, duration: float) -> None:
    for row in np.flatnonzero(seconds < 0)[:1]:
        raise table.wrong(
            int(row), f"its time is {-seconds[row]:g} s before t = 0, which is {_zero(table)}; no row may be earlier"
        )
    late = np.flatnonzero(seconds > duration * (1 + _SAME))
    for row in late[:1]:
        raise table.wrong(
            int(row),
            f"its time of {seconds[row]:.10g} s is after the end of the run; duration_s is {duration:g}, and the last "
            f"row is at {np.ceil(seconds.max()):.10g} s (--set duration_s=...)",
        )


def _zero(table: MeasurementTable) -> str:
    return "time_s 0" if table.whole is None else "start_utc"


def _track(
    table: MeasurementTable, found: Matched, seconds: Array, scale: Array | None, mine: NDArray[np.int64], size: int
) -> TableTrack:
    """Return the rows of one target, given by their numbers in order of time."""
    times = seconds[mine]
    new = np.diff(times, prepend=-np.inf) > _SAME * np.maximum(1.0, times)
    tick, row = np.cumsum(new) - 1, found.row[mine]
    _check_once(table, mine, tick * size + row)
    ticks = times[new]
    value, arrival = np.full((ticks.size, size), np.nan), np.full((ticks.size, size), np.inf)
    value[tick, row] = found.value[mine]
    came = np.empty_like(times)
    came[np.argsort(mine)] = np.maximum.accumulate(times[np.argsort(mine)])  # in the order of the file
    arrival[tick, row] = came
    if scale is None:
        return TableTrack(Times(ticks), value, None, arrival)
    scales = np.ones((ticks.size, size))
    scales[tick, row] = scale[mine]
    return TableTrack(Times(ticks), value, scales, arrival)


def _check_once(table: MeasurementTable, mine: NDArray[np.int64], place: NDArray[np.int64]) -> None:
    """Refuse a row that is there twice at one instant."""
    order = np.argsort(place, kind="stable")
    again = np.flatnonzero(np.diff(place[order]) == 0)
    for k in again[:1]:
        first, second = sorted((int(mine[order[k]]), int(mine[order[k + 1]])))
        series = table.series[table.which[second]]
        name = " ".join(part for part in series[1:4] if part)
        raise table.wrong(second, f"{name} is there twice at one time; line {table.lines[first]} has it already")


def _jumps(table: MeasurementTable, seconds: Array, of: NDArray[np.int64]) -> list[str]:
    """Return a note on times that step back within a target's rows: out of order, or of a clock that jumped."""
    by_target = np.argsort(of, kind="stable")
    steps = np.where(np.diff(of[by_target]) == 0, np.diff(seconds[by_target]), 0.0)
    back = np.flatnonzero(steps < 0)
    if not back.size:
        return []
    worst = int(back[np.argmin(steps[back])])
    return [
        f"{table.path.name}: times step back {back.size} times, at most by {-steps[worst]:g} s (line "
        f"{table.lines[by_target[worst + 1]]}): rows are put in order; if a clock jumped, they are wrong."
    ]


def _gaps(table: MeasurementTable, seconds: Array) -> list[str]:
    """Return a note on the longest time without any row, where it is much longer than usual."""
    order = np.argsort(seconds, kind="stable")
    steps = np.diff(seconds[order])
    moving = steps[steps > 0]
    if not moving.size:
        return []
    k, usual = int(np.argmax(steps)), float(np.median(moving))
    if steps[k] <= max(_LONG_GAP * usual, _LONG_GAP):
        return []
    return [
        f"{table.path.name}: nothing for {steps[k]:g} s before line {table.lines[order[k + 1]]} (usually {usual:g} s "
        "from row to row)."
    ]
