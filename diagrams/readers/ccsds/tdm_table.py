"""Tracking Data Messages as tables of measurements."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from quietfix.diagrams.readers.ccsds.tdm import TrackingMessage, read_tdm
from quietfix.diagrams.readers.ccsds.tdm_observations import Link, Observations, observations
from quietfix.diagrams.readers.measurements import MeasurementTable, Series
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["TDM_SUFFIXES", "tdm_measurements"]

TDM_SUFFIXES = (".tdm", ".kvn")
"""Endings of the names of files that are taken for Tracking Data Messages."""

_KINDS = {
    "range": "range",
    "range_rate": "range_rate",
    "mean_range_rate": "range_rate",
    "frequency": "received_frequency",
    "azimuth": "bearing",
    "elevation": "elevation",
    "tdoa": "tdoa",
    "fdoa": "fdoa",
}
"""Kinds of a table of measurements; a bearing is clockwise from north, as the standard's azimuth."""

_ONE_LEG = ("bearing", "elevation")  # of the last leg of the signal path, whatever the path
_UNAMBIGUOUS = 1e6  # km: no range near the Earth is as long


def tdm_measurements(path: Path, two_way: str = "") -> MeasurementTable:
    """Read a Tracking Data Message as a table of measurements: `read_measurements`.

    The target is the participant next to the receiver. What is integrated is taken as of the middle of its interval:
    a mean range rate over T is off that by :math:`T^2/24` of the range's third derivative. A message has no sigmas.

    Parameters
    ----------
    path : Path
    two_way : {'', 'half', 'whole'}
        What ranges and range rates from a station to the target and back are: of half of that way, or of the whole.
        "For two-way and three-way data, the ICD should specify whether the observable is based upon the round trip
        light time, or half the round trip light time" (CCSDS 503.0-B-1, corrigendum of 2010, 3.5.2.6).

    Raises
    ------
    UserError
        As `read_tdm` and `observations`, for two-way ranges and rates of which `two_way` does not say what they are,
        for three-way ones and frequencies over two legs, for ambiguous ranges and those in range units,
        and if there is nothing that a table has.
    """
    message = read_tdm(path)
    found = observations(message)
    kept = [i for i, link in enumerate(found.links) if link.kind in _KINDS]
    rows = np.flatnonzero(np.isin(found.link, kept))
    if not rows.size:
        there = ", ".join([*found.left_out, *(link.kind for link in found.links)])
        raise UserError(f"{shown(path)}: no measurements of a table are in it; it has {there}")
    series = [_series(path, link, two_way) if i in kept else None for i, link in enumerate(found.links)]
    numbers = {i: n for n, i in enumerate(kept)}
    link = found.link[rows]
    factors = np.array([_factor(one, two_way) for one in found.links])
    middle = np.array([one.middle for one in found.links])[link]
    rest = found.rest[rows] + middle
    carried = np.floor(rest)
    return MeasurementTable(
        path,
        found.line[rows],
        found.second[rows] + carried.astype(np.int64),
        rest - carried,
        np.array([numbers[i] for i in link.tolist()], dtype=np.int64),
        [one for one in series if one is not None],
        found.value[rows] * factors[link],
        np.full(rows.size, np.nan),
        _notes(path, message, found, two_way),
    )


def _back_again(link: Link) -> bool:
    """Return whether it is a range or its rate from a station to the target and back."""
    ranging = _KINDS.get(link.kind) in ("range", "range_rate")
    return ranging and len(link.path) == 3 and link.path[0] == link.path[2] and not link.other


def _factor(link: Link, two_way: str) -> float:
    """Return what a value is multiplied by: a range in seconds is in metres in a table."""
    share = 0.5 if two_way == "whole" and _back_again(link) else 1.0
    return share * (SPEED_OF_LIGHT if (link.kind, link.unit) == ("range", "s") else 1.0)


def _series(path: Path, link: Link, two_way: str) -> Series:
    """Return what a link is in a table.

    Raises
    ------
    UserError
        If nobody but the parties knows what its values are.
    """
    kind = _KINDS[link.kind]
    where = f"{shown(path)}: {link.kind} of {link.path[0]}"
    longest = max(len(link.path), len(link.other))
    if kind not in _ONE_LEG and longest > 2 and not (two_way and _back_again(link)):
        also = ", or measurements.two_way, which says it" if _back_again(link) else ""
        raise UserError(
            f"{where} over {longest - 1} legs is not allowed: the standard leaves open whether it is of the whole way "
            f"or of half of it; one way, PATH = 2,1{also}"
        )
    if link.unit == "RU":
        raise UserError(f"{where} in RANGE_UNITS RU is not allowed: only its parties know what they are; km, s")
    modulus = link.modulus * (SPEED_OF_LIGHT / 1e3 if link.unit == "s" else 1.0)
    if 0 < modulus < _UNAMBIGUOUS:
        raise UserError(f"{where} is ambiguous by RANGE_MODULUS {link.modulus:g} {link.unit}; unambiguous ranges")
    unit = "m" if (link.kind, link.unit) == ("range", "s") else link.unit
    return Series(link.path[-2], kind, link.receiver, link.reference, unit)


def _notes(path: Path, message: TrackingMessage, found: Observations, two_way: str) -> list[str]:
    """Return what is left out or taken for something else."""
    left = dict(found.left_out)
    for i, link in enumerate(found.links):
        if link.kind not in _KINDS:
            left[link.kind] = left.get(link.kind, 0) + int(np.count_nonzero(found.link == i))
    notes = [f"{shown(path)}: left out: {', '.join(f'{n} {name}' for name, n in left.items())}."] if left else []
    means = [link for link in found.links if link.kind == "mean_range_rate"]
    if means:
        longest = max(link.interval for link in means)
        notes.append(f"{shown(path)}: mean range rates over {longest:g} s are taken as of the middle of that.")
    if two_way and any(_back_again(link) for link in found.links):
        notes.append(
            f"{shown(path)}: two-way ranges and rates are taken as of {two_way} of the way there and back, and as of "
            "their time tags: off by the range rate times the light time."
        )
    if any(link.tagged == "TRANSMIT" for link in found.links):
        notes.append(f"{shown(path)}: its times are of transmission, and taken as those of reception.")
    delays = {name for one in message.segments for name in one.metadata if "_DELAY_" in name}
    if delays:
        notes.append(f"{shown(path)}: {', '.join(sorted(delays))} are not applied.")
    return notes
