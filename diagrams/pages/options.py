"""What ``quietfix report`` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["report"]


def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="A folder that a command wrote.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The page.  [default: RESULT.html]", show_default=False)
    ] = None,
) -> None:
    """Write a page of a result: one HTML file with tables, curves, map, single trials and block diagram.

    It needs no network. RESULT: what run, replay, compare, sweep or verify wrote with --out. An earlier page is
    replaced, any other file is not.
    """
    from quietfix.diagrams.console.answer import tell
    from quietfix.diagrams.pages.command import report_command

    tell(**report_command(result, out))
