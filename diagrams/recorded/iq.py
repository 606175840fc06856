"""I/Q recordings of one's own, compared with one of them: ``quietfix replay iq FILE FILE [...]``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.iq_comparison import PairResult
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.readers.iq.any_file import read_iq
from quietfix.diagrams.readers.iq.recording import IqRecording
from quietfix.diagrams.recorded.iq_blocks import Alike
from quietfix.diagrams.recorded.iq_compared import Compared, compared, with_rates
from quietfix.diagrams.recorded.locating.position import Heard, Located, locate
from quietfix.diagrams.recorded.locating.receivers import Known, known_by_table, known_by_tracks
from quietfix.diagrams.recorded.reports.iq_report import IqReport, rows_of
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from quietfix.systems.ambiguity.clock_drift import ClockDrift

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_recordings"]

SOURCE = Source(
    folder="",
    origin="two or more I/Q recordings of your own: SigMF (https://sigmf.org), WAV, or bare samples (--rate, --type)",
    several=True,
    truth=False,
)


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
    one = compared(recordings, settings)
    known = _known(one.heard, settings)
    still = known is not None and not known.moving and settings.position.speed_mps == 0
    drifts: dict[str, ClockDrift] = {}
    if settings.clocks == "corrected":
        drifts = _drifts(one, settings, still)
        one = compared(with_rates(recordings, list(one.heard.blocks), _rates(drifts)), settings)

    def report(result: xr.Dataset) -> IqReport:
        times = result["time"].values
        found, said = one.results(result), []
        if settings.clocks == "corrected":
            found = [_inflated(one, pair, times, drifts) for pair in found]
            said = _corrected(drifts, list(one.heard.blocks))
        else:
            said = one.drift_lines(one.drifts(times, found, still), still)
        told = IqReport(
            settings=settings,
            dated=one.heard.began is not None,
            length=one.length,
            times=times,
            pairs=found,
            gaps=[*one.gaps, *said],
            began=one.heard.began,
            phases=one.phases(result),
        )
        if known is None:
            return told
        folder = TemporaryDirectory(prefix="quietfix-")
        located = _located(one, known, settings, times, found, Path(folder.name))
        return replace(told, located=located, written=None if located.report is None else folder)

    return one.model(report)


def _known(heard: Alike, settings: Settings) -> Known | None:
    """Return where the receivers are; None: nobody knows."""
    if settings.platforms:
        return known_by_table(Path(settings.platforms), heard.names)
    return known_by_tracks(heard.tracks, heard.began)


def _drifts(one: Compared, settings: Settings, still: bool) -> dict[str, ClockDrift]:
    """Return what the clocks drift, by a comparison of the recordings as they are."""
    found: list[dict[str, ClockDrift]] = []

    def look(result: xr.Dataset) -> IqReport:
        times, pairs = result["time"].values, one.results(result)
        found.append(one.drifts(times, pairs, still))
        return IqReport(settings, False, one.length, times, pairs)

    study = Study(SYSTEM, scenario=settings, model=one.model(look))
    study.report(join(list(study.chunks())))
    return found[0]


def _rates(drifts: Mapping[str, ClockDrift]) -> dict[str, float]:
    return {name: drift.rate for name, drift in drifts.items()}


def _inflated(one: Compared, pair: PairResult, times: Any, drifts: Mapping[str, ClockDrift]) -> PairResult:
    """Return differences whose sigmas tell of the drift that was taken away, too."""
    drift = drifts.get(pair.auxiliary)
    if drift is None:
        return pair
    factor = drift.inflation(one.since(pair.auxiliary, times), np.where(pair.good, pair.sigma_tdoa, np.nan))
    return replace(pair, sigma_tdoa=factor * pair.sigma_tdoa)


def _corrected(drifts: Mapping[str, ClockDrift], names: Sequence[str]) -> list[str]:
    """Return what was taken away, in words."""
    if not drifts:
        return ["clocks: nothing is corrected; that takes four comparisons and core:frequency, or places that stand"]
    return [
        f"{name}: its sample clock was taken to run {1e6 * drift.rate:.4g} +- {1e6 * drift.sigma:.2g} ppm fast from "
        "its first sample on, and corrected; the sigmas of TDOA tell of that"
        for name, drift in drifts.items()
    ]


def _located(
    one: Compared, known: Known, settings: Settings, times: Any, pairs: Sequence[PairResult], folder: Path
) -> Located:
    rows = rows_of(pairs)
    coherence = np.concatenate([pair.coherence[pair.good] for pair in pairs])
    said = Heard(
        reference=list(one.heard.blocks)[one.heard.reference],
        carrier=one.carrier,
        began=one.heard.began,
        times=times,
        tdoa=rows[: len(pairs)],
        fdoa=rows[len(pairs) :],
        coherence=float(np.median(coherence)) if coherence.size else 0.0,
    )
    try:
        return locate(said, known, settings.position, folder)
    except UserError as error:  # what was measured is not lost for that
        return Located(None, [f"no fix: {error}"])


SYSTEM = System(
    name="iq",
    title="recording: TDOA and FDOA of I/Q recordings of your own (SigMF, WAV), and where the emitter is",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
    estimates=False,
)
