"""The examples of a page: what stands in its fenced blocks, and whether a command said what the page shows.

A block is a file where its first line is a comment with a name (``# drone.yaml``), or where the comment before it says
so; a ``console`` block has commands behind ``$ `` and, below one, what it prints. In what is shown ``...`` stands for
anything; numbers may differ by half of their last digit and by a tolerance. An HTML comment before a block, which no
reader sees, says what else is to be known::

    <!-- example: file log.csv -->        the block is this file
    <!-- example: skip needs a cluster --> it is not run, and why
    <!-- example: status 2 -->            the commands end with this status
    <!-- example: within 5 % -->          numbers may differ by so much
    <!-- example: newcomer -->            run by tests/newcomer only: it makes the environment
    <!-- example: newcomer; instead quietfix run ... -->   what stands for it elsewhere
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Block", "Command", "UnclearError", "blocks_of", "differing_line"]

RUN = ("console", "python", "yaml", "csv", "json", "text", "toml", "bash", "sh", "shell")
"""Languages of blocks that may be examples; of these `MUST` may not be left without a name or a reason."""
MUST = ("console", "python", "yaml", "bash", "sh", "shell")
TOLERANCE = 1e-3
_FENCE = re.compile(r"^(?P<marks>`{3,})(?P<info>[^`]*)$")
_SAID = re.compile(r"^<!-- example: (?P<what>.*?) -->$")
_NAME = re.compile(r"^# (?P<name>[\w./-]+\.\w+)(?=[\s:,])")
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w])")


class UnclearError(ValueError):
    """What cannot be run as it stands on a page: line and reason."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line, self.reason = line, reason


@dataclass
class Command:
    """A line to be given to a shell, and what the page shows of its output."""

    line: int
    text: str
    shown: list[str] = field(default_factory=list)


@dataclass
class Block:
    """A fenced block of a page: a file, commands, or Python to be run."""

    line: int
    language: str
    text: str
    file: str | None = None
    skip: str | None = None
    status: int = 0
    within: float = TOLERANCE
    newcomer: bool = False
    instead: str | None = None
    commands: list[Command] = field(default_factory=list)


def _tell(block: Block, what: str) -> None:
    """Put what a comment says of a block into it."""
    for part in what.split("; "):
        key, _, value = part.partition(" ")
        if key == "file":
            block.file = value
        elif key == "skip":
            block.skip = value
        elif key == "status":
            block.status = int(value)
        elif key == "within":
            block.within = float(value.removesuffix("%")) / 100
        elif key == "newcomer":
            block.newcomer = True
        elif key == "instead":
            block.instead = value
        else:
            raise UnclearError(
                block.line, f"example: {part!r} is none of file, skip, status, within, newcomer, instead"
            )


def _commands(block: Block) -> Iterator[Command]:
    """Read a console block."""
    command: Command | None = None
    for number, line in enumerate(block.text.splitlines(), block.line + 1):
        if command is not None and command.text.endswith("\\") and not command.shown:
            command.text += "\n" + line
        elif line.startswith("$ "):
            if command is not None:
                yield command
            command = Command(number, line.removeprefix("$ "))
        elif command is None:
            raise UnclearError(number, "a console block begins with a command behind '$ '")
        else:
            command.shown.append(line)
    if command is not None:
        yield command


def _finished(block: Block) -> Block:
    """Return a block with its name and its commands, or say what is unclear of it."""
    if block.file is None and block.language != "console" and (found := _NAME.match(block.text)):
        block.file = found["name"]
    if block.language == "console":
        block.commands = list(_commands(block))
        if not block.commands:
            raise UnclearError(block.line, "a console block without a command")
    elif block.language in MUST[2:] and not (block.file or block.skip):
        raise UnclearError(block.line, f"a {block.language} block without a file's name, that nothing runs")
    return block


def blocks_of(page: Path) -> list[Block]:
    """Return the examples of a page in their order."""
    found: list[Block] = []
    said, block, marks, lines = "", None, "", list[str]()
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if block is not None:
            if line.rstrip() == marks:
                block.text = "\n".join(lines) + "\n"
                found.append(_finished(block))
                block, marks, said = None, "", ""
            else:
                lines.append(line)
        elif marks:
            marks = "" if line.rstrip() == marks else marks
        elif opened := _FENCE.match(line):
            language = opened["info"].strip()
            marks, lines = opened["marks"], []
            if language in MUST or (language in RUN and said):
                block = Block(number, language, "")
                if said:
                    _tell(block, said)
        elif told := _SAID.match(line.strip()):
            said = told["what"]
        elif line.strip():
            if said:
                raise UnclearError(number, "the comment 'example:' stands before a block")
            said = ""
    if marks:
        raise UnclearError(number, f"a block that {marks} does not end")
    return found


def _same_number(shown: str, said: str, within: float) -> bool:
    """Return whether two numbers agree to half of the last digit shown, and to a tolerance."""
    mantissa, _, exponent = shown.lower().partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(float(shown) - float(said)) <= within * abs(float(shown)) + 0.501 * last


def _plain(line: str) -> str:
    """Return a line without what the width of its columns decides."""
    return re.sub(r"\s+", " ", re.sub(r"-{3,}|─+", "---", line)).strip()


def _same(shown: str, said: str, within: float) -> bool:
    """Return whether a line is the one that is shown."""
    shown, said = _plain(shown), _plain(said)
    pieces, numbers, at = [], [], 0
    for found in _NUMBER.finditer(shown):
        pieces.append(re.escape(shown[at : found.start()]).replace(r"\.\.\.", ".*?"))
        numbers.append(found[0])
        at = found.end()
    pieces.append(re.escape(shown[at:]).replace(r"\.\.\.", ".*?"))
    match = re.fullmatch(r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)".join(pieces), said)
    return match is not None and all(_same_number(a, b, within) for a, b in zip(numbers, match.groups(), strict=True))


def differing_line(shown: list[str], said: list[str], within: float = TOLERANCE) -> str | None:
    """Return the first line shown that was not said at its place, or None where all were.

    A line ``...`` stands for any number of lines; empty lines do not count.
    """
    shown, said = [line for line in shown if line.strip()], [line for line in said if line.strip()]
    at, anywhere = 0, False
    for line in shown:
        if line.strip() == "...":
            anywhere = True
            continue
        places = range(at, len(said)) if anywhere else range(at, min(at + 1, len(said)))
        place = next((i for i in places if _same(line, said[i], within)), None)
        if place is None:
            return line
        at, anywhere = place + 1, False
    return None if anywhere or at == len(said) else f"(nothing more), where {said[at]!r} was said"
