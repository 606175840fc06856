"""Requirements files: what may stand in them, and mistakes as one clear line."""

import numpy as np
import pytest

from quietfix.diagrams.commands import command_line
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.sequential import FAILS, HOLDS, UNDECIDED, Limit, plan_looks
from quietfix.diagrams.verification.specification import read_specification
from quietfix.diagrams.verification.verify import Verification

GOOD = """
system: three_satellite
set: [duration_s=10]
requirements:
  - name: position
    estimator: iekf
    metric: !Rmse {of: position, time_s: 10}
    at_most: 5000
"""


def written(folder, text, name="some.requirements.yaml"):
    file = folder / name
    file.write_text(text)
    return file


def test_what_a_requirement_leaves_out_comes_from_the_file(tmp_path):
    text = GOOD.replace("    estimator: iekf\n", "").replace("  - name: position\n    metric", "  - metric")
    specification = read_specification(written(tmp_path, "confidence: 0.9\nestimators: [iekf]\n" + text))
    (requirement,) = specification.requirements
    assert requirement.estimator == "iekf" and requirement.confidence == 0.9 and requirement.case == ""
    assert requirement.name == "RMSE of position at 10 s"
    assert specification.slow and specification.looks_at() == (100, 215, 464, 1000)
    assert specification.looks_at(300) == (100, 144, 208, 300) and specification.looks_at(60) == (60,)


def test_the_looks():
    assert plan_looks(100, 100, 5) == (100,) and plan_looks(100, 1000, 1) == (1000,)
    assert plan_looks(100, 102, 9) == (100, 101, 102)
    assert plan_looks(50, 800, 5) == (50, 100, 200, 400, 800)


def test_what_follows_from_an_interval():
    above, below, band = Limit(at_least=1.0), Limit(at_most=1.0), Limit(0.0, 1.0)
    lower, upper = np.array([0.2, 0.2, 1.5, -1.0, np.nan, -np.inf]), np.array([0.8, 1.2, 2.0, -0.5, np.nan, np.inf])
    none = UNDECIDED
    np.testing.assert_array_equal(above.decide(lower, upper), [FAILS, none, HOLDS, FAILS, none, none])
    np.testing.assert_array_equal(below.decide(lower, upper), [HOLDS, none, FAILS, HOLDS, none, none])
    np.testing.assert_array_equal(band.decide(lower, upper), [HOLDS, none, FAILS, FAILS, none, none])
    # at the limit itself: allowed
    assert below.decide(0.5, 1.0) == HOLDS and above.decide(1.0, 2.0) == HOLDS and below.decide(1.0, 2.0) == none
    assert below.tail(0.95, 5) == pytest.approx(0.01) and band.tail(0.95, 5) == pytest.approx(0.005)


