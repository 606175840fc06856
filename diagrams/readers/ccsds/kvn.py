"""Keyword = value notation of the navigation messages of CCSDS: lines, numbers, epochs, and how they are refused."""

from __future__ import annotations

import difflib
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.earth.time_scales import SCALES, to_tai
from quietfix.systems.files import Unreadable, read_text

__all__ = ["KvnLine", "KvnText", "brief"]

_LARGEST_FILE = 64_000_000  # bytes: a million lines
_LONGEST_LINE = 10_000  # the standard allows 254 characters
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d{1,4})?", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d{1,10}", re.ASCII)
_UNIT = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")
_NOT_CONVERTED = {
    "TDB": "it departs from TT by up to 2 ms through the year",
    "TCB": "it gains 0.5 s a year on TDB",
    "TCG": "it gains 22 ms a year on TT",
    "UT1": "it departs from UTC by up to 0.9 s, which only the IERS knows",
    "SCLK": "only its spacecraft knows it",
    "MET": "only its mission knows it",
    "MRT": "only its mission knows it",
}


def brief(value: str) -> str:
    """Return a text of a file as a message shows it: quoted, and not all of a long one."""
    return repr(value if len(value) <= 60 else f"{value[:57]}...")


@dataclass(frozen=True)
class KvnLine:
    """A line that is not blank.

    Attributes
    ----------
    number : int
        From 1.
    text : str
        Without the blanks around it.
    keyword : str
        In capitals, what is before the first ``=``, or the first word.
    value : str
        What follows, without the blanks around it.
    assigned : bool
        Whether there is a ``=``.
    """

    number: int
    text: str
    keyword: str
    value: str
    assigned: bool


