"""Help of ``quietfix replay``."""

from __future__ import annotations

import textwrap
from typing import Any

from typer.core import TyperCommand

__all__ = ["ReplayHelp"]

_WORDS = "diagrams.words"


def _setting_lines(line: str, width: int) -> list[str]:
    """Return a field and its comment as lines of help, the comment below the field where both are too wide."""
    field, mark, comment = line.partition("  # ")
    if not mark or len(line) + 2 <= width:
        return [f"  {line}"]
    return [f"  {field}", *textwrap.wrap(comment, width, initial_indent="      # ", subsequent_indent="      # ")]


class ReplayHelp(TyperCommand):
    """Help that ends with the settings of the recording that stands beside ``--help``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Keep the words: ``--help`` is answered before they are read."""
        ctx.meta[_WORDS] = list(args)
        return super().parse_args(ctx, args)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the settings."""
        from quietfix.diagrams.assembly.find import RECORDINGS
        from quietfix.diagrams.studies.recordings import recording_settings

        super().format_epilog(ctx, formatter)
        for dataset in [word for word in ctx.meta.get(_WORDS, ()) if word in RECORDINGS][:1]:
            formatter.write(f"\nSettings of {dataset} and their defaults, for --set:\n")
            for line in recording_settings(dataset).splitlines():
                formatter.write("".join(f"{part}\n" for part in _setting_lines(line, formatter.width)))
