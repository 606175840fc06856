"""The drone declared in Python is the one declared in YAML, and every command takes it."""

import json
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from tests.diagrams.test_command_line import in_process
from tests.own.drone import DRONE

HERE = Path(__file__).parent
FILE = f"{HERE / 'drone.py'}:DRONE"


def check_equal(duration, trials):
    """Bit for bit: the names of the blocks are the keys of the noise, and the arithmetic is the same."""
    changes = {"duration_s": duration}
    ours = run_study(DRONE, trials=trials, set=changes, keep="all")
    theirs = run_study(str(HERE / "drone.yaml"), trials=trials, set=changes, keep="all")
    assert list(ours["row"].values) == list(theirs["row"].values)
    for name in ("truth", "platforms", "measurement", "estimate", "covariance", "nees", "nis", "bound_position"):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    assert np.isfinite(ours["estimate"]).all()


def test_the_same_numbers_as_in_yaml():
    check_equal(30, 5)


@pytest.mark.slow
def test_the_same_numbers_as_in_yaml_for_the_whole_run():
    check_equal(200, 100)


COMMANDS = {
    "run": ["run", FILE, "--trials", "2", "--set", "duration_s=10"],
    "compare": ["compare", FILE, "--estimator", "default", "--trials", "2", "--set", "duration_s=10"],
    "sweep": ["sweep", FILE, "--vary", "sigma_tdoa_ns=30:60:2", "--trials", "2", "--set", "duration_s=10"],
    "observe": ["observe", FILE, "--set", "duration_s=10"],
    "gdop": ["gdop", FILE, "--set", "duration_s=4", "--out", "maps"],
    "draw": ["draw", FILE, "--out", "drone.svg"],
    "show": ["show", FILE],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_take_it(command, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = in_process(capsys, *COMMANDS[command])
    assert status == 0, err
    assert "drone.py:DRONE" in out or command in ("draw", "gdop")


def test_requirements_of_it(tmp_path, capsys):
    file = tmp_path / "drone.requirements.yaml"
    file.write_text(
        f"system: {FILE}\ntrials: 20\ntrial_limit: 20\nlooks: 1\ncases: {{short: {{set: [duration_s=20]}}}}\n"
        "requirements:\n"
        "  - {name: none is lost, case: short, estimator: ukf, metric: !DivergenceRate {}, at_most: 0.5}\n"
    )
    status, _, err = in_process(capsys, "verify", str(file), "--out", str(tmp_path / "out"))
    assert status == 0, err
    (found,) = json.loads((tmp_path / "out" / "verification.json").read_text())["requirements"]
    assert found["verdict"] == "holds" and found["estimate"] == 0
