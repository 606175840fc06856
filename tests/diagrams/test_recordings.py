"""Recordings as systems: every command, a user's estimator, and what is refused, with the reason."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from diagrams import run_study
from diagrams.assembly.find import RECORDINGS, find
from diagrams.command_line import app, main
from diagrams.errors import UserError
from diagrams.rerun import ask_again
from diagrams.results import open_result
from diagrams.study import Study, join

ROBUST = """
from systems.estimators.kalman import KalmanEstimator
from systems.filters.iterated_extended import IteratedExtendedKalman


class Robust(KalmanEstimator):
    def __init__(self, name, model, motion, start, wiring):
        super().__init__(name, IteratedExtendedKalman(max_iterations=1), model, motion, start, wiring)
"""
FEW = ["every_s=200"]


@pytest.fixture(scope="module")
def out(tmp_path_factory, recorded):
    folder = tmp_path_factory.mktemp("doptrack") / "out"
    data = recorded("doptrack_delfic3").parent
    told = CliRunner().invoke(
        app, ["run", "doptrack", "--data", str(data), "--set", *FEW, "--estimator", "ukf", "--out", str(folder)]
    )
    assert told.exit_code == 0, told.output
    return folder, told.output


def test_a_recording_is_run_as_any_system(out):
    """Table, result and summary of every study, and beside them what this recording tells."""
    folder, printed = out
    assert "doptrack, 1 trials, seed 0" in printed and "its sigma [km]" in printed
    files = {path.name for path in folder.iterdir()}
    assert {"results.zarr", "summary.json", "diagram.svg", "error_position.png", "station_error.png"} <= files
    result, summary = open_result(folder), json.loads((folder / "summary.json").read_text())
    assert result.attrs["system"] == summary["system"] == "doptrack" and summary["trials"] == 1
    row = summary["estimators"]["ukf"]
    error = np.linalg.norm((result["estimate"] - result["truth"]).sel(state=["x", "y", "z"]).values[0, 0, -1])
    assert row["rmse_position_m"][-1] == pytest.approx(error, rel=1e-12)
    # horizontal and vertical parts of the same error, told by the report
    assert np.hypot(row["horizontal_error_m"], row["height_error_m"]) == pytest.approx(error, rel=1e-3)
    # the bound has the Gaussian part of the noise, which tails can only widen
    assert 0 < row["bound_position_m"][-1] < row["sigma_horizontal_m"] * 1.1


def test_it_runs_again_from_its_result(out, monkeypatch):
    folder, _ = out
    monkeypatch.delenv("QUIETFIX_DATA", raising=False)
    found, options = ask_again(folder, None, {}, False)
    again = join(list(Study(found, **options).chunks()))
    np.testing.assert_array_equal(again["estimate"], open_result(folder)["estimate"])


def test_a_users_estimator(recorded, tmp_path, monkeypatch):
    """An iterated filter of one iteration is the extended one; this system gives both heavy tails."""
    (tmp_path / "my_robust_filters.py").write_text(ROBUST)
    monkeypatch.syspath_prepend(tmp_path)
    settings = {"data": recorded("doptrack_delfic3"), "every_s": 200}
    result = run_study("doptrack", estimators=["my_robust_filters:Robust", "ekf"], set=settings)
    np.testing.assert_array_equal(*(result["estimate"].sel(estimator=name) for name in ("robust", "ekf")))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gdop", "doptrack"], "gdop: doptrack is not allowed; it is a recording: its target is where it was"),
        (["observe", "doptrack"], "observe: doptrack is not allowed; it is a recording: nobody knows all of the true"),
        (
            ["compare", "bearings"],
            "compare: bearings is not allowed; it is a recording: nobody knows where its targ",
        ),
        (["compare", "iq"], "compare: iq is not allowed; it is a recording: nobody knows where its target was"),
        (
            ["run", "iq", "--estimator", "ekf", "--data", "a"],
            "estimators: ekf is not allowed for iq; nothing is estima",
        ),
        (["run", "bearings"], "FILE: it is missing; bearings takes a CSV file of your own"),
        (["sweep", "doptrack", "--vary", "every_s=1:2:2"], "sweep: doptrack is not allowed; it is a recording: its"),
        (["run", "three_satellite", "--data", "x"], "--data: x is not allowed for three_satellite; it is no recording"),
        (["run", "doptrack", "--data", "a", "--data", "b"], "--data: 2 are not allowed for doptrack; one"),
        (["replay", "doptrack", "a.csv"], "FILE: a.csv is not allowed for doptrack; its recording is in the data fold"),
        (["replay", "three_satellite"], "dataset: three_satellite is not known"),
        (["run", "doptrack", "--set", "sigma_mps=[1, 2]"], "sigma_mps: [1.0, 2.0] is not allowed; three numbers > 0"),
        (["run", "doptrack", "--set", "oscillator_states.bias=4"], "oscillator_states.bias: 4 is not allowed; 1, 2 or"),
        (["run", "doptrack", "--data", "/no/such"], "/no/such/doptrack_delfic3 is not a folder; name the folder"),
    ],
)
def test_what_makes_no_sense_is_one_line(arguments, message, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    said = capsys.readouterr().err
    assert caught.value.code == 2 and message in said and said.count("\n") == 1


def test_there_are_as_many_trials_as_tracks(recorded):
    settings = {"data": recorded("doptrack_delfic3"), "every_s": 200}
    with pytest.raises(UserError, match=r"trials: 7 from 0 on are not allowed; doptrack is a recording of 1 track"):
        Study("doptrack", set=settings, trials=7)
    with pytest.raises(UserError, match=r"trials: 1 from 3 on is not allowed"):
        Study("doptrack", set=settings, trials=1, first_trial=3)


def test_they_are_listed_and_drawn(recorded, tmp_path):
    listed = CliRunner().invoke(app, ["list"]).output
    for name in RECORDINGS:
        assert f"\n{name}: recording: " in listed and find(name).system.recording is not None
    path = tmp_path / "doptrack.svg"
    drawn = CliRunner().invoke(
        app, ["draw", "doptrack", "--data", str(recorded("doptrack_delfic3")), "--out", str(path)]
    )
    assert drawn.exit_code == 0 and all(word in path.read_text() for word in ("recorded", "bias_drift", "TrackTruth"))
