"""Printed tables: whole, split or turned, but never cropped; and what decides how wide they are."""

import fcntl
import os
import re
import struct
import sys
import termios
import threading
from pathlib import Path

import pytest

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.console.progress import Progress
from quietfix.diagrams.console.tables import Column, Styled, Table, print_table, rendered
from quietfix.diagrams.console.terminal import live, say, styled, width_of, wrapped
from quietfix.diagrams.tables.comparison import comparison_table
from tests.fitting import WIDTHS, check_fits

PACKAGES = [Path(__file__).parents[2] / name for name in ("diagrams", "systems")]
NUMBERS = ["1007 (882-1188)", "1.2e7 (430050-2.9e7)", "-0.000123 to 17.25", "51599†"]


def numbers(rows: int, columns: int, keys: int = 1) -> Table:
    names = [Column(f"key {k}") for k in range(keys)]
    headings = [*names, *(f"number {k} [m/s]" for k in range(columns))]
    table = Table("title of it, 3 trials", headings, keys, "Words. " * 30)
    for row in range(rows):
        cells = (f"{row}{column}{NUMBERS[(row + column) % 4]}" for column in range(columns))
        table.add(*(f"some_name_{row // 2 if k == 0 < keys - 1 else row}" for k in range(keys)), *cells)
    return table


@pytest.mark.parametrize("keys", [1, 2])
@pytest.mark.parametrize("columns", [1, 4, 9, 14])
@pytest.mark.parametrize("rows", [1, 2, 7])
def test_every_cell_is_printed_whole(rows, columns, keys):
    check_fits(numbers(rows, columns, keys))


@pytest.mark.parametrize("name", ["a_name_of_" + "forty_letters_" * 3, "many words " * 9])
def test_long_names_leave_the_numbers_whole(name):
    table = numbers(3, 5)
    table.add(name, *NUMBERS, "1")
    check_fits(table)


def test_a_word_wider_than_the_terminal_stands_out():
    """The only way to break the width: below it would have to be cut."""
    name = "x" * 90
    table = numbers(2, 3)
    table.add(name, "1", "2", "3")
    lines = rendered(table, 80)
    assert any(name in line for line in lines)
    assert max(len(line) for line in lines if name not in line) <= 80


def test_split_turned_and_whole():
    wide = numbers(3, 9)
    assert len([line for line in rendered(wide, None) if "number" in line]) == 1
    split = rendered(wide, 80)
    assert sum("some_name_2" in line for line in split) > 1 and max(map(len, split)) <= 80
    turned = rendered(numbers(1, 9), 80)
    assert sum("some_name_0" in line for line in turned) == 1
    assert [line.split()[0] for line in turned[1:11]] == ["key", *["number"] * 9]


def test_groups_are_of_nearly_the_same_width():
    lines = rendered(numbers(3, 5), 80)
    rules = [len(line) for line in lines if line.startswith(" --")]
    assert len(rules) > 1 and min(rules) > 0.5 * max(rules)


def test_first_of_two_keys_is_written_once_and_begins_a_section():
    lines = rendered(numbers(4, 1, keys=2), None)
    assert [("some_name_0 " in line, "some_name_1 " in line) for line in lines[3:8]] == [
        (True, False),
        (False, True),  # the second key of the second row
        (False, False),
        (True, False)[::-1],
        (False, False),
    ]
    assert lines[5] == ""


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ValueError, match="cells: 2 are given; the table has 3 columns"):
        numbers(1, 2).add("a", "b")


# ------------------------------------------------------------------------------------- the tables of commands


