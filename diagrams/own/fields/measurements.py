"""Measurements of one's own in the place of simulated ones, as scenario fields."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.paths.movers import Track
from quietfix.systems.documented import choice, documented, text

__all__ = ["Measurements"]


@dataclass
class Measurements:
    """What was measured, in a table: CSV with any delimiter, or Parquet.

    Columns time (ISO 8601 with its zone; t = 0 is start_utc, or the first row without it) or time_s, kind, receiver,
    reference, value, unit; and as needed target, sigma. A row is of the sensor whose row is KIND_RECEIVER_REFERENCE.
    Rows of kind toa without a reference are arrival times by the receivers' common clock, of one message those of one
    target and one time; sigma is that of an arrival.
    """

    file: str = text("path, relative to the scenario's file")
    two_way: str = choice(
        "of a Tracking Data Message: what two-way ranges and range rates are of the way there and back, which its "
        "parties agree on; empty: they are refused",
        "",
        ("", "half", "whole"),
    )
    truth: Track | None = documented(
        "where the target was, of several with a column target; null: as target says, if it does", None
    )
