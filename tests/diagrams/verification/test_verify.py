"""Verification end to end on short runs: numbers equal those of a study, looks continue it, files and exit status."""

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
from quietfix.diagrams.commands import command_line
from quietfix.diagrams.statistics.metrics import diverged, median, percentile, rmse
from quietfix.diagrams.statistics.sequential import FAILS, HOLDS, UNDECIDED
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.verification.verify import Verification, verify
from tests.interrupts import listening

PROJECT = Path(__file__).parents[3]
SHORT = "system: three_satellite\nset: [duration_s=20]\ntrials: 60\ntrial_limit: 120\nlooks: 2\nseed: 4\n"

METRICS = """
  - {name: rmse, metric: !Rmse {of: height, time_s: 20}}
  - {name: clipped, metric: !Rmse {of: position, time_s: 20, clip: 1000}}
  - {name: rmse over time, metric: !Rmse {of: position, interval_s: [5, 10, 15, 20]}}
  - {name: median, metric: !Median {of: speed, time_s: 10}}
  - {name: percentile, metric: !Percentile {of: course, percent: 80, time_s: 20}}
  - {name: spread in time, metric: !Median {of: x, interval_s: [5, 20], over_time: std}}
  - {name: worst in time, metric: !Median {of: position, interval_s: [5, 20], over_time: max}}
  - {name: mean, metric: !Mean {of: vy, time_s: 20}}
  - {name: share, metric: !Share {of: position, within: 4000, time_s: 20}}
  - {name: divergence, metric: !DivergenceRate {limit_m: 5000}}
  - {name: convergence, metric: !ConvergenceTime {threshold_m: 3000}}
  - {name: nees, metric: !Nees {interval_s: [10, 20], per_state: true}}
  - {name: nis, metric: !Nis {interval_s: [1, 20]}}
  - {name: efficiency, metric: !Efficiency {of: velocity, time_s: 20}}
  - {name: ratio, metric: !RmseRatio {of: position, to: iekf_tdoa_phase, time_s: 20}}
""".replace("}}", "}, estimator: iekf, at_least: 0, at_most: 1e9}")


def written(folder, text, name="short.requirements.yaml"):
    file = folder / name
    file.write_text(text)
    return file


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Limits that nothing breaks: what is looked at is the estimate of the last look."""
    text = SHORT.replace("120", "60").replace("looks: 2", "looks: 1") + "requirements:" + METRICS
    return verify(written(tmp_path_factory.mktemp("verify"), text))


def test_estimates_are_those_of_a_study(report):
    data = run_study(
        "three_satellite", estimators=["iekf", "iekf_tdoa_phase"], trials=60, seed=4, set=["duration_s=20"]
    )
    error = errors(data)
    one = error.sel(estimator="iekf")
    axes = (data["estimate"] - data["truth"]).sel(estimator="iekf")
    square = (one["position"] ** 2).transpose("trial", "time").values
    nis = data[["nis", "nis_dof"]].sel(estimator="iekf", time=slice(1, None)).sum()
    curve = rmse(error["position"]).sel(estimator="iekf").values
    expected = {
        "rmse": rmse(error["height"]).sel(estimator="iekf", time=20),
        "clipped": np.sqrt(np.mean(np.minimum(one["position"].sel(time=20), 1000) ** 2)),
        "rmse over time": np.sqrt(square[:, [*range(5, 11), *range(15, 21)]].mean()),
        "median": median(error["speed"]).sel(estimator="iekf", time=10),
        "percentile": percentile(error["course"], 80).sel(estimator="iekf", time=20),
        "spread in time": np.median(axes.sel(state="x", time=slice(5, 20)).std("time")),
        "worst in time": np.median(one["position"].sel(time=slice(5, 20)).max("time")),
        "mean": axes.sel(state="vy", time=20).mean(),
        "share": (one["position"].sel(time=20) <= 4000).mean(),
        "divergence": diverged(data, 5000).sel(estimator="iekf").mean(),
        "convergence": next(t for t in range(21) if (curve[t:] <= 3000).all()),
        "nees": data["nees"].sel(estimator="iekf", time=slice(10, None)).mean() / 6,
        "nis": nis["nis"] / nis["nis_dof"],
        "efficiency": rmse(error["velocity"]).sel(estimator="iekf", time=20)
        / data["bound_velocity"].sel(estimator="iekf", time=20),
        "ratio": rmse(error["position"]).sel(estimator="iekf", time=20)
        / rmse(error["position"]).sel(estimator="iekf_tdoa_phase", time=20),
    }
    found = {finding.requirement.name: finding.estimate for finding in report.findings}
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(float(value), rel=1e-9), name
    assert 0 < found["divergence"] < 1 and 0 < found["share"] < 1 and found["convergence"] > 0  # not trivial


def test_intervals_hold_their_estimate(report):
    for finding in report.findings:
        assert finding.lower <= finding.estimate <= finding.upper, finding.sentence()
        assert finding.tail == pytest.approx(0.025) and finding.trials == 60
    units = {finding.requirement.name: finding.unit for finding in report.findings}
    assert units["rmse"] == "m" and units["median"] == "m/s" and units["percentile"] == "deg"
    assert units["mean"] == "m/s" and units["convergence"] == "s" and units["ratio"] == units["nees"] == ""


LADDER = (
    SHORT
    + """
requirements:
  - {name: far below, metric: !Rmse {of: position, time_s: 20}, estimator: iekf, at_most: 9000}
  - {name: far above, metric: !Rmse {of: position, time_s: 20}, estimator: iekf, at_most: 1000}
  - {name: about there, metric: !Rmse {of: position, time_s: 20}, estimator: iekf, at_most: 3300}
