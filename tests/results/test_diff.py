"""`quietfix diff`: paired where the noise is the same, intervals that hold what they promise, what was asked for."""

import numpy as np
import pytest

from quietfix.diagrams.commands.results import difference
from quietfix.diagrams.commands.results.asked import asked_lines
from quietfix.diagrams.commands.results.difference import compared
from quietfix.diagrams.commands.results.trials import Ends
from tests.results.made import dataset, quietfix, refused, told, write


def ends(error, nees=None, lost=None, never=None):
    error = np.asarray(error, dtype=float)
    no = np.zeros(error.shape, dtype=bool)
    return Ends(
        error,
        np.ones(error.shape) if nees is None else nees,
        np.full(error.shape, np.nan),
        no if lost is None else lost,
        never if never is not None else no,
    )


def test_paired_where_seed_and_system_are_the_same(tmp_path, capsys):
    made = write(tmp_path / "a", dataset())
    closer = made["truth"] + 0.9 * (made["estimate"] - made["truth"])
    better = made.assign(estimate=closer.transpose(*made["estimate"].dims))
    write(tmp_path / "b", better.assign_attrs(scenario="a: 2\n"))
    found = told(capsys, "diff", tmp_path / "a", tmp_path / "b")
    assert found["paired"] and found["trials_in_common"] == 8
    assert found["asked"] == [{"field": "a", "a": "1", "b": "2"}]
    row = found["estimators"]["iekf"]
    # every error is 0.9 times the other one: the ratio has no spread, but for the rounding of Earth-fixed places
    assert [row["ratio"][part] for part in ("value", "low", "high")] == pytest.approx([0.9] * 3, rel=1e-6)
    assert row["b_closer"]["value"] == 1.0 and row["b_closer"]["low"] == pytest.approx(0.025 ** (1 / 8), rel=1e-9)
    assert row["rmse_b_m"]["value"] == pytest.approx(0.9 * row["rmse_a_m"]["value"], rel=1e-6)
    alone = told(capsys, "inspect", tmp_path / "a")["estimators"]["iekf"]
    assert row["rmse_a_m"]["value"] == pytest.approx(alone["rmse_position_m"], rel=1e-12)
    at = told(capsys, "diff", tmp_path / "a", tmp_path / "b", "--at", "26")
    assert at["time_a_s"] == at["time_b_s"] == 25.0
    capsys.readouterr()
    assert quietfix("diff", tmp_path / "a", tmp_path / "b") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Paired: 8 trials" in said and "asked: a: 1 in A, 2 in B" in said and "* 0.9 (0.9-0.9)" in said


def test_only_trials_that_both_have_are_paired(tmp_path, capsys):
    made = write(tmp_path / "a", dataset())
    write(tmp_path / "b", made.isel(trial=slice(3, 8)))
    found = told(capsys, "diff", tmp_path / "a", tmp_path / "b")
    assert found["trials_in_common"] == 5 and found["estimators"]["ukf"]["identical"]
    assert found["estimators"]["ukf"]["trials_a"] == 5


def test_unpaired_and_said_where_the_noise_differs(tmp_path, capsys):
    write(tmp_path / "a", dataset(seed=0))
    write(tmp_path / "b", dataset(seed=1))
    found = told(capsys, "diff", tmp_path / "a", tmp_path / "b")
    assert not found["paired"] and found["why_not_paired"] == "the seed is 0 in A and 1 in B"
    assert "b_closer" not in found["estimators"]["iekf"]
    capsys.readouterr()
    assert quietfix("diff", tmp_path / "a", tmp_path / "b") == 0
    assert "Not paired: the seed is 0 in A and 1 in B" in " ".join(capsys.readouterr().out.split())


def test_what_cannot_be_told_apart_is_refused(tmp_path, capsys):
    write(tmp_path / "a", dataset(names=("iekf", "ukf")))
    write(tmp_path / "b", dataset(names=("ekf", "pf")))
    assert "no estimator is in both" in refused(capsys, "diff", tmp_path / "a", tmp_path / "b")
    assert "at: 999 is not allowed; 0 to 100 s" in refused(
        capsys, "diff", tmp_path / "a", tmp_path / "a", "--at", "999"
    )
    write(tmp_path / "c", dataset(names=("ekf",)))
    write(tmp_path / "d", dataset(names=("iekf",)))
    assert list(told(capsys, "diff", tmp_path / "c", tmp_path / "d")["estimators"]) == ["ekf, iekf"]


