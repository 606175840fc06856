"""The block diagram as Graphviz text: blocks with the ports that are connected, alike estimators in one box.

Every cell is as wide as its text in DejaVu Sans, the widest of the fonts that a program which shows the drawing may
take for Helvetica; text begins at the left of its cell, so that it ends within the cell whichever font it is.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from textwrap import fill
from typing import Any

from pydrake.systems.framework import Diagram, PortDataType, System

from quietfix.systems.signals import EnsembleBlock

__all__ = ["Notes", "diagram_dot"]

_FEEDBACK = 'color="#c00000", style=dashed, penwidth=1.8'
_KNOWN_TO_ALL = 'color="#b0b0b0"'
_MOST, _WIDTH = 12, 30  # names below a block's, and characters in a line of them
_BIG, _TEXT, _SMALL = 18, 12, 9  # points
_PAD = 6  # points beside a text
_GREY = "#606060"
_UNITS = 3  # on a wire
_FEW = 2  # outputs that lead nowhere and are named all the same
_STYLE = """rankdir=LR
ranksep=0.7
nodesep=0.35
pad=0.25
fontname="Helvetica"
labelloc=t
labeljust=l
node [shape=plaintext, margin=0, fontname="Helvetica", fontsize=12]
edge [arrowsize=0.7, fontname="Helvetica", fontsize=9, fontcolor="#606060"]
"""

Edge = tuple[str, str, str, str]
"""Block and output port, block and input port."""


@dataclass(frozen=True)
class Notes:
    """What a drawing says beside blocks and wires.

    Attributes
    ----------
    dashed : collection of (str, str)
        Feedback connections, as names of blocks (from, to): red and dashed.
    contents : mapping of str to sequence of str
        Names of what blocks carry or measure, by the block's name.
    alike : collection of str
        Names of the blocks that share a box where the same wires lead to them: the estimators.
    trials : int or None
        How many trials a wire carries; None: that is not known yet.
    units : mapping of (str, str) to sequence of str
        Units of the numbers on an output port, by block and port, where the block itself does not say them.
    """

    dashed: Collection[tuple[str, str]] = ()
    contents: Mapping[str, Sequence[str]] = field(default_factory=dict)
    alike: Collection[str] = ()
    trials: int | None = None
    units: Mapping[tuple[str, str], Sequence[str]] = field(default_factory=dict)


def diagram_dot(diagram: Diagram, header: str | None = None, notes: Notes | None = None) -> str:
    """Return a diagram as Graphviz text that reads well, the same each time.

    Parameters
    ----------
    diagram : Diagram
        What is drawn, one level deep; without recorders and loggers, which would double the picture.
    header : str, optional
        Title; by default the diagram's name.
    notes : Notes, optional

    Returns
    -------
    str
        Names of blocks bold, their classes and contents small, outputs that lead nowhere in one line; on wires the
        size, trials times numbers, and units; wires that carry ``platforms``, which nearly every block reads, grey.

    Raises
    ------
    ValueError
        If a feedback connection does not exist.
    """
    said = notes or Notes()
    blocks = {block.get_name(): block for block in diagram.GetSystems()}
    edges = _edges(diagram)
    missing = sorted(set(said.dashed) - {(source, sink) for source, _, sink, _ in edges})
    if missing:
        raise ValueError(f"dashed: there is no connection {' or '.join(f'{a} -> {b}' for a, b in missing)}")
    boxes = _boxes(blocks, edges, said)
    place = {name: i for i, members in enumerate(boxes) for name in members}
    wires = _wires(edges, place, said)
    title = header or diagram.get_name()
    lines = [_node(i, members, blocks, wires, boxes, said) for i, members in enumerate(boxes)]
    lines += _drawn_wires(wires, boxes, blocks, edges, said)
    head = f"label=<{_table([[_cell(title, _BIG, bold=True)]])}>\n"
    return "digraph quietfix {\n" + _STYLE + head + "\n".join(lines) + "\n}\n"


def _edges(diagram: Diagram) -> list[Edge]:
    """Return all connections, by the order of the blocks that they lead to."""
    order = {block.get_name(): i for i, block in enumerate(diagram.GetSystems())}
    found = []
    for (sink, at), (source, out) in diagram.connection_map().items():
        where = (order[sink.get_name()], int(at))
        ports = source.get_output_port(out).get_name(), sink.get_input_port(at).get_name()
        found.append((where, (source.get_name(), ports[0], sink.get_name(), ports[1])))
    return [edge for _, edge in sorted(found)]


def _boxes(blocks: Mapping[str, System], edges: Sequence[Edge], notes: Notes) -> list[list[str]]:
    """Return the blocks of each box: alone, but of those that are alike all with the same wires together."""
    found: dict[Any, list[str]] = {}
    for name in blocks:
        inputs = tuple(sorted((edge[3], edge[0], edge[1]) for edge in edges if edge[2] == name))
        outputs = any(edge[0] == name for edge in edges)
        key = inputs if name in notes.alike and not outputs else name
        found.setdefault(key, []).append(name)
    return list(found.values())


def _wires(edges: Sequence[Edge], place: Mapping[str, int], notes: Notes) -> list[tuple[int, str, int, str, bool]]:
    """Return from box and port, to box and port, and whether it is fed back, of every wire that is drawn."""
    found: dict[tuple[int, str, int, str], bool] = {}
    for source, out, sink, port in edges:
        found[place[source], out, place[sink], port] = (source, sink) in set(notes.dashed)
    return [(*wire, back) for wire, back in found.items()]


def _node(
    index: int,
    members: Sequence[str],
    blocks: Mapping[str, System],
    wires: Sequence[tuple[int, str, int, str, bool]],
    boxes: Sequence[Sequence[str]],
    notes: Notes,
) -> str:
    """Return a box: names, classes, contents, and the ports that are connected."""
    first = blocks[members[0]]
    taken = list(dict.fromkeys(port for _, _, sink, port, _ in wires if sink == index))
    given = list(dict.fromkeys(out for source, out, *_ in wires if source == index))
    every = [first.get_output_port(i).get_name() for i in range(first.num_output_ports())]
    folded = [name for name in every if name not in given]
    rows = [[line] for line in _heading(members, blocks, notes)]
    ports = [
        [_port(f"i{taken.index(name)}", name) for name in taken],
        [_port(f"o{given.index(name)}", name) for name in given],
    ]
    columns = [_table([[cell] for cell in cells], border=1) for cells in ports if cells]
    body = [_table(rows, pad=1)]
    if columns:
        inner = "".join(f'<TD VALIGN="TOP" CELLPADDING="0">{column}</TD>' for column in columns)
        body.append(f'<TABLE BORDER="0" CELLSPACING="0" CELLPADDING="0"><TR>{inner}</TR></TABLE>')
    if folded:
        body.append(_table([[line] for line in _folded(folded)], pad=1))
    cells = "".join(f"<TR><TD>{part}</TD></TR>" for part in body)
    table = f'<TABLE BORDER="1" CELLBORDER="0" CELLSPACING="0" CELLPADDING="3" BGCOLOR="white">{cells}</TABLE>'
    return f"n{index} [label=<{table}>]"


def _heading(members: Sequence[str], blocks: Mapping[str, System], notes: Notes) -> list[str]:
    if len(members) > 1:
        width = max(_width(name, _TEXT, True) for name in members)
        return [
            _cell(f"{len(members)} estimators, wired alike", _SMALL),
            *(f"{_cell(name, _TEXT, bold=True, least=width)}{_cell(_kind(blocks[name]), _SMALL)}" for name in members),
        ]
    (name,) = members
    small = [_kind(blocks[name]), *_lines(notes.contents.get(name, ()))]
    return [_cell(name, _TEXT, bold=True), *(_cell(line, _SMALL) for line in small)]


def _folded(names: Sequence[str]) -> list[str]:
    """Return the outputs that lead nowhere, the first of many."""
    shown = list(names[:_FEW]) + ([f"{len(names) - _FEW} more"] if len(names) > _FEW else [])
    lines = _lines(["gives too: " + shown[0], *shown[1:]])
    return [_cell(line, _SMALL) for line in lines]


def _drawn_wires(
    wires: Sequence[tuple[int, str, int, str, bool]],
    boxes: Sequence[Sequence[str]],
    blocks: Mapping[str, System],
    edges: Sequence[Edge],
    notes: Notes,
) -> list[str]:
    """Return the wires, each signal with its size and units where it leads to first."""
    lines, told = [], set()
    for source, out, sink, port, back in wires:
        taken = list(dict.fromkeys(name for _, _, box, name, _ in wires if box == sink))
        given = list(dict.fromkeys(name for box, name, *_ in wires if box == source))
        style = [_FEEDBACK] if back else [_KNOWN_TO_ALL] if port == "platforms" else []
        if (source, out) not in told:
            told.add((source, out))
            words = _size(blocks, boxes[source][0], out, edges, notes)
            style += [f"label=<{_table([[_cell(words, _SMALL)]])}>"] if words else []
        ends = f"n{source}:o{given.index(out)}:e -> n{sink}:i{taken.index(port)}:w"
        lines.append(f"{ends} [{', '.join(style)}]" if style else ends)
    return lines


def _size(blocks: Mapping[str, System], name: str, out: str, edges: Sequence[Edge], notes: Notes) -> str:
    """Return the size of a signal, trials times numbers, and its units."""
    block = blocks[name]
    port = block.GetOutputPort(out)
    if port.get_data_type() != PortDataType.kVectorValued:
        return "object"
    trials, size = block.output_size(out) if isinstance(block, EnsembleBlock) else (1, port.size())
    several = "trials" if notes.trials is None else f"{notes.trials}"
    units = [unit for unit in _units(blocks, name, out, edges, notes) if unit]
    named = list(dict.fromkeys(unit for unit in units if unit != "1")) or (["no unit"] if units else [])
    more = [*named[:_UNITS], f"{len(named) - _UNITS} more units"] if len(named) > _UNITS + 1 else named
    return f"{several if trials > 1 else '1'} \N{MULTIPLICATION SIGN} {size}" + (f": {', '.join(more)}" if more else "")


def _units(
    blocks: Mapping[str, System], name: str, out: str, edges: Sequence[Edge], notes: Notes, depth: int = 8
) -> Sequence[str]:
    """Return the units on an output; a block that hands a signal on does not change them."""
    block = blocks[name]
    own = [row.unit for row in block.components(out)] if isinstance(block, EnsembleBlock) else []
    if any(own):
        return own
    if (name, out) in notes.units:
        return notes.units[name, out]
    inputs = [(source, port, at) for source, port, sink, at in edges if sink == name]
    size = _rows(block, out)
    handed = [(source, port) for source, port, at in inputs if at == out and _rows(blocks[source], port) == size]
    if not handed and sum(_rows(blocks[source], port) for source, port, _ in inputs) == size:
        handed = [(source, port) for source, port, _ in inputs]  # what joins signals
    if not depth:
        return []
    return [unit for source, port in handed for unit in _units(blocks, source, port, edges, notes, depth - 1)]


def _rows(block: System, out: str) -> int:
    """Return how many numbers of each trial are on an output."""
    port = block.GetOutputPort(out)
    if port.get_data_type() != PortDataType.kVectorValued:
        return 0
    return int(block.output_size(out)[1] if isinstance(block, EnsembleBlock) else port.size())


# ---------------------------------------------------------------------------------------------------- text and cells


def _lines(names: Sequence[str]) -> list[str]:
    """Return names in a few short lines, the first of many."""
    shown = list(names[:_MOST]) + ([f"{len(names) - _MOST} more"] if len(names) > _MOST else [])
    return fill(", ".join(shown), _WIDTH, break_long_words=False, break_on_hyphens=False).splitlines()


def _kind(block: System) -> str:
    return type(block).__name__.rpartition(".")[2]


def _port(tag: str, name: str) -> str:
    return _cell(name, _TEXT, tag=tag)


def _cell(text: str, points: int, bold: bool = False, least: float = 0, tag: str = "") -> str:
    """Return a cell that is wide enough for its text in any font."""
    width = max(_width(text, points, bold), least)
    words = escape(text, quote=False)
    words = f"<B>{words}</B>" if bold else words
    color = f' COLOR="{_GREY}"' if points == _SMALL else ""
    port = f' PORT="{tag}"' if tag else ""
    size = f'WIDTH="{width + 2 * _PAD:.0f}" HEIGHT="{1.45 * points:.0f}"'
    return f'<TD{port} ALIGN="LEFT" {size}><FONT POINT-SIZE="{points}"{color}>{words}</FONT></TD>'


def _table(rows: Sequence[Sequence[str]], border: int = 0, pad: int = 2) -> str:
    cells = "".join(f"<TR>{''.join(row)}</TR>" for row in rows)
    return f'<TABLE BORDER="0" CELLBORDER="{border}" CELLSPACING="0" CELLPADDING="{pad}">{cells}</TABLE>'


@cache
def _font(bold: bool) -> Any:
    from matplotlib import get_data_path
    from matplotlib.ft2font import FT2Font

    return FT2Font(f"{get_data_path()}/fonts/ttf/DejaVuSans{'-Bold' if bold else ''}.ttf")


def _width(text: str, points: float, bold: bool) -> float:
    """Return the width of a text in DejaVu Sans [points]."""
    font = _font(bold)
    font.set_size(points, 72)
    font.set_text(text)
    return float(font.get_width_height()[0] / 64)
