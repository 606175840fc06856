"""Dates with a time of day as files write them, in UTC."""

from __future__ import annotations

import re
from datetime import UTC, datetime

__all__ = ["instant"]

_STAMP = re.compile(r"(\d{4}-\d\d-\d\d)[Tt ](\d\d:\d\d:\d\d)(?:[.,](\d+))? ?([Zz]|[+-]\d\d(?::?\d\d)?)?")


def instant(value: str | datetime) -> tuple[int, float]:
    """Return an ISO 8601 date with a time of day as UTC: whole seconds since 1970, and the rest [s], 0 to 1.

    The two are apart so that no digit of a fraction is lost: a double resolves 0.2 us of the seconds since 1970.

    Parameters
    ----------
    value : str or datetime
        With ``Z`` or any offset such as ``+02:00``, ``+0200`` or ``+02``, which is honoured; without one it is taken
        to be UTC. A text may have any number of digits after the second.

    Raises
    ------
    ValueError
        If it is no date with a time of day.
    """
    if isinstance(value, datetime):
        digits = value.microsecond * 1e-6
        moment = value.replace(microsecond=0)
        moment = moment.replace(tzinfo=UTC) if moment.utcoffset() is None else moment
    else:
        parts = _STAMP.fullmatch(value.strip())
        if parts is None:
            raise ValueError(
                f"{value} is not allowed; a date with a time of day such as 2026-03-01T12:00:00.000001Z, with or "
                "without an offset such as +02:00"
            )
        zone = parts[4] or "Z"
        zone = "+00:00" if zone in "Zz" else zone
        try:
            moment = datetime.fromisoformat(f"{parts[1]}T{parts[2]}{zone}")
        except ValueError as error:
            raise ValueError(f"{value} is not allowed; {error}") from error
        digits = float(f"0.{parts[3]}") if parts[3] else 0.0
    whole = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return whole.days * 86400 + whole.seconds, digits
