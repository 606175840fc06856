"""I/Q recordings made alike: in one time, at one sample rate, by names of receivers; and what is lost then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from quietfix.diagrams.parts.iq_comparison import Piece
from quietfix.diagrams.readers.iq.recording import IqRecording, Segment
from quietfix.diagrams.recorded.locating.receivers import ReceiverTrack, named
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.earth.time_scales import posix_to_tai
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.resample import resampled

__all__ = ["Alike", "alike", "check", "lost"]

_AS_LOW = 1.001
_MOSTLY = 0.5  # of the longest recording: less of it in common is told

Parts = list[IqBlock]


@dataclass(frozen=True, eq=False)
class Alike:
    """Recordings, ready to be compared.

    Attributes
    ----------
    blocks : dict of str to list of IqBlock
        Parts without a gap of each receiver, in the time since the first sample of all.
    channels : dict of str to list of list of IqBlock
        The same of all channels of a receiver that has several; the first is what is in `blocks`.
    names : dict of str to str
        Name of the recording of each receiver.
    reference : int
        Place of the receiver that the others are compared with.
    began : (int, float), optional
        First sample of all in seconds of TAI since 1970; None: the files do not say.
    tracks : dict of str to ReceiverTrack or None
        Where the receivers were, as the recordings say.
    notes : list of str
        What was done to them.
    """

    blocks: dict[str, Parts]
    channels: dict[str, list[Parts]]
    names: dict[str, str]
    reference: int
    began: tuple[int, float] | None
    tracks: dict[str, ReceiverTrack | None]
    notes: list[str]


def alike(recordings: Sequence[IqRecording], settings: Settings) -> Alike:
    """Return recordings in one time and at one sample rate: the lowest, or one as low as that.

    Raises
    ------
    UserError
        If some say when they begin and others do not, or a name is not allowed.
    """
    stamps = [one.start for one in recordings]
    dated = [stamp for stamp in stamps if stamp is not None]
    if dated and len(dated) < len(stamps):
        silent = next(one.name for one in recordings if one.start is None)
        raise UserError(f"FILE: {silent} does not say when it begins (core:datetime); all recordings must, or none")
    first = min(dated, default=(0, 0.0))
    receivers = named([one.name for one in recordings], settings.receivers)
    rates = [one.sample_rate for one in recordings]
    chosen = choose("reference", settings.reference or receivers[0], receivers)
    reference = receivers.index(chosen)
    # the reference's own, but for a much lower one: nothing is to be made up
    rate = rates[reference] if rates[reference] <= _AS_LOW * min(rates) else min(rates)
    blocks: dict[str, Parts] = {}
    channels: dict[str, list[Parts]] = {}
    tracks: dict[str, ReceiverTrack | None] = {}
    for name, one in zip(receivers, recordings, strict=True):
        # whole seconds apart, so that no digit of the fractions is lost
        begin = 0.0 if one.start is None else (one.start[0] - first[0]) + (one.start[1] - first[1])
        parts = [_parts(segments, one.sample_rate, rate, begin) for segments in one.channels]
        blocks[name] = parts[0]
        if len(parts) > 1:
            channels[name] = parts
        tracks[name] = None
        if one.places is not None:
            tracks[name] = ReceiverTrack(one.places[:, 0] + begin, one.places[:, 1:])
    notes = []
    if len(set(rates)) > 1:
        others = [f"{n} {r:.10g} Hz" for n, r in zip(receivers, rates, strict=True) if r != rate]
        notes.append(f"resampled to {rate:.10g} Hz: {', '.join(others)}")
    began = None
    if dated:
        try:
            began = posix_to_tai(first[0]), first[1]
        except ValueError as error:
            raise UserError(f"FILE: core:datetime: {error}") from error
    names = {receiver: one.name for receiver, one in zip(receivers, recordings, strict=True)}
    return Alike(blocks, channels, names, reference, began, tracks, notes)


def _parts(segments: Sequence[Segment], own: float, rate: float, begin: float) -> Parts:
    parts = [IqBlock(part.samples, own, part.frequency, begin + part.begin) for part in segments]
    return parts if own == rate else [resampled(part, rate) for part in parts]


def check(common: Sequence[Piece], settings: Settings, every: float, shared: float) -> None:
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


def lost(
    recordings: Sequence[IqRecording], blocks: Mapping[str, Sequence[IqBlock]], common: Sequence[Piece], short: int
) -> list[str]:
    """Return what of the recordings was not compared, in words."""
    lines = []
    for one, (name, parts) in zip(recordings, blocks.items(), strict=True):
        lines += [f"{name}: {note}" for note in one.notes]
        if one.unclaimed:
            lines.append(f"{name}: {one.unclaimed} samples before its first capture are left out")
        if len(parts) > 1:
            begins, ends = (np.array([p.start_time[0] + k * p.duration for p in parts]) for k in (0, 1))
            missing = float(np.maximum(begins[1:] - ends[:-1], 0.0).sum())
            lines.append(f"{name}: {len(parts)} captures that do not follow each other, {missing:.6g} s between them")
    total = sum(piece.duration for piece in common)
    heard = {name: sum(part.duration for part in parts) for name, parts in blocks.items()}
    longest = max(heard, key=heard.__getitem__)
    if total < _MOSTLY * heard[longest]:
        lines.append(
            f"only {total:.4g} s are compared, of the {heard[longest]:.4g} s of {longest}: what all have in common; "
            f"the shortest is {min(heard, key=heard.__getitem__)} with {min(heard.values()):.4g} s; is a file cut?"
        )
    if len(common) > 1:
        too_short = f"; {short} of them are shorter than a comparison, and left out" if short else ""
        lines.append(f"the recordings have {total:.6g} s in common, in {len(common)} pieces{too_short}")
    return lines
