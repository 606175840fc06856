"""Three hundred inputs that are spoilt at random: no traceback, no hang, no gigabyte.

Each batch is a process of its own, so that a hang or a flood of memory ends that alone.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from quietfix.systems.plants.sp3 import read_sp3
from tests.faults import formats, mutations

ROOT = Path(__file__).parents[2]
MOST_RESIDENT = 1_000_000_000  # bytes
FEW = {"scenario": 16, "requirements": 5, "bearings": 5, "locards": 4, "sigmf": 40, "wav": 40, "iq": 2, "sp3": 4}
FEW |= {"tdm": 40, "oem": 40, "gpx": 40, "platforms": 40}  # a millisecond each
MANY = {"scenario": 150, "requirements": 40, "bearings": 25, "locards": 15, "sp3": 20, "attributes": 20}
MANY |= {"sigmf": 200, "wav": 200, "iq": 15}
MANY |= {"tdm": 200, "oem": 200, "gpx": 200, "platforms": 200}


def batch(kind, count, folder):
    """Return what a batch of mutations did."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.mutations", kind, "0", str(count), str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60 + 60 * count,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert not found["faults"], "\n".join(f"{kind} {n}: {what}" for n, what in found["faults"].items())
    assert found["resident"] < MOST_RESIDENT
    assert sum(found["outcomes"].values()) == count
    return found["outcomes"]


@pytest.mark.parametrize("kind", FEW)
def test_forty_mutations(kind, tmp_path):
    batch(kind, FEW[kind], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", MANY)
def test_three_hundred_mutations(kind, tmp_path):
    outcomes = batch(kind, MANY[kind], tmp_path)
    assert outcomes.get("refused", 0) >= MANY[kind] // 5  # they are mutations that matter


def test_what_is_spoilt_is_good_before(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(mutations, "spoil", lambda data, rng: data)
    monkeypatch.setattr(mutations, "spoil_bytes", lambda content, rng: content)
    monkeypatch.setattr(mutations, "spoil_table", lambda text, rng: text)
    monkeypatch.setattr(formats, "spoilt", lambda text, rng, spoil_bytes: text.encode())
    for kind in ("requirements", "bearings", "locards", "sigmf", "wav", "iq", "tdm", "oem", "gpx", "platforms"):
        assert mutations.judged(kind, 1, tmp_path) == ("ran", None), kind
    (tmp_path / "o.sp3").write_text(mutations.sp3_text())
    assert read_sp3(tmp_path / "o.sp3").times.size == 14