@pytest.mark.parametrize("paired", [True, False])
def test_the_two_ways_to_an_interval_agree(paired, monkeypatch):
    """Of 2000 trials of Gaussian errors bootstrap and normal distribution differ by a few percent of the width."""
    rng = np.random.default_rng(5)
    common = rng.standard_normal(2000)
    a, b = ends(100 * abs(common)), ends(90 * abs(common + 0.3 * rng.standard_normal(2000)))
    slow = compared(a, b, paired, 0.95)
    monkeypatch.setattr(difference, "MANY", 10)
    fast = compared(a, b, paired, 0.95)
    for name in ("ratio", "rmse_a_m", "rmse_b_m"):
        width = slow[name]["high"] - slow[name]["low"]
        for part in ("low", "high"):
            # 9999 resamples know a limit to about 2 % of the width
            assert fast[name][part] == pytest.approx(slow[name][part], abs=0.08 * width), (name, part)
    assert fast["ratio"]["value"] == pytest.approx(slow["ratio"]["value"], rel=1e-12)  # sums in another order


def test_pairing_narrows_the_interval_and_it_covers_the_truth():
    """Errors that share most of their noise; the true ratio is known. 200 repetitions of the 95 % interval."""
    rng = np.random.default_rng(1)
    inside, widths = 0, []
    for _ in range(200):
        common = rng.standard_normal(5000)
        a, b = ends(abs(common)), ends(abs(1.1 * common + 0.2 * rng.standard_normal(5000)))
        true = np.sqrt(1.1**2 + 0.2**2)
        found = {paired: compared(a, b, paired, 0.95)["ratio"] for paired in (True, False)}
        inside += found[True]["low"] <= true <= found[True]["high"]
        widths.append([found[paired]["high"] - found[paired]["low"] for paired in (True, False)])
    # binomial(200, 0.95): mean 190, standard deviation 3.1
    assert 179 <= inside <= 200
    paired, unpaired = np.mean(widths, axis=0)
    assert paired < 0.5 * unpaired


def test_lost_trials_and_those_that_never_started():
    nan = np.nan
    never = np.array([False, True, False, False])
    a = ends([1.0, np.inf, 2.0, 3.0], never=never)
    b = ends([1.0, 1.0, np.inf, 3.0], nees=np.array([1.0, 1.0, nan, 1.0]), lost=np.array([False, False, True, False]))
    found = compared(a, b, True, 0.95)
    assert found["trials_a"] == found["trials_b"] == 3
    assert found["rmse_a_m"]["value"] == pytest.approx(np.sqrt(14 / 3)) and found["rmse_b_m"]["value"] is None
    assert found["ratio"]["value"] is None and found["nees_b"]["value"] is None
    assert (found["diverged_b"], found["not_started_a"]) == (1, 1) and not found["identical"]
    assert found["b_closer"] == {"value": 0.0, "low": 0.0, "high": pytest.approx(0.975), "trials": 1}


def test_what_was_asked_is_told_in_the_words_of_the_files():
    files = '{"cone.py": "sha256:%s", "kept.py": "sha256:3"}'
    was = {"system": "own.yaml", "system_file": "/a/own.yaml", "system_fingerprint": "sha256:1", "keep": "estimates"}
    now = {**was, "system_fingerprint": "sha256:2", "system_files": files % "7", "seed": 1}
    was["scenario"] = "sensors: {tdoa: !Tdoa {sigma_ns: 30.0, mask: null}}\nwidth: 4\n"
    now["scenario"] = (
        "sensors:\n  tdoa: !Tdoa {sigma_ns: 60.0, mask: null}\n  line: !Custom {class: 'cone:Cone', every_s: 0.5,"
        " gate: null, errors: {rate: 0.0}, platforms: [delta]}\nwidth: 4\n"
    )
    assert asked_lines(was, now) == [
        "sensors.tdoa.sigma_ns: 30 in A, 60 in B",
        "sensors.line: only in B: !Custom {class: cone:Cone, every_s: 0.5, platforms: [delta]}",
        "seed: only in B: 1",
        "file cone.py: only in B",
        "file kept.py: only in B",
        "file own.yaml: has changed between A and B",
    ]
    changed = {**now, "system_files": files % "8"}
    assert asked_lines(now, changed) == ["file cone.py: has changed between A and B"]
    assert asked_lines(now, now) == []
    ones, twos = ({"scenario": "".join(f"f{k}: {value}\n" for k in range(30))} for value in (1, 2))
    told = asked_lines(ones, twos)
    assert (len(told), told[0], told[-1]) == (21, "f0: 1 in A, 2 in B", "10 fields more, which --json has")
