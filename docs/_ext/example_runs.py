"""Run the examples of pages, each page in a folder of its own, from top to bottom.

    python docs/_ext/example_runs.py docs/own.md docs/tasks/imm.md

All is imported once; every page and every command is then a forked process, so that a command costs what it computes.
What a page makes stays in ``docs/_build/examples/PAGE`` for its figures; a page whose examples passed is run again only
where it, or the code, has changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from example_blocks import Block, Command, UnclearError, blocks_of, differing_line

__all__ = ["PLACE", "run_pages"]

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
PLACE = Path(os.environ.get("QUIETFIX_EXAMPLES") or DOCS / "_build" / "examples")
LONGEST_S = 300
NOT_SAID = re.compile(
    r"compiling numerical kernels|numerical kernels are compiled|quietfix: \S+: \d+ of \d+ [a-z]+(, .*)?$"
)
"""What is printed once for a machine, and how far a slow one has come."""
_SLOW_IMPORTS = (
    "matplotlib.pyplot",
    "quietfix",
    "quietfix.diagrams.commands.command_line",
    "quietfix.diagrams.commands.running",
    "quietfix.diagrams.commands.judging.comparing",
    "quietfix.diagrams.commands.judging.verifying",
    "quietfix.diagrams.studies.whole",
)


def _environment(folder: Path) -> dict[str, str]:
    """Return the environment of a command: `quietfix` and `python` are those that run this."""
    path = os.pathsep.join([str(PLACE / ".bin"), str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    python_path = f"{ROOT}{os.pathsep}{folder}"
    return kept | {"PATH": path, "PYTHONPATH": python_path, "COLUMNS": "110", "MPLBACKEND": "Agg", "QUIETFIX_DATA": ""}


def _forked(arguments: list[str], folder: Path, log: Path) -> int:
    """Run ``quietfix`` in a forked process; return its status."""
    pid = os.fork()
    if pid:
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    status = 70
    try:
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(_environment(folder))
        with log.open("a", buffering=1, encoding="utf-8") as stream:
            os.dup2(stream.fileno(), 1)
            os.dup2(stream.fileno(), 2)
            sys.stdout = sys.stderr = stream
            from quietfix.diagrams.commands import command_line

            sys.argv = ["quietfix", *arguments]
            command_line.main()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 0
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        os._exit(status)


def _shell(text: str, folder: Path, log: Path) -> int:
    """Run a command that is more than ``quietfix`` and its options in a shell."""
    with log.open("a", encoding="utf-8") as stream:
        return subprocess.run(
            ["bash", "-c", text],
            cwd=folder,
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            timeout=LONGEST_S,
            check=False,
        ).returncode


def _needs_a_shell(text: str) -> bool:
    """Return whether a command is more than words, or starts processes that would import this again."""
    if "--workers" in text:
        return True
    bare = re.sub(r"'[^']*'|\"[^\"$`]*\"", "", text.replace("\\\n", " "))
    return bool(set(bare) & set("|&;<>()$`*?[]#~{}\\\n"))


def _run_command(command: Command, block: Block, folder: Path, log: Path) -> str | None:
    """Run a command; return what is wrong with it, if anything is."""
    log.unlink(missing_ok=True)
    words = [] if _needs_a_shell(command.text) else shlex.split(command.text.replace("\\\n", " "))
    if words[:1] == ["quietfix"]:
        status = _forked(words[1:], folder, log)
    else:
        status = _shell(command.text, folder, log)
    said = [line for line in log.read_text(encoding="utf-8").splitlines() if not NOT_SAID.match(line)]
    if status != block.status:
        return f"{command.text!r} ended with status {status}, not {block.status}: " + " | ".join(said[-12:])
    if command.shown and (line := differing_line(command.shown, said, block.within)) is not None:
        return f"{command.text!r} does not say {line!r} there, but:\n" + "\n".join(said)
    return None


def _run_block(block: Block, folder: Path) -> Iterable[tuple[int, str]]:
    """Run a block; yield lines and what is wrong there."""
    log = folder.parent / f"{folder.name}.log"
    if block.file:
        path = folder / block.file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
    elif block.language == "python":
        command = Command(block.line, "python example.py")
        (folder / "example.py").write_text(block.text, encoding="utf-8")
        if wrong := _run_command(command, block, folder, log):
            yield block.line, wrong
    for command in block.commands:
        if wrong := _run_command(command, block, folder, log):
            yield command.line, wrong
            return  # what follows builds on it
    log.unlink(missing_ok=True)


def _run_page(page: Path, folder: Path) -> list[tuple[int, str]]:
    """Run the examples of a page; return lines and what is wrong there."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "tests").symlink_to(ROOT / "tests")  # pages name files of the clone
    try:
        blocks = blocks_of(page)
    except UnclearError as error:
        return [(error.line, str(error))]
    for block in blocks:
        if block.instead:
            block.commands = [Command(block.commands[-1].line, block.instead, block.commands[-1].shown)]
        elif block.skip or block.newcomer:
            continue
        if wrong := list(_run_block(block, folder)):
            return wrong
    return []


