"""Tables that others wrote, as text with any delimiter or as Parquet: chunks of columns, and the line of each row."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.files import Unreadable, read_bytes, regular_size

__all__ = ["Chunk", "broken", "chunks_of"]

_LARGEST = 200_000_000  # bytes
_MOST = 1_000_000  # rows; with its arrays such a table takes less than 1 GB
_CHUNK = 1 << 16
_DELIMITERS = (",", ";", "\t", "|", " ")
_PARQUET = (".parquet", ".pq")

Names = Callable[[Sequence[str]], bool]


class Chunk(NamedTuple):
    """Some rows of a table.

    Attributes
    ----------
    lines : sequence of int
        Line of each in its file; of Parquet its number, from 1.
    columns : dict of str to sequence
        By name, in small letters; text, of Parquet also numbers and `datetime64` arrays.
    notes : list of str
        What is doubtful in the file as such.
    """

    lines: Sequence[int]
    columns: dict[str, Any]
    notes: list[str]


def broken(path: Path, line: int | None, message: str) -> UserError:
    """Return the error for a place in a file; of Parquet the line is the number of a row."""
    unit = " row " if path.suffix.lower() in _PARQUET else ""
    error = UserError(f"{shown(path)}{'' if line is None else f':{unit}{line}'}: {message}")
    error.placed = True
    return error


def chunks_of(path: Path, known: Names, words: str) -> Iterator[Chunk]:
    """Yield the rows of a table, as many at once as do not fill the memory.

    Parameters
    ----------
    path : Path
    known : callable
        Says whether names of columns are those that are needed: the delimiter is the first with which they are.
    words : str
        Which they are.

    Raises
    ------
    UserError
        In one line with file and line: what cannot be read, is empty or too large, lines with too few or too many
        fields.
    """
    try:
        yield from (_parquet if path.suffix.lower() in _PARQUET else _text)(path, known, words)
    except Unreadable as error:
        raise broken(path, None, f"it cannot be read ({error.reason})") from error


# ---------------------------------------------------------------------------------------------------------- text


def _text(path: Path, known: Names, words: str) -> Iterator[Chunk]:
    content = read_bytes(path, _LARGEST)
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise broken(path, None, "it is not allowed as UTF-16; UTF-8")
    try:
        yield from _lines(path, content, known, words)
    except UnicodeDecodeError as error:
        at = _line_of(content)
        raise broken(path, at, f"byte {error.object[error.start]:#x} is not allowed; text in UTF-8") from error


def _line_of(content: bytes) -> int:
    """Return the first line that is not UTF-8."""
    return next(i for i, line in enumerate(content.split(b"\n"), 1) if not _decodes(line))


def _decodes(line: bytes) -> bool:
    try:
        line.decode()
    except UnicodeDecodeError:
        return False
    return True


def _lines(path: Path, content: bytes, known: Names, words: str) -> Iterator[Chunk]:
    stream = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig", newline="")
    skipped, header, remark = 0, "", ""
    rest: Iterable[str] = stream
    for line in stream:
        skipped += 1
        if line.strip() and not line.startswith("#"):
            header = line
            break
        remark = line if line.strip() else remark
    if header and remark and not _split(header, known) and _split(remark[1:], known):  # names behind a '#'
        header, rest, skipped = remark[1:], chain([header], stream), skipped - 1
    if not header.strip():
        raise broken(path, None, f"it is empty; a line of names and rows below it: {words}")
    delimiter, names = _header(path, skipped, header, known, words)
    notes = [] if content.endswith((b"\n", b"\r")) else [_unended(path)]
    reader = csv.reader(rest, delimiter=delimiter, skipinitialspace=True, strict=True)
    rows: list[list[str]] = []
    lines: list[int] = []
    total = 0
    try:
        for row in reader:
            if not row or row[0].startswith("#") or row == [""]:
                continue
            if len(row) != len(names):
                if delimiter == " " and len(row) == len(names) + 1 and not row[-1]:
                    row.pop()
                else:
                    cut = "; is the file cut?" if len(row) < len(names) else ""
                    raise broken(
                        path,
                        skipped + reader.line_num,
                        f"{len(row)} fields are not allowed; {len(names)} as names{cut}",
                    )
            rows.append(row)
            lines.append(skipped + reader.line_num)
            if len(rows) == _CHUNK:
                total += _CHUNK
                if total >= _MOST:
                    raise broken(path, lines[-1], f"more than {_MOST} rows are not allowed; cut the file into parts")
                yield _columns(names, lines, rows, notes)
                rows, lines = [], []
    except csv.Error as error:
        raise broken(path, skipped + reader.line_num, f"it cannot be read ({error})") from error
    if rows or not total:
        yield _columns(names, lines, rows, notes)


def _split(header: str, known: Names) -> bool:
    """Return whether a line holds the names that are needed, with any delimiter."""
    for delimiter in _DELIMITERS:
        try:
            fields = next(csv.reader([header.strip()], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error:
            continue
        if known([field.strip().lower() for field in fields]):
            return True
    return False


def _unended(path: Path) -> str:
    return f"{shown(path)}: its last line has no end; if the file was cut, the last number may be too short."


def _columns(names: Sequence[str], lines: Sequence[int], rows: Sequence[Sequence[str]], notes: list[str]) -> Chunk:
    stripped = (
        ([text.strip() for text in column] for column in zip(*rows, strict=True)) if rows else ([] for _ in names)
    )
    return Chunk(lines, dict(zip(names, stripped, strict=True)), notes)


def _header(path: Path, line: int, header: str, known: Names, words: str) -> tuple[str, list[str]]:
    """Return delimiter and names."""
    best: list[str] = []
    for delimiter in _DELIMITERS:
        try:
            fields = next(csv.reader([header.strip()], delimiter=delimiter, skipinitialspace=True), [])
        except csv.Error:
            continue
        names = [field.strip().lower() for field in fields]
        if known(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise broken(path, line, f"column {twice[0][:60]} is there twice; once")
            return delimiter, names
        best = max(best, names, key=len)
    raise broken(path, line, f"columns {', '.join(best)[:200]} are not allowed; {words}")


# ------------------------------------------------------------------------------------------------------- Parquet


def _parquet(path: Path, known: Names, words: str) -> Iterator[Chunk]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    if (size := regular_size(path)) > _LARGEST:
        raise broken(path, None, f"{size} bytes are not allowed; at most {_LARGEST}")
    try:
        with pq.ParquetFile(path) as file:
            names = [str(name).strip().lower() for name in file.schema_arrow.names]
            if not known(names):
                raise broken(path, None, f"columns {', '.join(names)[:200]} are not allowed; {words}")
            if file.metadata.num_rows > _MOST:
                raise broken(path, None, f"{file.metadata.num_rows} rows are not allowed; at most {_MOST}")
            done = 0
            for batch in file.iter_batches(_CHUNK):
                columns = {name: _values(column, pa) for name, column in zip(names, batch.columns, strict=True)}
                yield Chunk(range(done + 1, done + 1 + batch.num_rows), columns, [])
                done += batch.num_rows
            if not done:
                yield Chunk([], {name: [] for name in names}, [])
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise broken(path, None, f"it cannot be read ({' '.join(str(error).split())[:200]})") from error


def _values(column: Any, pa: Any) -> Any:
    """Return a column as an array of numbers, or of dates as nanoseconds since 1970, or a list of texts."""
    kind = column.type
    if pa.types.is_dictionary(kind):
        column, kind = column.dictionary_decode(), kind.value_type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind):
        return column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    if pa.types.is_timestamp(kind):
        zone = "Z" if kind.tz else ""
        return [f"{one}{zone}" if one else "" for one in column.cast(pa.timestamp("ns")).cast(pa.string()).to_pylist()]
    return ["" if one is None else str(one).strip() for one in column.to_pylist()]
