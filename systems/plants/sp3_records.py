"""The lines of an SP3 file, and whether all of them are there."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.time_scales import LEAP_SECONDS, posix_to_tai

__all__ = ["Records", "elapsed", "in_tai", "read_records"]

Array = NDArray[np.float64]

_CLOCK = 60  # characters of a line up to and with its clock, which some files leave out; what follows is optional
_BAD = 999999.0  # some files mark what is absent so, where the standard says zero
_LEAP_SECONDS = [leap for leap in LEAP_SECONDS if leap.year > 1980]  # since GPS was level with UTC


@dataclass(frozen=True, eq=False)
class Records:
    """What a file says of one satellite.

    Attributes
    ----------
    epochs : list of datetime
        In the time system of the file.
    positions : ndarray, shape (samples, 3)
        [m]; NaN where absent.
    velocities : ndarray, shape (samples, 3)
        In the file's own unit; NaN where absent.
    """

    epochs: list[datetime]
    positions: Array
    velocities: Array


def elapsed(epochs: list[datetime], time_system: str) -> Array:
    """Return the seconds since the first epoch; leap seconds count in UTC and in GLONASS time, which follows it."""
    passed = [leap for leap in _LEAP_SECONDS if epochs[0] < leap <= epochs[-1] and time_system in ("UTC", "GLO")]
    return np.array([(epoch - epochs[0]).total_seconds() + sum(leap <= epoch for leap in passed) for epoch in epochs])


_BEHIND_TAI = {"GPS": 19, "GAL": 19, "QZS": 19, "IRN": 19, "TAI": 0, "BDT": 33}  # s


def in_tai(epoch: datetime, time_system: str) -> tuple[int, float]:
    """Return an epoch as seconds of TAI since 1970, whole and rest; GLONASS time is UTC in these files."""
    moment = epoch - datetime(1970, 1, 1)
    second, rest = moment.days * 86400 + moment.seconds, moment.microseconds * 1e-6
    behind = _BEHIND_TAI.get(time_system)
    return (posix_to_tai(second) if behind is None else second + behind), rest


def read_records(path: Path, lines: list[str], satellite: str, expected: int) -> Records:
    """Read one satellite's records.

    Parameters
    ----------
    path : Path
        Whose name stands in messages.
    lines : list of str
        Of the file.
    satellite : str
        Which.
    expected : int
        Number of epochs that the header announces.

    Returns
    -------
    Records

    Raises
    ------
    ValueError
        For a line that cannot be read, epochs out of order, and a file that ends in the middle.
    """
    epochs: list[datetime] = []
    states: list[list[float]] = []
    kinds: list[str] = []  # of each epoch the first letters of its lines
    lasts: list[str] = []  # and the last one
    ended = False
    for number, line in enumerate(lines, 1):
        if line.startswith("EOF"):
            ended = True
            break
        try:
            if line.startswith("* "):
                epochs.append(_epoch(line))
                states.append([np.nan] * 6)
                kinds.append("")
                lasts.append(line)
            elif line[:1] in ("P", "V"):
                kinds[-1] += line[0]
                if line[1:4].strip() == satellite:
                    at = slice(0, 3) if line[0] == "P" else slice(3, 6)
                    states[-1][at] = _coordinates(line)
        except (ValueError, IndexError, OverflowError) as error:
            raise ValueError(f"{path.name}: line {number} cannot be read: {line[:80]!r}") from error
        if lasts and line.strip():
            lasts[-1] = line
    _check_order(path, epochs)
    _check_end(path, epochs, kinds, lasts, ended, expected)
    table = np.array(states).reshape(-1, 6)
    return Records(epochs, 1e3 * table[:, :3], table[:, 3:])


def _epoch(line: str) -> datetime:
    """Return the epoch of a line; minute 60, which some files have, is the next hour."""
    year, month, day, hour, minute, second = line[1:].split()[:6]
    time = timedelta(hours=int(hour), minutes=int(minute), seconds=float(second))
    if not timedelta() <= time <= timedelta(days=1, seconds=1):
        raise ValueError
    return datetime(int(year), int(month), int(day)) + time


def _coordinates(line: str) -> list[float]:
    values = [float(line[4 + 14 * i : 18 + 14 * i]) for i in range(3)]
    absent = not any(values) or max(map(abs, values)) >= _BAD
    return [np.nan] * 3 if absent else values


def _check_order(path: Path, epochs: list[datetime]) -> None:
    for i in range(1, len(epochs)):
        if epochs[i] <= epochs[i - 1]:
            raise ValueError(
                f"{path.name}: epoch {i + 1}, {epochs[i]}, does not come after the one before, {epochs[i - 1]}"
            )


def _check_end(
    path: Path, epochs: list[datetime], kinds: list[str], lasts: list[str], ended: bool, expected: int
) -> None:
    """Refuse a file that is not whole.

    Without an EOF line it is whole if it has all its epochs, and as much of the last one as of the one before. With
    one, a header that counts intervals for epochs, or both ends of an arc that has one of them, is borne.
    """
    count = len(epochs)
    if ended:
        steps = {later - sooner for sooner, later in pairwise(epochs)}
        if count == expected or (abs(count - expected) == 1 and len(steps) == 1):
            return
    elif count == expected:
        if count > 1 and kinds[-1] == kinds[-2] and len(lasts[-1].rstrip()) >= min(_CLOCK, len(lasts[-2].rstrip())):
            return
        raise ValueError(
            f"{path.name}: it ends in the middle: the last of {expected} epochs is cut, and there is no EOF line"
        )
    raise ValueError(
        f"{path.name}: it ends in the middle: {count} of {expected} epochs{'' if ended else ', and no EOF line'}"
    )
