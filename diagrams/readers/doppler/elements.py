"""Two-line elements: one object's two lines, and files of many objects with or without names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quietfix.diagrams.readers.rows import broken
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.files import Unreadable, read_bytes

__all__ = ["UNIX_EPOCH", "Elements", "checked_satellite", "read_elements"]

UNIX_EPOCH = 2440587.5
"""Julian date of 1970-01-01T00:00:00."""

_DAY = 86400.0
_LENGTH = 69
_LARGEST = 50_000_000  # bytes
_ANGLE, _SMALL = r"[ \d]{2}\d\.\d{4}", r"[ +-]\d{5}[ +-]\d"
_FORMATS = (  # what SGP4's own reader makes of anything else may be NaN
    rf"1 [ \dA-Z][ \d]{{4}}. .{{8}} [ \d]\d[ \d]{{2}}\d\.\d{{8}} [ +-]\.\d{{8}} {_SMALL} {_SMALL} [ \d] [ \d]{{4}}\d",
    rf"2 [ \dA-Z][ \d]{{4}} {_ANGLE} {_ANGLE} \d{{7}} {_ANGLE} {_ANGLE} [ \d]\d\.\d{{8}}[ \d]{{5}}\d",
)


@dataclass(frozen=True, eq=False)
class Elements:
    """One object of a file.

    Attributes
    ----------
    number : str
        Of the catalogue.
    name : str
        As the line above the elements says; empty: there is none.
    line : int
        Of the file: that of its first line of elements.
    epoch : float
        Seconds since 1970, UTC without leap seconds.
    satellite : sgp4.api.Satrec
    """

    number: str
    name: str
    line: int
    epoch: float
    satellite: Any

    @property
    def label(self) -> str:
        """Number and, if there is one, name."""
        return f"{self.number} {self.name}".strip()


def checked_satellite(line_1: str, line_2: str, fields: tuple[str, str]) -> Any:
    """Return the SGP4 satellite of two lines.

    Parameters
    ----------
    line_1, line_2 : str
        69 characters each.
    fields : (str, str)
        What they are called, for messages.

    Raises
    ------
    UserError
        For lines of another length, wrong check sums, numbers elsewhere than in their columns, two objects, and
        elements that SGP4 refuses.
    """
    from sgp4.api import Satrec

    lines = line_1.rstrip(), line_2.rstrip()
    for i, (line, field) in enumerate(zip(lines, fields, strict=True), 1):
        if len(line) != _LENGTH:
            raise UserError(f"{field}: {len(line)} characters are not allowed; {_LENGTH}")
        if not line.isascii() or line[:2] != f"{i} ":
            raise UserError(f"{field}: {line[:10]!r}... is not allowed; it begins with '{i} '")
        sum_ = sum(int(c) if c.isdecimal() else c == "-" for c in line[:-1]) % 10
        if line[-1] != str(sum_):
            raise UserError(f"{field}: checksum {line[-1]} is not allowed; that of the line is {sum_}")
        if not re.fullmatch(_FORMATS[i - 1], line):
            raise UserError(f"{field}: {line!r} is not allowed; numbers in the columns of two-line elements")
    if lines[0][2:7] != lines[1][2:7]:
        first, second = (line[2:7].strip() for line in lines)
        raise UserError(f"{fields[1]}: catalogue number {second} is not allowed; line_1 has {first}")
    whole = fields[0].removesuffix(".line_1")
    try:
        satellite = Satrec.twoline2rv(*lines)
    except ValueError as error:
        raise UserError(f"{whole}: the lines cannot be read ({' '.join(str(error).split())})") from error
    if satellite.error:
        raise UserError(f"{whole}: SGP4 refuses these elements (error {satellite.error})")
    return satellite


def read_elements(path: Path | str) -> tuple[list[Elements], list[str]]:
    """Read a file of two-line elements: two lines per object, or three with its name first.

    A name may begin with ``0 ``; empty lines and lines that begin with ``#`` are skipped. Elements that cannot be are
    left out.

    Returns
    -------
    elements : list of Elements
        In the order of the file.
    notes : list of str
        Which were left out, and why.

    Raises
    ------
    UserError
        If the file cannot be read or holds no elements; it names the first line that is wrong.
    """
    file = Path(path)
    try:
        text = read_bytes(file, _LARGEST).decode("utf-8-sig", errors="replace")
    except Unreadable as error:
        raise broken(file, None, f"it cannot be read ({error.reason})") from error
    lines = [(i, line.rstrip()) for i, line in enumerate(text.splitlines(), 1)]
    lines = [(i, line) for i, line in lines if line.strip() and not line.startswith("#")]
    found: list[Elements] = []
    wrong: list[str] = []
    name, k = "", 0
    while k < len(lines):
        i, line = lines[k]
        if not line.startswith("1 "):
            if line.startswith("2 "):
                wrong.append(f"{file.name}:{i}: a second line of elements without its first")
            name, k = line.removeprefix("0 ").strip()[:40], k + 1
            continue
        if k + 1 == len(lines) or not lines[k + 1][1].startswith("2 "):
            wrong.append(f"{file.name}:{i}: a first line of elements without its second")
            name, k = "", k + 1
            continue
        try:
            fields = f"{file.name}:{i}", f"{file.name}:{lines[k + 1][0]}"
            satellite = checked_satellite(line, lines[k + 1][1], fields)
            epoch = (satellite.jdsatepoch - UNIX_EPOCH) * _DAY + satellite.jdsatepochF * _DAY
            found.append(Elements(line[2:7].strip(), name, i, epoch, satellite))
        except UserError as error:
            wrong.append(str(error))
        name, k = "", k + 2
    if not found:
        raise broken(file, None, wrong[0].partition(": ")[2] if wrong else "it holds no two-line elements")
    return found, [f"{len(wrong)} elements cannot be and are left out, first {wrong[0]}"] if wrong else []
