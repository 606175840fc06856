"""Requirements files as pytest sees them: in sessions of their own, in a folder outside the project."""

import os
import subprocess
import sys
import xml.etree.ElementTree
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[3]
PLUGIN = "quietfix.diagrams.verification.pytest_plugin"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(PROJECT)}

THREE = """
system: three_satellite
set: [duration_s=10]
trials: 60
trial_limit: 60
cases: {near: {set: [truth.cross_km=50]}, far: {set: [truth.cross_km=500]}}
estimators: [iekf]
requirements:
  - {name: holds, case: near, metric: !Rmse {time_s: 10}, at_most: 9000}
  - {name: fails, case: near, metric: !Rmse {time_s: 10}, at_most: 1000}
  - {name: open, case: far, metric: !Share {within: 2500, time_s: 10}, at_least: 0.6}
"""


@pytest.fixture
def session(folder, monkeypatch, capsys):
    """A function that runs pytest in the folder, in this process; it returns exit status and what was printed."""
    monkeypatch.chdir(folder)

    def run(*arguments):
        status = pytest.main(["-p", PLUGIN, "-p", "no:cacheprovider", "--capture=sys", "-n", "0", *arguments])
        captured = capsys.readouterr()
        return int(status), captured.out + captured.err

    return run


def process(folder, *arguments):
    """Run pytest in a process of its own, as its workers need; return exit status and what was printed."""
    command = [sys.executable, "-m", "pytest", "-p", PLUGIN, "-p", "no:cacheprovider", *arguments]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False, env=ENVIRONMENT
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "three.requirements.yaml").write_text(THREE)
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers --import-mode=importlib\n")
    return tmp_path


def test_one_test_per_requirement(folder, session):
    status, out = session("-rA", "--junitxml=junit.xml")
    assert status == 1, out
    assert "1 passed" in out and "2 failed" in out and "Traceback" not in out
    assert "fails: fails; RMSE of position at 10 s of iekf in case near is " in out
    assert "m, limit <= 1000 m, confidence 0.95, 60 trials" in out
    assert (
        "open: undecided at 60 trials; share of trials with position error <= 2500 at 10 s of iekf in case far" in out
    )
    cases = list(xml.etree.ElementTree.parse(folder / "junit.xml").iter("testcase"))
    assert [case.get("name") for case in cases] == ["holds [near]", "fails [near]", "open [far]"]
    assert [len(case.findall("failure")) for case in cases] == [0, 1, 1]
    found = {p.get("name"): p.get("value") for p in cases[2].iter("property")}
    assert found["verdict"] == "undecided" and found["trials"] == "60" and 0 < float(found["lower"]) < 0.5


def test_slow_unless_the_file_says_otherwise(folder, session):
    (folder / "quick.requirements.yaml").write_text("slow: false" + THREE)
    (folder / "other.yaml").write_text(THREE)
    status, out = session("-m", "not slow", "--collect-only", "-q")
    assert status == 0, out
    assert "3/6 tests collected (3 deselected)" in out and "quick.requirements.yaml::holds [near]" in out
    # only what is selected is judged, and only its case is run
    status, out = session("-k", "holds and quick", "-q")
    assert status == 0 and "1 passed" in out


def test_a_mistake_is_one_line_at_collection(folder, session):
    (folder / "three.requirements.yaml").write_text(THREE.replace("at_most: 9000", "at_mots: 9000"))
    status, out = session()
    assert status == 2 and "Traceback" not in out
    assert "three.requirements.yaml:9: requirements.0.at_mots: at_mots is not known (did you mean at_most?)" in out
    (folder / "three.requirements.yaml").write_text(
        THREE.replace("time_s: 10}, at_most: 9000", "time_s: 99}, at_most: 9")
    )
    status, out = session("-k", "holds")
    assert status == 1 and "metric.time_s: 99 is not allowed; the run has epochs from 0 to 10 s" in out
    assert "Traceback" not in out


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["-n", "2"], ["-n", "2", "--dist", "loadgroup"], ["-p", "no:xdist"]])
def test_workers_give_the_same(folder, arguments):
    status, out = process(folder, *arguments)
    assert status == 1 and "1 passed" in out and "2 failed" in out, out


def test_the_plugin_loads_nothing_heavy():
    probe = f"import sys, {PLUGIN}; print([m for m in ('pydrake', 'numpy', 'xarray', 'scipy') if m in sys.modules])"
    command = [sys.executable, "-c", probe]
    found = subprocess.run(command, capture_output=True, text=True, check=True, env=ENVIRONMENT)
    assert found.stdout.strip() == "[]"
