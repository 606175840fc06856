"""Tables of received frequencies: one satellite, one station, a column of times and one of frequencies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.rows import Chunk, broken, chunks_of
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.time_scales import posix_of, posix_to_tai, to_tai

__all__ = ["Received", "read_received"]

Array = NDArray[np.float64]

_TIMES = (
    "time",
    "timestamp",
    "time_utc",
    "utc",
    "datetime",
    "date",
    "time_s",
    "seconds",
    "t",
    "unix",
    "unix_s",
    "epoch",
)
_ABSOLUTE = ("measured_freq", "frequency", "freq", "received_frequency", "rx_freq", "rx_frequency", "f", "value")
_OFFSETS = ("doppler_offset", "doppler", "offset", "doppler_shift", "shift", "frequency_offset", "freq_offset")
_UNITS = {"_hz": 1.0, "_khz": 1e3, "_mhz": 1e6, "": 1.0}
_WORDS = "a column of times (time, timestamp ...) and one of frequencies (frequency_hz, doppler_hz ...) are needed; "
_NAMED = "--time-column and --frequency-column name them"
_UNIX = 3e8  # s: larger numbers are seconds since 1970
_FEWEST = 20  # rows
_OFFSET = 0.01  # of the carrier: smaller values are offsets from it


@dataclass(frozen=True, eq=False)
class Received:
    """What was received.

    Attributes
    ----------
    path : Path
    lines : ndarray of int, shape (rows,)
        Of the file, in the order of time.
    second, rest : int, float
        The first row in seconds since 1970 (UTC without leap seconds), whole ones and the rest.
    times : ndarray, shape (rows,)
        Since then [s], strictly increasing.
    frequency : ndarray, shape (rows,)
        Received less the carrier [Hz].
    carrier : float
        [Hz]
    notes : list of str
        What was taken for what, and what is doubtful.
    """

    path: Path
    lines: NDArray[np.int64]
    second: int
    rest: float
    times: Array
    frequency: Array
    carrier: float
    notes: list[str]


def read_received(
    path: Path | str,
    carrier: float | None,
    start: str | None = None,
    time_column: str | None = None,
    frequency_column: str | None = None,
) -> Received:
    """Read a table of received frequencies; rows without one are left out.

    Parameters
    ----------
    path : path
        Text with any delimiter, or Parquet.
    carrier : float, optional
        [Hz]; None: the middle of the frequencies, which must be absolute ones then.
    start : str, optional
        When seconds of less than 3e8 begin: a date in UTC, or with its offset.
    time_column, frequency_column : str, optional
        None: by their usual names.

    Raises
    ------
    UserError
        In one line with file, line, column, value and what is allowed.
    """
    file = Path(path)
    asked = [None if name is None else name.strip().lower() for name in (time_column, frequency_column)]

    def known(names: Sequence[str]) -> bool:
        return bool(_time_name(names, asked[0]) and _value_name(names, asked[1]))

    lines: list[int] = []
    whole: list[NDArray[np.int64]] = []
    rest: list[Array] = []
    values: list[Array] = []
    notes: dict[str, None] = {}
    times_name = value_name = ""
    for chunk in chunks_of(file, known, _WORDS + _NAMED):
        times_name = _time_name(list(chunk.columns), asked[0])
        value_name = _value_name(list(chunk.columns), asked[1])
        notes |= dict.fromkeys(chunk.notes)
        second, part, said = _times(file, chunk, times_name, start)
        notes |= dict.fromkeys(said)
        lines += list(chunk.lines)
        whole.append(second)
        rest.append(part)
        values.append(_numbers(file, chunk, value_name))
    table = np.array(lines, dtype=np.int64), np.concatenate(whole), np.concatenate(rest), np.concatenate(values)
    return _ordered(file, table, carrier, (times_name, value_name), list(notes))


def _time_name(names: Sequence[str], asked: str | None) -> str:
    if asked is not None:
        return asked if asked in names else ""
    return next((name for name in _TIMES if name in names), "")


def _value_name(names: Sequence[str], asked: str | None) -> str:
    if asked is not None:
        return asked if asked in names else ""
    usual = [name + unit for name in (*_ABSOLUTE, *_OFFSETS) for unit in _UNITS]
    return next((name for name in usual if name in names), next((name for name in names if "freq" in name), ""))


def _times(file: Path, chunk: Chunk, name: str, start: str | None) -> tuple[NDArray[np.int64], Array, list[str]]:
    """Return whole seconds of TAI since 1970, the rest, and notes."""
    column = chunk.columns[name]
    texts = column if isinstance(column, list) else [repr(float(one)) for one in column]
    whole, rest = np.empty(len(texts), dtype=np.int64), np.empty(len(texts))
    notes: dict[str, None] = {}
    zero = None if start is None else _moment(start)
    for i, text in enumerate(texts):
        number = _number(text)
        try:
            if number is None:
                if zero is not None:
                    raise ValueError(f"{text[:40]!r} is not allowed with --start, which is for seconds")
                whole[i], rest[i] = to_tai(text, "UTC", offsets=True)
                if text[-1:] not in "Zz" and not ("+" in text[-6:] or "-" in text[-6:]):
                    notes[f"column {name}: dates without a zone are taken as UTC"] = None
            elif number >= _UNIX:
                second = math.floor(number)
                whole[i], rest[i] = posix_to_tai(second), number - second
                notes[f"column {name}: numbers are taken as seconds since 1970, UTC"] = None
            elif zero is None:
                raise ValueError(f"{text[:40]!r} is not allowed without --start, the date that seconds begin at")
            elif not number > -_UNIX:
                raise ValueError(f"{text[:40]!r} is not allowed; a date, or seconds")
            else:
                second = math.floor(zero[1] + number)
                whole[i], rest[i] = zero[0] + second, zero[1] + number - second
        except (ValueError, OverflowError) as error:
            raise broken(file, chunk.lines[i], f"{name}: {error}") from error
    return whole, rest, list(notes)


def _moment(start: str) -> tuple[int, float]:
    try:
        return to_tai(start, "UTC", offsets=True)
    except ValueError as error:
        raise UserError(f"--start: {error}") from error


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def _numbers(file: Path, chunk: Chunk, name: str) -> Array:
    """Return a column of numbers; NaN where it is empty or says so."""
    column = chunk.columns[name]
    found = np.full(len(chunk.lines), np.nan)
    for i, value in enumerate(column):
        if isinstance(value, str):
            if value == "":
                continue
            number = _number(value)
            if number is None:
                raise broken(file, chunk.lines[i], f"{name}: {value!r:.60} is not allowed; a frequency")
            value = number
        if abs(value) > 1e12:
            raise broken(file, chunk.lines[i], f"{name}: {value:g} is not allowed; at most 1e12 in size")
        found[i] = value
    return found


def _ordered(
    file: Path,
    table: tuple[NDArray[np.int64], NDArray[np.int64], Array, Array],
    carrier: float | None,
    names: tuple[str, str],
    notes: list[str],
) -> Received:
    """Return rows in the order of time, as offsets from the carrier."""
    lines, whole, rest, values = table
    filled = np.isfinite(values) & np.isfinite(rest)
    if np.count_nonzero(filled) < _FEWEST:
        raise broken(
            file, None, f"{np.count_nonzero(filled)} rows with a frequency are not allowed; at least {_FEWEST}"
        )
    if not filled.all():
        notes.append(f"{np.count_nonzero(~filled)} rows without a frequency are left out")
    lines, whole, rest, values = lines[filled], whole[filled], rest[filled], values[filled]
    order = np.lexsort((rest, whole))
    lines, whole, rest, values = lines[order], whole[order], rest[order], values[order]
    times = (whole - whole[0]) + (rest - rest[0])
    again = np.diff(times, prepend=-1.0) <= 0
    if again.any():
        notes.append(f"{np.count_nonzero(again)} rows of a time that another row has are left out")
    lines, times, values = lines[~again], times[~again], values[~again]
    frequency, carrier, said = _offsets(file, values, carrier, names[1])
    notes.insert(0, f"column {names[0]} is the time, {said}")
    return Received(file, lines, posix_of(int(whole[0])), float(rest[0]), times, frequency, carrier, notes)


def _offsets(file: Path, values: Array, carrier: float | None, name: str) -> tuple[Array, float, str]:
    """Return frequencies less the carrier, the carrier [Hz], and what was taken for what."""
    unit = next(unit for unit in ("_khz", "_mhz", "_hz", "") if name.endswith(unit))
    scale, middle = _UNITS[unit], float(np.median(values))
    if not unit and carrier is not None and abs(middle) > 1:
        scale = next((s for s in (1.0, 1e3, 1e6) if abs(middle * s / carrier - 1) < _OFFSET), 1.0)
    shown = {1.0: "Hz", 1e3: "kHz", 1e6: "MHz"}[scale]
    if carrier is None:
        if abs(middle * scale) < 1e6:
            raise broken(file, None, f"{name}: offsets from a carrier are not allowed without --carrier-mhz")
        carrier = float(0.5 * (np.percentile(values, 10) + np.percentile(values, 90)) * scale)
        said = f"{name} the frequency [{shown}]; no carrier was named: {carrier / 1e6:.6f} MHz, the middle of it"
        return values * scale - carrier, carrier, said
    if abs(middle * scale) < _OFFSET * carrier:
        return values * scale, carrier, f"{name} the offset from the carrier [{shown}], {carrier / 1e6:.6f} MHz"
    if abs(middle * scale / carrier - 1) > _OFFSET:
        raise broken(
            file,
            None,
            f"{name}: {middle * scale / 1e6:g} MHz is not allowed with a carrier of {carrier / 1e6:g} MHz",
        )
    return values * scale - carrier, carrier, f"{name} the frequency [{shown}]; carrier {carrier / 1e6:.6f} MHz"
