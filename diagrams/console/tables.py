"""Tables that fit: a table wider than the terminal is split or turned; no cell is ever cropped."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.cells import cell_len

from quietfix.diagrams.console.answer import asked_for_json
from quietfix.diagrams.console.terminal import padded, styled, width_of, wrapped, write

__all__ = ["Column", "Styled", "Table", "lost", "print_table", "rendered", "three_digits", "with_interval"]

_GAP = "  "
_MARGIN = 1
_NAME = 24  # a cell of words up to this length is not broken: splitting the table reads better
_CODES = {"bold": "1", "green": "32", "red": "1;31", "yellow": "33"}


@dataclass(frozen=True)
class Column:
    """A column of words: to the left, and broken between words where room is short."""

    heading: str


@dataclass(frozen=True)
class Styled:
    """A cell that stands out on a terminal: ``bold``, ``green``, ``red`` or ``yellow``."""

    text: str
    style: str


@dataclass
class Table:
    """What is to be printed; `print_table` decides how.

    Attributes
    ----------
    title : str
        The line above.
    columns : sequence of str or Column
        Headings: a `str` for numbers, which stand to the right and in one line; a `Column` for words.
    keys : int
        The first so many columns say what a row is about: they are repeated where the table is split. With more than
        one, a first key equal to that above is left blank, and a new one begins a section.
    caption : str
        Sentences below.
    rows : list
        See `add`.
    """

    title: str
    columns: Sequence[str | Column]
    keys: int = 1
    caption: str = ""
    rows: list[list[Styled]] = field(default_factory=list)

    def add(self, *cells: str | Styled) -> None:
        """Add a row.

        Raises
        ------
        ValueError
            If there are not as many cells as columns.
        """
        if len(cells) != len(self.columns):
            raise ValueError(f"cells: {len(cells)} are given; the table has {len(self.columns)} columns")
        self.rows.append([cell if isinstance(cell, Styled) else Styled(cell, "") for cell in cells])


def print_table(table: Table) -> None:
    """Print a table to standard output, as wide as `quietfix.diagrams.console.terminal.width_of` says.

    With ``--json`` it is not printed: the command tells its numbers.
    """
    if asked_for_json():
        return
    write("\n".join(rendered(table, width_of(sys.stdout), styled(sys.stdout))))


def rendered(table: Table, width: int | None, style: bool = False) -> list[str]:
    """Return the lines of a table.

    Whole where it fits. Else its columns stand in groups, one below the other, each with the keys; a table of one row,
    or of which not even one column fits beside the keys, is turned: a line per cell, a block per row.

    Parameters
    ----------
    table : Table
        At least one row or none.
    width : int or None
        Columns of the terminal; None: no limit.
    style : bool
        With colours and bold headings.
    """
    parts = [_grid(table, group, width, style) for group in _groups(table, width)]
    lines = wrapped(table.title, width)
    for part in parts or _blocks(table, width, style):
        lines += [*part, ""]
    lines += [*wrapped(table.caption, width), ""] if table.caption else []
    return [line.rstrip() for line in lines]


# ----------------------------------------------------------------------------------------------------- layout


def _heading(column: str | Column) -> str:
    return column if isinstance(column, str) else column.heading


def _longest(texts: Sequence[str]) -> int:
    return max((cell_len(text) for text in texts), default=0)


def _least(table: Table, i: int) -> int:
    """Return the least width of a column: its numbers and short names stay in one line, longer words may be broken."""
    cells = [row[i].text for row in table.rows]
    widest = _longest(cells)
    if isinstance(table.columns[i], Column):
        widest = max(min(widest, _NAME), _longest([word for cell in cells for word in cell.split()]))
    return max(widest, _longest(_heading(table.columns[i]).split()))


def _total(widths: Sequence[int]) -> int:
    return _MARGIN + sum(widths) + len(_GAP) * (len(widths) - 1)


def _groups(table: Table, width: int | None) -> list[list[int]]:
    """Return the columns of each part, in their order; nothing where the table has to be turned."""
    least = [_least(table, i) for i in range(len(table.columns))]
    if width is None or _total(least) <= width:
        return [list(range(len(least)))]
    if len(table.rows) == 1:
        return []
    groups = _filled(least, table.keys, width)
    for narrower in range(width):  # as many groups, but of nearly the same width
        even = _filled(least, table.keys, narrower)
        if even and len(even) == len(groups):
            return even
    return groups


def _filled(least: Sequence[int], keys: int, width: int) -> list[list[int]]:
    """Return groups of columns, each as full as the width allows; nothing if a column does not fit beside the keys."""
    groups: list[list[int]] = []
    for i in range(keys, len(least)):
        if _total([least[k] for k in (*range(keys), i)]) > width:
            return []
        if groups and _total([least[k] for k in (*groups[-1], i)]) <= width:
            groups[-1].append(i)
        else:
            groups.append([*range(keys), i])
    return groups


def _widths(table: Table, group: Sequence[int], width: int | None) -> list[int]:
    """Return the widths of columns: all in one line, or the widest ones narrowed until the group fits."""
    widths = [_longest([_heading(table.columns[i]), *(row[i].text for row in table.rows)]) for i in group]
    least = [_least(table, i) for i in group]
    while width is not None and _total(widths) > width:
        spare = [k for k in range(len(group)) if widths[k] > least[k]]
        widths[max(spare, key=lambda k: widths[k])] -= 1
    return widths


# ------------------------------------------------------------------------------------------------------ lines


def _grid(table: Table, group: Sequence[int], width: int | None, style: bool) -> list[str]:
    """Return headings, a rule and the rows of a group of columns."""
    widths = _widths(table, group, width)
    right = [isinstance(table.columns[i], str) for i in group]
    names = [Styled(_heading(table.columns[i]), "bold") for i in group]
    lines = _row(names, widths, right, style)
    lines.append(" " * _MARGIN + _GAP.join("-" * width for width in widths))
    above = None
    for row in table.rows:
        cells = [row[i] for i in group]
        if table.keys > 1:
            if above is not None and cells[0] != above:
                lines.append("")
            above, cells[0] = cells[0], Styled("", "") if cells[0] == above else cells[0]
        lines += _row(cells, widths, right, style)
    return lines


def _row(cells: Sequence[Styled], widths: Sequence[int], right: Sequence[bool], style: bool) -> list[str]:
    broken = [wrapped(cell.text, width) for cell, width in zip(cells, widths, strict=True)]
    lines = []
    for k in range(max(map(len, broken))):
        parts = []
        for cell, texts, width, to_the_right in zip(cells, broken, widths, right, strict=True):
            text = padded(texts[k] if k < len(texts) else "", width, to_the_right)
            parts.append(_painted(text, cell.style, style))
        lines.append(" " * _MARGIN + _GAP.join(parts))
    return lines


def _blocks(table: Table, width: int | None, style: bool) -> list[list[str]]:
    """Return a block per row, a line per cell."""
    names = [_heading(column) for column in table.columns]
    left = _longest(names)
    room = None if width is None else max(width - _MARGIN - left - len(_GAP), 1)
    blocks = []
    for row in table.rows:
        lines = []
        for name, cell in zip(names, row, strict=True):
            beside = room is None or _longest(cell.text.split()) <= room
            if not beside:
                lines.append(" " * _MARGIN + _painted(name, "bold", style))
            for k, text in enumerate(wrapped(cell.text, room if beside else width)):
                head = padded("" if k else name, left) if beside else ""
                lines.append(" " * _MARGIN + _painted(head, "bold", style) + _GAP + _painted(text, cell.style, style))
        blocks.append(lines)
    return blocks


def _painted(text: str, name: str, style: bool) -> str:
    """Return a text between escape codes; its spaces stay outside of them."""
    core = text.strip()
    return text.replace(core, f"\033[{_CODES[name]}m{core}\033[0m") if style and name and core else text


# ---------------------------------------------------------------------------------------------------- numbers


def with_interval(entry: Mapping[str, float | None]) -> str:
    """Return a value with its interval in brackets, from ``{"value", "low", "high"}``."""
    if entry["value"] is None:
        return "-"
    if entry["low"] is None and entry["high"] is None:  # of a single trial
        return three_digits(entry["value"])
    return f"{three_digits(entry['value'])} ({three_digits(entry['low'])}-{three_digits(entry['high'])})"


def lost(diverged: int, not_started: int, flagged: int | None = None) -> str:
    """Return how many trials have diverged, and beside it how many never started, or are called lost at the end."""
    told = [str(diverged), *([f"{not_started} not started"] if not_started else [])]
    return ", ".join([*told, *([f"{flagged} flagged"] if flagged else [])])


def three_digits(value: float | None) -> str:
    """Return a number with about three digits; a dash for none."""
    if value is None:
        return "-"
    if abs(value) >= 1e6:
        return f"{value:.2g}".replace("e+0", "e").replace("e+", "e")
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
