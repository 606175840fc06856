"""The swap matrix: who takes part, what is compared, what it costs, and a user's own estimators in it."""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands import command_line
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.experiments.candidates import STANDARD, line_up
from quietfix.diagrams.experiments.compare import compare
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bootstrap import PairedBootstrap, interval
from quietfix.diagrams.statistics.metrics import armse, rmse
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.whole import join
from quietfix.systems.registry import ESTIMATORS

SHORT = {
    "three_satellite": ["duration_s=12"],
    "bearing_crossing": ["duration_s=40"],
    "beacon_rocket": ["stop_s=50.5"],
    "satellite_ranging": ["duration_s=100"],
    "dual_satellite": ["duration_s=12"],
}
OWN = '''
"""Two estimators of a user's, outside the project."""
from dataclasses import dataclass

import numpy as np

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Innovation
from quietfix.systems.filters.gaussian import GaussianFilter, predict_extended
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman


@dataclass(frozen=True)
class Gated(IteratedExtendedKalman):
    gate: float = 25.0

    def update(self, mean, covariance, observation, model):
        result = super().update(mean, covariance, observation, model)
        out = result.nis > self.gate
        return result._replace(
            mean=np.where(out[:, None], mean, result.mean),
            covariance=np.where(out[:, None, None], covariance, result.covariance),
        )


class DeadReckoning(Estimator):
    def memory_sizes(self):
        return {"mean": self.motion.size, "covariance": self.motion.size**2}

    def begin(self, mean, covariance, epoch):
        return {"mean": np.array(mean), "covariance": np.reshape(covariance, (len(mean), -1)).copy()}

    def moments(self, memory):
        return memory["mean"], memory["covariance"].reshape(-1, self.motion.size, self.motion.size)

    def predict(self, memory, dt, epoch):
        mean, covariance = predict_extended(*self.moments(memory), self.motion, dt)
        return {"mean": mean, "covariance": covariance.reshape(len(mean), -1)}

    def update(self, memory, observation, epoch):
        nothing = np.full(len(observation.value), np.nan)
        return memory, Innovation(observation.value - np.nan, nothing, np.zeros(len(nothing)))


class NoUpdate(GaussianFilter):
    pass


class HalfAnEstimator(Estimator):
    def predict(self, memory, dt, epoch):
        return memory


class Neither:
    pass
'''


