"""Every format that goes in, spoilt anywhere: the command runs, or says in one line why not; no hang, no gigabyte.

Each is a process of its own, so that a hang or a flood of memory ends that alone.
"""

import datetime
import json
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.diagrams.test_command_line import in_process
from tests.faults import anywhere, mutations

ROOT = Path(__file__).parents[2]
KINDS = ("csv", "parquet", "tdm", "sp3", "oem", "gpx", "platforms", "tle")
# hypothesis changes them so many times; OEM, GPX and platforms another 200 times each by `tests.faults.mutations`
CHANGED = {"csv": 200, "sp3": 200, "tdm": 200, "oem": 40, "gpx": 40, "platforms": 40, "parquet": 40, "tle": 200}


def spoilt(what, kind, examples, folder):
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.anywhere", what, kind, str(examples), str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["whole"] == ["ran", None], found["whole"]  # it is what is spoilt that is refused
    assert not found["faults"], "\n".join(f"{kind} {n}: {fault}" for n, fault in found["faults"].items())
    assert found["resident"] < mutations.MOST_RESIDENT
    return found["outcomes"]


def test_a_few_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    table = anywhere.kinds()["csv"]
    refused = 0
    for content in anywhere.changed(table, 10):
        Path(table.name).write_bytes(content)
        status, _, err = in_process(capsys, *table.arguments)
        assert status == 0 or (status == 2 and err.count("\n") == 1), (content, err)
        refused += status == 2
    assert refused > 2


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_cut_at_every_tenth_byte(kind, tmp_path):
    found = spoilt("cut", kind, 0, tmp_path)
    assert sum(found.values()) == -(-len(anywhere.kinds()[kind].content) // 10)
    # a file of two-line elements without its last lines has fewer objects, and nothing says how many there should be
    assert found["refused"] >= sum(found.values()) * (0.4 if kind == "tle" else 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_changed_anywhere(kind, tmp_path):
    found = spoilt("changed", kind, CHANGED[kind], tmp_path)
    # hypothesis may find that there are not so many different ones
    assert CHANGED[kind] * 0.9 <= sum(found.values()) and found["refused"] > CHANGED[kind] // 5


COLUMNS = {
    "time_s": [0.0, 0.0, 0.0],
    "kind": ["tdoa"] * 3,
    "receiver": ["alpha", "bravo", "charlie"],
    "reference": ["delta"] * 3,
    "value": [7.4, 32.6, 12.7],
    "unit": ["us"] * 3,
}
NOON = datetime.datetime(2026, 3, 1, 12)
TYPES = {
    "value": [["7.4x", "1", "2"], [[1.0]] * 3, [{"a": 1}] * 3, [b"\xff", b"1", b"2"], [NOON] * 3, [1e300, 1.0, 2.0]],
    "time_s": [["zero", "1", "2"], [NOON] * 3, [None] * 3, [float("inf"), 0.0, 0.0], [[0]] * 3],
    "kind": [[1, 2, 3], [None] * 3, [True] * 3, [b"\xff"] * 3, [["tdoa"]] * 3],
    "receiver": [[1, 2, 3], [None] * 3, [{"a": "alpha"}] * 3],
    "reference": [[1.5] * 3, [NOON] * 3],
    "unit": [[1, 2, 3], [None] * 3, [["us"]] * 3],
    "sigma": [["wide"] * 3, [True, False, True], [[1.0]] * 3, [-1.0, 1.0, 1.0]],
    "time": [[NOON] * 3, [0.0, 1.0, 2.0], ["noon"] * 3],
}


@pytest.mark.parametrize(("column", "number"), [(name, i) for name, each in TYPES.items() for i in range(len(each))])
def test_a_column_of_another_type_in_parquet(column, number, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    columns = {**COLUMNS, column: TYPES[column][number]}
    if column == "time":
        del columns["time_s"]
    pq.write_table(pa.table(columns), "m.parquet")
    arguments = ("run", anywhere.DRONE, "--measurements", "m.parquet", "--estimator", "ekf")
    status, out, err = in_process(capsys, *arguments)
    assert status == 2 and not out and err.count("\n") == 1 and len(err) < 600, err
    assert "m.parquet" in err and column in err, err
