"""Recordings as systems: every command, a user's estimator, and what is refused, with the reason."""

import json
import shutil
import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import RECORDINGS, find
from quietfix.diagrams.commands.command_line import app, main
from quietfix.diagrams.experiments.compare import compare
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.epochs import from_the_end
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.rerun import ask_again
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.store import write
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join

ROBUST = """
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman


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
    assert "doptrack, 1 trial, seed 0" in printed and "its sigma [km]" in printed
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


def test_a_recording_that_has_changed_is_told(recorded, tmp_path):
    """And settings that make more tracks of it run them all."""
    folder = tmp_path / "locards_mlat"
    shutil.copytree(recorded("locards_mlat_unseen"), folder)
    for name in ("set_6.csv", "README.md"):
        (folder / name).unlink()
    text = (folder / "set_5.csv").read_text().splitlines()[:20]
    (folder / "set_5.csv").write_text("\n".join(text) + "\n")
    settings = [f"data={folder}"]
    result = join(list(Study("locards", set=settings, estimators=["iekf"]).chunks()))
    write(tmp_path / "results.zarr", result, "trial", 0, result.sizes["trial"], result.sizes["trial"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, options = ask_again(tmp_path / "results.zarr", None, {"set": ["gap_s=1"]}, False)
    assert Study(found, **options).request.trials > result.sizes["trial"]
    (folder / "set_5.csv").write_text("\n".join(text[:-1]) + "\n")
    with pytest.warns(UserWarning, match=r"set_5\.csv has changed since"):
        ask_again(tmp_path / "results.zarr", None, {}, False)


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
        (["verify", "REQUIREMENTS"], "verify: locards is not allowed; it is a recording: requirements are judged over"),
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
def test_what_makes_no_sense_is_one_line(arguments, message, capsys, tmp_path):
    file = tmp_path / "locards.requirements.yaml"
    file.write_text("system: locards\ntrials: 20\n")
    arguments = [str(file) if one == "REQUIREMENTS" else one for one in arguments]
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


# ------------------------------------------------------------------------------------------------- one's own

OWN = '''
"""Ranges to two masts, recorded on two walks: a recording of one's own."""

from dataclasses import dataclass

import numpy as np

from quietfix.diagrams import Source, System
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.parts.recorded import RecordedStream
from quietfix.systems.documented import documented, text
from quietfix.systems.starts.start import GivenStart
from quietfix.systems.registry import estimator_options
from quietfix.systems.sensors.recorded import Recording

SOURCE = Source("walks", "a phone", holds="walk_*.csv")


@dataclass
class Scenario:
    estimators: dict[str, estimator_options()] = documented("estimators", factory=dict)
    data: str = text("folder of the walks", "")


def declare(scenario):
    files = sorted(data_folder(SOURCE, scenario.data).glob("walk_*.csv"))
    tables = [np.loadtxt(file, delimiter=",", ndmin=2) for file in files]
    masts = np.array([[-50.0, 0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0]])
    played = RecordedStream(
        [Recording(table[:, 0], table[:, 1:3], masts) for table in tables], [table[:, 3:5] for table in tables]
    )
    motion = FlatMotion()

    def assume(bus, name, options):
        return Assumed(Ranges(), motion, GivenStart([0.0, 30.0], np.eye(2) * 100.0), Ranges().names)

    return Model(
        clock=played.clock,
        duration=played.duration,
        divergence=20.0,
        parts=[played],
        assume=assume,
        frame="local",
        truth_states=("x", "y"),
        recorded=Recorded([file.stem for file in files], played.clocks, played.times),
    )


SYSTEM = System("walks", "two walks", Scenario, declare, {"estimators": {"iekf": {"_tag": "!Iekf"}}}, recording=SOURCE)
'''

MODELS = """
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.stationary import Stationary


def FlatMotion():
    return Stationary(2)


class Ranges(MeasurementModel):
    names, units, sigmas = ("range_0", "range_1"), ("m", "m"), (1.0, 1.0)

    def predict(self, target, platforms):
        return np.linalg.norm(target[..., None, :2] - platforms[..., :2], axis=-1)

    def jacobian(self, target, platforms):
        offset = target[..., None, :2] - platforms[..., :2]
        return offset / np.linalg.norm(offset, axis=-1, keepdims=True)

    def noise_covariance(self):
        return np.eye(2)
"""


def test_a_recording_of_ones_own(tmp_path, capsys):
    """Two files of unequal length are two tracks, located to within the ranges' noise, and compared at their ends."""
    (tmp_path / "mine.py").write_text(OWN.replace("SOURCE = ", f"{MODELS}\n\nSOURCE = ", 1))
    rng = np.random.default_rng(2)
    masts = np.array([[-50.0, 0], [50.0, 0]])
    for k, count in enumerate((12, 5)):
        place = np.array([5.0 * k, 40.0])
        ranges = np.linalg.norm(place - masts, axis=-1) + rng.normal(0, 1.0, (count, 2))
        table = np.column_stack([10.0 * k + np.arange(count), ranges, np.tile(place, (count, 1))])
        np.savetxt(tmp_path / f"walk_{k}.csv", table, delimiter=",")
    reference = f"{tmp_path / 'mine.py'}:SYSTEM"
    result = run_study(reference, estimators=["iekf", "ukf"], set={"data": str(tmp_path)})
    assert list(result["track"].values) == ["walk_0", "walk_1"] and result.sizes["epoch"] == 12
    np.testing.assert_array_equal(result["time"].values[1, :5], 10.0 + np.arange(5))
    error = errors(from_the_end(result))["position"].values[..., -1]
    # 5 ranges of 1 m to masts at right angles: 0.6 m; four sigmas
    assert (error < 2.5).all() and (error > 0).all()
    with pytest.raises(SystemExit) as stop:
        main(["compare", reference, "--data", str(tmp_path), "--estimator", "iekf", "--estimator", "ekf"])
    assert stop.value.code == 0 and "the end of each track" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", ["doptrack", "kiwisdr"])
def test_nobody_reads_the_truth(name, recorded):
    """Nothing of the diagram is connected to where the target is said to be."""
    system = find(name).system
    study = Study(name, set={"data": recorded(system.recording.folder)})
    truth = study.probe.truth.get_system()
    sources = [source for source, _ in study.picture.connection_map().values()]
    assert truth not in sources and len(sources) >= 6


def test_one_track_has_no_interval(recorded):
    """Of one trial nobody knows how far chance moves an error: numbers without intervals, and nobody is the best."""
    settings = [f"data={recorded('doptrack_delfic3')}", "every_s=200"]
    found = compare("doptrack", estimators=["iekf", "ukf"], set=settings)
    rows = found["estimators"]
    for row in rows.values():
        assert row["rmse_position_m"]["value"] > 0 and row["rmse_position_m"]["low"] is None
        assert row["rmse_position_m"]["high"] is None and row["diverged"] == 0
    best = found["best"]["rmse_position_m"]
    assert best["name"] == min(rows, key=lambda name: rows[name]["rmse_position_m"]["value"])
    assert not best["significant"] and found["trials"] == 1
    with pytest.raises(UserError, match=r"at: 1e.08 is not allowed; doptrack runs from 0 to"):
        compare("doptrack", estimators=["iekf", "ukf"], set=settings, at=1e8)