def in_process(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        command_line.main(list(arguments))
    captured = capsys.readouterr()
    return ended.value.code or 0, captured.out, captured.err


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder with a user's file, as the current one; the module's name differs from test to test."""
    name = f"own_{abs(hash(str(tmp_path)))}"
    (tmp_path / f"{name}.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return name


@pytest.mark.parametrize("system", SHORT)
def test_the_standard_estimators_run_on_every_system(system):
    """They are put in through the registry, and what comes out is finite."""
    try:
        scenario = load_scenario(system, settings=SHORT[system])
    except UserError as error:
        pytest.skip(str(error))
    chosen = line_up(system, scenario)
    assert set(chosen.names) == {*scenario.estimators, *(name for name in STANDARD if name in ESTIMATORS)}
    assert chosen.left_out == {}
    wanted = [name for name in STANDARD if name in chosen.names]
    found = compare(system, scenario=chosen.scenario, estimators=wanted, trials=4)
    for name in wanted:
        row = found["estimators"][name]
        assert row["rmse_position_m"]["low"] <= row["rmse_position_m"]["value"] <= row["rmse_position_m"]["high"]
        assert row["cost_us"] > 0


def test_the_rest_of_the_registry_says_why_not():
    scenario = load_scenario("three_satellite", settings=SHORT["three_satellite"])
    chosen = line_up("three_satellite", scenario, ["all"])
    assert {"iekf_hypotheses", "mgekf"} <= set(chosen.names)
    assert {"crossing", "imm", "ml", "range_bank", "ra", "ra_paper", "bank"} == set(chosen.left_out)
    assert set(chosen.names) | set(chosen.left_out) | {"custom"} == {*ESTIMATORS, *scenario.estimators}
    assert chosen.left_out["ml"].startswith("it locates by bearings")
    assert "mgekf" not in scenario.estimators  # the caller's own is left as it was


def test_numbers_are_those_of_the_study():
    """The same stream, so the same RMSE as `run_study`; intervals as the bootstrap gives them one by one."""
    names = ["iekf", "ekf", "iekf_tdoa_phase"]
    settings = ["duration_s=40"]
    found = compare("three_satellite", estimators=names, trials=30, seed=2, set=settings)
    result = run_study("three_satellite", estimators=names, trials=30, seed=2, set=settings)
    error = errors(result)["position"]
    for i, name in enumerate(names):
        row = found["estimators"][name]
        curve = rmse(error).values[i]
        np.testing.assert_allclose(row["rmse_position_m"]["value"], curve[-1], rtol=1e-12)
        np.testing.assert_allclose(row["armse_position_m"]["value"], armse(curve), rtol=1e-12)
        ends = interval(PairedBootstrap(30).apply(error.values[i, :, -1:] ** 2, np.sqrt))
        np.testing.assert_allclose(row["rmse_position_m"]["high"], ends.high[0], rtol=1e-12)
        bound = float(result["bound_position"][i, -1])
        np.testing.assert_allclose(row["efficiency"]["value"], curve[-1] / bound, rtol=1e-12)
        assert not row["efficiency_means_something"]  # a straight line, and the filter has process noise
        np.testing.assert_allclose(
            row["nees_per_state"]["value"], float(result["nees"][i, :, -1].mean()) / 6, rtol=1e-12
        )
    best = found["best"]["rmse_position_m"]
    assert best["ratio"]["iekf_tdoa_phase"]["low"] > 1 and not best["significant"]  # iekf and ekf are alike
    # at another time
    middle = compare("three_satellite", estimators=names, trials=30, seed=2, set=settings, at=20.0)
    np.testing.assert_allclose(
        middle["estimators"]["ekf"]["rmse_position_m"]["value"], rmse(error).values[1, 20], rtol=1e-12
    )
    alone = compare("three_satellite", estimators=["iekf", "iekf_tdoa_phase"], trials=30, seed=2, set=settings)
    assert alone["best"]["rmse_position_m"]["name"] == "iekf" and alone["best"]["rmse_position_m"]["significant"]


def test_efficiency_where_truth_moves_as_believed():
    settings = ["duration_s=20", "truth.motion=!RandomAcceleration {}"]
    found = compare("three_satellite", estimators=["iekf"], trials=20, set=settings)
    assert found["estimators"]["iekf"]["efficiency_means_something"]
    assert found["best"]["rmse_position_m"]["runner_up"] is None
    # a rocket's thrust is none of the motion models
    rocket = compare("beacon_rocket", estimators=["ekf"], trials=3, set=["stop_s=51"])["estimators"]["ekf"]
    assert rocket["bound_position_m"] > 0 and not rocket["efficiency_means_something"]


def test_who_looks_ahead_cannot_be_the_best():
    found = compare("satellite_ranging", estimators=["ra_look_ahead", "bo"], trials=4, set=["duration_s=300"])
    assert not found["estimators"]["ra_look_ahead"]["causal"]
    assert found["best"]["armse_position_m"]["name"] == "bo"
    assert (
        found["estimators"]["ra_look_ahead"]["armse_position_m"]["value"]
        < (found["estimators"]["bo"]["armse_position_m"]["value"])
    )


def test_cost_is_the_estimators_own():
    """An estimator that burns 2 ms in every correction is charged them, its neighbour is not, and the numbers of both
    are those of an unwatched study."""
    options = {"estimators": ["ekf", "ukf"], "trials": 5, "set": ["duration_s=20"]}
    study = ComparedStudy("three_satellite", **options)
    wire = study.wire

    def slow(trials):
        wired, builder, scores = wire(trials)
        algorithm = wired.estimators["ukf"].algorithm

        class Slow(type(algorithm)):
            def update(self, *arguments):
                until = time.thread_time() + 2e-3
                while time.thread_time() < until:
                    pass
                return super().update(*arguments)

        wired.estimators["ukf"].algorithm = Slow(alpha=algorithm.alpha, beta=algorithm.beta, kappa=algorithm.kappa)
        return wired, builder, scores

    study.wire = slow
    result = join(list(study.chunks()))
    assert study.stopwatches["ekf"].steps == 20  # the first epoch is spent on the start
    assert 400 < study.costs["ukf"] < 1500  # 2 ms for 5 trials, and the filter itself
    assert study.costs["ekf"] < 400  # without them
    plain = run_study("three_satellite", **options)
    np.testing.assert_array_equal(result["estimate"], plain["estimate"])


def test_a_users_estimators_take_part(own, capsys):
    """A filter and a whole estimator, in a file in the current folder."""
    status, out, err = in_process(
        capsys,
        *["compare", "three_satellite", "--trials", "6", "--set", "duration_s=12", "--out", "result"],
        *["--estimator", "iekf", "--estimator", f"{own}:Gated", "--estimator", f"{own}:DeadReckoning"],
    )
    assert status == 0, err
    found = json.loads(Path("result/comparison.json").read_text())
    assert list(found["estimators"]) == ["iekf", "gated", "deadreckoning"]
    assert "deadreckoning" in out and "paired bootstrap" in out
    assert {"results.zarr", "summary.json", "comparison.png", "error_position.png"} <= {
        path.name for path in Path("result").iterdir()
    }
    rows = found["estimators"]
    assert rows["gated"]["rmse_position_m"] == rows["iekf"]["rmse_position_m"]  # nothing to gate here
    assert rows["deadreckoning"]["rmse_position_m"]["value"] > rows["iekf"]["rmse_position_m"]["value"]


def test_markdown_of_several_systems(capsys):
    status, out, err = in_process(
        capsys,
        *["compare", "three_satellite", "bearing_crossing", "--trials", "3", "--format", "markdown"],
        *["--estimator", "ekf", "--estimator", "ukf", "--set", "duration_s=12"],
    )
    assert status == 0, err
    lines = out.splitlines()
    rows = [line for line in lines if line.startswith("| ")]
    assert len({line.count("|") for line in rows}) == 1 and len(rows) == 1 + 2 * (1 + 2)
    assert "**bearing_crossing**" in out and "3 trials, seed 0" in out and "Python" in out


def test_variants_are_told_apart_in_markdown(capsys):
    variants = ["bearing_crossing", "bearing_crossing:northbound"]
    status, out, err = in_process(
        capsys, "compare", *variants, "--trials", "2", "--format", "markdown", "--estimator", "ekf"
    )
    assert status == 0, err
    assert "**bearing_crossing:northbound**" in out
    assert re.search(r"; bearing_crossing \d+ s, bearing_crossing:northbound \d+ s\.", out)


MISTAKES = [
    (["--estimator", "OWN:NoUpdate"], "lacks update"),
    (["--estimator", "OWN:HalfAnEstimator"], "lacks begin, memory_sizes, moments, update"),
    (["--estimator", "OWN:Neither"], "a subclass of"),
    (["--estimator", "OWN:Absent"], "has no Absent"),
    (["--estimator", "no_such_module:Filter"], "cannot be imported"),
    (["--estimator", "iekg"], "did you mean iekf"),
    (["--estimator", "ml"], "it locates by bearings"),
    (["--trials", "1"], "at least 2"),
    (["--trials", "0"], "trials: 0"),
    (["--at", "500"], "0 to 150 s"),
    (["--format", "html"], "table, markdown"),
    (["--set", "truth.sigma_tdoa_ns=-1"], "truth.sigma_tdoa_ns"),
]


@pytest.mark.parametrize(("arguments", "word"), MISTAKES, ids=[word for _, word in MISTAKES])
def test_mistakes_are_one_line(arguments, word, own, capsys):
    status, out, err = in_process(capsys, "compare", "three_satellite", *(a.replace("OWN", own) for a in arguments))
    assert status == 2 and out == "" and err.count("\n") == 1 and word in err, err


def test_a_class_without_a_method_is_refused_by_run_too(own, capsys):
    status, _, err = in_process(capsys, "run", "three_satellite", "--estimator", f"{own}:HalfAnEstimator")
    assert status == 2 and "lacks begin" in err


@pytest.mark.slow
def test_full_size_by_the_installed_command(tmp_path):
    """100 trials of the default system in a separate process; the three full filters are alike, fewer rows worse."""
    project = Path(__file__).parents[2]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "quietfix.diagrams.commands.command_line",
            "compare",
            "three_satellite",
            "--out",
            "made",
        ],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(project)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "made" / "comparison.json").read_text())
    best = found["best"]["rmse_position_m"]
    assert best["ratio"].get("iekf_tdoa_phase", {"low": 0})["low"] > 1.5
    assert not best["significant"]
