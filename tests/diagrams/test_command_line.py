"""The command line as a user meets it: separate processes where exit status and files matter."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams.assembly.drawing import is_drawing
from quietfix.diagrams.commands import command_line
from quietfix.diagrams.studies.results import open_result
from tests.interrupts import listening

QUIETFIX = [sys.executable, "-m", "quietfix.diagrams.commands.command_line"]
PROJECT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(PROJECT), "PYTHONUNBUFFERED": "1"}
SHORT = ["--set", "duration_s=10"]


def quietfix(*arguments, cwd=None):
    command = [*QUIETFIX, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120, check=False, env=ENVIRONMENT)


def in_process(capsys, *arguments):
    """Run the command in this process; return exit status, standard output, standard error."""
    with pytest.raises(SystemExit) as ended:
        command_line.main(list(arguments))
    captured = capsys.readouterr()
    return ended.value.code or 0, captured.out, captured.err


def test_help_and_version(capsys):
    status, out, _ = in_process(capsys, "--help")
    assert status == 0 and "Exit status" in out and "replay" in out
    # Help must not load what takes long to load.
    probe = (
        "import sys, quietfix.diagrams.commands.command_line; "
        "print([m for m in ('pydrake', 'numpy', 'xarray') if m in sys.modules])"
    )
    command = [sys.executable, "-c", probe]
    found = subprocess.run(command, capture_output=True, text=True, check=True, env=ENVIRONMENT)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("folder", [".", "", "/", ".."])
def test_out_without_a_name_is_one_line(capsys, folder):
    status, _, err = in_process(capsys, "run", "three_satellite", *SHORT, "--trials", "1", "--out", folder)
    assert status == 2 and err.startswith("quietfix: --out: ") and err.count("\n") == 1


def test_warning_is_one_line(capsys):
    before = warnings.formatwarning
    status, *_ = in_process(capsys, "list")
    assert status == 0 and warnings.formatwarning is before
    assert command_line._format_warning("stations: 3", UserWarning, "f.py", 1) == "quietfix: warning: stations: 3\n"


def test_list_and_show(capsys):
    status, out, _ = in_process(capsys, "list")
    assert status == 0 and "three_satellite:coplanar" in out and "iekf_tdoa_phase" in out and "locards" in out
    status, out, _ = in_process(capsys, "show", "three_satellite", "--set", "truth.height_km=12")
    assert status == 0 and "height_km: 12.0  # height of the target" in out


def test_shown_scenario_runs(capsys, tmp_path):
    _, out, _ = in_process(capsys, "show", "three_satellite", *SHORT)
    (tmp_path / "mine.yaml").write_text(out)
    status, table, err = in_process(
        capsys, "run", "three_satellite", "--scenario", str(tmp_path / "mine.yaml"), "--trials", "2"
    )
    assert status == 0, err
    assert "iekf_tdoa_phase" in table


def test_run_writes_a_whole_folder_and_runs_again_from_it(tmp_path, capsys):
    done = quietfix("run", "three_satellite", "--trials", "4", "--seed", "5", *SHORT, "--out", "first", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "first").iterdir()}
    assert {"results.zarr", "summary.json", "diagram.svg"} <= names
    assert sum(name.endswith(".png") for name in names) >= 4
    summary = json.loads((tmp_path / "first" / "summary.json").read_text())
    assert summary["system"] == "three_satellite" and summary["variant"] is None
    assert summary["trials"] == 4 and summary["seed"] == 5 and len(summary["time_s"]) == 11
    row = summary["estimators"]["iekf"]
    for key in ("rmse_position_m", "median_position_m", "nees_mean", "bound_position_m", "bound_truth_position_m"):
        assert len(row[key]) == 11
    assert row["nis_mean"][0] is None and row["diverged"] == 0
    result = open_result(tmp_path / "first")
    error = (result["estimate"] - result["truth"]).sel(estimator="iekf").values[..., :3]
    np.testing.assert_allclose(row["rmse_position_m"], np.sqrt((error**2).sum(-1).mean(0)), rtol=1e-12)

    again = quietfix("run", "--from", "first", "--out", "second", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    np.testing.assert_array_equal(open_result(tmp_path / "second")["estimate"], result["estimate"])
    assert open_result(tmp_path / "second").attrs["scenario"] == result.attrs["scenario"]

    command = ["run", "three_satellite", "--trials", "1", *SHORT, "--out", str(tmp_path / "first")]
    status, _, err = in_process(capsys, *command)
    assert status == 2 and "--overwrite" in err
    assert in_process(capsys, *command, "--overwrite")[0] == 0
    assert open_result(tmp_path / "first").sizes["trial"] == 1
    assert {path.name for path in tmp_path.iterdir()} == {"first", "second"}


def test_table_warns_where_an_rmse_means_little(capsys):
    common = ["run", "bearing_crossing", "--trials", "2", "--set", "duration_s=20"]
    status, out, err = in_process(capsys, *common, "--estimator", "way2_first")
    assert status == 0, err
    assert "has no variance" in out
    assert "has no variance" not in in_process(capsys, *common, "--estimator", "ml")[1]


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_draw(capsys, tmp_path, suffix):
    file = tmp_path / f"picture.{suffix}"
    status, _, err = in_process(capsys, "draw", "three_satellite", "--out", str(file))
    assert status == 0, err
    assert file.stat().st_size > 5000
    assert is_drawing(file) == (suffix == "svg")


MISTAKES = [
    (["run", "two_satellite"], "two_satellite"),
    (["run", "three_satellite:flat"], "flat"),
    (["run"], "system"),
    (["run", "three_satellite", "--trials", "0"], "trials: 0"),
    (["run", "three_satellite", "--trials", "-1"], "trials: -1"),
    (["run", "three_satellite", "--estimator", "iekg"], "did you mean iekf"),
    (["run", "three_satellite", "--set", "truth.sigma_tdoa_ns=-1"], "truth.sigma_tdoa_ns"),
    (["run", "three_satellite", "--set", "truth.sigma_tdoa_ns=.nan"], "truth.sigma_tdoa_ns"),
    (["run", "three_satellite", "--scenario", "absent.yaml"], "absent.yaml"),
    (["run", "three_satellite", "--keep", "nothing"], "keep: nothing"),
    (["run", "three_satellite", "--set", "duration_s=1e8"], "duration_s: 1e+08"),
    (["run", "dual_satellite:signal", "--set", "sensing.snr_main_db=-400"], "sensing.snr_main_db: -400"),
    (["run", "dual_satellite:signal", "--set", "sensing.waveform.symbol_rate_mbd=1e-6"], "sensing.waveform: a band"),
    (["run", "--from", "nowhere"], "nowhere"),
    (["draw", "three_satellite", "--out", "x.pdf"], "x.pdf"),
    (["draw", "three_satellite", "--out", "/no/such/folder/x.svg"], "/no/such/folder/x.svg"),
    (["run", "three_satellite", "--trials", "1", "--out", "/proc/quietfix"], "/proc/quietfix"),
    (["gdop", "three_satellite", "--set", "satellites=[]"], "satellites: 0"),
    (["replay", "nothing"], "nothing"),
    (["replay", "locards", "--data", "/no/such/folder"], "/no/such/folder"),
]


@pytest.mark.parametrize(("arguments", "words"), MISTAKES)
def test_mistakes_are_one_line_and_status_2(capsys, arguments, words):
    status, _, err = in_process(capsys, *arguments)
    assert status == 2, err
    assert words in err
    assert err.strip().count("\n") == 0 and "Traceback" not in err


def test_wrong_type_on_the_command_line_is_status_2(capsys):
    status, _, err = in_process(capsys, "run", "three_satellite", "--trials", "many")
    assert status == 2 and "--trials" in err and "many" in err and err.strip().count("\n") == 0
    status, _, err = in_process(capsys, "fly")
    assert status == 2 and "fly" in err and err.strip().count("\n") == 0


def test_interrupt_keeps_finished_chunks_and_says_so(tmp_path):
    arguments = ["run", "three_satellite", "--trials", "100000", "--chunk", "20", "--out", "long", *SHORT]
    process = subprocess.Popen(
        [*QUIETFIX, *arguments], cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT, preexec_fn=listening
    )
    store = tmp_path / "long.partial" / "results.zarr" / "zarr.json"
    for _ in range(600):
        if store.exists():
            break
        time.sleep(0.1)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted" in err and "Traceback" not in err
    assert not (tmp_path / "long").exists()
    kept = open_result(tmp_path / "long.partial")
    assert kept.sizes["trial"] % 20 == 0 and kept.sizes["trial"] >= 20
    assert np.isfinite(kept["estimate"].values).all()


@pytest.mark.parametrize("asked", [["list"], ["show", "three_satellite"]])
def test_a_reader_that_goes_away_is_no_mistake(asked):
    """As `quietfix list | head -1` does it: nothing is said, status 0."""
    command = [sys.executable, "-u", "-m", "quietfix", *asked]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        running.stdout.readline()
        running.stdout.close()
        assert running.stderr.read() == ""
    assert running.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("asked", [["list"], ["show", "three_satellite"]])
def test_an_output_that_is_full_is_one_line(asked):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "quietfix", *asked], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2
    assert done.stderr == "quietfix: the output cannot be written (No space left on device)\n"
