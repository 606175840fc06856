"""Recordings of samples against each other: what is compared when, as a model, and what the result says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded, Report
from quietfix.diagrams.parts.iq_channels import IqChannels, channel_name
from quietfix.diagrams.parts.iq_comparison import PairResult, pair_result, pieces
from quietfix.diagrams.parts.iq_pairs import IqPairs
from quietfix.diagrams.readers.iq.recording import IqRecording
from quietfix.diagrams.recorded.iq_blocks import Alike, alike, check, lost
from quietfix.diagrams.recorded.locating.rows import Rows
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.ambiguity.clock_drift import ClockDrift, clock_drift
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart

__all__ = ["Compared", "compared", "with_rates"]

_SURE = 3.29  # sigmas: what is seen in one of 1000 clocks that do not drift


@dataclass(frozen=True, eq=False)
class Compared:
    """What is compared.

    Attributes
    ----------
    heard : Alike
    pairs : list of (int, int)
        Places of reference and other receiver.
    part : IqPairs
    channels : IqChannels
    length : float
        Integration time [s].
    gaps : list of str
        What is not compared, in words.
    """

    heard: Alike
    pairs: list[tuple[int, int]]
    part: IqPairs
    channels: IqChannels
    length: float
    gaps: list[str]

    @property
    def carrier(self) -> float:
        """To which the reference was tuned [Hz]; 0: nobody knows."""
        blocks = list(self.heard.blocks.values())
        return float(blocks[self.heard.reference][0].centre_frequency)

    def model(self, report: Callable[[xr.Dataset], Report]) -> Model:
        """Return a model of it."""
        channels = [self.channels] if self.channels.signals else []
        signals = [*self.part.signals, *self.channels.signals]
        return Model(
            clock=self.part.plan.clock,
            duration=self.part.plan.end,
            divergence=0.0,
            parts=[self.part, *channels, _Joined(self.pairs)],
            assume=_nothing,
            signals={name: name for name in (*signals, "noise_covariance")},
            rows=[row.name for pair in self.pairs for row in IqPairs.rows(pair)],
            recorded=Recorded(report=report, keeps=["measurement", *signals]),
        )

    def results(self, result: xr.Dataset) -> list[PairResult]:
        """Return what was found of each pair."""
        names = list(self.heard.blocks)
        return [pair_result(names, pair, result) for pair in self.pairs]

    def phases(self, result: xr.Dataset) -> list[Rows]:
        """Return what was found between channels."""
        found = []
        for name, channels in self.channels.receivers.items():
            for i in range(1, len(channels)):
                other = channel_name(name, i)
                both = result[f"phase_{other}"].isel(trial=0).transpose("time", ...).values
                found.append(Rows("phase", other, channel_name(name, 0), "rad", both[:, 0], both[:, 1]))
        return found

    def drifts(self, times: Any, pairs: Sequence[PairResult], still: bool) -> dict[str, ClockDrift]:
        """Return how fast the clock of each receiver runs against that of the reference, where that can be known.

        Parameters
        ----------
        times : ndarray
            Of the comparisons [s].
        pairs : sequence of PairResult
        still : bool
            Whether neither receivers nor emitter move.
        """
        found = {}
        for one in pairs:
            if still:
                found[one.auxiliary] = clock_drift(times, one.tdoa, one.sigma_tdoa)
            elif self.carrier > 0:
                rate = one.fdoa, one.sigma_fdoa, self.carrier
                found[one.auxiliary] = clock_drift(times, one.tdoa, one.sigma_tdoa, *rate)
        return {name: drift for name, drift in found.items() if np.isfinite(drift.rate)}

    def drift_lines(self, drifts: dict[str, ClockDrift], still: bool) -> list[str]:
        """Return those that are more than chance, in words."""
        reference = list(self.heard.blocks)[self.heard.reference]
        why = "TDOA changes, and nothing moves" if still else "TDOA changes, and FDOA does not explain it"
        return [
            f"{name}: its sample clock runs {1e6 * abs(drift.rate):.4g} +- {1e6 * drift.sigma:.2g} ppm "
            f"{'faster' if drift.rate > 0 else 'slower'} than that of {reference} ({why}; --set clocks=corrected)"
            for name, drift in drifts.items()
            if abs(drift.rate) > _SURE * drift.sigma
        ]

    def since(self, name: str, times: Any) -> Any:
        """Return times since the first sample of a receiver [s], up to which its clock is taken to agree."""
        return times - float(self.heard.blocks[name][0].start_time[0])


def compared(recordings: Sequence[IqRecording], settings: Settings) -> Compared:
    """Return what is compared of recordings: every one with the reference.

    Raises
    ------
    UserError
        If there are fewer than two, they do not fit each other, or a setting is not allowed.
    """
    if len(recordings) < 2:
        raise UserError(f"FILE: {len(recordings)} recording(s) are not allowed; two or more are compared")
    heard = alike(recordings, settings)
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
        part = IqPairs(heard.blocks, pairs, function, settings.window, length, every)
    except ValueError as error:
        raise UserError(f"iq: {error}") from error
    channels = IqChannels(heard.channels, settings.prefilter, part.plan.clock, part.samples)
    gaps = [*heard.notes, *lost(recordings, heard.blocks, common, part.plan.short)]
    return Compared(heard, pairs, part, channels, length, gaps)


def with_rates(recordings: Sequence[IqRecording], names: Sequence[str], rates: dict[str, float]) -> list[IqRecording]:
    """Return recordings whose clocks run right: so much faster (relative) they were, by receiver.

    What is counted in samples is a time by the clock; what has a date is not.
    """
    found = []
    for name, one in zip(names, recordings, strict=True):
        pace = 1 + rates.get(name, 0.0)
        channels = [
            tuple(part if part.dated else replace(part, begin=part.begin / pace) for part in segments)
            for segments in one.channels
        ]
        own = replace(one, sample_rate=one.sample_rate * pace, segments=channels[0], others=tuple(channels[1:]))
        found.append(own)
    return found


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
            {f"pair_{j}{i}": JoinedPart(2, components=IqPairs.rows((i, j))) for i, j in self.pairs},
            1,
            "all pairs, side by side",
        )
        bus.add(joined, gives={port: port for port in ("measurement", "noise_covariance")}, takes=takes)


def _nothing(bus: Bus, name: str, options: Any) -> Assumed:
    raise UserError(f"estimators.{name}: it is not allowed; nothing is estimated of I/Q recordings alone")