REQUIREMENTS = """
system: three_satellite
trials: 120
trial_limit: 120
looks: 1
set: [duration_s=5]
requirements:
  - {name: position at the end of the short flight, estimator: iekf_tdoa_fdoa_phase,
     metric: !Rmse {of: position, time_s: 5}, at_most: 1260}
  - {name: consistent, estimator: ekf, metric: !Nis {interval_s: [1, 5]}, at_least: 0.95, at_most: 1.05}
"""
SHORT = ("--trials", "3", "--set", "duration_s=5")
COMMANDS = {
    "run": ("run", "three_satellite", *SHORT),
    "compare": ("compare", "three_satellite", *SHORT, "--estimator", "default"),
    "sweep": ("sweep", "three_satellite", *SHORT, "--vary", "truth.sigma_tdoa_ns=10:30:3", "--estimator", "iekf"),
    "verify": ("verify", "FILE"),
    "observe": ("observe", "three_satellite", "--window", "30", "--estimator", "iekf"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.filterwarnings("ignore")
def test_tables_of_the_commands_fit(command, tmp_path, printed_tables, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    (tmp_path / "short.requirements.yaml").write_text(REQUIREMENTS)
    with pytest.raises(SystemExit) as ended:
        main([part.replace("FILE", str(tmp_path / "short.requirements.yaml")) for part in COMMANDS[command]])
    assert ended.value.code in ((0, 1, 3) if command == "verify" else (0, None))
    out, err = capsys.readouterr()
    assert printed_tables
    for table in printed_tables:
        check_fits(table)
    assert max(map(len, out.splitlines())) <= 60 and "\033" not in out + err


def test_comparison_of_large_numbers_fits():
    """The widest cells there are: an estimator that is lost, one that is the best, one that is not causal."""
    entry = {"value": 12345678.9, "low": 430050.0, "high": 29345678.0}
    row = {
        "rmse_position_m": entry,
        "armse_position_m": {"value": 25882.0, "low": 25834.0, "high": 25933.0},
        "median_position_m": 43151.0,
        "efficiency": {"value": 51599.0},
        "efficiency_means_something": False,
        "nees_per_state": {"value": 9.3e19},
        "nees_verdict": "high",
        "causal": False,
        "diverged": 73,
        "not_started": 27,
        "cost_us": 3737.0,
    }
    best = {"significant": True, "name": "b"}
    found = {"system": "three_satellite", "variant": "coplanar", "time_s": 150, "trials": 100, "seed": 0}
    names = ("iekf_tdoa_fdoa_phase", "a", "b")
    found |= {"best": dict.fromkeys(("rmse_position_m", "armse_position_m"), best)}
    check_fits(comparison_table(found | {"estimators": {name: row for name in names}}))


# --------------------------------------------------------------------------------------------------- terminal


class Terminal:
    """A pseudo-terminal as a stream; a thread reads it, for its buffer is small."""

    END = "\x1e"

    def __init__(self, columns: int) -> None:
        self._reading, writing = os.openpty()
        fcntl.ioctl(writing, termios.TIOCSWINSZ, struct.pack("HHHH", 25, columns, 0, 0))
        self.stream = os.fdopen(writing, "w", encoding="utf-8")
        self._read = b""
        self._reader = threading.Thread(target=self._collect, daemon=True)
        self._reader.start()

    def _collect(self) -> None:
        while not self._read.endswith(self.END.encode()):
            self._read += os.read(self._reading, 1000)

    def text(self) -> str:
        """Return all that was written; nothing can be written after it."""
        self.stream.write(self.END)
        self.stream.flush()
        self._reader.join(timeout=60)
        return self._read.decode().removesuffix(self.END)

    def close(self) -> None:
        if self._reader.is_alive():
            self.text()
        self.stream.close()
        os.close(self._reading)


@pytest.fixture
def terminal(monkeypatch):
    made = []

    def make(columns: int, **environment: str) -> Terminal:
        for name in ("COLUMNS", "NO_COLOR", "FORCE_COLOR"):
            monkeypatch.delenv(name, raising=False)
        for name, value in ({"TERM": "xterm"} | environment).items():
            monkeypatch.setenv(name, value)
        made.append(Terminal(columns))
        monkeypatch.setattr(sys, "stdout", made[-1].stream)
        monkeypatch.setattr(sys, "stderr", made[-1].stream)
        return made[-1]

    yield make
    monkeypatch.undo()
    for one in made:
        one.close()


def test_a_table_is_as_wide_as_the_terminal(terminal):
    for columns in (60, 100):
        window = terminal(columns)
        print_table(numbers(3, 9))
        lines = re.sub(r"\033\[[0-9;]*m", "", window.text()).splitlines()
        assert lines == rendered(numbers(3, 9), columns)


@pytest.mark.parametrize(
    ("value", "expected"), [("80", 80), ("1000", 1000), ("", 70), ("0", 70), ("-5", 70), ("wide", 70)]
)
def test_columns_goes_before_the_terminal(terminal, value, expected):
    assert width_of(terminal(70, COLUMNS=value).stream) == expected


def test_a_terminal_without_a_size_has_80_columns(terminal):
    assert width_of(terminal(0).stream) == 80


def test_a_pipe_has_no_width_unless_columns_says_so(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert width_of(sys.stdout) is None
    monkeypatch.setenv("FORCE_COLOR", "1")
    table = numbers(2, 14)
    table.add("best", Styled("* 7", "bold"), *["1"] * 13)
    print_table(table)
    say("word " * 100)
    out = capsys.readouterr().out
    assert "\033" not in out and ("word " * 100) in out and any(len(line) > 200 for line in out.splitlines())
    monkeypatch.setenv("COLUMNS", "72")
    print_table(table)
    say("word " * 100)
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 72


def test_colours_only_where_they_are_wanted(terminal):
    table = numbers(2, 2)
    table.add("judged", Styled("holds", "green"), Styled("fails", "red"))
    for environment, expected in (({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)):
        window = terminal(80, **environment)
        print_table(table)
        text = window.text()
        assert styled(window.stream) is expected
        assert ("\033[32mholds\033[0m" in text) is expected and ("\033" in text) is expected
        plain = re.sub(r"\033\[[0-9;]*m", "", text).splitlines()
        assert plain == rendered(table, 80), "codes must not move the columns"


def test_what_the_encoding_lacks_is_no_error(monkeypatch, tmp_path):
    with (tmp_path / "out.txt").open("w", encoding="ascii") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        say("0.5†")
    assert (tmp_path / "out.txt").read_text() == "0.5?\n"


def test_progress_stays_out_of_pipes_and_dumb_terminals(terminal, monkeypatch):
    monkeypatch.setattr("quietfix.diagrams.console.progress._PATIENCE", -1.0)

    def bar(stream):
        monkeypatch.setattr(sys, "stderr", stream)
        with Progress("working", 2) as progress:
            progress.update(1)

    window = terminal(80)
    bar(window.stream)
    assert live(window.stream) and "working" in window.text()
    dumb = terminal(80, TERM="dumb")
    bar(dumb.stream)
    print("end", file=dumb.stream)
    assert dumb.text().strip() == "end"


def test_progress_in_a_pipe(monkeypatch, capsys):
    monkeypatch.setattr("quietfix.diagrams.console.progress._PATIENCE", -1.0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    with Progress("working", 2) as progress:
        progress.update(1)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("width", WIDTHS)
def test_sentences_break_between_words_only(width):
    text = "  list: 1.2e7 (430050-2.9e7), iekf_tdoa_fdoa_phase and -0.25 m; " * 9
    lines = wrapped(text, width)
    assert max(map(len, lines)) <= width and " ".join(lines).split() == text.split()
    assert lines[0].startswith("  list") and all(line.startswith("    ") for line in lines[1:])


def test_nobody_else_prints_tables():
    """One place decides how tables are printed; `quietfix.diagrams.console.progress` alone draws with rich."""
    for file in (path for package in PACKAGES for path in package.rglob("*.py")):
        if file.name in ("tables.py", "terminal.py", "progress.py"):
            continue
        found = re.search(r"^\s*(from|import) rich\b.*", file.read_text(encoding="utf-8"), re.MULTILINE)
        assert found is None, f"{file}: {found.group()}"
