"""Lines of JSON as rows of sensors: what each says, checked by itself."""

from __future__ import annotations

import difflib
import json
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from quietfix.diagrams.live.light import LightTimes
from quietfix.diagrams.live.refused import Counted, Refused
from quietfix.diagrams.own.fed.handed import Handed
from quietfix.diagrams.own.fed.matching import Meaning, beyond, meaning_of
from quietfix.diagrams.readers.measurements import COLUMNS, Series
from quietfix.diagrams.readers.stamps import BadStamp, read_stamps
from quietfix.diagrams.schema.errors import UserError

__all__ = ["LONGEST", "Heard", "LineReader"]

Moment = tuple[int, float]

LONGEST = 1 << 16
"""Most bytes of a line."""

_FARTHEST = 1e15
_SERIES = 10_000  # that are remembered
_COLUMNS = frozenset(COLUMNS)
_SIGMAS = 5.0
_TEXT = 200  # most letters of a name


class Heard(NamedTuple):
    """A row: when [s], of which target, which of the rows, its value in SI units, and sigma over what is believed."""

    time: float
    target: str
    row: int
    value: float
    scale: float


class LineReader:
    """Reads lines of JSON with the columns of a table of measurements.

    Parameters
    ----------
    handed : Handed
        What can be measured.
    doubts : Counted
        Where is counted what is doubtful.
    zero : (int, float), optional
        t = 0 in seconds of TAI since 1970, whole ones and the rest; None: the first line with a date.
    dates : bool, optional
        Whether lines have dates (`time`) or seconds (`time_s`); None: as the first line has it.
    """

    def __init__(self, handed: Handed, doubts: Counted, zero: Moment | None, dates: bool | None = None) -> None:
        self._rows = handed.rows
        self._believed = np.sqrt(np.diagonal(handed.noise_covariance)).tolist()
        self._scalable, self._end = handed.scalable, handed.end
        self.zero, self.dates = zero, dates
        self._meanings: dict[Series, Meaning] = {}
        self._light, self._doubts = LightTimes(handed), doubts

    @property
    def begins(self) -> bool:
        """Whether t = 0 is the first date, and none has come."""
        return self.zero is None and self.dates is None

    def stamp(self, line: bytes) -> Moment | None:
        """Return the date of a line in seconds of TAI since 1970; None if it has none."""
        try:
            return _moment_of(_object(line).get("time"))
        except Refused:
            return None

    def read(self, line: bytes) -> Heard:
        """Return what a line says.

        Raises
        ------
        Refused
            Naming the field, the value and what is allowed.
        """
        said = _object(line)
        time = self._time(said)
        texts = [_text(said, name) for name in Series._fields]
        series = Series(*texts)
        meaning = self._meanings.get(series) or self._meaning(series)
        row = self._rows[meaning.row]
        written = _number(said, "value")
        value = meaning.value(written)
        turned = written * meaning.factor if meaning.compass else value
        if wrong := beyond(row, turned, written, series):
            raise Refused("value", wrong)
        sigma = _number(said, "sigma")
        if sigma <= 0:
            raise Refused("sigma", f"sigma: {sigma:g} is not allowed; > 0, or empty: as the sensor has it")
        scale = 1.0 if sigma != sigma else sigma * abs(meaning.factor) / self._believed[meaning.row]
        if scale != 1.0 and not self._scalable:
            raise Refused("sigma", f"sigma: {sigma:g} is not allowed with phases that are resolved; sigma_deg")
        self._doubt(said, time, meaning.row, value, scale)
        return Heard(time, series.target or "target", meaning.row, value, scale)

    def _meaning(self, series: Series) -> Meaning:
        try:
            found = meaning_of(series, self._rows)
        except UserError as error:
            raise Refused(str(error).partition(":")[0], str(error)) from None
        if len(self._meanings) >= _SERIES:
            self._meanings.clear()
        self._meanings[series] = found
        return found

    def _time(self, said: dict[str, Any]) -> float:
        dates, seconds = (said.get(name) not in (None, "") for name in ("time", "time_s"))
        if dates and seconds:
            raise Refused("time", "time: both time and time_s are not allowed; one of them")
        if not dates and not seconds:
            raise Refused("time", "time: nothing is not allowed; time with its zone, or time_s, seconds")
        if self.dates is not None and dates != self.dates:
            names = ("time", "time_s") if dates else ("time_s", "time")
            raise Refused("time", f"{names[0]}: it is not allowed after lines with {names[1]}; {names[1]}")
        if dates:
            time = self._since(said["time"])
        else:
            time = _number(said, "time_s")
            if time != time:
                raise Refused("time", "time_s: nothing is not allowed; seconds")
        if time < 0:
            raise Refused("before t = 0", f"its time is {-time:g} s before t = 0; no row may be earlier")
        if time > self._end * (1 + 4e-12):
            raise Refused(
                "after the end",
                f"its time of {time:.10g} s is after the end of the run, until when the platforms are known; "
                f"duration_s is {self._end:g} (--set duration_s=...)",
            )
        self.dates = dates
        return time

    def _since(self, stamp: Any) -> float:
        whole, rest = _moment_of(stamp)
        if self.zero is None:
            self.zero = whole, rest
        return (whole - self.zero[0]) + (rest - self.zero[1])

    def _doubt(self, said: dict[str, Any], time: float, number: int, value: float, scale: float) -> None:
        """Count what is believed all the same, as it is in a table."""
        row = self._rows[number]
        if row.compares_clocks:
            most = self._light.most(number, time)
            if abs(value) > most + _SIGMAS * scale * self._believed[number]:
                words = (
                    f"{row.name}: {1e6 * value:.4g} us is more than the {1e6 * most:.4g} us that light takes between "
                )
                self._doubts.add("beyond light", f"{words}the two; unit, or clocks?")
        elif row.compass and said["kind"] == "azimuth":
            words = "azimuth: taken as counter-clockwise from east (clockwise from north is kind bearing)"
            self._doubts.once("azimuth", words)
        for name in said.keys() - _COLUMNS:
            near = difflib.get_close_matches(name, COLUMNS, n=1, cutoff=0.75)
            hint = f" (did you mean {near[0]}?)" if near else ""
            self._doubts.add(f"column {name[:20]}", f"column {name[:40]} is not known{hint} and means nothing")


