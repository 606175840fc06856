"""A user's own estimator class that is wrong: one line that names it, whatever it does."""

import sys

import numpy as np
import pytest

from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.judging.comparing import compare_command
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.whole import run_study
from quietfix.diagrams.verification.verify import verify

FILTERS = """
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

class Raises(IteratedExtendedKalman):
    def update(self, *arguments):
        raise ZeroDivisionError("in my update")

class Narrow(IteratedExtendedKalman):
    def update(self, *arguments):
        result = super().update(*arguments)
        return result._replace(mean=result.mean[:, :3])

class Nothing(IteratedExtendedKalman):
    def update(self, *arguments):
        return None

class Iekf(IteratedExtendedKalman):
    pass

class HalfLost(IteratedExtendedKalman):
    def update(self, *arguments):
        result = super().update(*arguments)
        mean = result.mean.copy()
        mean[::2] = float("nan")
        return result._replace(mean=mean)
"""


@pytest.fixture(autouse=True)
def filters(tmp_path, monkeypatch):
    (tmp_path / "wrong_filters.py").write_text(FILTERS, encoding="utf-8")
    (tmp_path / "wrong_file.py").write_text("x = 1 / 0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("wrong_filters", None)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("wrong_filters:Raises", r"ZeroDivisionError: in my update \(wrong_filters.py, line 6\)"),
        ("wrong_filters:Narrow", r"estimate has the shape \(4, 3\); \(4, 6\) is expected"),
        ("wrong_filters:Nothing", "AttributeError"),
        ("wrong_file:Any", "cannot be imported .ZeroDivisionError"),
    ],
)
def test_a_class_that_fails_is_named_in_one_line(name, said):
    with pytest.raises(UserError, match=said) as caught:
        run_study("three_satellite", estimators=[name], trials=4, set={"duration_s": 3})
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_a_class_does_not_take_the_place_of_another_estimator():
    for taken in ("iekf", "pf"):
        scenario = load_scenario("three_satellite")
        before = dict(scenario.estimators)
        with pytest.raises(UserError, match=f"called {taken}"):
            select_estimators(scenario, [f"my:{taken.capitalize()}"])
        assert scenario.estimators == before
    scenario = load_scenario("three_satellite")
    assert select_estimators(scenario, ["my:Gated", "my:Gated"]) == ["gated"]
    with pytest.raises(UserError, match="called gated"):
        select_estimators(scenario, ["yours:Gated"])


def test_trials_that_are_lost_do_not_drop_out_of_nees_and_nis(tmp_path):
    file = tmp_path / "lost.yaml"
    file.write_text(
        "system: three_satellite\ntrials: 120\ntrial_limit: 120\nlooks: 1\nset: [duration_s=3]\nrequirements:\n"
        '  - {name: a, estimator: "wrong_filters:HalfLost", metric: !Nees {time_s: 3}, at_most: 12}\n'
        '  - {name: b, estimator: "wrong_filters:HalfLost", metric: !Nis {interval_s: [1, 3]}, at_most: 2}\n',
        encoding="utf-8",
    )
    report = verify(file)
    assert report.status == 1 and all(np.isinf(finding.estimate) for finding in report.findings)


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (
            "{name: b, estimator: default, metric: !Rmse {time_s: 2}, at_most: 2.0e4}",
            "requirements.1.estimator: default",
        ),
        ('{name: b, estimator: "other:Raises", metric: !Rmse {time_s: 2}, at_most: 2.0e4}', "called raises"),
        (
            "{name: b, estimator: iekf, metric: !RmseRatio {to: default, time_s: 2}, at_most: 2.0}",
            "requirements.1.metric.to: default",
        ),
    ],
)
def test_a_requirement_is_about_one_estimator(tmp_path, second, said):
    file = tmp_path / "x.yaml"
    first = '{name: a, estimator: "wrong_filters:Raises", metric: !Rmse {time_s: 2}, at_most: 2.0e4}'
    head = "system: three_satellite\ntrials: 60\ntrial_limit: 60\nlooks: 1\nset: [duration_s=2]\nrequirements:\n"
    file.write_text(f"{head}  - {first}\n  - {second}\n", encoding="utf-8")
    with pytest.raises(UserError, match=said):
        verify(file)


def test_compare_sees_every_folder_and_repetition_before_it_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("quietfix.diagrams.commands.judging.comparing.prepare", lambda *a, **k: pytest.fail("it ran"))
    with OutputFolder(tmp_path / "bearing_crossing") as folder:
        folder.finish()
    with pytest.raises(UserError, match="holds an earlier result"):
        compare_command(["three_satellite", "bearing_crossing"], {}, None, "table", tmp_path, False)
    with pytest.raises(UserError, match="given twice"):
        compare_command(["three_satellite", "three_satellite"], {}, None, "table", None, False)


def test_files_of_the_same_name_beside_two_requirements_files_are_two(tmp_path):
    statuses = []
    for folder, offset in (("a", 0.0), ("b", 1e6)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same_name.py").write_text(
            "from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman\n\n\n"
            "class Shifted(IteratedExtendedKalman):\n    def update(self, *arguments):\n"
            "        result = super().update(*arguments)\n"
            f"        return result._replace(mean=result.mean + {offset})\n",
            encoding="utf-8",
        )
        file = tmp_path / folder / "x.yaml"
        file.write_text(
            "system: three_satellite\ntrials: 60\ntrial_limit: 60\nlooks: 1\nset: [duration_s=2]\nrequirements:\n"
            '  - {name: r, estimator: "same_name:Shifted", metric: !Rmse {time_s: 2}, at_most: 2.0e4}\n',
            encoding="utf-8",
        )
        statuses.append(verify(file).status)
    assert statuses == [0, 1]


def test_lost_trials_make_the_nees_infinite():
    from quietfix.diagrams.experiments.compare import compare
    from quietfix.diagrams.tables.comparison import comparison_table

    found = compare(
        "three_satellite", estimators=["iekf", "wrong_filters:HalfLost"], trials=6, set=["duration_s=3"], seed=1
    )
    row = found["estimators"]["halflost"]
    assert row["nees_per_state"]["value"] is None and row["nees_verdict"] == "high"
    assert found["estimators"]["iekf"]["nees_per_state"]["value"] is not None
    assert comparison_table(found).columns  # it can be printed
