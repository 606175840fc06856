"""As a newcomer would: from a clone to the report of a system of one's own, by the commands of the site's first pages.

The commands, files and what is printed are taken from the pages, so they cannot drift apart. One shell runs them all,
in a fresh clone, with an environment that `make demo` makes there.
"""

import os
import re
import shutil
import subprocess

import pytest

from tests.site.paths import DOCS, ROOT

from example_blocks import blocks_of, differing_line  # isort: skip
from example_runs import NOT_SAID  # isort: skip

PAGES = ("start.md", "own.md")
DONE = "====== command"
FOREIGN = re.compile(
    r"^(PYTHON.*|VIRTUAL_ENV|PIP_REQUIRE_VIRTUALENV|NUMBA_.*|MAKE.*|MFLAGS|QUIETFIX_.*|NO_COLOR|FORCE_COLOR)$"
)


def transcript(folder):
    """Return the script of all that is typed, and the commands in their order; files lie ready in a folder."""
    script, commands = ["set -o pipefail"], []
    for page in PAGES:
        for number, block in enumerate(blocks_of(DOCS / page)):
            if block.file:
                ready = folder / f"{page}-{number}"
                ready.write_text(block.text, encoding="utf-8")
                script.append(f"cp {ready} {block.file}")
            assert not block.skip, f"{page}:{block.line}: a newcomer types this"
            for command in block.commands:
                commands.append((page, block, command))
                script += [f"{command.text}", f'echo "{DONE} $?"']
    return "\n".join(script) + "\n", commands


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="not a git checkout")
def test_from_a_clone_to_the_report_of_a_system_of_ones_own(tmp_path):
    (tmp_path / "ready").mkdir()
    (tmp_path / "work").mkdir()
    script, commands = transcript(tmp_path / "ready")
    environment = {name: value for name, value in os.environ.items() if not FOREIGN.match(name)}
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=tmp_path / "work",
        env=environment | {"ADDRESS": str(ROOT), "COLUMNS": "110"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1200,
        check=False,
    )
    assert len(commands) > 12
    said = re.split(rf"^{DONE} (\d+)$", done.stdout, flags=re.MULTILINE)
    assert len(said) // 2 == len(commands), done.stdout[-3000:]
    for (page, block, command), text, status in zip(commands, said[::2], said[1::2], strict=False):
        where = f"{page}:{command.line}: {command.text}"
        assert int(status) == block.status, f"{where}\n{text[-3000:]}"
        lines = [line for line in text.splitlines() if not NOT_SAID.match(line)]
        if command.shown:
            wrong = differing_line(command.shown, lines, block.within)
            assert wrong is None, f"{where} does not say {wrong!r} there, but:\n{text}"
    clone = tmp_path / "work" / "quietfix"
    for report in ("demo.html", "drone.html", "with_antennas.html"):
        assert (clone / report).stat().st_size < 5e6  # bytes, of one page that is all there is
