"""Dates in UTC, TAI, GPS time and terrestrial time, as seconds of TAI; leap seconds.

A moment is a pair: whole seconds of TAI since 1970-01-01T00:00:00 TAI, and the rest [s], 0 to 1. One double resolves
0.2 us of seconds since 1970; the pair keeps 15 digits after the second.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from datetime import date, datetime
from decimal import Decimal
from functools import lru_cache

__all__ = ["LEAP_SECONDS", "SCALES", "from_tai", "posix_of", "posix_to_tai", "to_posix", "to_tai"]

_JANUARY = (*range(1973, 1981), 1988, 1990, 1991, 1996, 1999, 2006, 2009, 2017)
_JULY = (1972, 1981, 1982, 1983, 1985, 1992, 1993, 1994, 1997, 2012, 2015)

LEAP_SECONDS = tuple(sorted([*(datetime(y, 1, 1) for y in _JANUARY), *(datetime(y, 7, 1) for y in _JULY)]))
"""First instants in UTC after a leap second (IERS Bulletin C; the last one to date was in 2016)."""

_DAY = 86400
_EPOCH = date(1970, 1, 1).toordinal()
_UTC_BEGINS = (date(1972, 1, 1).toordinal() - _EPOCH) * _DAY  # before, UTC had seconds of another length
_FIRST = 10  # TAI - UTC in 1972 [s]
_LEAPS = [(leap.toordinal() - _EPOCH) * _DAY for leap in LEAP_SECONDS]
_LEAPS_TAI = [leap + _FIRST + i for i, leap in enumerate(_LEAPS, 1)]

SCALES = {"UTC": Decimal(0), "TAI": Decimal(0), "GPS": Decimal(19), "TT": Decimal("-32.184")}
"""Time scales that are read and written: TAI minus each [s], for UTC without its leap seconds."""

_STAMP = re.compile(
    r"(\d{4}-(?:\d\d-\d\d|\d{3}))[Tt ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d+))?)? ?([Zz]|[+-]\d\d(?::?\d\d)?)?", re.ASCII
)
_ALLOWED = "a date with a time of day such as 2026-03-01T12:00:00.25, or 2026-060T12:00:00.25 by the day of the year"


def posix_to_tai(second: int) -> int:
    """Return whole seconds of TAI since 1970 of seconds since 1970 in UTC without leap seconds.

    Raises
    ------
    ValueError
        Before 1972.
    """
    if second < _UTC_BEGINS:
        raise ValueError("UTC before 1972-01-01 is not allowed; its seconds were not those of TAI")
    return second + _FIRST + bisect_right(_LEAPS, second)


def posix_of(second: int) -> int:
    """Return seconds since 1970 in UTC without leap seconds; a leap second and the one after it are the same."""
    passed = bisect_right(_LEAPS_TAI, second)
    return second - _FIRST - passed


def to_tai(text: str, scale: str = "UTC", offsets: bool = False) -> tuple[int, float]:
    """Read a date with a time of day.

    Parameters
    ----------
    text : str
        ISO 8601 with a calendar date or the day of the year (CCSDS 301.0-B-4, ASCII time codes A and B), with any
        number of digits after the second, which may be 60 where UTC has a leap second.
    scale : {'UTC', 'TAI', 'GPS', 'TT'}
        Which the date is in. TAI = GPS + 19 s = TT - 32.184 s.
    offsets : bool
        Whether an offset from UTC such as ``+02:00`` may follow; a ``Z`` may in UTC.

    Returns
    -------
    second : int
        Whole seconds of TAI since 1970-01-01T00:00:00 TAI.
    rest : float
        [s], 0 to 1.

    Raises
    ------
    ValueError
        If it is no such date; the message begins with the text.
    """
    minute, second, digits = _read(text, scale, offsets)
    if scale == "UTC":
        if minute < _UTC_BEGINS:
            raise ValueError(f"{text[:60]!r} is not allowed; UTC since 1972, when its seconds became those of TAI")
        return _moment(posix_to_tai(minute) + second, digits)
    if scale == "TT":
        exact = minute + second + Decimal(f"0.{digits or 0}") + SCALES[scale]
        whole = int(exact.to_integral_value("ROUND_FLOOR"))
        part = float(exact - whole)
        return (whole + 1, 0.0) if part >= 1 else (whole, part)
    return _moment(minute + second + int(SCALES[scale]), digits)


def to_posix(text: str) -> tuple[int, float]:
    """Read a date with a time of day in UTC, where leap seconds do not matter.

    Parameters
    ----------
    text : str
        As `to_tai` with an offset, which is honoured; without one it is taken to be UTC. Also before 1972.

    Returns
    -------
    second : int
        Whole seconds since 1970 without leap seconds, see `posix_of`.
    rest : float
        [s], 0 to 1.

    Raises
    ------
    ValueError
        As `to_tai`.
    """
    minute, second, digits = _read(text.strip(), "UTC", True)
    return _moment(minute + second, digits)


def _moment(whole: int, digits: str | None) -> tuple[int, float]:
    part = float(f"0.{digits}") if digits else 0.0
    return (whole + 1, 0.0) if part >= 1 else (whole, part)


def _read(text: str, scale: str, offsets: bool) -> tuple[int, int, str | None]:
    """Return the beginning of a minute, in seconds since 1970 of days of 86400 s, the second, and its digits."""
    parts = _STAMP.fullmatch(text)
    if parts is None:
        raise ValueError(f"{text[:60]!r} is not allowed; {_ALLOWED}")
    day, hour, minute, second, digits, zone = parts.groups()
    if zone and (scale != "UTC" or not (offsets or zone in "Zz")):
        raise ValueError(f"{text[:60]!r} is not allowed; {'no offset' if scale == 'UTC' else f'no Z: it is {scale}'}")
    start = _days(day)
    if int(hour) > 23 or int(minute) > 59 or int(second or 0) > 60:
        raise ValueError(f"{text[:60]!r} is not allowed; 00:00:00 to 23:59:60")
    whole = start * _DAY + 3600 * int(hour) + 60 * int(minute) - _offset(zone)
    if second == "60" and (scale != "UTC" or whole + 60 not in _LEAPS):
        raise ValueError(f"{text[:60]!r} is not allowed; second 60 is only where UTC has a leap second")
    return whole, int(second or 0), digits


@lru_cache(maxsize=1024)
def _days(text: str) -> int:
    """Return days since 1970 of a date."""
    try:
        if len(text) == 8:
            year, count = int(text[:4]), int(text[5:])
            found = date(year, 1, 1).toordinal() + count - 1
            if not 1 <= count <= 366 or date.fromordinal(found).year != year:
                raise ValueError(f"day {count} is not in {year}")
            return found - _EPOCH
        return date(int(text[:4]), int(text[5:7]), int(text[8:])).toordinal() - _EPOCH
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{text!r} is not allowed; {error}") from error


def _offset(zone: str | None) -> int:
    """Return how far a zone is ahead of UTC [s]."""
    if not zone or zone in "Zz":
        return 0
    minutes = 60 * int(zone[1:3]) + int(zone[-2:] if len(zone) > 3 else 0)
    if minutes > 14 * 60:
        raise ValueError(f"{zone!r} is not allowed; an offset of at most 14 hours")
    return (-60 if zone[0] == "-" else 60) * minutes


def from_tai(second: int, rest: float, scale: str = "UTC") -> str:
    """Write a moment as an ISO 8601 date with all the digits of its fraction; `to_tai` gives the same moment.

    Parameters
    ----------
    second : int
        Whole seconds of TAI since 1970.
    rest : float
        [s], 0 to 1.
    scale : {'UTC', 'TAI', 'GPS', 'TT'}
        To write it in.

    Raises
    ------
    ValueError
        If it is before 1972 in UTC, or not in the years 1 to 9999.
    """
    if not 0 <= rest < 1:
        raise ValueError(f"rest of a second: {rest} is not allowed; 0 to 1")
    part = Decimal(repr(float(rest)))
    leap = False
    if scale == "UTC":
        leap = second + 1 in _LEAPS_TAI
        whole = posix_of(second - leap)
        if whole < _UTC_BEGINS:
            raise ValueError("UTC before 1972-01-01 is not allowed; its seconds were not those of TAI")
    else:
        exact = part - SCALES[scale]
        carried = int(exact.to_integral_value("ROUND_FLOOR"))
        whole, part = second + carried, exact - carried
    day, left = divmod(whole, _DAY)
    if not 1 <= day + _EPOCH <= date.max.toordinal():
        raise ValueError(f"{second} s since 1970 is not allowed; years 1 to 9999")
    digits = f"{part:f}".partition(".")[2].rstrip("0")
    clock = f"{left // 3600:02d}:{left // 60 % 60:02d}:{left % 60 + leap:02d}"
    return f"{date.fromordinal(day + _EPOCH).isoformat()}T{clock}{'.' + digits if digits else ''}"
