"""How often each command declares, wires and builds, solves and reads: a count, so that no helper builds its own."""

import pytest

from quietfix.diagrams import figures
from quietfix.diagrams.assembly.dot import Notes, diagram_dot
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study
from quietfix.diagrams.verification.verify import verify
from quietfix.systems.counting import counting

SHORT = "duration_s=5"
FACTS = ("declared", "wired", "built", "solved")

REQUIREMENTS = """
system: three_satellite
set: [duration_s=5]
trials: 30
trial_limit: 60
looks: 2
seed: 4
cases: {near: {set: [truth.sigma_tdoa_ns=20]}, far: {set: [truth.sigma_tdoa_ns=30]}}
requirements:
  - {name: a, case: near, metric: !Median {of: height, time_s: 5}, estimator: iekf, at_most: 1e9}
  - {name: b, case: far, metric: !Rmse {of: height, time_s: 5}, estimator: iekf, at_most: 2900}
"""


def facts(counts):
    return tuple(counts[what] for what in FACTS)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "--trials", "2"], (1, 2, 1, 1)),
        # drawn from the wiring that tells the facts
        (["run", "--trials", "2", "--out", "result"], (1, 2, 2, 1)),
        (["draw"], (1, 1, 1, 1)),
        (["compare", "--trials", "2", "--estimator", "iekf", "--estimator", "pf_sir", "--at", "3"], (1, 2, 1, 1)),
        # unasked, the particle filter is tried: ekf, iekf and ukf are the scenario's
        (["compare", "--trials", "2", "--at", "3"], (1, 3, 1, 1)),
        (["sweep", "--trials", "2", "--estimator", "iekf", "--vary", "truth.sigma_tdoa_ns=10,20,30"], (3, 6, 3, 3)),
        (["observe"], (1, 2, 1, 1)),
        (["observe", "--estimator", "iekf", "--estimator", "pf"], (1, 2, 1, 1)),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_command_builds_once(tmp_path, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(figures, "study_figures", lambda *_: None)  # they take seconds, and build nothing
    command, *options = arguments
    with counting() as counts, pytest.raises(SystemExit, match=r"^0$"):
        main([command, "three_satellite", "--set", SHORT, *options])
    assert facts(counts) == expected


def test_looks_go_on_with_the_diagram_of_their_case(tmp_path):
    file = tmp_path / "short.requirements.yaml"
    file.write_text(REQUIREMENTS)
    with counting() as counts:
        report = verify(file)
    assert [finding.trials for finding in report.findings] == [30, 60]  # one case looks twice
    assert facts(counts) == (2, 4, 2, 2)


def test_chunks_run_in_one_diagram():
    with counting() as counts:
        run_study("three_satellite", estimators=["iekf"], trials=5, chunk=2, set=[SHORT])
    assert facts(counts) == (1, 2, 1, 1)


@pytest.mark.parametrize(
    ("system", "settings", "solved", "read"),
    [
        ("dual_satellite", [SHORT], 1, 0),
        ("satellite_ranging", ["duration_s=190"], 2, 0),
        ("beacon_rocket", ["stop_s=50.2"], 6, 0),  # segments of the flight, between its events
        ("satellite_ranging:jason2", ["duration_s=190"], 1, 1),
    ],
)
def test_orbits_flights_and_records_are_solved_and_read_once(system, settings, solved, read, request, monkeypatch):
    if read:
        monkeypatch.setenv("QUIETFIX_DATA", str(request.getfixturevalue("recorded")("sp3").parent))
    scenario = load_scenario(*system.split(":"), settings=settings)
    with counting() as counts:
        for _ in Study(system, scenario=scenario, trials=2).chunks():
            pass
    assert (counts["solved"], counts["read"], counts["built"]) == (solved, read, 1)


@pytest.mark.parametrize(
    "system", ["three_satellite", "dual_satellite:signal", "bearing_crossing", "satellite_ranging"]
)
def test_the_picture_is_that_of_a_diagram_of_one_trial(system):
    """What is drawn was wired for two trials, and answers the same after it was built."""
    study = Study(system, trials=1)
    before = study.attributes(), study.probe.truth_names
    notes = Notes(dashed=study.probe.dashed, trials=1)
    drawn, plain = (diagram_dot(diagram, notes=notes) for diagram in (study.picture, study.diagram(1)[0]))
    assert drawn == plain
    assert (study.attributes(), study.probe.truth_names) == before
