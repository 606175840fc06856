"""Tables of measurements: what a simulated study wrote and is read back, and what others wrote."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.command_line import app
from quietfix.diagrams.own.fed.covering import judge
from quietfix.diagrams.own.fed.report import MeasuredReport, Told
from quietfix.diagrams.own.writing import write_measurements, write_truth
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.results import open_result

DRONE = Path(__file__).parent / "drone.yaml"
FEW = {"duration_s": 30}
HEAD = ("time_s", "target", "kind", "receiver", "reference", "value", "unit", "sigma")
# nobody knows where the target is: nothing is drawn about it
BLIND = ["target=null", "start=!Snapshot {sensors: [tdoa, barometer], height_m: 500}"]


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


def rows_of(path, trial="0"):
    """The rows of one trial, as lists of text."""
    return [row for row in csv.reader(path.read_text().splitlines()[1:]) if row[1] == trial]


def run_on(path, **settings):
    sets = {**FEW, "measurements.file": str(path), **settings}
    return run_study(DRONE.as_posix(), set=sets, estimators=["ekf"])


def in_other_words(time, target, kind, receiver, reference, value, unit, sigma):
    """The same row in other units, the other way round, as a compass has it, with a date around a leap second."""
    second = 50 + int(float(time))
    clock = f"01:59:{second}" if second <= 60 else f"02:00:{second - 61:02d}"
    day = "2017-01-01"  # an hour and more before midnight in UTC it is midnight at +02:00
    stamp = f"{day}T{clock}.000+02:00"
    number = float(value)
    if kind == "tdoa":
        return [stamp, kind, reference, receiver, repr(-1e9 * number), "ns", "30"]
    if kind == "azimuth":
        compass = 90 - math.degrees(number)
        return [stamp, "bearing", receiver, "", repr((compass + 180) % 360 - 180), "deg", "0.5"]
    return [stamp, kind, "", "", repr(number / 1e3), "km", ""]


def test_the_same_in_other_words(written, tmp_path):
    """Units, signs, a compass, any order, another delimiter, a run over a leap second: nothing but rounding differs."""
    result, path = written
    rows = [in_other_words(*row) for row in rows_of(path)]
    np.random.default_rng(2).shuffle(rows)
    lines = ["; ".join(row) for row in [["time", *HEAD[2:]], *rows]]
    (tmp_path / "log.txt").write_text("# of a logger\n\n" + "\n".join(lines) + "\n")
    told = run_on(tmp_path / "log.txt")
    # values have 1e-16 of rounding, and the filter's gain makes no more than 1e5 of it in 30 s
    np.testing.assert_allclose(told["estimate"][0, 0], result["estimate"].sel(estimator="ekf")[0], atol=1e-5)
    np.testing.assert_array_equal(told["time"], np.arange(31.0))
    assert "rows are put in order" in told.attrs["note"]


def test_parquet_is_the_same(written, tmp_path):
    import pyarrow as arrow
    from pyarrow import parquet

    result, path = written
    columns = list(zip(*rows_of(path), strict=True))
    table = {
        name: [float(v) if name in ("time_s", "value", "sigma") else v for v in column]
        for name, column in zip(HEAD, columns, strict=True)
    }
    parquet.write_table(arrow.table(table), tmp_path / "log.parquet")
    told = run_on(tmp_path / "log.parquet")
    np.testing.assert_array_equal(told["estimate"][0, 0], result["estimate"].sel(estimator="ekf")[0])


def test_sigmas_of_rows_are_those_of_the_noise(written, tmp_path):
    """Where the table says 60 ns, the estimators do what they do where they believe in 60 ns."""
    _, path = written
    rows = [[*row[:7], "60e-9" if row[2] == "tdoa" else ""] for row in rows_of(path)]
    (tmp_path / "said.csv").write_text("\n".join(",".join(row) for row in [HEAD, *rows]) + "\n")
    (tmp_path / "silent.csv").write_text("\n".join(",".join(row[:7]) for row in [HEAD, *rows]) + "\n")
    said = run_on(tmp_path / "said.csv")
    believed = run_on(tmp_path / "silent.csv", **{"sensors.tdoa.sigma_ns": 60})
    other = run_on(tmp_path / "silent.csv")
    # (2 s)^2 and 2 * s^2 * 2 differ by rounding
    np.testing.assert_allclose(said["estimate"], believed["estimate"], atol=1e-6)
    assert np.abs(said["estimate"] - other["estimate"]).max() > 1.0


def test_a_truth_beside_it(written, tmp_path):
    """What the study knew of its targets, in a file: the errors are the same bit by bit, of other targets unknown."""
    result, path = written
    write_truth(result, tmp_path / "truth.csv")
    some = [line for line in (tmp_path / "truth.csv").read_text().splitlines() if ",1," not in line]
    (tmp_path / "some.csv").write_text("\n".join(some) + "\n")
    sets = {
        **FEW,
        "measurements.file": str(path),
        "target": None,
        "measurements.truth.file": str(tmp_path / "truth.csv"),
    }
    told = run_study(DRONE.as_posix(), set=sets)
    np.testing.assert_array_equal(told["nees"], result["nees"])
    with pytest.raises(UserError, match="nobody knows where 1 was then"):
        run_study(DRONE.as_posix(), set={**sets, "measurements.truth.file": str(tmp_path / "some.csv")})


def test_a_recording_is_not_simulated(written):
    _, path = written
    sets = [f"measurements.file={path}", "duration_s=30"]
    for command in ("gdop", "observe", "sweep"):
        more = ["--vary", "sensors.tdoa.sigma_ns=1:2:2"] if command == "sweep" else []
        told = CliRunner().invoke(app, [command, str(DRONE), *more, *(p for one in sets for p in ("--set", one))])
        assert isinstance(told.exception, UserError) and "it is a recording" in str(told.exception), told.output


def test_by_the_command_line_and_without_a_truth(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    out = run(app, ["run", str(DRONE), "--set", "duration_s=20", "--trials", "1", "--out", "o", "--write-measurements"])
    assert out.exit_code == 0 and "measurements.csv" in out.output, out.output
    sets = [part for one in ["duration_s=20", *BLIND] for part in ("--set", one)]
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


def test_sigmas_that_cannot_cover_the_residuals_are_told(written, tmp_path):
    _, path = written
    rows = [[*row[:-1], repr(float(row[-1]) / 5) if row[-1] else ""] for row in rows_of(path)]
    small = tmp_path / "small.csv"
    small.write_text("\n".join(",".join(row) for row in [HEAD, *rows]) + "\n")
    common = ["run", DRONE.as_posix(), "--estimator", "iekf", "--set", "duration_s=30", "--measurements"]
    told = CliRunner().invoke(app, [*common, str(small)]).output
    assert "0: the claimed sigmas cannot cover" in told
    # written with sigmas a fifth of those that the noise was drawn with
    found = float(told.split("iekf, which are ")[1].split(" times")[0])
    assert found == pytest.approx(5.0, abs=1.5)
    assert "cannot cover" not in CliRunner().invoke(app, [*common, str(path)]).output


def test_what_ends_under_the_ground_is_said():
    def told(height):
        place = {"latitude_deg": 49.0, "longitude_deg": 16.0, "height_m": height}
        covering = judge(np.ones(9), np.ones(9), np.arange(9.0), [])
        return Told("ekf", f"at {height:g}", 9, 9, 8.0, place, {}, 1.0, 0.5, 1.5, 1.0, covering)

    report = MeasuredReport([told(-6609.4), told(-90.0)], xr.Dataset(), None, True, "air", "")
    deep = [line for line in report.notes() if "under the ground" in line]
    assert len(deep) == 1 and deep[0].startswith("at -6609.4: ekf ends 6609 m below the ellipsoid")
