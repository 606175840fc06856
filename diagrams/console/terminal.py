"""How wide the output is and whether it takes colours; sentences wrapped to that width."""

from __future__ import annotations

import os
import sys
from typing import TextIO

from rich.cells import cell_len

from quietfix.diagrams.console.answer import asked_for_json, note

__all__ = ["done", "live", "padded", "say", "styled", "width_of", "wrapped", "write"]

_WIDTH_UNKNOWN = 80  # of a terminal that does not say
_PLAIN = ("dumb", "unknown")


def width_of(stream: TextIO) -> int | None:
    """Return how many columns a stream has.

    Parameters
    ----------
    stream : TextIO
        Such as ``sys.stdout``.

    Returns
    -------
    int or None
        The environment variable ``COLUMNS`` where it is a positive number; else the terminal's own width; None, no
        limit, for a file or a pipe.
    """
    try:
        asked = int(os.environ.get("COLUMNS", ""))
    except ValueError:
        asked = 0
    if asked > 0:
        return asked
    if not stream.isatty():
        return None
    try:
        return os.get_terminal_size(stream.fileno()).columns or _WIDTH_UNKNOWN
    except (OSError, ValueError):
        return _WIDTH_UNKNOWN


def live(stream: TextIO) -> bool:
    """Return whether lines of a stream can be overwritten: a terminal, and not a dumb one."""
    return stream.isatty() and os.environ.get("TERM") not in _PLAIN


def styled(stream: TextIO) -> bool:
    """Return whether a stream takes colours and bold type: `live`, and no ``NO_COLOR`` in the environment."""
    return live(stream) and not os.environ.get("NO_COLOR")


def wrapped(text: str, width: int | None) -> list[str]:
    """Return the lines of a text, broken between words only: a longer word stands out, and no number is cut.

    Parameters
    ----------
    text : str
        Line breaks and the indent of its first line are kept; lines that follow are indented by two more.
    width : int or None
        Columns; None: no limit.
    """
    lines: list[str] = []
    for line in text.split("\n"):
        if width is None or cell_len(line) <= width:
            lines.append(line)
            continue
        indent = line[: len(line) - len(line.lstrip())]
        current = ""
        for word in line.split():
            longer = f"{current} {word}" if current else indent + word
            if current and cell_len(longer) > width:
                lines.append(current)
                longer = f"{indent}  {word}" if indent else word
            current = longer
        lines.append(current)
    return lines


def padded(text: str, width: int, right: bool = False) -> str:
    """Return a text with spaces to a width in columns of the terminal (wide characters take two)."""
    spaces = " " * (width - cell_len(text))
    return spaces + text if right else text + spaces


def say(text: str) -> None:
    """Print a sentence to standard output, wrapped where that has a width; with ``--json`` it is among the notes."""
    if asked_for_json():
        note(text)
    else:
        write("\n".join(wrapped(text, width_of(sys.stdout))))


def done(text: str) -> None:
    """Print a sentence that says what has been written; with ``--json`` nothing, as fields of the answer say that."""
    if not asked_for_json():
        say(text)


def write(text: str) -> None:
    """Print to standard output; what its encoding lacks becomes a question mark, not an error."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(text.encode(encoding, "replace").decode(encoding))
