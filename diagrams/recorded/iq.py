"""I/Q recordings of one's own, compared with one of them: ``quietfix replay iq FILE FILE [...]``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.iq_comparison import PairResult, pair_result, pieces
from quietfix.diagrams.parts.iq_pairs import IqPairs
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.readers.iq.any_file import read_iq
from quietfix.diagrams.readers.iq.recording import IqRecording
from quietfix.diagrams.recorded.iq_blocks import Alike, alike, check, lost
from quietfix.diagrams.recorded.locating.position import Heard, Located, locate
from quietfix.diagrams.recorded.locating.receivers import Known, known_by_table, known_by_tracks
from quietfix.diagrams.recorded.reports.iq_report import IqReport, rows_of
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_recordings"]

SOURCE = Source(
    folder="",
    origin="two or more I/Q recordings of your own: SigMF (https://sigmf.org), WAV, or bare samples (--rate, --type)",
    several=True,
    truth=False,
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
    raw = settings.raw
    recordings = [
        one for file in settings.data for one in read_iq(Path(file), raw.rate_hz, raw.type, 1e6 * raw.frequency_mhz)
    ]
    return declare_recordings(recordings, settings)


def declare_recordings(recordings: Sequence[IqRecording], settings: Settings) -> Model:
    """Return the same of recordings that were read already: every one against the reference.

    Raises
    ------
    UserError
        If there are fewer than two, they do not fit each other, or a setting is not allowed.
    """
    if len(recordings) < 2:
        raise UserError(f"FILE: {len(recordings)} recording(s) are not allowed; two or more are compared")
    heard = alike(recordings, settings)
    known = _known(heard, settings)
    common = pieces(list(heard.blocks.values()))
    if not common:
        raise UserError("FILE: the recordings have no time in common; they must overlap (core:datetime)")
    shared = max(piece.duration for piece in common)
    length = settings.integration_s or min(0.1, shared / 16)
    every = settings.every_s or length
    check(common, settings, every, shared)
    pairs = [(heard.reference, j) for j in range(len(heard.blocks)) if j != heard.reference]
    try:
        function = CrossAmbiguity(prefilter=settings.prefilter, confidence=settings.confidence, follow_rate=False)
        compared = IqPairs(heard.blocks, pairs, function, settings.window, length, every)
    except ValueError as error:
        raise UserError(f"iq: {error}") from error
    gaps = [*heard.notes, *lost(recordings, heard.blocks, common, compared.plan.short)]
    names = list(heard.blocks)

    def report(result: xr.Dataset) -> IqReport:
        found = [pair_result(names, pair, result) for pair in pairs]
        times = result["time"].values
        told = IqReport(settings, heard.began is not None, length, times, found, gaps, heard.began)
        if known is None:
            return told
        folder = TemporaryDirectory(prefix="quietfix-")
        located = _located(heard, known, settings, times, found, Path(folder.name))
        return replace(told, located=located, written=None if located.report is None else folder)

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


def _known(heard: Alike, settings: Settings) -> Known | None:
    """Return where the receivers are; None: nobody knows."""
    if settings.platforms:
        return known_by_table(Path(settings.platforms), heard.names)
    return known_by_tracks(heard.tracks, heard.began)


def _located(
    heard: Alike, known: Known, settings: Settings, times: Any, pairs: Sequence[PairResult], folder: Path
) -> Located:
    rows = rows_of(pairs)
    coherence = np.concatenate([pair.coherence[pair.good] for pair in pairs])
    said = Heard(
        reference=list(heard.blocks)[heard.reference],
        carrier=float(next(iter(heard.blocks.values()))[0].centre_frequency),
        began=heard.began,
        times=times,
        tdoa=rows[: len(pairs)],
        fdoa=rows[len(pairs) :],
        coherence=float(np.median(coherence)) if coherence.size else 0.0,
    )
    return locate(said, known, settings.position, folder)


def _nothing(bus: Bus, name: str, options: Any) -> Assumed:
    raise UserError(f"estimators.{name}: it is not allowed; nothing is estimated of I/Q recordings alone")


SYSTEM = System(
    name="iq",
    title="recording: TDOA and FDOA of I/Q recordings of your own (SigMF, WAV), and where the emitter is",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
    estimates=False,
)