"""
)


def test_three_outcomes_and_the_looks(tmp_path):
    report = verify(written(tmp_path, LADDER))
    below, above, there = report.findings
    assert (below.verdict, above.verdict, there.verdict) == (HOLDS, FAILS, UNDECIDED)
    assert (below.trials, above.trials, there.trials) == (60, 60, 120) and report.looks == (60, 120)
    assert report.status == 1 and "undecided at 120 trials" in there.sentence()
    # the second look continues the first: the same as a study of 120 trials
    data = run_study("three_satellite", estimators=["iekf"], trials=120, seed=4, set=["duration_s=20"])
    whole = float(rmse(errors(data)["position"])[0, -1])
    assert there.estimate == pytest.approx(whole, rel=1e-12)
    # alone, a requirement is judged as among others, on the same trials
    again = Verification(tmp_path / "short.requirements.yaml")
    alone = again.judge(again.specification.requirements[2])
    assert (alone.estimate, alone.lower, alone.upper) == (there.estimate, there.lower, there.upper)


def command(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        command_line.main(["verify", *map(str, arguments)])
    captured = capsys.readouterr()
    return ended.value.code or 0, captured.out, captured.err


def test_exit_status_table_and_files(tmp_path, capsys):
    rows = LADDER.splitlines(keepends=True)
    head, (good, bad, open_) = "".join(rows[:-3]), rows[-3:]
    expected = {good: 0, good + open_: 3, open_ + bad + good: 1}
    for text, status in expected.items():
        file = written(tmp_path, head + text)
        found, out, err = command(capsys, file, "--out", tmp_path / "out", "--overwrite")
        assert found == status, out + err
    for words in (
        "far below",
        "about there",
        "undecided",
        "fails",
        "holds",
        "<= 9000",
        "probability 0.05",
        "1 of 3 hold",
    ):
        assert words in out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {MARKER, "verification.json", "verification.png"}
    written_ = json.loads((tmp_path / "out" / "verification.json").read_text())
    assert written_["status"] == 1 and written_["seed"] == 4 and written_["looks"] == [60, 120]
    assert [row["verdict"] for row in written_["requirements"]] == ["undecided", "fails", "holds"]
    status, _, err = command(capsys, file, "--out", tmp_path / "out")
    assert status == 2 and "--overwrite" in err
    status, out, _ = command(capsys, file, "--trials", 60, "--seed", 5)
    assert status == 1 and "seed 5" in out and "120" not in out


MINE = '''"""An iterated filter that forgets."""

from dataclasses import dataclass

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman


@dataclass(frozen=True)
class Fading(IteratedExtendedKalman):
    """A tenth more covariance after every update."""

    def update(self, mean, covariance, observation, model):
        result = super().update(mean, covariance, observation, model)
        return result._replace(covariance=1.1 * result.covariance)
'''


def test_an_estimator_in_its_own_file_takes_part(tmp_path):
    """A class beside the requirements file, outside the project: named where an estimator is, and as a comparison."""
    (tmp_path / "my_fading.py").write_text(MINE)
    text = (
        SHORT
        + """
requirements:
  - {name: mine, metric: !Rmse {of: position, time_s: 20}, estimator: "my_fading:Fading", at_most: 9000}
  - {name: both, metric: !RmseRatio {of: position, to: "my_fading:Fading", time_s: 20}, estimator: iekf, at_most: 2}
  - {name: nees, metric: !Nees {time_s: 20}, estimator: "my_fading:Fading", at_most: 9}
"""
    )
    before = list(sys.path)
    report = verify(written(tmp_path, text))
    assert [finding.word for finding in report.findings] == ["holds"] * 3
    assert report.findings[1].estimate < 1  # it is worse than the filter that remembers
    assert sys.path == before


def test_a_system_without_that_number(tmp_path):
    """A rocket has no height above the ellipsoid, and a bias that grows with a power of time no motion of its own."""
    text = "system: beacon_rocket\nset: [stop_s=51, \"bias={_tag: '!PowerBias'}\"]\n"
    text += "trials: 60\ntrial_limit: 60\nrequirements:\n"
    row = "  - {metric: !Efficiency {of: position, time_s: 51, bound: bound_truth}, estimator: ukf, at_most: 2}\n"
    with pytest.raises(ValueError, match="estimator ukf has no such bound in this system"):
        verify(written(tmp_path, text + row))
    row = "  - {metric: !Rmse {of: bias, time_s: 51}, estimator: ukf_unaugmented, at_most: 2}\n"
    with pytest.raises(ValueError, match=r"requirements\.0\.metric\.of: bias is not known; there are position, velo"):
        verify(written(tmp_path, text + row))
    row = "  - {metric: !Rmse {of: height, time_s: 51}, estimator: ukf, at_most: 2}\n"
    with pytest.raises(ValueError, match=r"requirements\.0\.metric\.of: height is not known; there are position, velo"):
        verify(written(tmp_path, text + row))


def test_interrupt_is_status_130(tmp_path):
    file = written(tmp_path, SHORT.replace("20]", "150]").replace("120", "200000") + LADDER[len(SHORT) :])
    environment = os.environ | {"PYTHONPATH": str(PROJECT)}
    arguments = [sys.executable, "-m", "quietfix.diagrams.commands.command_line", "verify", str(file), "--out", "out"]
    process = subprocess.Popen(
        arguments, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=environment, preexec_fn=listening
    )
    for _ in range(600):
        if (tmp_path / "out.partial").exists():
            break
        time.sleep(0.1)
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted" in err and "Traceback" not in err
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "out.partial").exists() == ("chunks are kept" in err)
