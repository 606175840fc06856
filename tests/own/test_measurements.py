"""Tables of measurements: what a simulated study wrote and is read back, and what others wrote."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from diagrams import run_study
from diagrams.assembly.find import find
from diagrams.commands.command_line import app
from diagrams.own.writing import write_measurements
from diagrams.studies.results import open_result

DRONE = Path(__file__).parent / "drone.yaml"
FEW = {"duration_s": 30}
BLIND = {  # nobody knows where the target is: nothing is drawn about it
    "target": None,
    "start": {"sensors": ["tdoa", "barometer"], "height_m": 500},
}
BLIND_TEXT = ["target=null", "start=!Snapshot {sensors: [tdoa, barometer], height_m: 500}"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A simulated study of three trials and its table."""
    path = tmp_path_factory.mktemp("written") / "measurements.csv"
    result = run_study(DRONE.as_posix(), trials=3, set=FEW, keep="measurements")
    rows = write_measurements(result, find(DRONE.as_posix()).system.load(settings=["duration_s=30"]), path)
    # three rows of TDOA a second, a bearing at 2, 6 ... 30, a height at 0, 5 ... 30 s
    assert rows == 3 * (3 * 31 + 8 + 7)
    return result, path


def test_a_study_read_back_is_the_same_bit_by_bit(written):
    result, path = written
    again = run_study(DRONE.as_posix(), set={**FEW, "measurements.file": str(path)})
    assert again["track"].values.tolist() == ["0", "1", "2"]
    np.testing.assert_array_equal(again["time"], np.broadcast_to(result["time"], (3, 31)))
    for what in ("estimate", "nis", "nees"):
        np.testing.assert_array_equal(again[what].values, result[what].values)
    np.testing.assert_array_equal(again["measurement"].values, result["measurement"].values)


def test_by_the_command_line_and_without_a_truth(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    out = run(app, ["run", str(DRONE), "--set", "duration_s=20", "--trials", "1", "--out", "o", "--write-measurements"])
    assert out.exit_code == 0 and "measurements.csv" in out.output, out.output
    sets = [part for one in ["duration_s=20", *BLIND_TEXT] for part in ("--set", one)]
    fed = run(app, ["run", str(DRONE), *sets, "--measurements", "o/measurements.csv", "--out", "fed"])
    assert fed.exit_code == 0, fed.output
    assert "nobody knows where the target was" in fed.output and "RMSE" not in fed.output
    result, summary = open_result("fed"), json.loads(Path("fed/summary.json").read_text())
    assert summary["estimators"]["ekf"]["diverged"] is None and not result["truth"].notnull().any()
    assert not any(Path("fed").glob("error_*.png"))
    table = np.genfromtxt("fed/estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    last = table[(table["estimator"] == "ekf") & (table["time_s"] == 20)][0]
    estimate = result["estimate"].sel(estimator="ekf").values[0, -1]
    assert [last["x_m"], last["vz_mps"]] == [estimate[0], estimate[5]]
    assert last["cov_x_x"] == result["covariance"].sel(estimator="ekf").values[0, -1, 0, 0]
    # the estimate is near to the drone, which the run did not know
    truth = open_result("o")["truth"].values[-1, :3]
    assert np.linalg.norm(estimate[:3] - truth) < 4 * np.sqrt(last["cov_x_x"] + last["cov_y_y"] + last["cov_z_z"])
