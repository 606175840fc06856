"""`quietfix new`: what it writes runs and holds, and it never writes over anything."""

import ast
import os
import re
import sys
from pathlib import Path

import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import RECORDINGS
from quietfix.diagrams.commands import new
from quietfix.diagrams.commands.command_line import app
from quietfix.diagrams.commands.judging.verifying import verify_command
from quietfix.diagrams.schema.scenario import read_yaml
from quietfix.diagrams.verification.specification import read_specification
from tests.diagrams.test_command_line import in_process

KINDS = [*(("--template", template) for template in new.TEMPLATES), ("--python",)]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def written(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_written_runs_and_its_requirements_are_read(capsys, folder, kind):
    status, out, err = in_process(capsys, "new", "mine", *kind)
    assert status == 0 and not err
    system = "mine.py" if kind == ("--python",) else "mine.yaml"
    assert written(folder) == sorted([system, "mine.requirements.yaml"])
    assert not any("NAME" in (folder / name).read_text(encoding="utf-8") for name in written(folder))
    _, run, _, verify = out.splitlines()
    reference = run.split()[2]
    result = run_study(reference, trials=2, set={"duration_s": 10})
    assert result["estimate"].sizes["time"] > 1 and result.attrs["system_file"] == str(folder / system)
    assert read_specification(folder / verify.split()[2]).system == reference


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_requirements_hold_at_every_seed(capsys, kind, seed):
    in_process(capsys, "new", "mine", *kind)
    assert verify_command(Path("mine.requirements.yaml"), None, False, seed=seed) == 0


def test_limits_come_from_the_system_without_a_template_too(capsys, folder):
    in_process(capsys, "new", "mine")
    assert "tdoa" in read_yaml(folder / "mine.yaml")["sensors"]


def test_the_module_is_that_of_the_page():
    """But for docstrings, comments and the name of the object."""

    def bare(text):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            first = body[0] if isinstance(body, list) and len(body) > 1 else None
            if isinstance(getattr(first, "value", None), ast.Constant) and isinstance(first, ast.Expr):
                del body[0]
        return ast.unparse(tree)

    page = (Path(__file__).parents[2] / "docs" / "tasks" / "python_system.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(# mine\.py\n.*?)```", page, re.DOTALL)
    written = bare(new.new_files("four_stations", python=True)["four_stations.py"])
    assert written.replace("SYSTEM", "DRONE").replace("four_stations", "drone") == bare(block)


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("mine.yaml", (), "without .yaml"),
        ("a b", (), "letters, digits, _ and -"),
        ("drei-Öre", (), "letters, digits, _ and -"),
        ("", (), "letters, digits, _ and -"),
        ("x/y", (), "letters, digits, _ and -"),
        ("..", (), "letters, digits, _ and -"),
        ("x" * 61, (), "at most 60"),
        ("a\n", (), "letters, digits, _ and -"),
        ("my-own", ("--python",), "no word of Python"),
        ("class", ("--python",), "no word of Python"),
        ("numpy", ("--python",), "it would hide the module"),
        ("mine", ("--template", "shp"), "did you mean ship"),
        ("mine", ("--template", "ship", "--python"), "--template: ship is not allowed with --python"),
    ],
)
def test_what_is_not_allowed_is_one_line_and_nothing_is_written(capsys, folder, name, options, said):
    status, _, err = in_process(capsys, "new", name, *options)
    assert status == 2 and said in err and err.count("\n") == 1
    assert written(folder) == []


@pytest.mark.parametrize("kind", ["file", "link to nothing", "folder"])
@pytest.mark.parametrize("there", ["mine.yaml", "mine.requirements.yaml"])
def test_nothing_is_written_over(capsys, folder, there, kind):
    path = folder / there
    {"file": lambda: path.write_text("x"), "folder": path.mkdir, "link to nothing": lambda: path.symlink_to("no")}[
        kind
    ]()
    status, _, err = in_process(capsys, "new", "mine")
    assert status == 2 and f"{there} is there already" in err and err.count("\n") == 1
    assert written(folder) == [there]
    assert kind != "file" or path.read_text() == "x"


def test_a_folder_of_that_name_is_no_module(capsys, folder):
    (folder / "boat").mkdir()
    assert in_process(capsys, "new", "boat", "--python")[0] == 0


@pytest.mark.parametrize("hard_links", [True, False])
def test_a_file_that_comes_meanwhile_is_left_and_the_other_is_not_written(capsys, folder, monkeypatch, hard_links):
    """Between the look and the writing: the second file is somebody's by then."""
    link, theirs = os.link, folder / "mine.requirements.yaml"

    def meanwhile(source, target):
        if target == theirs.name:
            theirs.write_text("theirs")
        if not hard_links:
            raise PermissionError(1, "Operation not permitted", source)
        link(source, target)

    monkeypatch.setattr(os, "link", meanwhile)
    status, _, err = in_process(capsys, "new", "mine")
    assert status == 2 and "is there already" in err and err.count("\n") == 1
    assert written(folder) == [theirs.name] and theirs.read_text() == "theirs"


def test_without_hard_links_both_are_written(capsys, folder, monkeypatch):
    def refuse(source, target):
        raise PermissionError(1, "Operation not permitted", source)

    monkeypatch.setattr(os, "link", refuse)
    assert in_process(capsys, "new", "mine")[0] == 0
    assert written(folder) == ["mine.requirements.yaml", "mine.yaml"]
    assert (folder / "mine.yaml").read_text(encoding="utf-8") == new.new_files("mine")["mine.yaml"]


def test_a_folder_that_cannot_be_written_is_one_line(capsys, folder, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device", str(arguments[0]))

    monkeypatch.setattr("builtins.open", full)
    status, _, err = in_process(capsys, "new", "mine")
    assert status == 2 and "cannot be written (No space left on device)" in err and err.count("\n") == 1


def commands():
    return [command.name or command.callback.__name__ for command in app.registered_commands]


@pytest.mark.parametrize("command", [*([name] for name in commands()), *(["replay", name] for name in RECORDINGS)])
def test_help_is_as_narrow_as_the_terminal(capsys, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setenv("TERMINAL_WIDTH", "60")
    _, out, _ = in_process(capsys, *command, "--help")
    assert max(map(len, out.splitlines())) <= 60, [line for line in out.splitlines() if len(line) > 60]
