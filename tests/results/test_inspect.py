"""`quietfix inspect`: which trials are the worst, why one is lost, how it went; what is no result is refused."""

import json
import shutil

import numpy as np
import pytest

from quietfix.diagrams.statistics.metrics import summarise
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.output import OutputFolder
from tests.results.made import dataset, quietfix, refused, told, write


@pytest.fixture
def spoiled(tmp_path):
    """A result in which, of `iekf`, trial 2 never starts, 5 runs away at 50 s, and 6 ends in no number at 90 s."""
    made = dataset()
    estimate, nees, rows = (made[name].values.copy() for name in ("estimate", "nees", "nis_dof"))
    estimate[0, 2] = np.nan
    estimate[0, 5, 10:, 0] += 1e6
    nees[0, 5, 10:] = 6000.0  # of six components: its covariance does not tell
    rows[0, 5, 7:10] = 0.0
    estimate[0, 6, 18:] = np.nan
    nees[0, 2], nees[0, 6, 18:] = np.nan, np.nan
    dims = made["nees"].dims
    made = made.assign(estimate=((*dims, "state"), estimate), nees=(dims, nees), nis_dof=(dims, rows))
    return tmp_path / "r", write(tmp_path / "r", made)


def test_the_worst_trials_and_why(spoiled, capsys):
    path, made = spoiled
    found = told(capsys, "inspect", path, "--worst", "4", "--estimator", "iekf")
    rows = {row["trial"]: row for row in found["estimators"]["iekf"]["trials"]}
    assert list(rows)[:3] == [2, 6, 5] and len(rows) == 4
    assert rows[2]["state"] == "never started" and "at most 3 of 5 rows" in rows[2]["why"]
    assert rows[6]["state"] == "lost" and rows[6]["position_error_m"] is None
    assert rows[6]["why"] == "its estimate is no number from 90 s on"
    assert "further off than divergence_m, 50000 m, from 50 s on" in rows[5]["why"]
    assert "nothing measured at the 3 epochs before, from 35 s on" in rows[5]["why"]
    assert "its covariance does not tell (NEES/n 1e+03" in rows[5]["why"]
    error = errors(made)["position"].sel(estimator="iekf")
    fourth = list(rows.values())[3]
    kept = error.sel(trial=[0, 1, 3, 4, 7]).values[:, -1]
    assert fourth["state"] == "kept" and fourth["position_error_m"] == kept.max()
    nees = made["nees"].sel(estimator="iekf", trial=fourth["trial"]).values[-1] / 6
    assert fourth["nees_per_state"] == pytest.approx(nees, rel=1e-12)  # one division


def test_the_counts_are_those_of_the_summary(spoiled, capsys):
    path, made = spoiled
    found = told(capsys, "inspect", path)["estimators"]
    for name, row in summarise(made).items():
        mine = found[name]
        assert (mine["diverged"], mine["not_started"]) == (row["diverged"], row["not_started"])
        if name == "iekf":  # one of its trials is no number at the end
            assert mine["rmse_position_m"] is None and row["rmse_position_m"][-1] is None
        else:  # the sum of eight squares in another order
            assert mine["rmse_position_m"] == pytest.approx(row["rmse_position_m"][-1], rel=1e-12)
        assert mine["median_position_m"] == pytest.approx(row["median_position_m"][-1], rel=1e-12)


def test_the_course_of_one_trial(spoiled, capsys):
    path, made = spoiled
    found = told(capsys, "inspect", path, "--trial", "3")["estimators"]["ukf"]
    one = made.sel(estimator="ukf", trial=3)
    assert found["trial"] == 3 and found["state"] == "kept" and found["why"] is None
    np.testing.assert_array_equal(found["course"]["time_s"], one["time"])
    np.testing.assert_array_equal(found["course"]["nis"], one["nis"])
    whole = errors(made)
    for what, unit in (("position", "m"), ("height", "m"), ("velocity", "mps"), ("course", "deg")):
        expected = whole[what].sel(estimator="ukf", trial=3)
        # one trial alone is the same as in a batch, but for the rounding of a sum of three squares
        np.testing.assert_allclose(found["course"][f"{what}_error_{unit}"], expected, rtol=1e-9, atol=1e-12)
    assert found["largest_error_m"] == pytest.approx(
        float(whole["position"].sel(estimator="ukf", trial=3).max()), rel=1e-9
    )
    capsys.readouterr()
    assert quietfix("inspect", path, "--trial", "5") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "trial 5" in said and "iekf, trial 5: lost: further off" in said


