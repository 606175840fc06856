"""The block diagram as a picture: Drake's own Graphviz text, tidied, through ``dot`` or the package graphviz-pure."""

from __future__ import annotations

import re
import shutil
import sysconfig
import tempfile
from collections.abc import Collection, Mapping, Sequence
from html import escape
from pathlib import Path
from textwrap import fill

import pydot
from pydrake.systems.framework import System

from quietfix.diagrams.schema.errors import UserError

__all__ = ["diagram_dot", "draw", "find_graphviz", "is_drawing"]

_FORMATS = (".svg", ".png")
_SIGNATURE = b"<!-- a block diagram drawn by quietfix -->"
_FEEDBACK = 'color="#c00000", style=dashed, penwidth=1.8'
_KNOWN_TO_ALL = 'color="#b0b0b0"'
_MOST, _WIDTH = 12, 30  # names below a block's, and characters in a line of them
_STYLE = """ranksep=1.2
nodesep=0.35
fontname="Helvetica"
node [fontname="Helvetica", fontsize=12]
edge [arrowsize=0.7]
"""


def diagram_dot(
    diagram: System,
    dashed: Collection[tuple[str, str]] = (),
    header: str | None = None,
    contents: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """Return a diagram as Graphviz text that reads well.

    Parameters
    ----------
    diagram : Diagram
        What is drawn, one level deep; without recorders and loggers, which would double the picture.
    dashed : collection of (str, str)
        Feedback connections, as names of blocks (from, to): red and dashed.
    header : str, optional
        Title; by default the diagram's name.
    contents : mapping of str to sequence of str, optional
        Names of what blocks carry or measure, by the block's name.

    Returns
    -------
    str
        Names of blocks bold, their classes and contents small; wires that carry ``platforms``, which nearly every block
        reads, grey.

    Raises
    ------
    ValueError
        If a feedback connection does not exist.
    """
    text = diagram.GetGraphvizString(max_depth=1)
    blocks = {node: _block(body) for node, body in re.findall(r"^(s\d+) \[(.*?)^>\];", text, re.DOTALL | re.MULTILINE)}
    left = set(dashed)

    def style(edge: re.Match[str]) -> str:
        start, end, port = edge["start"], edge["end"], edge["port"]
        (source, _), (sink, inputs) = blocks.get(start, ("", {})), blocks.get(end, ("", {}))
        if (source, sink) in dashed:
            left.discard((source, sink))
            return f"{edge[0]} [{_FEEDBACK}]"
        return f"{edge[0]} [{_KNOWN_TO_ALL}]" if inputs.get(port) == "platforms" else edge[0]

    text = re.sub(r"^(?P<start>s\d+):\w+:e -> (?P<end>s\d+):(?P<port>\w+):w$", style, text, flags=re.MULTILINE)
    if left:
        raise ValueError(f"dashed: there is no connection {' or '.join(f'{a} -> {b}' for a, b in sorted(left))}")
    carried = contents or {}

    def headed(found: re.Match[str]) -> str:
        lines = [_short(found["class"]), *_lines(carried.get(found["name"], ()))]
        small = "<BR/>\n".join(f'<FONT POINT-SIZE="9" COLOR="#606060">{line}</FONT>' for line in lines)
        return f"<B>{found['name']}</B><BR/>\n{small}"

    text = re.sub(r"<B>(?P<class>[^<]*)</B><BR/>\nname=(?P<name>[^\n]*)", headed, text)
    title = f'<FONT POINT-SIZE="18"><B>{escape(header or diagram.get_name(), quote=False)}</B></FONT>'
    text = re.sub(r"(?<=^label=)<<TABLE.*?</TABLE>>", lambda _: f"<{title}>", text, count=1, flags=re.DOTALL | re.M)
    # the margin keeps feedback, which goes around the outermost blocks, inside the frame
    text = text.replace("concentrate=true\n", "concentrate=true\nmargin=20\n", 1)
    return text.replace("rankdir=LR\n", "rankdir=LR\n" + _STYLE, 1)


def _block(body: str) -> tuple[str, dict[str, str]]:
    """Return the name of a node and the names of its ports by Graphviz's port."""
    name = re.search(r"^name=(.*)$", body, re.MULTILINE)
    ports = dict(re.findall(r'<TD PORT="(\w+)"[^>]*>([^<]*)</TD>', body))
    return (name[1] if name else ""), ports


def _lines(names: Sequence[str]) -> list[str]:
    """Return names in a few short lines, the first of many."""
    shown = list(names[:_MOST]) + ([f"{len(names) - _MOST} more"] if len(names) > _MOST else [])
    lines = fill(", ".join(shown), _WIDTH, break_long_words=False, break_on_hyphens=False).splitlines()
    return [escape(line, quote=False) for line in lines]


def _short(class_name: str) -> str:
    return class_name.rpartition(".")[2]


def find_graphviz() -> str:
    """Return the program that draws: ``dot`` on the PATH, else ``graphviz-pure`` of this Python or on the PATH.

    Raises
    ------
    UserError
        If there is neither.
    """
    scripts = Path(sysconfig.get_path("scripts"))
    found = shutil.which("dot") or shutil.which("graphviz-pure", path=str(scripts)) or shutil.which("graphviz-pure")
    if found is None:
        raise UserError("draw: neither dot (Graphviz) nor graphviz-pure is found; pip install graphviz-pure")
    return found


def draw(
    diagram: System,
    path: Path | str,
    dashed: Collection[tuple[str, str]] = (),
    header: str | None = None,
    contents: Mapping[str, Sequence[str]] | None = None,
) -> Path:
    """Draw a diagram into a file.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    path : path
        Ends in ``.svg`` or ``.png``.
    dashed, header, contents
        See `diagram_dot`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UserError
        For another ending, or without a Graphviz.
    """
    target = Path(path)
    if target.suffix.lower() not in _FORMATS:
        raise UserError(f"draw: {target.name} is not allowed; a file name that ends in {' or '.join(_FORMATS)}")
    text = diagram_dot(diagram, dashed, header, contents)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "diagram.dot").write_text(text, encoding="utf-8")
        # pydot's parser would add nothing to the text, and takes longer than the drawing
        arguments = [f"-T{target.suffix[1:].lower()}", "-o", "diagram.out", "diagram.dot"]
        _, complaint, process = pydot.call_graphviz(find_graphviz(), arguments, folder)
        if process.returncode != 0:
            words = complaint if isinstance(complaint, str) else bytes(complaint).decode(errors="replace")
            raise UserError(f"draw: {find_graphviz()} failed ({words.strip()})")
        drawn = (Path(folder) / "diagram.out").read_bytes()
    target.write_bytes(drawn.replace(b"<svg", _SIGNATURE + b"\n<svg", 1) if target.suffix.lower() == ".svg" else drawn)
    return target


def is_drawing(path: Path) -> bool:
    """Return whether a file is an SVG that `draw` wrote."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        return _SIGNATURE in stream.read(4096)