class KvnText:
    """The text of a file, and messages that name it.

    Parameters
    ----------
    path : path
        A regular file in UTF-8; a byte order mark, any kind of line ends, tabs, blank lines and keywords in small
        letters are borne.

    Raises
    ------
    UserError
        If it cannot be read or is no text.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            self._text = read_text(self.path, _LARGEST_FILE, encoding="utf-8-sig")
        except Unreadable as error:
            raise UserError(f"{shown(self.path)} cannot be read ({error.reason})") from error

    @property
    def terminated(self) -> bool:
        """Whether the last line has an end."""
        return self._text.endswith(("\n", "\r"))

    def lines(self) -> Iterator[KvnLine]:
        """Walk over the lines that are not blank."""
        for number, raw in enumerate(io.StringIO(self._text, newline=None), 1):
            text = raw.strip()
            if not text:
                continue
            if len(text) > _LONGEST_LINE:
                self.refuse(number, f"a line of {len(text)} characters is not allowed; at most {_LONGEST_LINE}")
            before, equals, after = text.partition("=")
            if equals and before.split()[:1] not in (["COMMENT"], ["comment"]):
                yield KvnLine(number, text, before.strip().upper(), after.strip(), True)
            else:
                word, *rest = text.split(None, 1)
                yield KvnLine(number, text, word.upper(), rest[0] if rest else "", False)

    def refuse(self, number: int | None, reason: str) -> NoReturn:
        """Raise a `UserError` that names file and line."""
        place = "" if number is None else f", line {number}"
        raise UserError(f"{shown(self.path)}{place}: {reason}")

    def version(self, line: KvnLine | None, kind: str, versions: Sequence[str]) -> str:
        """Return the version in the first line of a message of some `kind`: OEM, TDM; the newest is the last."""
        name = f"CCSDS_{kind}_VERS"
        if line is None:
            self.refuse(None, f"it is empty; {name} = {versions[-1]}")
        if line.keyword != name or not line.assigned:
            self.refuse(line.number, f"{brief(line.text)} is not allowed; {name} = {versions[-1]} (KVN, not XML)")
        return self.choice(line.number, name, line.value, versions)

    def header(
        self, lines: Iterator[KvnLine], allowed: Sequence[str], needed: Sequence[str]
    ) -> tuple[dict[str, str], tuple[str, ...], KvnLine | None]:
        """Return the header of a message, its comments, and the first META_START after it."""
        found: dict[str, str] = {}
        comments: list[str] = []
        line = next(lines, None)
        while line is not None and line.keyword != "META_START":
            if line.keyword == "COMMENT":
                comments.append(line.value)
            else:
                name = self.keyword(line, allowed, "in the header")
                self.once(line, found)
                if name == "CREATION_DATE":
                    self.epoch(line.number, name, line.value, "UTC")
                found[name] = line.value
            line = next(lines, None)
        self.required(line.number if line else None, found, needed, "in the header")
        return found, tuple(comments), line

    def metadata(
        self, lines: Iterator[KvnLine], begin: int, allowed: Sequence[str]
    ) -> tuple[dict[str, KvnLine], tuple[str, ...]]:
        """Return the lines up to META_STOP by their keywords, and comments; `begin`: where META_START is."""
        found: dict[str, KvnLine] = {}
        comments: list[str] = []
        for line in lines:
            if line.keyword == "META_STOP" and not line.value:
                return found, tuple(comments)
            if line.keyword == "COMMENT":
                comments.append(line.value)
                continue
            self.keyword(line, allowed, "in the metadata")
            self.once(line, found)
            found[line.keyword] = line
        self.refuse(None, f"it ends before the META_STOP of line {begin}'s META_START")

    def number(self, line: int, field: str, value: str, unit: str = "") -> float:
        """Return a finite number; its unit may follow in brackets.

        Parameters
        ----------
        line : int
            Where it is.
        field : str
            Its keyword.
        value : str
            As it is written; ``D`` may stand for ``E``.
        unit : str
            Which the standard gives it.
        """
        written = self.without_unit(line, field, value, unit)
        found = math.nan
        if _NUMBER.fullmatch(written):
            found = float(written.translate(_EXPONENT))
        if not math.isfinite(found):
            self.refuse(line, f"{field} {brief(value)} is not allowed; a number{f' [{unit}]' if unit else ''}")
        return found

    def without_unit(self, line: int, field: str, value: str, unit: str) -> str:
        """Return a value without the unit in brackets that may follow it, which must be the standard's."""
        if not value.endswith("]"):
            return value
        parts = _UNIT.fullmatch(value)
        if parts is None or parts[2].strip() != unit:
            self.refuse(
                line, f"{field} {brief(value)} is not allowed; {f'its unit is [{unit}]' if unit else 'no unit'}"
            )
        return parts[1]

    def integer(self, line: int, field: str, value: str, least: int) -> int:
        """Return a whole number that is not less than `least`."""
        if not _INTEGER.fullmatch(value) or int(value) < least:
            self.refuse(line, f"{field} {brief(value)} is not allowed; a whole number >= {least}")
        return int(value)

    def choice(self, line: int, field: str, value: str, allowed: Iterable[str]) -> str:
        """Return that one of `allowed` which a text is, whatever the case of its letters."""
        names = {one.upper(): one for one in allowed}
        if value.upper() not in names:
            near = difflib.get_close_matches(value.upper()[:60], names, n=1, cutoff=0.75)
            hint = f" (did you mean {names[near[0]]}?)" if near else ""
            self.refuse(line, f"{field} {brief(value)} is not allowed{hint}; {', '.join(names.values())}")
        return names[value.upper()]

    def keyword(self, line: KvnLine, allowed: Iterable[str], where: str) -> str:
        """Return the keyword of an assignment that is allowed there."""
        names = list(allowed)
        if line.keyword not in names:
            near = difflib.get_close_matches(line.keyword[:60], names, n=1)
            hint = f" (did you mean {near[0]}?)" if near else ""
            self.refuse(line.number, f"{brief(line.keyword)} is not allowed {where}{hint}")
        if not line.assigned or not line.value:
            self.refuse(line.number, f"{line.keyword} {brief(line.value)} is not allowed; {line.keyword} = value")
        return line.keyword

    def once(self, line: KvnLine, found: Mapping[str, object]) -> None:
        """Refuse a keyword that has been found before."""
        if line.keyword in found:
            self.refuse(line.number, f"{line.keyword} is there twice; once is allowed")

    def scale(self, line: int, value: str) -> str:
        """Return a time scale that can be turned into TAI."""
        name = value.upper()
        if name in SCALES:
            return name
        why = f": {_NOT_CONVERTED[name]}" if name in _NOT_CONVERTED else ""
        self.refuse(line, f"TIME_SYSTEM {brief(value)} is not allowed; {', '.join(SCALES)}{why}")

    def epoch(self, line: int, field: str, value: str, scale: str) -> tuple[int, float]:
        """Return an epoch as whole seconds of TAI since 1970 and the rest."""
        try:
            return to_tai(value, scale)
        except ValueError as error:
            self.refuse(line, f"{field} {error}")

    def required(self, line: int | None, found: Mapping[str, object], names: Iterable[str], where: str) -> None:
        """Refuse a block that lacks a keyword."""
        for name in names:
            if name not in found:
                self.refuse(line, f"{name} is missing {where}; it is needed")


_EXPONENT = str.maketrans("Dd", "Ee")
