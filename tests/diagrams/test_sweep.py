"""Sweeps: what is varied, on what noise, what they find, and sensor errors in the systems."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import systems
from quietfix.diagrams.commands import command_line
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.experiments.sweep import Sweep, parse_vary, sweep
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study
from tests.interrupts import listening
from tests.laws.test_truth_ports import connections, leaks

PROJECT = Path(__file__).parents[2]
TDOA_FDOA = "estimators.tdoa_fdoa=!Iekf {measurements: [tdoa, fdoa]}"


def in_process(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        command_line.main(list(arguments))
    captured = capsys.readouterr()
    return ended.value.code or 0, captured.out, captured.err


def values(found, name, metric, part="value"):
    return np.array([entry[part] for entry in found["estimators"][name][metric]])


@pytest.mark.parametrize(
    ("text", "expected", "geometric"),
    [
        ("a.b=0:0.1:5", (0, 0.025, 0.05, 0.075, 0.1), False),
        ("a=log:1:100:3", (1, 10, 100), True),
        ("a=0,5,20", (0, 5, 20), False),
        ("a=0.1:0.3:3", (0.1, 0.2, 0.3), False),
        ("a=5:1:2", (5, 1), False),
    ],
)
def test_what_is_varied(text, expected, geometric):
    found = parse_vary(text)
    assert found.values == expected and found.geometric == geometric


MISTAKES = [
    ("truth.sigma_tdoa_ns=20", "1 point"),
    ("truth.sigma_tdoa_ns=20:20:3", "1 point"),
    ("truth.sigma_tdoa_ns=20:30:1", "1 point"),
    ("truth.sigma_tdoa_ns=20:30:0", "no point"),
    ("truth.sigma_tdoa_ns=20:30", "KEY=A:B:N"),
    ("truth.sigma_tdoa_ns=a:b:3", "KEY=A:B:N"),
    ("truth.sigma_tdoa_ns=1:inf:3", "KEY=A:B:N"),
    ("truth.sigma_tdoa_ns", "KEY=A:B:N"),
    ("truth.sigma_tdoa_ns=log:0:30:3", "numbers > 0"),
    ("truth.sigma_tdoa_ms=1:2:2", "did you mean sigma_tdoa_ns"),
    ("truht.sigma_tdoa_ns=1:2:2", "did you mean truth"),
    ("truth.motion=1:2:2", "a field that is a number"),
    ("truth.phase=1:2:2", "a field that is a number"),
    ("truth.light_time=0:1:2", "a field that is a number"),
    ("truth.sigma_tdoa_ns.x=1:2:2", "has no fields"),
    ("satellites.7.along_km=1:2:2", "3 entries"),
    ("truth.sigma_tdoa_ns=-1:20:3", "truth.sigma_tdoa_ns: -1.0 is not allowed"),
    ("truth.errors.drop_out_rate=0:2:3", "truth.errors.drop_out_rate: 2.0 is not allowed"),
    ("estimators.iekf.max_iterations=1:2:3", "whole numbers"),
]


@pytest.mark.parametrize(("vary", "word"), MISTAKES, ids=[vary for vary, _ in MISTAKES])
def test_mistakes_are_one_line(vary, word, capsys):
    status, out, err = in_process(capsys, "sweep", "three_satellite", "--vary", vary)
    assert status == 2 and out == "" and err.count("\n") == 1 and word in err, err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--vary", "duration_s=10:20:2", "--trials", "1"], "at least 2"),
        (["--vary", "duration_s=10:20:2", "--at", "15"], "0 to 10 s"),
        (["--vary", "duration_s=10:20:2", "--estimator", "iekg"], "did you mean iekf"),
        ([], "--vary"),
    ],
)
def test_other_mistakes(arguments, word, capsys):
    status, _, err = in_process(capsys, "sweep", "three_satellite", *arguments)
    assert status == 2 and err.count("\n") == 1 and word in err, err


def test_fields_of_lists_integers_and_nulls():
    """An element of a list, a whole number, and a field that is null in the scenario can be varied."""
    for vary in ("satellites.1.along_km=-40:-30:2", "estimators.iekf.max_iterations=1:3:3"):
        found = sweep("three_satellite", vary, estimators=["iekf"], trials=2, set=["duration_s=3"])
        assert len(found["values"]) == len(found["estimators"]["iekf"]["rmse_position_m"])
    found = sweep("three_satellite", "belief.sigma_tdoa_ns=20:40:2", trials=2, set=["duration_s=3"], estimators=["ekf"])
    one, other = values(found, "ekf", "rmse_position_m")
    assert one != other


def test_points_are_studies_on_the_same_noise():
    """Every point is `run_study` with that value and the same seed; the period changes, the end does not."""
    options = {"estimators": ["ekf"], "trials": 5, "seed": 3}
    found = sweep("three_satellite", "period_s=1:2:2", at=10.0, set=["duration_s=20"], **options)
    for k, period in enumerate((1, 2)):
        result = run_study("three_satellite", set={"duration_s": 20, "period_s": period}, **options)
        error = errors(result)["position"].values[0]
        at = int(np.argmin(np.abs(result["time"].values - 10)))
        entry = found["estimators"]["ekf"]["rmse_position_m"][k]
        np.testing.assert_allclose(entry["value"], np.sqrt((error[:, at] ** 2).mean()), rtol=1e-12)
    assert found["time_s"] == [10, 10]
    # the same noise: scaled with sigma, not drawn anew
    settings = {"duration_s": 3}
    parts = [
        run_study("three_satellite", keep="measurements", set=settings | {"truth.sigma_tdoa_ns": s}, **options)
        for s in (1e-6, 20, 40)
    ]
    exact, single, double = (part["measurement"].values[..., 0] for part in parts)
    np.testing.assert_allclose(double - exact, 2 * (single - exact), atol=1e-6 * 20e-9 * 100)


def test_attitude_and_clock_errors_find_what_is_known():
    """40 trials of the default geometry (target 300 km to the right of the track), at 150 s.

    0.05 deg of roll turns the line of sight to the ground by 0.6 to 0.7 km: it does not average, and the RMSE grows by
    a factor of 4 to 7 (5.2 with 100 trials) with a NEES of 3 per state, while TDOA and FDOA know nothing of it.
    5 ns on the reference's clock is a quarter of sigma: the RMSE stays within 10 %, but over 150 epochs it is 3 sigma
    of the mean, and the NEES triples at least.
    """
    settings, names = [TDOA_FDOA], ["iekf", "tdoa_fdoa"]
    roll = sweep("three_satellite", "truth.errors.attitude_roll_deg=0,0.05", estimators=names, trials=40, set=settings)
    assert 4 < values(roll, "iekf", "rmse_ratio")[1] < 7
    assert values(roll, "iekf", "rmse_ratio", "low")[1] > 3.5
    assert values(roll, "iekf", "nees_per_state")[1] > 2 and roll["estimators"]["iekf"]["nees_verdict"][1] == "high"
    np.testing.assert_allclose(values(roll, "tdoa_fdoa", "rmse_ratio"), 1, atol=1e-12)
    clock = sweep("three_satellite", "truth.errors.clock_offset_ns=0,5", estimators=["iekf"], trials=40)
    assert abs(values(clock, "iekf", "rmse_ratio")[1] - 1) < 0.1
    nees = values(clock, "iekf", "nees_per_state")
    assert nees[1] > 2.5 * nees[0] and clock["estimators"]["iekf"]["nees_verdict"] == ["low", "high"]


@pytest.mark.slow
def test_what_is_known_at_full_size():
    """100 trials: a factor of about 5, NEES far out of band; the same off nadir; pitch and yaw cost nothing there; a
    consistent filter (truth of its own model) leaves its band at 5 ns, with the RMSE within 3 %."""
    options = {"estimators": ["iekf", "tdoa_fdoa"], "trials": 100}
    near = sweep("three_satellite", "truth.errors.attitude_roll_deg=0,0.05", set=[TDOA_FDOA], **options)
    assert 4.5 < values(near, "iekf", "rmse_ratio")[1] < 6
    assert values(near, "iekf", "nees_per_state")[1] > 2.5
    assert values(near, "tdoa_fdoa", "rmse_ratio")[1] == pytest.approx(1, abs=1e-12)
    far = [TDOA_FDOA, "truth.along_km=150", "truth.cross_km=-500"]
    off = sweep("three_satellite", "truth.errors.attitude_roll_deg=0,0.05", set=far, **options)
    assert 4 < values(off, "iekf", "rmse_ratio")[1] < 8
    pitch = sweep("three_satellite", "truth.errors.attitude_pitch_deg=0,0.05", estimators=["iekf"])
    assert abs(values(pitch, "iekf", "rmse_ratio")[1] - 1) < 0.1
    own = ["truth.motion=!RandomAcceleration {}"]
    clock = sweep("three_satellite", "truth.errors.clock_offset_ns=0,5,20", estimators=["iekf"], set=own)
    assert abs(values(clock, "iekf", "rmse_ratio")[1] - 1) < 0.03
    assert clock["estimators"]["iekf"]["nees_verdict"] == ["in band", "high", "high"]


# ------------------------------------------------------------------------------------------- on the wires

ERRORS = {
    "three_satellite": ("truth.errors", ["attitude_roll_deg=0.1", "clock_offset_ns=5", "sigma_platform_position_m=10"]),
    "dual_satellite": ("truth.errors", ["attitude_yaw_deg=0.1", "clock_offset_ns=5", "sigma_platform_velocity_mps=1"]),
    "bearing_crossing": ("truth.errors", ["attitude_yaw_deg=1", "sigma_attitude_deg=1"]),
    "satellite_ranging": ("truth.errors", ["attitude_pitch_deg=0.1"]),
    "beacon_rocket": ("sensor.errors", ["sigma_platform_position_m=10"]),
}
QUICK = {
    "three_satellite": {"duration_s": 4},
    "dual_satellite": {"duration_s": 4},
    "bearing_crossing": {"duration_s": 4},
    "satellite_ranging": {"duration_s": 40},
    "beacon_rocket": {"stop_s": 50.2},
}


@pytest.mark.parametrize("system", ERRORS)
def test_errors_on_the_wires_of_every_system(system):
    """With errors on: no estimator sees the truth, every measured row but the missing ones is finite, and trial 2 alone
    is trial 2 of the batch. Off: not one block more, and bit for bit what it was."""
    if system not in systems():
        pytest.skip(f"no {system}")
    at, some = ERRORS[system]
    settings = {f"{at}.{pair.partition('=')[0]}": pair.partition("=")[2] for pair in some} | QUICK[system]
    settings |= {f"{at}.outlier_rate": 0.1, f"{at}.drop_out_rate": 0.1}
    name = next(n for n in load_scenario(system).estimators if "ra" not in n)
    diagram, wired = Study(system, estimators=[name], set=settings, trials=3).diagram(3)
    assert leaks(diagram, wired.truth) == []
    blocks = {source.get_name() for source, *_ in connections(diagram)}
    assert "reading_error" in blocks
    options = {"estimators": [name], "keep": "measurements"}
    batch = run_study(system, set=settings, trials=3, **options)
    alone = run_study(system, set=settings, trials=1, first_trial=2, **options)
    np.testing.assert_array_equal(alone["measurement"][0], batch["measurement"][2])
    off = {f"{at}.outlier_sigmas": 3.0} | QUICK[system]
    plain, _ = Study(system, estimators=[name], set=off, trials=3).diagram(3)
    assert not any(
        "error" in source.get_name() for source, *_ in connections(plain) if "sensors" in type(source).__module__
    )
    np.testing.assert_array_equal(
        run_study(system, set=off, trials=3, **options)["estimate"],
        run_study(system, set=QUICK[system], trials=3, **options)["estimate"],
    )


@pytest.mark.parametrize(
    ("system", "setting", "word"),
    [
        ("bearing_crossing", "truth.errors.clock_offset_ns=5", "no times of arrival"),
        ("bearing_crossing", "truth.errors.attitude_roll_deg=5", "about z only"),
        ("bearing_crossing", "truth.errors.sigma_platform_position_m=5", "sigma_navigation_m"),
        ("satellite_ranging", "truth.errors.sigma_clock_offset_ns=5", "no times of arrival"),
        ("satellite_ranging", "truth.errors.sigma_platform_position_m=5", "sigma_observer_m"),
        ("satellite_ranging", "truth.errors.drop_out_rate=0.1", "what the sensor will read"),
        ("beacon_rocket", "sensor.errors.attitude_yaw_deg=5", "no directions"),
        ("three_satellite", "truth.errors.drop_out_rate=1.1", "<= 1"),
    ],
)
def test_senseless_errors_are_refused(system, setting, word):
    with pytest.raises(UserError, match=word):
        run_study(system, trials=2, set=[setting])
    with pytest.raises(UserError, match="clock_offset_platform: 3"):
        run_study(
            "three_satellite",
            trials=1,
            set=["truth.errors.clock_offset_ns=5", "truth.errors.clock_offset_platform=3"],
        )


def test_missing_rows_are_in_the_bound():
    """With half of the rows missing the bound is larger: they are not counted."""
    options = {"trials": 4, "estimators": ["ekf"]}
    found = sweep("three_satellite", "truth.errors.drop_out_rate=0,0.5", set=["duration_s=20"], **options)
    none, half = found["estimators"]["ekf"]["bound_position_m"]
    assert 1.1 < half / none < 2.5


# ----------------------------------------------------------------------------------------------- the folder


def test_the_folder(tmp_path, capsys):
    status, out, err = in_process(
        capsys,
        *["sweep", "three_satellite", "--vary", "truth.sigma_tdoa_ns=log:10:40:3", "--trials", "4"],
        *["--set", "duration_s=5", "--estimator", "ekf", "--out", str(tmp_path / "made")],
    )
    assert status == 0, err
    assert {path.name for path in (tmp_path / "made").iterdir()} == {MARKER, "results.zarr", "sweep.json", "sweep.png"}
    found = json.loads((tmp_path / "made" / "sweep.json").read_text())
    assert found["values"] == [10, 20, 40] and found["key"] == "truth.sigma_tdoa_ns" and found["trials"] == 4
    result = open_result(tmp_path / "made")
    assert dict(result["position_error"].sizes) == {"point": 3, "estimator": 1, "trial": 4}
    mean = np.sqrt((result["position_error"].values ** 2).mean(-1))[:, 0]
    np.testing.assert_allclose(values(found, "ekf", "rmse_position_m"), mean, rtol=1e-12)
    assert "sigma_tdoa_ns" in out and "same noise" in out
    planned = Sweep("three_satellite", "truth.sigma_tdoa_ns=10:20:2", trials=2, set=["duration_s=2"])
    assert [int(part.sizes["trial"]) for part in planned.points()] == [2, 2]


@pytest.mark.slow
def test_interrupt_keeps_the_finished_points(tmp_path):
    command = [
        sys.executable,
        "-m",
        "quietfix.diagrams.commands.command_line",
        "sweep",
        "three_satellite",
        "--trials",
        "300",
    ]
    command += ["--vary", "truth.sigma_tdoa_ns=10:40:20", "--out", "cut", "--estimator", "iekf"]
    environment = os.environ | {"PYTHONPATH": str(PROJECT)}
    running = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True, preexec_fn=listening
    )
    chunk = tmp_path / "cut.partial" / ".quietfix-chunks" / "0.npz"
    until = time.monotonic() + 120
    while not chunk.exists() and running.poll() is None and time.monotonic() < until:
        time.sleep(0.1)
    time.sleep(1.0)
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=60)
    assert running.returncode == 130 and "of 20 chunks are kept" in err and "of 20 points are whole" in err, err
    kept = json.loads((tmp_path / "cut.partial" / "sweep.json").read_text())
    assert 1 <= len(kept["values"]) < 20 and not (tmp_path / "cut").exists()
    assert open_result(tmp_path / "cut.partial").sizes["point"] == len(kept["values"])
