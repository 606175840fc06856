"""I/Q recordings of one's own, compared with the first of them: ``quietfix replay iq FILE FILE [...]``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.iq_comparison import Piece, pair_result, pieces
from quietfix.diagrams.parts.iq_pairs import IqPairs
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.readers.sigmf_file import IqRecording, read_sigmf
from quietfix.diagrams.recorded.reports.iq_report import IqReport
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_recordings"]

SOURCE = Source(
    folder="",
    origin="two or more SigMF recordings of your own (https://sigmf.org), of one sample rate",
    several=True,
    truth=False,
)


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


@dataclass(frozen=True, eq=False)
class _Joined:
    """All pairs side by side."""

    pairs: Sequence[tuple[int, int]]

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        takes: dict[str, str] = {}
        for i, j in self.pairs:
            takes |= {f"pair_{j}{i}": f"measurement_{j}{i}"}
            takes |= {f"pair_{j}{i}_noise_covariance": f"noise_covariance_{j}{i}"}
        joined = JoinedMeasurements(
            {f"pair_{j}{i}": JoinedPart(2) for i, j in self.pairs}, 1, "all pairs, side by side"
        )
        bus.add(joined, gives={port: port for port in ("measurement", "noise_covariance")}, takes=takes)


def declare(settings: Settings) -> Model:
    """Return recorded samples and their comparison; nothing is estimated. See `quietfix.diagrams.assembly`."""
    if not settings.data:
        raise UserError(f"FILE: it is missing; iq compares {SOURCE.origin}")
    return declare_recordings([one for file in settings.data for one in read_sigmf(Path(file))], settings)


def declare_recordings(recordings: Sequence[IqRecording], settings: Settings) -> Model:
    """Return the same of recordings that were read already: every one against the first.

    Raises
    ------
    UserError
        If there are fewer than two, they do not fit each other, or a setting is not allowed.
    """
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
    pairs = [(0, j) for j in range(1, len(blocks))]
    try:
        function = CrossAmbiguity(prefilter=settings.prefilter, confidence=settings.confidence, follow_rate=False)
        compared = IqPairs(blocks, pairs, function, settings.window, length, every)
    except ValueError as error:
        raise UserError(f"iq: {error}") from error
    gaps = _gaps(recordings, blocks, common, compared.plan.short)
    names = list(blocks)

    def report(result: xr.Dataset) -> IqReport:
        found = [pair_result(names, pair, result) for pair in pairs]
        return IqReport(settings, dated, length, result["time"].values, found, gaps)

    return Model(
        clock=compared.plan.clock,
        duration=compared.plan.end,
        divergence=0.0,
        parts=[compared, _Joined(pairs)],
        assume=_nothing,
        signals={name: name for name in (*compared.signals, "noise_covariance")},
        rows=[f"{kind}_{j}{i}" for i, j in pairs for kind in ("tdoa", "fdoa")],
        recorded=Recorded(report=report, keeps=["measurement", *compared.signals]),
    )


def _nothing(bus: Bus, name: str, options: Any) -> Assumed:
    raise UserError(f"estimators.{name}: it is not allowed; nothing is estimated of I/Q recordings alone")


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


SYSTEM = System(
    name="iq",
    title="recording: TDOA and FDOA of I/Q recordings of your own (SigMF)",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
    estimates=False,
)