def _moment_of(stamp: Any) -> Moment:
    if not isinstance(stamp, str):
        raise Refused("time", f"time: {stamp!r:.60} is not allowed; a date with its zone, or time_s")
    try:
        return _moment(stamp)
    except BadStamp as error:
        raise Refused("time", f"time: {error}") from None


@lru_cache(maxsize=64)
def _moment(stamp: str) -> Moment:
    whole, rest = read_stamps([stamp])
    return int(whole[0]), float(rest[0])


def _object(line: bytes) -> dict[str, Any]:
    if len(line) > LONGEST:
        raise Refused("too long", f"a line of more than {LONGEST} bytes is not allowed")
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):  # UnicodeDecodeError is a ValueError, too
        raise Refused("not JSON", f"{_shown(line)} is not allowed; an object of JSON") from None
    if not isinstance(said, dict):
        raise Refused("not an object", f"{_shown(line)} is not allowed; an object of JSON")
    if any(name not in said for name in ("kind", "value", "unit")):
        absent = next(name for name in ("kind", "value", "unit") if name not in said)
        raise Refused(absent, f"{absent}: it is missing in {_shown(line)}")
    return said


def _shown(line: bytes) -> str:
    return repr(line[:80].decode("utf-8", "replace"))


def _text(said: dict[str, Any], name: str) -> str:
    """Return a text; of a number, such as that of an aircraft, this without a decimal point."""
    value = said.get(name)
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise Refused(name, f"{name}: {value!r:.60} is not allowed; text")
    if isinstance(value, float):
        value = f"{value:.0f}" if value.is_integer() else repr(value)
    try:
        text = str(value).strip()
    except ValueError:  # thousands of digits
        text = "0" * (_TEXT + 1)
    if len(text) > _TEXT:
        raise Refused(name, f"{name}: {text[:40]}... is not allowed; at most {_TEXT} letters")
    return text


def _number(said: dict[str, Any], name: str) -> float:
    """Return a number, as such or as text; NaN where there is none."""
    value = said.get(name)
    if value is None or value == "":
        return float("nan")
    try:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError
        number = float(value)
    except (ValueError, OverflowError):
        raise Refused(name, f"{name}: {value!r:.60} is not allowed; a number") from None
    if abs(number) > _FARTHEST:
        raise Refused(name, f"{name}: {number:g} is not allowed; a number up to {_FARTHEST:g}")
    return number
