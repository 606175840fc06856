"""What must hold of every printed table, whatever the width: it fits, and no word or number of it is cut or lost."""

import re
from collections import Counter
from itertools import pairwise

from quietfix.diagrams.console.tables import Column, Table, rendered

WIDTHS = (60, 80, 100, 132, 200)


def check_fits(table: Table) -> None:
    """Read the lines of a table at every width and find all its cells."""
    assert table.rows, "a table without rows says nothing about how rows are printed"
    for width in (*WIDTHS, None):
        lines = rendered(table, width)
        assert width is None or max(map(len, lines)) <= width, (width, "\n".join(lines))
        found = read(lines, table)
        wanted = [[tidy(cell.text) for cell in row] for row in table.rows]
        assert found == wanted, (width, "\n".join(lines))
        printed = Counter(" ".join(lines).split())
        assert not Counter(f"{table.title} {table.caption}".split()) - printed, (width, "\n".join(lines))


def tidy(text: str) -> str:
    """Return a text with single spaces."""
    return " ".join(text.split())


def headings(table: Table) -> list[str]:
    """Return the headings of a table."""
    return [column.heading if isinstance(column, Column) else column for column in table.columns]


def read(lines: list[str], table: Table) -> list[list[str]]:
    """Return the cells of printed lines, row by row, from the columns under each rule and from turned blocks."""
    rules = [k for k, line in enumerate(lines) if re.fullmatch(r" -+(  -+)*", line)]
    return read_groups(lines, rules, table) if rules else read_blocks(lines, table)


def read_groups(lines: list[str], rules: list[int], table: Table) -> list[list[str]]:
    """Read groups of columns; a row begins where the cell of a column that stands in one line does."""
    columns: list[list[str]] = []
    for k in rules:
        spans = [match.span() for match in re.finditer("-+", lines[k])]
        end = next((j for j in range(k + 1, len(lines)) if not lines[j] and done(lines, j, rules)), len(lines))
        group = read_columns([line for line in lines[k + 1 : end] if line], spans, table)
        columns += group if not columns else group[table.keys :]
    return [list(row) for row in zip(*columns, strict=True)]


def done(lines: list[str], j: int, rules: list[int]) -> bool:
    """Return whether a blank line is not one between sections: no rows of the same columns follow it."""
    rest = lines[j + 1 :]
    following = next((n for n, line in enumerate(rest) if not line), len(rest))
    return not rest or any(j < k <= j + 1 + following for k in rules) or not rest[0].startswith(" ")


def read_columns(lines: list[str], spans: list[tuple[int, int]], table: Table) -> list[list[str]]:
    """Read one group; a first key that is left blank is that of the row above."""
    cut = [[line[a:b].strip() for a, b in spans] for line in lines]
    for line, cells in zip(lines, cut, strict=True):
        assert tidy(line) == tidy(" ".join(cells)), f"outside of its column: {line}"
    second = table.keys - 1  # always filled, and at the first line of a row
    starts = [n for n, cells in enumerate(cut) if cells[second] and all(cells[table.keys :])]
    rows = [cut[a:b] for a, b in zip(starts, [*starts[1:], len(cut)], strict=True)]
    joined = [[tidy(" ".join(cells)) for cells in zip(*row, strict=True)] for row in rows]
    for above, row in pairwise(joined):
        row[0] = row[0] or above[0]
    return [list(column) for column in zip(*joined, strict=True)]


def read_blocks(lines: list[str], table: Table) -> list[list[str]]:
    """Read turned rows: heading and cell, until as many as the table has columns."""
    left = max(map(len, headings(table))) + 3
    cells: list[str] = []
    for line in lines:
        if line[:left].strip() in headings(table) and line.startswith(" ") and line[1:2] != " ":
            assert line[:left].strip() == headings(table)[len(cells) % len(table.columns)]
            cells.append(line[left:])
        elif line.startswith("   "):
            cells[-1] += " " + line
    size = len(table.columns)
    return [[tidy(cell) for cell in cells[k : k + size]] for k in range(0, len(cells), size)]
