"""Satellites that are ahead of their elements, as scenario fields."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import number

__all__ = ["AlongTrack"]


@dataclass
class AlongTrack:
    """The time that a satellite is ahead of where its elements say: the state ``ahead_NAME`` [s], anew in every pass.

    Two-line elements of a low satellite are off by about 1 km along the track when new and 1.5 km more per day: 0.13 s
    and 0.2 s per day. Rows of !Range, !RangeRate and !Frequency.
    """

    sigma_s: float = number("standard deviation of it, as it is drawn and as it is believed to be [s]", 0.3, above=0)
    pause_s: float = number("after so long without a measurement another pass begins [s]", 600.0, above=0)
    true_s: float | None = number("in a simulation: the same in every trial [s]; null: drawn", None)
    walk_s2ps: float = number("variance that it is believed to gain per second within a pass [s^2/s]", 0.0, at_least=0)
