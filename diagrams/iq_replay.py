"""Replay of I/Q recordings of one's own: ``quietfix replay iq FILE FILE [...]``, TDOA and FDOA against time."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from diagrams.errors import UserError
from diagrams.iq_pairs import PairResult, Piece, add_pairs, pair_result, pieces, simulate
from diagrams.iq_settings import Settings
from diagrams.replay import Dataset
from diagrams.sigmf_file import IqRecording, read_sigmf
from diagrams.tables import Column, Table
from systems.ambiguity.estimate import CrossAmbiguity
from systems.iq.block import IqBlock
from systems.recorder import record

__all__ = ["DATASET", "IqReplay", "Settings", "compare"]

Array = NDArray[np.float64]


def _blocks(recordings: Sequence[IqRecording]) -> tuple[dict[str, list[IqBlock]], bool]:
    """Return parts by name in the time since the first sample of all, and whether the files say when they begin."""
    rates = {one.sample_rate for one in recordings}
    if len(rates) > 1:
        text = ", ".join(f"{one.name} {one.sample_rate:.10g} Hz" for one in recordings)
        raise UserError(f"FILE: sample rates that differ are not allowed ({text}); resample them to one rate first")
    stamps = [one.start for one in recordings]
    dated = [stamp for stamp in stamps if stamp is not None]
    if dated and len(dated) < len(stamps):
        silent = next(one.name for one in recordings if one.start is None)
        raise UserError(f"FILE: {silent} does not say when it begins (core:datetime); all recordings must, or none")
    first = min(dated, default=(0, 0.0))
    blocks: dict[str, list[IqBlock]] = {}
    for i, one in enumerate(recordings):
        # whole seconds apart, so that no digit of the fractions is lost
        begin = 0.0 if one.start is None else (one.start[0] - first[0]) + (one.start[1] - first[1])
        name = one.name if one.name not in blocks else f"{one.name} ({i + 1})"
        blocks[name] = [
            IqBlock(part.samples, one.sample_rate, part.frequency, begin + part.begin) for part in one.segments
        ]
    return blocks, bool(dated)


def _check(common: Sequence[Piece], settings: Settings, every: float, shared: float) -> None:
    """Raise UserError if a setting does not fit the recordings."""
    rate = common[0].parts[0].sample_rate
    if every * rate < 1:
        raise UserError(f"every_s: {every:g} is not allowed; at least a sample of the recordings, {1 / rate:.4g} s")
    if 1e-6 * settings.half_delay_us > shared:
        raise UserError(
            f"half_delay_us: {settings.half_delay_us:g} is not allowed; at most the {1e6 * shared:.6g} us that the "
            "recordings have in common"
        )
    for tuned in {part.centre_frequency - piece.parts[0].centre_frequency for piece in common for part in piece.parts}:
        # what is received at one frequency lies that far apart in the samples; beyond the rate it is another's alias
        if not abs(settings.frequency_hz - tuned) < rate:
            raise UserError(
                f"frequency_hz: {settings.frequency_hz:g} is not allowed for receivers tuned {tuned:.10g} Hz apart; "
                f"less than the sample rate, {rate:.10g} Hz, from that"
            )
    try:
        empty = not settings.prefilter.moments(rate).weight.any()
    except ValueError as error:
        raise UserError(f"iq: {error}") from error
    if empty:
        raise UserError(
            f"low_hz, high_hz, notch_hz: {settings.low_hz:g}, {settings.high_hz:g}, {settings.notch_hz:g} are not "
            f"allowed; something must be left of {-0.5 * rate:.10g} to {0.5 * rate:.10g} Hz"
        )


def compare(recordings: Sequence[IqRecording], settings: Settings | None = None) -> IqReplay:
    """Compare every recording with the first one, in one diagram.

    Parameters
    ----------
    recordings : sequence of IqRecording
        At least two.
    settings : Settings, optional
        How they are compared.

    Raises
    ------
    UserError
        If there are fewer than two, they do not fit each other, or a setting is not allowed.
    """
    settings = settings or Settings()
    if len(recordings) < 2:
        raise UserError(f"FILE: {len(recordings)} recording(s) are not allowed; two or more are compared")
    blocks, dated = _blocks(recordings)
    common = pieces(list(blocks.values()))
    if not common:
        raise UserError("FILE: the recordings have no time in common; they must overlap (core:datetime)")
    shared = max(piece.duration for piece in common)
    length = settings.integration_s or min(0.1, shared / 16)
    every = settings.every_s or length
    _check(common, settings, every, shared)
    try:
        function = CrossAmbiguity(prefilter=settings.prefilter, confidence=settings.confidence, follow_rate=False)
        builder = DiagramBuilder()
        pairs = [(0, j) for j in range(1, len(blocks))]
        compared = add_pairs(builder, blocks, pairs, function, settings.window, length, every)
    except ValueError as error:
        raise UserError(f"iq: {error}") from error
    recorder = record(builder, compared.ports(), compared.clock)
    times, logs = simulate(builder.Build(), recorder, compared.end)
    names = list(blocks)
    results = [pair_result(names, pair, logs) for pair in pairs]
    return IqReplay(settings, dated, length, times, results, _gaps(recordings, blocks, common, compared.short))


def _gaps(
    recordings: Sequence[IqRecording], blocks: Mapping[str, Sequence[IqBlock]], common: Sequence[Piece], short: int
) -> list[str]:
    """Return what of the recordings was not compared, in words."""
    lines = []
    for one, (name, parts) in zip(recordings, blocks.items(), strict=True):
        if one.unclaimed:
            lines.append(f"{name}: {one.unclaimed} samples before its first capture are left out")
        if len(parts) > 1:
            begins, ends = (np.array([p.start_time[0] + k * p.duration for p in parts]) for k in (0, 1))
            missing = float(np.maximum(begins[1:] - ends[:-1], 0.0).sum())
            lines.append(f"{name}: {len(parts)} captures that do not follow each other, {missing:.6g} s between them")
    if len(common) > 1:
        total = sum(piece.duration for piece in common)
        too_short = f"; {short} of them are shorter than a comparison, and left out" if short else ""
        lines.append(f"the recordings have {total:.6g} s in common, in {len(common)} pieces{too_short}")
    return lines


@dataclass(frozen=True, eq=False)
class IqReplay:
    """What came out of a comparison of recordings.

    Attributes
    ----------
    settings : Settings
    dated : bool
        Whether the files say when they begin; otherwise they were taken to begin together.
    length : float
        Integration time [s].
    times : ndarray, shape (samples,)
        Middle of each comparison at the first receiver, since the first sample of all [s].
    pairs : list of PairResult
        Each recording against the first.
    gaps : list of str
        What of the recordings was not compared, in words.
    """

    settings: Settings
    dated: bool
    length: float
    times: Array
    pairs: list[PairResult] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)

    def table(self) -> Table:
        """See `Replay.table`."""
        heads = ("TDOA, us", "scatter", "sigma", "FDOA, Hz", "scatter", "sigma", "peak, dB", "found")
        title = f"{self.times.size} comparisons of {1e3 * self.length:.4g} ms with {self.pairs[0].main}"
        table = Table(title, [Column("recording"), *heads])
        for pair in self.pairs:
            good = pair.good
            if not good.any():
                table.add(pair.auxiliary, *["-"] * 7, f"0 of {good.size}")
                continue
            table.add(
                pair.auxiliary,
                f"{1e6 * np.median(pair.tdoa[good]):.4f}",
                f"{1e6 * pair.tdoa[good].std():.4f}",
                f"{1e6 * np.median(pair.sigma_tdoa[good]):.4f}",
                f"{np.median(pair.fdoa[good]):.3f}",
                f"{pair.fdoa[good].std():.3f}",
                f"{np.median(pair.sigma_fdoa[good]):.3f}",
                f"{10 * np.log10(np.median(pair.peak[good])):.1f}",
                f"{np.count_nonzero(good)} of {good.size}",
            )
        return table

    def notes(self) -> list[str]:
        """See `Replay.notes`."""
        lines = ["differences: that recording minus the first; medians over time"]
        if not self.dated:
            lines.append("the files do not say when they begin (core:datetime); they were taken to begin together")
        lines += self.gaps
        lines += [f"{pair.auxiliary}: flagged: {reasons}" for pair in self.pairs if (reasons := pair.reasons())]
        return lines

    def summary(self) -> Mapping[str, Any]:
        """See `Replay.summary`."""
        return {
            "integration_s": self.length,
            "settings": vars(self.settings),
            "gaps": self.gaps,
            "time_s": self.times.tolist(),
            "pairs": {
                f"{pair.auxiliary} - {pair.main}": {
                    "tdoa_s": _listed(pair.tdoa),
                    "sigma_tdoa_s": _listed(pair.sigma_tdoa),
                    "fdoa_hz": _listed(pair.fdoa),
                    "sigma_fdoa_hz": _listed(pair.sigma_fdoa),
                    "peak_to_noise": _listed(pair.peak),
                    "flag": pair.flag.tolist(),
                }
                for pair in self.pairs
            },
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Replay.draw`: the figure, and the same numbers as CSV."""
        from diagrams.figures.iq_replay import draw_differences
        from diagrams.figures.style import save

        return [
            save(draw_differences(self.pairs, self.times, self.length), folder / "differences.png"),
            self._write(folder / "differences.csv"),
        ]

    def _write(self, path: Path) -> Path:
        with path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(
                ["time_s", "main", "auxiliary", "tdoa_s", "sigma_tdoa_s", "fdoa_hz", "sigma_fdoa_hz", "flag"]
            )
            for pair in self.pairs:
                columns = (pair.tdoa, pair.sigma_tdoa, pair.fdoa, pair.sigma_fdoa)
                for k, time in enumerate(self.times):
                    numbers = [f"{column[k]:.12g}" if np.isfinite(column[k]) else "" for column in columns]
                    writer.writerow([f"{time:.9f}", pair.main, pair.auxiliary, *numbers, int(pair.flag[k])])
        return path


def _listed(values: Array) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def _run(files: Sequence[Path], progress: bool, settings: Settings) -> IqReplay:
    return compare([one for file in files for one in read_sigmf(file)], settings)


DATASET = Dataset(
    name="iq",
    folder="",
    source="two or more SigMF recordings of your own (https://sigmf.org), of one sample rate",
    run=_run,
    takes_file=True,
    several_files=True,
    settings=Settings,
)
