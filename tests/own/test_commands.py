"""Every command takes every file of a user's own beside this one, and what it writes is there and made of numbers."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from quietfix.diagrams.schema.scenario import read_yaml
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION
from quietfix.diagrams.studies.results import open_result
from tests.diagrams.test_command_line import in_process

HERE = Path(__file__).parent
NAMES = ("drone", "ship", "beacon", "geostationary", "rocket")
AT_REST = ("beacon", "geostationary")  # these have no course
SHORT = {"rocket": 30}  # its sensors begin at 20 s; the others: 10 s
REQUIREMENTS = """
system: {file}
trials: 20
trial_limit: 20
looks: 1
slow: false
cases:
  short: {{set: [duration_s={duration}]}}
requirements:
  - {{name: none is lost, case: short, estimator: ukf, metric: !DivergenceRate {{}}, at_most: 0.9}}
"""


def check_numbers(value, where):
    """Refuse what is not finite, wherever it is."""
    if isinstance(value, dict):
        for key, item in value.items():
            check_numbers(item, f"{where}.{key}")
    elif isinstance(value, list):
        for i, item in enumerate(value):
            check_numbers(item, f"{where}.{i}")
    elif value is None or isinstance(value, float):
        assert value is not None and math.isfinite(value), where


def pictures(folder):
    """Names of the PNG files of a folder; each has to be one."""
    found = {path.name: path.read_bytes() for path in folder.glob("*.png")}
    assert all(content.startswith(b"\x89PNG") and len(content) > 5000 for content in found.values())
    return set(found)


def check_run(folder, name):
    estimators, sizes = list(read_yaml(HERE / f"{name}.yaml")["estimators"]), open_result(folder).load()
    for variable in ("estimate", "nees", "bound_position", "bound_height", "bound_velocity"):
        assert np.isfinite(sizes[variable]).all(), variable
    of_each = json.loads((folder / "summary.json").read_text())["estimators"]
    assert list(of_each) == estimators
    for key in ("rmse_position_m", "rmse_height_m", "rmse_speed_mps"):
        check_numbers([of_each[one][key] for one in estimators], key)
    wanted = {f"error_{what}.png" for what in ("position", "height", "speed")}
    wanted |= {f"{what}.png" for what in ("percentiles_position", "nees", "nis", "ground", "convergence")}
    wanted |= set() if name in AT_REST else {"error_course.png"}
    wanted |= {"error_bias.png"} if "oscillator" in read_yaml(HERE / f"{name}.yaml") else set()
    assert pictures(folder) == wanted
    assert "</svg>" in (folder / "diagram.svg").read_text()


def check_all(capsys, monkeypatch, place, name, requirements, short, others):
    """Run the eight; `short` goes to those that take --set, `others` are the estimators of compare."""
    monkeypatch.chdir(place)
    file = str(HERE / f"{name}.yaml")

    def quietfix(command, *arguments):
        status, out, err = in_process(capsys, command, *arguments)
        assert status == 0, (command, err)
        return out

    quietfix("run", file, "--trials", "4", "--out", "run", *short)
    check_run(place / "run", name)

    quietfix("compare", file, "--trials", "4", "--out", "compare", *short, *others)
    compared = json.loads((place / "compare" / "comparison.json").read_text())["estimators"]
    assert {"iekf", "ukf"} <= set(compared) and "comparison.png" in pictures(place / "compare")
    for key in ("rmse_position_m", "armse_position_m", "bound_position_m", "efficiency", "nees_per_state", "cost_us"):
        check_numbers([compared[one][key] for one in compared], key)

    begin = SHORT.get(name, 10)
    vary = f"duration_s={begin}:{begin + 5}:2"
    quietfix("sweep", file, "--vary", vary, "--trials", "3", "--estimator", "ukf", "--out", "sweep")
    swept = json.loads((place / "sweep" / "sweep.json").read_text())
    assert swept["values"] == [begin, begin + 5] and pictures(place / "sweep") == {"sweep.png"}
    for key in ("rmse_position_m", "rmse_ratio", "bound_position_m", "efficiency", "nees_per_state"):
        check_numbers(swept["estimators"]["ukf"][key], key)

    quietfix("verify", str(requirements), "--out", "verify")
    verdicts = json.loads((place / "verify" / "verification.json").read_text())["requirements"]
    assert {one["verdict"] for one in verdicts} == {"holds"}
    check_numbers([one["estimate"] for one in verdicts], "estimate")

    quietfix("observe", file, "--out", "observe", *short)
    check_numbers(json.loads((place / "observe" / "summary.json").read_text())["sets"][0]["prior_sigma"], "prior")
    assert len(pictures(place / "observe")) == 1

    out = quietfix("gdop", file, "--out", "gdop", *short)
    assert len(pictures(place / "gdop")) == 3 and "wrote gdop" in out
    rows = [line.split() for line in out.splitlines() if "[m]" in line or "[m/s]" in line]
    assert len(rows) == 3
    check_numbers([float(cell) for row in rows for cell in row[-5:]], "gdop")

    quietfix("draw", file, "--out", "draw.svg")
    assert "</svg>" in (place / "draw.svg").read_text()

    (place / "shown.yaml").write_text(quietfix("show", file))
    assert read_yaml(place / "shown.yaml")["duration_s"] == read_yaml(HERE / f"{name}.yaml")["duration_s"]

    written = [file for file in place.glob("*/*.json") if not file.name.startswith(".")]
    assert len(written) == 6  # compare writes two
    for file in written:
        assert json.loads(file.read_text())["schema_version"] == SCHEMA_VERSION, file
    resolved = place / "again.yaml"
    resolved.write_text(quietfix("show", str(place / "shown.yaml")))
    assert read_yaml(resolved) == read_yaml(place / "shown.yaml")


def outline(figure, path, **options):
    """Stand in for `Figure.savefig`, which takes most of the time of a short run."""
    Path(path).write_bytes(b"\x89PNG" + bytes(5000))


@pytest.mark.parametrize("name", NAMES)
def test_eight_commands(name, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", outline)
    duration = SHORT.get(name, 10)
    requirements = tmp_path / "short.requirements.yaml"
    requirements.write_text(REQUIREMENTS.format(file=HERE / f"{name}.yaml", duration=duration))
    others = ["--estimator", "iekf", "--estimator", "ukf"]
    check_all(capsys, monkeypatch, tmp_path, name, requirements, ["--set", f"duration_s={duration}"], others)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_eight_commands_at_full_size(name, tmp_path, capsys, monkeypatch):
    check_all(capsys, monkeypatch, tmp_path, name, HERE / f"{name}.requirements.yaml", [], [])
