"""A user's tree of files, and studies that are short enough to run a hundred times over it."""

import hashlib
import os
import shutil
import stat
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer.main
import xarray as xr

from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.commands import command_line, running
from quietfix.diagrams.studies.output import OutputFolder


def picture(root):
    """Return kind, permissions and content of everything below a folder, links not followed."""
    found = {}
    for where, folders, files in os.walk(root):
        for name in [*folders, *files]:
            path = Path(where, name)
            status = path.lstat()
            if stat.S_ISLNK(status.st_mode):
                content = os.readlink(path)
            elif stat.S_ISREG(status.st_mode):
                content = hashlib.sha256(path.read_bytes()).hexdigest()
            else:
                content = ""
            found[path.relative_to(root).as_posix()] = (oct(status.st_mode), content)
    return found


def chunk(first, count):
    """Return a small chunk of trials."""
    return xr.Dataset(
        {"estimate": (("trial", "time"), np.full((count, 3), 1.0 + first)), "truth": ("time", np.zeros(3))},
        {"trial": np.arange(first, first + count), "time": np.arange(3.0)},
        {"system": "three_satellite", "variant": "", "seed": 0, "first_trial": 0, "trials": 4, "version": "0"},
    )


class ShortStudy:
    """Stands for `quietfix.diagrams.studies.study.Study` where what is written matters, and not what is in it."""

    request = SimpleNamespace(trials=4, system="three_satellite", threads=1)
    picture, probe = None, SimpleNamespace(notes=lambda *_: None)  # `draw` below does not look at them
    recorded = None

    def __init__(self, system, **options):
        """Take anything."""

    def report(self, dataset):
        """Tell nothing: it is no recording."""

    size = 2

    def plan(self, **also):
        """Return what is asked for: two chunks."""
        return Plan({**chunk(0, 1).attrs, **also}, self.request.trials, self.size)

    system = SimpleNamespace(name="three_satellite")

    def parts(self, progress=False, first=0, count=None, numbers=None, width=None):
        """Yield them."""
        for number in range(self.plan().chunks):
            if numbers is None or number in numbers:
                begin, end = self.plan().place(number)
                yield Part(number, begin, self.chunk(begin, end - begin), np.full(3, 1.0 / (number + 3)))

    def chunk(self, begin, count):
        """Return a chunk."""
        return chunk(begin, count)

    def bounds(self, sums, times):
        """Return the sum of the chunks' part of it."""
        return {"bound_sum": ("time", sums)}

    def attributes(self):
        """Return what all chunks say."""
        return chunk(0, 1).attrs


def draw(diagram, path, *options):
    """Write what is known as a drawing of the program's."""
    path.write_bytes(b"<!-- a block diagram drawn by quietfix --><svg/>")


def illustrate(dataset, study, folder, *_):
    """Write what a study's figures are to a folder: one picture, one drawing."""
    (folder / "nees.png").write_bytes(b"png" * 100)
    (folder / "diagram.svg").write_text("<svg/>")


@cache
def command():
    """Return the command, whose parser takes longer to make than a short study."""
    return typer.main.get_command(command_line.app)


def shorten(monkeypatch):
    """Let `quietfix run` and `quietfix gdop` write a small result at once."""
    monkeypatch.setattr(command_line, "app", command())
    monkeypatch.setattr(
        "quietfix.diagrams.commands.mapping.map_figures", lambda of, scenario, folder: (folder / "m.png").touch()
    )
    monkeypatch.setattr("quietfix.diagrams.scale.asked.Study", ShortStudy)
    monkeypatch.setattr("quietfix.diagrams.studies.study.Study", ShortStudy)
    monkeypatch.setattr("quietfix.diagrams.assembly.drawing.draw", draw)
    monkeypatch.setattr("quietfix.diagrams.statistics.metrics.summarise", lambda *_: {})
    monkeypatch.setattr(running, "print_summary", lambda *arguments: None)
    monkeypatch.setattr(running, "_illustrate", illustrate)


def quietfix(*arguments):
    """Run the command in this process and return its exit status."""
    with pytest.raises(SystemExit) as ended:
        command_line.main([str(argument) for argument in arguments])
    return ended.value.code or 0


def write_result(folder):
    """Write an earlier result."""
    with OutputFolder(folder) as output:
        for part in ShortStudy("").parts():
            output.append(part.dataset)
        (output.work / "summary.json").write_text("{}")
        (output.work / "nees.png").write_bytes(b"png")
        output.finish()


def plant(root):
    """Plant a user's tree: folders that look like results, results with a user's files in them, links of all kinds."""
    files = {
        "thesis/notes.tex": "years of work",
        "pictures/a.png": "a photograph",
        "summaries/summary.json": "{}",
        "stores/results.zarr/zarr.json": "{}",
        "forged/.quietfix-result.json": "not a marker",
        "forged/nees.png": "a photograph",
        "file": "text",
        "taken.partial/x.txt": "a user's",
        "taken_file.partial": "a user's",
        "D/x": "upper case",
        "new.old/x": "a backup",
        "picture.svg": "<svg>mine</svg>",
    }
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (root / "taken_empty.partial").mkdir()
    for name, target in {
        "to_folder": "pictures",
        "to_file": "thesis/notes.tex",
        "dangling": "nowhere",
        "loop": "loop",
        "to_result": "kept",
        "taken_link.partial": "pictures",
        "taken_dangling.partial": "nowhere",
        "picture_link.svg": "picture.svg",
    }.items():
        (root / name).symlink_to(target)
    os.link(root / "picture.svg", root / "hard.svg")
    write_result(root / "kept")
    for name in ("noted", "noted_within", "changed", "linked", "locked", "left"):
        shutil.copytree(root / "kept", root / name)
    (root / "noted" / "my.png").write_text("a photograph")
    (root / "noted_within" / "results.zarr" / "estimate" / "remarks.txt").write_text("mine")
    (root / "changed" / "summary.json").write_text('{"remark": "mine"}')
    (root / "linked" / "nees.png").unlink()
    (root / "linked" / "nees.png").symlink_to("../pictures/a.png")
    (root / "locked").chmod(0o555)
    (root / "left").rename(root / "left_over.partial")
    (root / "left_over.partial" / "mine.txt").write_text("mine")