MISTAKES = [
    ("", "is empty; a system and its requirements"),
    ("- 1", "holds list; a mapping is needed"),
    ("system: [", "is not valid YAML"),
    ("system: two_satellite\nrequirements: []", "system: two_satellite is not known"),
    ("system: three_satellite", "requirements: none is given"),
    ("requirements: []", "system: it is missing"),
    (GOOD.replace("at_most", "at_mots"), "requirements.0.at_mots: at_mots is not known (did you mean at_most?)"),
    (GOOD + "colour: red", "colour: colour is not known"),
    (GOOD.replace("    at_most: 5000\n", ""), "requirements.0: there is no limit; at_least, at_most or both"),
    (GOOD + "    at_least: 6000\n", "requirements.0.at_least: 6000 is not allowed; less than at_most, which is 5000"),
    (GOOD + "    at_least: 5000\n", "requirements.0.at_least: 5000 is not allowed"),
    (GOOD.replace("5000", ".nan"), "requirements.0.at_most: nan is not allowed; a finite number"),
    (GOOD.replace("5000", "large"), "requirements.0.at_most: 'large' is not allowed; a number"),
    (GOOD.replace("    metric: !Rmse {of: position, time_s: 10}\n", ""), "requirements.0.metric: it is missing"),
    (GOOD.replace("!Rmse", "!Rmsee"), "requirements.0.metric: !Rmsee is not known (did you mean !Rmse?)"),
    (GOOD.replace("    estimator: iekf\n", ""), "requirements.0.estimator: it is missing"),
    (GOOD.replace("r: iekf", "r: iekg"), "estimator: iekg is not known (did you mean iekf?)"),
    ("estimators: [ukf]" + GOOD, "requirements.0.estimator: iekf is not known; there are ukf"),
    (GOOD.replace("of: position", "of: bias"), "requirements.0.metric.of: bias is not known; there are position"),
    (GOOD.replace("of: position", "of: altitude"), "requirements.0.metric.of: altitude is not known"),
    (GOOD.replace("time_s: 10", "time_s: 11"), "metric.time_s: 11 is not allowed; the run has epochs from 0 to 10 s"),
    (GOOD.replace("time_s: 10", "time_s: -1"), "metric.time_s: -1 is not allowed"),
    (GOOD.replace("time_s: 10", "time_s: .nan"), "metric.time_s: nan is not allowed"),
    (GOOD.replace(", time_s: 10", ""), "requirements.0.metric: time_s or interval_s is needed, and not both"),
    (GOOD.replace("time_s: 10", "interval_s: [5, 12]"), "interval_s: [5.0, 12.0] is not allowed; the run has epochs"),
    (GOOD.replace("time_s: 10", "interval_s: [5, 2]"), "interval_s: [5.0, 2.0] is not allowed; pairs of begin and end"),
    (GOOD.replace("time_s: 10", "interval_s: [5]"), "pairs of begin and end, rising"),
    (GOOD.replace("time_s: 10", "interval_s: [5.2, 5.4]"), "there is no epoch in it"),
    (GOOD.replace("!Rmse {of: position", "!Mean {of: position"), "metric.of: position is not allowed; an error with a"),
    (GOOD.replace("!Rmse {", "!RmseRatio {"), "requirements.0.metric.to: it is missing; another estimator"),
    (GOOD.replace("!Rmse {", "!RmseRatio {to: pdf, "), "estimator: pdf is not known"),
    (GOOD.replace("!Rmse {of: position", "!Efficiency {of: vx"), "metric.of: vx is not known; there are position"),
    (GOOD.replace("!Rmse {", "!Percentile {percent: 100, "), "metric.percent: 100 is not allowed"),
    (GOOD + "    confidence: 1\n", "requirements.0.confidence: 1 is not allowed; a number >= 0.5 and < 1"),
    (GOOD + "    confidence: 0\n", "requirements.0.confidence: 0 is not allowed"),
    (GOOD + "    confidence: .nan\n", "requirements.0.confidence: nan is not allowed"),
    ("confidence: 1.0" + GOOD, "confidence: 1.0 is not allowed"),
    (GOOD + GOOD[GOOD.index("  - name") :], "requirements.1.name: 'position' is not allowed"),
    ("trials: 200\ntrial_limit: 100" + GOOD, "trials: 200 is not allowed; at most trial_limit, which is 100"),
    ("trials: 0" + GOOD, "trials: 0 is not allowed"),
    ("looks: 0" + GOOD, "looks: 0 is not allowed"),
    ("trials: 20\ntrial_limit: 30" + GOOD, "requirements.0: 30 trials at the last look are not allowed"),
    (
        "trial_limit: 200" + GOOD.replace("!Rmse {", "!Percentile {percent: 99, "),
        "its confidence and 4 looks need at least 437 to decide it",
    ),
    ("cases: {a: {}, b: {}}" + GOOD, "requirements.0.case: it is missing; one of a, b"),
    ("cases: {a: {}}" + GOOD + "    case: c\n", "requirements.0.case: c is not known; there are a"),
    ("cases: {a: {variant: flat}}" + GOOD, "cases.a.variant: variant of three_satellite: flat is not known"),
    ("cases: {a: {set: [period_s=-1]}}" + GOOD, "case a: period_s: -1 is not allowed"),
    ("scenario: absent.yaml" + GOOD, "absent.yaml cannot be read"),
    (GOOD.replace("r: iekf", "r: my_filters:Absent"), "class: my_filters:Absent cannot be imported"),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES, ids=[words[:40] for _, words in MISTAKES])
def test_mistakes_are_one_clear_line(tmp_path, text, words):
    with pytest.raises(UserError) as caught:
        Verification(written(tmp_path, text)).build()
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert "some.requirements.yaml" in str(caught.value)


def test_a_class_without_the_needed_method(tmp_path):
    (tmp_path / "half_a_filter.py").write_text(
        "from quietfix.systems.filters.gaussian import GaussianFilter\n\n\nclass Half(GaussianFilter):\n    pass\n"
    )
    with pytest.raises(UserError, match=r"estimators\.half\.class: half_a_filter:Half lacks \w+") as caught:
        Verification(written(tmp_path, GOOD.replace("r: iekf", "r: half_a_filter:Half"))).build()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["absent.yaml"], "requirements file: absent.yaml cannot be read (No such file or directory)"),
        (["GOOD", "--trials", "0"], "--trials: 0 is not allowed"),
        (["GOOD", "--trials", "10"], "10 trials at the last look are not allowed"),
        (["GOOD", "--trials", "many"], "many is not allowed; a whole number"),
        (["GOOD", "--seed", "-1"], "--seed: -1 is not allowed"),
        (["GOOD", "--out", "/proc/quietfix"], "--out: /proc/quietfix cannot be written"),
        ([], "file"),
    ],
)
def test_mistakes_on_the_command_line_are_status_2(tmp_path, capsys, arguments, words):
    file = str(written(tmp_path, GOOD))
    with pytest.raises(SystemExit) as ended:
        command_line.main(["verify", *(file if a == "GOOD" else a for a in arguments)])
    err = capsys.readouterr().err
    assert ended.value.code == 2, err
    assert words.lower() in err.lower() and err.strip().count("\n") == 0 and "Traceback" not in err
