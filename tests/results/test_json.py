"""``--json``: every command has it, and prints one object with the numbers of its table, and nothing else."""

import json
import math
import re
from itertools import takewhile

import numpy as np
import pytest
import yaml

from quietfix.diagrams.commands.app import app
from quietfix.diagrams.console.answer import answering, tell
from quietfix.diagrams.console.terminal import say
from tests.identification.doppler import CARRIER, STATION, received
from tests.identification.test_identify import OBJECTS, TIMES, elements, write
from tests.results.made import quietfix

CROSSING = """\
frame: local
duration_s: 20
platforms:
  west: !Fixed {east_km: -12, north_km: 0, up_m: 20}
  east: !Fixed {east_km: 12, north_km: 0, up_m: 40}
target: !RandomMotion {start: !Straight {position_km: [-8, 20, 3], velocity_mps: [180, -30, 0]}}
sensors:
  west: !Bearing {platform: west, sigma_deg: 0.3, sigma_elevation_deg: 0.3}
  east: !Bearing {platform: east, sigma_deg: 0.3, sigma_elevation_deg: 0.3}
start: !Prior {sigma_position_m: 500, sigma_velocity_mps: 60}
estimators:
  ekf: !Ekf {}
  ukf: !Ukf {}
"""
REQUIREMENTS = """\
system: crossing.yaml
trials: 20
requirements:
- {name: accuracy, estimator: ekf, metric: !Rmse {of: position, time_s: 20}, at_most: 5000}
"""
STATION_OPTIONS = ("--station", ",".join(map(str, STATION)), "--carrier-mhz", 437.2)
BEARINGS = "time_s,x_m,y_m,bearing_deg,sigma_deg\n0,0,0,44,1\n1,1000,0,0.7,1\n2,2000,0,-46,1\n3,2500,0,-57,1\n"


