"""The block diagram as a picture: `diagram_dot` through ``dot`` or the package graphviz-pure."""

from __future__ import annotations

import shutil
import sysconfig
import tempfile
from pathlib import Path

import pydot
from pydrake.systems.framework import Diagram

from quietfix.diagrams.assembly.dot import Notes, diagram_dot
from quietfix.diagrams.schema.errors import UserError

__all__ = ["draw", "find_graphviz", "is_drawing"]

_FORMATS = (".svg", ".png")
_SIGNATURE = b"<!-- a block diagram drawn by quietfix -->"


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


def draw(diagram: Diagram, path: Path | str, header: str | None = None, notes: Notes | None = None) -> Path:
    """Draw a diagram into a file.

    Parameters
    ----------
    diagram : Diagram
        What is drawn.
    path : path
        Ends in ``.svg`` or ``.png``.
    header, notes
        See `quietfix.diagrams.assembly.dot.diagram_dot`.

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
    text = diagram_dot(diagram, header, notes)
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