def test_what_the_estimator_itself_calls_lost(spoiled, tmp_path, capsys):
    path, made = spoiled
    before = told(capsys, "inspect", path)["estimators"]["ukf"]
    assert before["lost"] is None and before["trials"][0]["flagged"] is None  # a result that does not say it
    lost = np.zeros(made["nees"].shape)
    lost[1, 3, 8:] = 1.0
    lost[1, 4, 6:9] = 1.0
    lost[0, 2] = np.nan  # never started
    named = made.assign(lost=(made["nees"].dims, lost))
    write(tmp_path / "named", named)
    found = told(capsys, "inspect", tmp_path / "named", "--worst", "8")["estimators"]
    for name, row in summarise(named).items():
        assert (found[name]["lost"], found[name]["ever_lost"]) == (row["lost"], row["ever_lost"])
    assert (found["ukf"]["lost"], found["ukf"]["ever_lost"]) == (1, 2)
    rows = {row["trial"]: row for row in found["ukf"]["trials"]}
    assert (rows[3]["flagged"], rows[3]["flagged_from_s"]) == (True, 40.0)
    assert (rows[4]["flagged"], rows[4]["flagged_from_s"]) == (False, 30.0)
    assert (rows[0]["flagged"], rows[0]["flagged_from_s"]) == (False, None)
    course = told(capsys, "inspect", tmp_path / "named", "--trial", "4")["estimators"]["ukf"]["course"]
    np.testing.assert_array_equal(course["lost"], lost[1, 4])
    capsys.readouterr()
    assert quietfix("inspect", tmp_path / "named", "--worst", "8", "--estimator", "ukf") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "diverged 0, 1 flagged" in said
    assert "ukf, trial 3: flagged by the estimator from 40 s on" in said
    assert "ukf, trial 4: flagged by the estimator from 30 s on, and no more at the end" in said


def test_a_number_that_stands_in_json_stands_in_the_table(spoiled, capsys):
    path, _ = spoiled
    row = told(capsys, "inspect", path, "--worst", "1", "--estimator", "ukf")["estimators"]["ukf"]["trials"][0]
    capsys.readouterr()
    assert quietfix("inspect", path, "--worst", "1", "--estimator", "ukf") == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.strip().startswith("ukf"))
    cells = line.split()
    assert cells[1] == str(row["trial"]) and cells[2] == f"{row['position_error_m']:.0f}"
    assert float(cells[5]) == pytest.approx(row["nees_per_state"], rel=5e-3)  # three digits


def test_what_is_wrong_is_one_line(spoiled, tmp_path, capsys, monkeypatch):
    made = spoiled[1]
    monkeypatch.chdir(tmp_path)
    assert "--trial: 99 is not allowed; r has 0 to 7" in refused(capsys, "inspect", "r", "--trial", "99")
    assert "--worst: 0 is not allowed" in refused(capsys, "inspect", "r", "--worst", "0")
    assert "--estimator: iekg is not known (did you mean iekf?)" in refused(
        capsys, "inspect", "r", "--estimator", "iekg"
    )
    assert "nowhere is not a result" in refused(capsys, "inspect", "nowhere")
    write(tmp_path / "older", made.assign_attrs(schema_version=1))
    assert "schema_version: 1 is not allowed" in refused(capsys, "inspect", "older")
    write(tmp_path / "later", made.assign_attrs(schema_version=99))
    assert "schema_version: 99 is not allowed" in refused(capsys, "inspect", "later")
    write(tmp_path / "poor", made.drop_vars("nis"))
    assert "is damaged: it has no nis" in refused(capsys, "inspect", "poor")
    with OutputFolder("map", kind="gdop") as output:
        (output.work / "a.png").write_bytes(b"png")
        output.finish()
    assert "is a result of `quietfix gdop` without trials" in refused(capsys, "inspect", "map")


@pytest.mark.parametrize("command", [("inspect", "r"), ("plot", "r"), ("diff", "r", "r"), ("export", "r", "x.csv")])
def test_a_damaged_result_is_refused(spoiled, tmp_path, capsys, monkeypatch, command):
    """A chunk that is missing would be read as numbers that are not known, without a word."""
    path, _ = spoiled
    monkeypatch.chdir(tmp_path)
    chunk = path / "results.zarr" / "estimate" / "c" / "0" / "1" / "0" / "0"
    before = chunk.read_bytes()
    chunk.unlink()
    assert "estimate/c/0/1/0/0 is missing since it was written" in refused(capsys, *command)
    chunk.write_bytes(before[:-9])
    assert "estimate/c/0/1/0/0 was changed since it was written" in refused(capsys, *command)
    shutil.rmtree(path / "results.zarr")
    refused(capsys, *command)
    (path / MARKER).write_text("{}")
    assert "damaged, or no marker" in refused(capsys, *command)
    assert {one.name for one in tmp_path.iterdir()} == {"r"}


def test_a_chunk_that_cannot_be_read_is_one_line_also_without_a_marker(spoiled, capsys):
    path, _ = spoiled
    (path / MARKER).unlink()
    assert quietfix("inspect", path) == 0  # a store that was copied alone
    chunk = path / "results.zarr" / "estimate" / "c" / "0" / "1" / "0" / "0"
    chunk.write_bytes(b"no zstd")
    assert "cannot be read" in refused(capsys, "inspect", path)


def test_what_an_interrupted_run_has_finished_can_be_looked_at(tmp_path, capsys):
    made = dataset()
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path / "d") as output:
        output.append(made.isel(trial=slice(4)))
        raise KeyboardInterrupt
    shutil.copytree(tmp_path / "d.partial", tmp_path / "e.partial")
    shutil.rmtree(tmp_path / "e.partial" / "results.zarr")  # as a run by chunks leaves it
    assert "unfinished work of `quietfix run`" in refused(capsys, "inspect", tmp_path / "e.partial")
    found = told(capsys, "inspect", tmp_path / "d.partial")
    assert found["trials"] == 4 and len(found["estimators"]["iekf"]["trials"]) == 4
    json.dumps(found, allow_nan=False)
