"""``python -m tests.benchmarks``: run the comparisons, print the tables."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.harness import Size
from tests.benchmarks.registry import COMPARISONS, comparison
from tests.benchmarks.report import environment, markdown, text


def main(arguments: Sequence[str] | None = None) -> int:
    """Return 0, or 1 if a threshold was not met."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--tiny", action="store_true", help="smallest sizes: shows that it works, not how fast it is")
    parser.add_argument("--rounds", type=int, default=None, help="interleaved rounds (5; with --tiny 1)")
    parser.add_argument("--only", action="append", choices=list(COMPARISONS), help="this comparison (may be repeated)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the tables as Markdown, too")
    options = parser.parse_args(arguments)
    rounds = options.rounds if options.rounds is not None else (1 if options.tiny else 5)
    if rounds < 1:
        parser.error(f"--rounds: {rounds} is not allowed; a whole number >= 1")
    size = Size(tiny=options.tiny, rounds=rounds)

    head = f"{environment()}; medians of {rounds} interleaved round{'s' * (rounds > 1)}"
    head += " at tiny sizes, which say nothing about speed" if options.tiny else ""
    print(head, flush=True)
    sections = []
    for name in options.only or COMPARISONS:
        section = comparison(name)(size)
        print(f"\n\n{text(section)}", flush=True)
        sections.append(section)
    if options.markdown:
        parts = [f"{head}.", *(markdown(section) for section in sections)]
        options.markdown.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    missed = sum(section.missed for section in sections)
    if missed:
        print(f"\n{missed} threshold{'s' * (missed > 1)} not met", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