def _code() -> str:
    """Return a digest of the code that examples run."""
    digest = hashlib.sha256(sys.version.encode())
    for top in (ROOT / "systems", ROOT / "diagrams", DOCS / "_ext"):
        for path in sorted(top.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path).encode() + path.read_bytes())
    return digest.hexdigest()


def _name(page: Path) -> str:
    """Return the name of a page: its path below the pages, without the ending."""
    page = page.resolve()
    return str(page.relative_to(DOCS if page.is_relative_to(DOCS) else ROOT).with_suffix(""))


def _start(page: Path, folder: Path, result: Path) -> int:
    """Begin with a page in a process of its own; return the number of that."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        began = time.perf_counter()
        wrong = _run_page(page, folder)
        took = {"took_s": round(time.perf_counter() - began, 1), "cpu_s": round(sum(os.times()[:4]), 1)}
        result.write_text(json.dumps({"wrong": wrong, **took}))
        status = 0
    except BaseException:
        import traceback

        result.write_text(json.dumps({"wrong": [(0, traceback.format_exc())], "took_s": 0, "cpu_s": 0}))
    finally:
        os._exit(status)


def _prepare() -> None:
    """Import what takes long, and put a command ``quietfix`` where a shell finds it."""
    bin_ = PLACE / ".bin"
    bin_.mkdir(parents=True, exist_ok=True)
    for name, what in (("quietfix", f'{sys.executable} -m quietfix "$@"'), ("python", f'{sys.executable} "$@"')):
        (bin_ / name).write_text(f"#!/bin/sh\nexec {what}\n")
        (bin_ / name).chmod(0o755)
    import importlib

    sys.path.insert(0, str(ROOT))
    for name in _SLOW_IMPORTS:
        importlib.import_module(name)


def run_pages(pages: Iterable[Path], jobs: int = 2) -> dict[Path, dict]:
    """Run the examples of pages, `jobs` pages at once.

    Returns
    -------
    dict
        Of each page that has examples: ``wrong``, lines and what is wrong there, ``took_s`` and ``cpu_s``.
    """
    code, found, waiting = _code(), {}, []
    for page in pages:
        name = _name(page)
        result, mark = PLACE / f"{name}.json", hashlib.sha256(code.encode() + page.read_bytes()).hexdigest()
        with contextlib.suppress(OSError, ValueError):
            kept = json.loads(result.read_text())
            if kept["mark"] == mark and not kept["wrong"]:
                found[page] = kept
                continue
        with contextlib.suppress(UnclearError):
            if not blocks_of(page):
                continue
        waiting.append((page, PLACE / name, result, mark))
    if waiting:
        _prepare()
    running: dict[int, tuple] = {}
    while waiting or running:
        while waiting and len(running) < jobs:
            task = waiting.pop(0)
            task[2].parent.mkdir(parents=True, exist_ok=True)
            running[_start(*task[:3])] = task
        pid, _ = os.wait()
        page, _, result, mark = running.pop(pid)
        found[page] = json.loads(result.read_text()) | {"mark": mark}
        result.write_text(json.dumps(found[page]))
    return found


def main(arguments: list[str]) -> int:
    """Run pages and tell how it went."""
    pages = [Path(name).resolve() for name in arguments]
    status = 0
    for page, result in run_pages(pages, int(os.environ.get("JOBS", "2"))).items():
        print(f"{page.relative_to(ROOT)}: {result['took_s']} s, {result['cpu_s']} s of processor time")
        for line, wrong in result["wrong"]:
            status = 1
            print(f"{page}:{line}: {wrong}")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
