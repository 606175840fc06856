"""The benchmarks work, and compare what they say they compare; how fast anything is, is not asserted."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stonesoup", reason="the bench extra is not installed")
pytest.importorskip("filterpy", reason="the bench extra is not installed")

from stonesoup.types.array import StateVectors
from stonesoup.types.state import ParticleState

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.geometry.body_frame import body_frame
from quietfix.systems.measurement.stack import Stack
from tests.benchmarks.__main__ import main
from tests.benchmarks.agreement import agreement
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.own_peers import loop
from tests.benchmarks.particle_filter import Measurement as ParticleMeasurement
from tests.benchmarks.particle_filter import bootstrap, make_scene
from tests.benchmarks.recorded_pass import RecordedPass, record_pass
from tests.benchmarks.registry import COMPARISONS
from tests.benchmarks.report import Section, Threshold, markdown, spread, text
from tests.benchmarks.single_target import SingleTarget
from tests.benchmarks.stone_soup_peers import iterated
from tests.peak_memory import peak_bytes

TINY = Size(tiny=True, rounds=1)
ROOT = Path(__file__).resolve().parents[2]
CHILD = [sys.executable, "-m", "tests.benchmarks.one_study", "0", "6"]


@pytest.fixture(scope="module")
def recorded() -> RecordedPass:
    return record_pass(TINY)


@pytest.mark.slow
def test_all_comparisons_run_and_are_written(tmp_path, capsys):
    file = tmp_path / "bench.md"
    assert main(["--tiny", "--markdown", str(file)]) == 0
    printed, written = capsys.readouterr().out, file.read_text()
    titles = "Iterated extended", "Drake diagram against", "Extended and unscented", "Whole study", "Satellite ranging"
    for title in titles:
        assert title in printed and f"**{title}" in written
    assert sum(line.startswith("| --- |") for line in written.splitlines()) == len(COMPARISONS)
    assert "not judged" in written and "NOT MET" not in written
    assert "one BLAS thread" in written and "numpy" in written
    assert "nan" not in written.replace("KalmanUpdater", "")


def test_the_plain_loop_makes_the_estimates_of_the_packaged_diagram(recorded):
    means, _ = loop(recorded.algorithm, recorded)
    # the same functions on the same numbers; the wires between them copy doubles
    np.testing.assert_allclose(means, recorded.estimate, rtol=1e-12)


def test_a_missing_first_epoch_is_the_only_thing_missing(recorded):
    assert np.isnan(recorded.measurement[0]).all()
    assert np.isfinite(recorded.measurement[1:]).all()
    assert recorded.measurement.shape == (7, 4, 6)
    assert recorded.work == 24 and recorded.first(1).work == 6


def test_measurement_function_of_one_target_is_the_models(recorded):
    assert isinstance(recorded.model, Stack)
    units = np.array([SPEED_OF_LIGHT, SPEED_OF_LIGHT, 1, 1, 1, 1])
    for epoch in (1, 6):
        state, platforms = recorded.estimate[epoch, 2], recorded.platforms[epoch]
        value, jacobian = recorded.model.linearize(state[None], platforms)
        for speed, scale in ((SPEED_OF_LIGHT, np.ones(6)), (1.0, units)):
            one = SingleTarget(recorded.model, platforms[0], speed)
            # differences of ranges of 1e6 m, 1e4 m long, keep 13 digits
            np.testing.assert_allclose(one.function(state), value[0] * scale, rtol=1e-11)
            rows = jacobian[0] * scale[:, None]
            error = np.abs(one.jacobian(state) - rows) / np.abs(rows).max(axis=-1, keepdims=True)
            assert error.max() < 1e-11


@pytest.mark.parametrize("linearisations", [2, 3])
def test_stone_soup_is_given_the_same_number_of_linearisations(recorded, linearisations):
    # A tolerance that is never reached, so that the limit decides; one linearisation more or less moves the
    # estimate of this pass by metres.
    limited = dataclasses.replace(recorded, algorithm=IteratedExtendedKalman(linearisations, 1e-12))
    with pytest.warns(UserWarning, match="did not converge"):
        theirs = iterated(limited).run()
    agreement(loop(limited.algorithm, limited), theirs).require(1e-4, 1e-6, "both")
    longer = loop(IteratedExtendedKalman(linearisations - 1, 1e-12), limited)
    assert agreement(longer, theirs).position > 0.01


def test_disagreement_and_nan_are_refused(recorded):
    mean, covariance = loop(recorded.algorithm, recorded)
    exact = agreement((mean, covariance), (mean, covariance))
    assert "agree" in exact.require(1e-9, 1e-9, "it and itself")
    for spoiled in (mean + 1e-3, np.where(mean == mean[-1, -1, -1], np.nan, mean)):
        with pytest.raises(ArithmeticError, match="not so"):
            agreement((mean, covariance), (spoiled, covariance)).require(1e-4, 1e-6, "these")
    with pytest.raises(ArithmeticError, match="not so"):
        agreement((mean, covariance), (mean, covariance * 1.001)).require(1e-4, 1e-6, "these")


def test_peers_take_turns_and_the_first_changes():
    calls: list[str] = []
    peers = [Peer(name, lambda name=name: calls.append(name), work=5) for name in "ab"]
    timings = race(peers, Size(tiny=True, rounds=3))
    assert "".join(calls) == "ab" + "ab" + "ba" + "ab"
    assert [len(timing.costs) for timing in timings.values()] == [3, 3]
    assert all(cost > 0 for cost in ratios(timings["a"], timings["b"]))


def test_a_long_run_takes_part_by_part(monkeypatch):
    monkeypatch.setattr(Size, "slices", 2)
    calls: list[str] = []
    long = Peer("long", lambda: calls.append("L"), 1, [lambda: calls.append("1"), lambda: calls.append("2")])
    short = Peer("short", lambda: calls.append("s"), 1)
    race([long, short], Size(tiny=True, rounds=1))
    assert "".join(calls) == "Ls" + "1s" + "s2"


def test_parts_of_stone_soup_are_its_whole_run(recorded):
    peer = iterated(recorded)
    whole, parts = peer.run(), [part() for part in peer.parts(2)]
    for k in (0, 1):
        np.testing.assert_array_equal(np.concatenate([part[k] for part in parts], axis=1), whole[k])
    assert peer.parts(1) == peer.parts(3) == []


def test_ratios_are_of_the_same_round():
    timings = race([Peer("a", lambda: None, 1), Peer("b", lambda: None, 1)], TINY)
    timings["a"].costs, timings["b"].costs = [6.0, 8.0, 10.0], [2.0, 1.0, 2.0]
    assert ratios(timings["a"], timings["b"]) == [3.0, 8.0, 5.0]
    assert timings["a"].median == 8.0


def test_thresholds_are_judged_by_the_median():
    section = Section("title", ("one", "two"))
    assert section.judge([39, 41, 43], Threshold(40, at_least=True)) == "met"
    assert section.judge([1.2, 1.31, 1.4], Threshold(1.3, at_least=False)) == "NOT MET"
    assert section.missed == 1
    assert Section("title", (), judged=False).judge([0], Threshold(40, at_least=True)) == "not judged"
    assert (str(Threshold(40, at_least=True)), str(Threshold(1.3, at_least=False))) == (">= 40", "<= 1.3")


def test_tables_line_up():
    section = Section("Title", ("a", "bcd"), [("12345", "1")], ["a note"])
    assert text(section).splitlines() == ["Title", "", "a      bcd", "-----  ---", "12345  1", "", "- a note"]
    assert markdown(section).splitlines()[2:5] == ["| a | bcd |", "| --- | --- |", "| 12345 | 1 |"]


def test_numbers_are_short():
    assert spread([1.2345, 40.04, 1030.4]) == "40.0 (1.23 - 1030)"


def test_a_number_of_rounds_below_one_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--tiny", "--rounds", "0"])
    assert stop.value.code == 2
    assert "--rounds: 0 is not allowed" in capsys.readouterr().err


def test_peak_memory_is_that_of_the_process_and_not_of_its_parent():
    ballast = np.ones(50_000_000)  # 400 MB, all of it touched
    mine = peak_bytes() / 1e6
    assert mine > ballast.nbytes / 1e6
    child = json.loads(subprocess.run(CHILD, capture_output=True, text=True, check=True, cwd=ROOT).stdout)
    assert 20 < child["megabytes"] < mine - 200  # Python, NumPy and Drake take their share


def test_stone_soup_measures_what_the_particle_filters_of_the_packaged_diagram_measure():
    scene = make_scene("pf", 50, 1, 2.0)
    model = scene.estimator.model
    direction, _, doppler = model.models
    states = np.concatenate([scene.prior[0], np.array([100.0, -50.0, 20.0])]) + np.arange(30).reshape(5, 6) * 100.0
    own = model.predict(states, scene.platforms[1]) * [1.0, 1.0, SPEED_OF_LIGHT, 1.0]
    axes = body_frame(scene.platforms[1], direction.platform, direction.earth_rate)
    peer = ParticleMeasurement(
        ndim_state=6,
        mapping=(0, 1, 2, 3, 4, 5),
        noise_covar=np.eye(4),
        platforms=scene.platforms[1],
        axes=axes,
        carrier=doppler.carrier,
    )
    theirs = np.asarray(peer.function(ParticleState(StateVectors(states.T))), dtype=float).T
    np.testing.assert_allclose(theirs, own, rtol=1e-9)
    # and both are at work: at the start the two means are those of 50 particles each of one prior
    apart = bootstrap(scene, 50)[0, :3] - scene.prior[0]
    assert np.linalg.norm(apart) < 30e3
