"""Nothing of a user's is touched: a tree of files is hashed before and after runs with every kind of ``--out``."""

import itertools
import re
import shutil

import pytest

from quietfix.diagrams.studies.marker import MARKER
from tests.faults.tree import picture, plant, quietfix, shorten

REFUSED = [
    *["thesis", "thesis/", "pictures", "summaries", "stores", "forged", "file", "file/inside", "D", "new.old"],
    *["to_folder", "to_folder/", "to_file", "dangling", "loop", "loop/inside", "to_result", "thesis/../pictures"],
    *["taken", "taken_file", "taken_empty", "taken_link", "taken_dangling", "left_over"],
    *["noted", "noted_within", "changed", "linked", "locked", "kept/inside", "kept/results.zarr/inside"],
    *[".", "..", "/", "", "thesis/..", "thesis/../", "../tree", "/dev/null", "n" * 300, "./kept/../to_file"],
]
WRITTEN = ["new", "new/", "a/b/new", "d", "to_folder/new", "thesis/new", "nowhere/../new", "thesis/../new", "KEPT"]
COMMANDS = [["run", "three_satellite"], ["gdop", "three_satellite"]]
LINE = re.compile(r"quietfix: --out: [^\n]+\n")


@pytest.fixture
def tree(tmp_path, monkeypatch):
    shorten(monkeypatch)
    root = tmp_path / "tree"
    root.mkdir()
    plant(root)
    monkeypatch.chdir(root)
    return root


def test_more_than_a_hundred_runs_leave_a_users_files_alone(tree, capsys):
    before, runs = picture(tree.parent), 0
    one_case = (tree / "THESIS").exists()  # a file system on which KEPT is kept, and d is D
    for out, (command, overwrite) in itertools.product(REFUSED, zip(COMMANDS, ([], ["--overwrite"]), strict=True)):
        assert quietfix(*command, "--out", out, *overwrite) == 2, out
        assert LINE.fullmatch(capsys.readouterr().err), out
        assert picture(tree.parent) == before, out
        runs += 1
    for out in (out for out in WRITTEN if not (one_case and out in ("KEPT", "d"))):
        for again in ([], ["--overwrite"]):
            assert quietfix(*COMMANDS[0], "--out", out, *again) == 0, capsys.readouterr().err
            after = picture(tree.parent)
            assert after.items() >= before.items(), out
            folder = (tree / out).resolve()
            ours = {folder, *folder.parents, *folder.rglob("*")}
            assert {tree.parent / name for name in after.keys() - before.keys()} <= ours, out
            runs += 1
        assert quietfix(*COMMANDS[0], "--out", out) == 2 and picture(tree.parent) == after
        shutil.rmtree(tree / "a" if out.startswith("a/") else folder)
        assert picture(tree.parent) == before
    assert runs >= 96 + 4 * (not one_case)


def test_only_the_marked_result_that_is_named_is_replaced(tree):
    before = picture(tree)
    assert quietfix(*COMMANDS[1], "--out", "kept", "--overwrite") == 0
    after = picture(tree)
    assert {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)} == {
        name for name in before.keys() | after.keys() if name.startswith("kept/")
    }
    assert {path.name for path in (tree / "kept").iterdir()} == {MARKER, "m.png"}


def test_an_empty_folder_is_filled(tree):
    (tree / "empty").mkdir()
    assert quietfix(*COMMANDS[1], "--out", "empty") == 0
    assert {path.name for path in (tree / "empty").iterdir()} == {MARKER, "m.png"}


def test_a_run_that_fails_takes_away_only_the_folders_it_made(tree, monkeypatch):
    before = picture(tree)
    monkeypatch.setattr("quietfix.diagrams.commands.mapping.map_figures", lambda *arguments: 1 / 0)
    for out in ("x", "x/y/z", "thesis/x/y"):
        with pytest.raises(ZeroDivisionError):
            quietfix_raising(out)
        assert picture(tree) == before


def quietfix_raising(out):
    from quietfix.diagrams.commands.running import gdop_command

    gdop_command("three_satellite", None, None, out, False)


def test_the_current_folder_is_not_replaced_from_within(tree, monkeypatch, capsys):
    monkeypatch.chdir(tree / "kept")
    before = picture(tree)
    for out in ("../kept", str(tree / "kept"), "."):
        assert quietfix(*COMMANDS[1], "--out", out, "--overwrite") == 2
        assert LINE.fullmatch(capsys.readouterr().err)
        assert picture(tree) == before


def test_a_later_version_is_not_replaced(tree, capsys):
    marker = tree / "kept" / MARKER
    marker.write_text(marker.read_text().replace('"format": 1', '"format": 2'))
    assert quietfix(*COMMANDS[1], "--out", "kept", "--overwrite") == 2
    assert "later version" in capsys.readouterr().err


@pytest.mark.parametrize("out", ["thesis", "picture_link.svg", "to_folder/a.svg/b.svg", "nowhere/x.svg", "folder.svg"])
def test_draw_leaves_links_and_folders_alone(tree, capsys, out):
    (tree / "folder.svg").mkdir()
    before = picture(tree)
    assert quietfix("draw", "three_satellite", "--out", out) == 2
    assert LINE.fullmatch(capsys.readouterr().err)
    assert picture(tree) == before


def test_draw_replaces_the_file_that_is_named_and_says_so(tree, capsys, monkeypatch):
    before = picture(tree)
    assert quietfix("draw", "three_satellite", "--out", "picture.svg") == 0
    assert capsys.readouterr().out == "replaced picture.svg\n"
    after = picture(tree)
    assert after.keys() == before.keys()
    assert {name for name in before if before[name] != after[name]} == {"picture.svg"}  # hard.svg keeps its content

    assert quietfix("draw", "three_satellite") == 0 and quietfix("draw", "three_satellite") == 0
    assert capsys.readouterr().out == "wrote three_satellite.svg\nreplaced three_satellite.svg\n"
    (tree / "three_satellite.svg").write_text("<svg>mine</svg>")
    assert quietfix("draw", "three_satellite") == 2  # nobody named it
    assert (tree / "three_satellite.svg").read_text() == "<svg>mine</svg>"

    def fail(diagram, path, *options):
        path.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("quietfix.diagrams.assembly.drawing.draw", fail)
    before = picture(tree)
    assert quietfix("draw", "three_satellite", "--out", "picture.svg") == 2
    assert "No space left" in capsys.readouterr().err and picture(tree) == before