def commands():
    """Names of all commands, in the order of ``--help``."""
    return [one.name or one.callback.__name__ for one in app.registered_commands]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a system, requirements, bearings, a study and a sweep."""
    folder = tmp_path_factory.mktemp("json")
    (folder / "crossing.yaml").write_text(CROSSING)
    (folder / "crossing.requirements.yaml").write_text(REQUIREMENTS)
    (folder / "bearings.csv").write_text(BEARINGS)
    write(folder, CARRIER + received(OBJECTS[90001], TIMES))
    elements(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for seed in (0, 1):
            assert quietfix("run", "crossing.yaml", "--trials", 8, "--seed", seed, "--out", f"study{seed}") == 0
    return folder


def both(capfd, place, monkeypatch, *arguments, status=0):
    """What a command prints without and with ``--json``."""
    monkeypatch.chdir(place)
    printed = []
    for extra in ((), ("--json",)):
        for path in place.glob("made*"):
            path.unlink() if path.is_file() else None
        capfd.readouterr()
        assert quietfix(*arguments, *extra) == status, capfd.readouterr().err
        printed.append(capfd.readouterr().out)
    found = json.loads(printed[1], parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert isinstance(found, dict)
    return printed[0], found


def tables(text):
    """Tables that were printed, each a list of rows {heading: cell}; columns are where the rule has them."""
    lines, found = text.split("\n"), []
    for k, line in enumerate(lines):
        if not re.fullmatch(r" -+(  -+)*", line):
            continue
        spans = [match.span() for match in re.finditer("-+", line)]
        head = [lines[k - 1][a:b].strip() for a, b in spans]
        rows, first = [], ""
        # an empty line may part the rows of two first keys
        for row in filter(None, takewhile(lambda line: line[:1] in ("", " "), lines[k + 1 :])):
            cells = dict(zip(head, (row[a:b].strip() for a, b in spans), strict=True))
            cells[head[0]] = first = cells[head[0]] or first
            rows.append(cells)
        found.append(rows)
    return found


def shows(cell, value):
    """Whether the first number of a cell is this one, rounded to the digits there; a dash is what is not known."""
    if value is None:
        return cell == "-"
    number = re.search(r"(-?\d+(?:\.(\d+))?)(?:e([+-]?\d+))?", cell)
    if number is None:
        return False
    last = 10.0 ** (int(number[3] or 0) - len(number[2] or ""))  # what one more in the last digit would be
    return abs(float(number[0]) - value) <= 0.501 * last


def run_agrees(text, found, *_):
    (rows,) = tables(text)
    assert [row["estimator"] for row in rows] == list(found["estimators"]) == ["ekf", "ukf"]
    for row in rows:
        told = found["estimators"][row["estimator"]]
        times = {f"{t:g} s [m]": i for i, t in enumerate(found["time_s"])}
        picked = [heading for heading in row if heading in times]
        assert len(picked) == 4
        for heading in picked:
            assert shows(row[heading], told["rmse_position_m"][times[heading]])
        ends = ("median_position_m", "bound_position_m", "rmse_height_m", "rmse_velocity_mps", "nees_mean")
        for heading, key in zip(("median [m]", "bound [m]", "height [m]", "velocity [m/s]", "NEES"), ends, strict=True):
            assert shows(row[heading], told[key][-1]), (heading, row)
        assert row["diverged"] == str(told["diverged"])


def replay_agrees(text, found, *_):
    (rows,) = tables(text)
    assert {row["fix"].split()[0] for row in rows} <= set(found["fixes"])
    for row in rows:
        told = found["fixes"][row["fix"].split()[0]]
        assert shows(row["x, m"], told["x_m"]) and shows(row["sigma y, m"], told["sigma_y_m"])


def compare_agrees(text, found, *_):
    (rows,), (one,) = tables(text), found["comparisons"]
    for row in rows:
        told = one["estimators"][row["estimator"]]
        assert shows(row["mean RMSE [m]"], told["armse_position_m"]["value"])
        assert shows(row["median [m]"], told["median_position_m"])
        assert shows(row["RMSE/bound"], told["efficiency"]["value"])
        assert shows(row["NEES/n"], told["nees_per_state"]["value"])


def sweep_agrees(text, found, *_):
    (rows,) = tables(text)
    assert len(rows) == 2 * len(found["values"])
    for i, row in enumerate(rows):
        told, k = found["estimators"][row["estimator"]], i % len(found["values"])
        assert shows(row["sigma_deg"], found["values"][k])
        assert shows(row["RMSE [m]"], told["rmse_position_m"][k]["value"])
        assert shows(row["NEES/n"], told["nees_per_state"][k]["value"])


def verify_agrees(text, found, *_):
    (rows,), (one,) = tables(text), found["requirements"]
    assert shows(rows[0]["estimate"], one["estimate"]) and rows[0]["verdict"] == one["verdict"] == "holds"
    assert found["status"] == 0


def inspect_agrees(text, found, *_):
    (rows,) = tables(text)
    told = [one for name in found["estimators"] for one in found["estimators"][name]["trials"]]
    assert len(rows) == len(told) == 10
    for row, one in zip(rows, told, strict=True):
        assert row["trial"] == str(one["trial"])
        assert shows(row["error [m]"], one["position_error_m"]) and shows(row["NIS/row"], one["nis_per_row"])


def diff_agrees(text, found, *_):
    (rows,) = tables(text)
    for row in rows:
        told = found["estimators"][row["estimator"]]
        assert any(shows(cell, told["rmse_a_m"]["value"]) for cell in row.values())
        assert any(shows(cell, told["ratio"]["value"]) for cell in row.values())


def gdop_agrees(text, found, *_):
    rows = [row for table in tables(text) for row in table]
    told = {
        (name, quantity): numbers
        for one in found["maps"]
        for name, row in one["sets"].items()
        for quantity, numbers in row.items()
    }
    assert len(rows) == len(told) > 0
    for row in rows:
        name, unit = row["quantity"].split(" [")
        numbers = told[row["measurements"], f"{name}_{unit.rstrip(']').replace('/', 'p')}"]
        assert row["points"] == str(numbers["points"])
        for heading, key in (("least", "least"), ("10 % below", "percentile_10"), ("largest", "largest")):
            assert shows(row[heading], numbers[key])


def observe_agrees(text, found, *_):
    for rows, one in zip(tables(text), found["sets"], strict=True):
        for row in rows:
            k = found["time_s"].index(float(row["time [s]"]))
            assert row["rank"] == f"{one['rank'][k]} of {len(one['components'])}"
            assert shows(row["variance left"], one["variance_left_of_directions"][k][-1])


def identify_agrees(text, found, *_):
    (rows,) = tables(text)
    for row, told in zip(rows, found["objects"], strict=False):
        assert told["number"] in row["object"] and shows(row["rms [m/s]"], told["rms_mps"])
        assert math.isclose(float(row["probability"]), told["probability"], abs_tol=5e-4)
    assert found["verdict"] in text


def list_agrees(text, found, *_):
    for one in found["systems"]:
        assert f"{one['name']}: {one['title']}" in text
    assert f"registered estimators: {', '.join(found['registered_estimators'])}" in text


def show_agrees(text, found, *_):
    plain = yaml.safe_load(re.sub(r"!\w+", "", text))
    assert found["scenario"]["duration_s"] == plain["duration_s"] == 150
    assert found["scenario"]["truth"]["sigma_tdoa_ns"] == plain["truth"]["sigma_tdoa_ns"]
    assert "[ns]" in found["meanings"]["truth.sigma_tdoa_ns"]
    assert all(meaning in text for meaning in found["meanings"].values())


def file_agrees(text, found, place, key="file"):
    assert found[key] in text and (place / found[key]).exists()


def play_agrees(text, found, place):
    (one,) = found["written"]
    file_agrees(text, one, place)
    assert (found["trial"] == 0 and f"{found['magnified']:g} times as large" in text) or "true to scale" in text


def new_agrees(text, found, place):
    assert found["system"] == "made.yaml" and all(line in text for line in found["next"])
    assert (place / found["requirements"]).exists()


def plot_agrees(text, found, place):
    assert ", ".join(found["figures"]) in text
    assert all((place / found["folder"] / name).exists() for name in found["figures"])


def export_agrees(text, found, place):
    file_agrees(text, found, place)
    assert f"{found['rows']} rows of {len(found['columns'])} columns" in text
    assert len((place / "made.csv").read_text().splitlines()) == found["rows"] + 1


CASES = {
    "list": (["list"], list_agrees),
    "new": (["new", "made"], new_agrees),
    "show": (["show", "three_satellite"], show_agrees),
    "run": (["run", "crossing.yaml", "--trials", 5, "--out", "out", "--overwrite", "--report"], run_agrees),
    "draw": (["draw", "crossing.yaml", "--out", "made.svg"], file_agrees),
    "gdop": (["gdop", "crossing.yaml", "--overwrite"], gdop_agrees),
    "observe": (["observe", "crossing.yaml"], observe_agrees),
    "replay": (["replay", "bearings", "bearings.csv"], replay_agrees),
    "compare": (["compare", "crossing.yaml", "--trials", 5, "--estimator", "default"], compare_agrees),
    "sweep": (["sweep", "crossing.yaml", "--vary", "sensors.west.sigma_deg=0.2:0.6:3", "--trials", 5], sweep_agrees),
    "verify": (["verify", "crossing.requirements.yaml"], verify_agrees),
    "inspect": (["inspect", "study0"], inspect_agrees),
    "plot": (["plot", "study0", "--out", "drawn", "--overwrite"], plot_agrees),
    "report": (["report", "study0", "--out", "made.html"], file_agrees),
    "play": (["play", "study0", "--html", "scene.html"], play_agrees),
    "diff": (["diff", "study0", "study1"], diff_agrees),
    "export": (["export", "study0", "made.csv"], export_agrees),
    "identify": (["identify", "heard.csv", "--tle", "all.tle", *STATION_OPTIONS], identify_agrees),
}
MARKDOWN = ["compare", "crossing.yaml", "--format", "markdown"]
LINES = ("live",)  # prints lines of JSON with or without it, which tests/live reads


@pytest.mark.parametrize("command", commands())
def test_every_command_prints_its_numbers_as_one_json_object(command, place, capfd, monkeypatch):
    (one,) = (each for each in app.registered_commands if (each.name or each.callback.__name__) == command)
    assert "--json" in _help(capfd, command)
    if command in LINES:
        return
    assert one is not None and command in CASES, f"{command} has no case here"
    arguments, agrees = CASES[command]
    text, found = both(capfd, place, monkeypatch, *arguments)
    agrees(text, found, place)


def _help(capfd, command):
    capfd.readouterr()
    assert quietfix(command, "--help") == 0
    return capfd.readouterr().out


def test_a_page_beside_a_run_is_told(place, capfd, monkeypatch):
    _, found = both(capfd, place, monkeypatch, *CASES["run"][0])
    (page,) = found["reports"]
    assert (place / page["file"]).stat().st_size == page["size_bytes"]


def test_a_requirement_that_fails_is_told_with_its_status(place, capfd, monkeypatch):
    text = (place / "crossing.requirements.yaml").read_text().replace("5000", "0.001")
    (place / "hard.requirements.yaml").write_text(text)
    _, found = both(capfd, place, monkeypatch, "verify", "hard.requirements.yaml", status=1)
    assert found["status"] == 1 and found["requirements"][0]["verdict"] == "fails"


def test_what_a_users_class_prints_goes_elsewhere(place, capfd, monkeypatch):
    """Prints of the process itself, and of one that it starts: neither is to spoil the object."""
    (place / "loud.py").write_text(
        "import os, subprocess\nfrom quietfix.systems.estimators.kalman import *\n"
        "print('loud'); subprocess.run(['echo', 'louder'])\n"
        "from quietfix.diagrams.library.three_satellite import SYSTEM\n"
    )
    monkeypatch.chdir(place)
    assert quietfix("show", "loud.py:SYSTEM", "--json") == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["scenario"]["duration_s"] == 150
    assert "loud" in said.err and "louder" in said.err


@pytest.mark.parametrize(
    "arguments",
    [["inspect", "nowhere"], ["run", "crossing.yaml", "--trials", 0], ["run", "nothing"], ["play", "no"], MARKDOWN],
)
def test_a_mistake_is_one_line_on_standard_error(arguments, place, capfd, monkeypatch):
    monkeypatch.chdir(place)
    capfd.readouterr()
    assert quietfix(*arguments, "--json") == 2
    said = capfd.readouterr()
    assert said.out == "" and said.err.startswith("quietfix: ") and said.err.count("\n") == 1


def test_what_is_not_finite_is_null_and_numbers_are_pythons(capsys):
    with answering(True):
        tell(a=np.array([1.5, np.nan, np.inf]), b={2: np.int64(3), "c": (np.float32(0.5), -math.inf)}, d=np.bool_(True))
        say("a sentence")
    found = json.loads(capsys.readouterr().out)
    assert found == {"a": [1.5, None, None], "b": {"2": 3, "c": [0.5, None]}, "d": True, "notes": ["a sentence"]}
    say("another one")
    assert capsys.readouterr().out == "another one\n"
