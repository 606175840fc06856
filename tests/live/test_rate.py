"""`quietfix live`: how many rows a second one core takes, without memory that grows, and whatever comes."""

import json
import resource
import time
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.live.session import Session
from quietfix.diagrams.own.fields.measurements import Measurements

DRONE = Path(__file__).parents[1] / "own" / "drone.yaml"
SECONDS = 3600


def session_on_the_drone(told, lag=0.0):
    scenario = find(DRONE.as_posix()).system.load()
    scenario.measurements = Measurements()
    return Session(Bench(scenario, DRONE.parent, ["ekf"]), told.append, lag=lag)


def stream(rows, seconds):
    """Rows of one target again and again, and with them the drone stands about where it was."""
    mine = [row for row in rows if row["target"] == "0"]
    for begin in range(0, seconds, 21):
        for row in mine:
            yield json.dumps({**row, "time_s": begin + float(row["time_s"])}).encode()


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.0, 10.0])
def test_a_thousand_rows_a_second(rows, lag):
    """An hour of the drone at 3.5 rows a second, and nothing is kept of it."""
    told = []
    session = session_on_the_drone(told, lag)
    lines = list(stream(rows, SECONDS))
    for line in lines[:1000]:
        session.hear(line, 0.0)
    peak, began, ticks = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter(), session.ticks
    for line in lines[1000:]:
        session.hear(line, 0.0)
        told.clear()
    took = time.perf_counter() - began
    count = len(lines) - 1000
    print(f"lag {lag:g} s: {count / took:.0f} rows/s, {(session.ticks - ticks) / took:.0f} ticks/s")
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak  # kB
    assert count / took > 1000
    assert grown < 4096  # 11000 ticks of 1 kB would be more
    (track,) = session.tracks.values()
    assert len(track.done) <= 12


NASTY = [None, True, "", "nan", "inf", 1e308, -1e15, 1e15, 1e-300, 0, -1, 3, "x", [], {}, [1], "9" * 400, 10**400, "\0"]
COLUMNS = ("time", "time_s", "target", "kind", "receiver", "reference", "value", "unit", "sigma")


def spoilt(line, random):
    """A good line as it is, with another value in a field, with other bytes, cut, or no line at all."""
    how = random.integers(6)
    at = int(random.integers(len(line)))
    if how == 0:
        said = {**json.loads(line), COLUMNS[random.integers(9)]: NASTY[random.integers(len(NASTY))]}
        return json.dumps(said).encode()
    if how == 1:
        return line[:at] + random.bytes(2) + line[at + 2 :]
    if how == 2:
        return line[:at]
    if how == 3:
        return random.bytes(40)
    return line


@pytest.mark.parametrize("seed", range(4))
def test_nothing_on_the_wire_ends_it(rows, seed):
    """Every line is a tick's row or counted, and every line that is told is JSON without NaN."""
    random = np.random.default_rng(seed)
    told = []
    session = session_on_the_drone(told, lag=5.0)
    lines = [json.dumps(row).encode() for row in rows]
    for i in range(300):
        line = spoilt(lines[min(i // 2, len(lines) - 1)], random)
        for piece in line.split(b"\n"):
            session.hear(piece, 0.0)
        if i % 40 == 0:
            session.idle(1.0)
        session.settle()
    session.finish(0.0)
    assert len(session.refusals.counts) > 5 and session.ticks > 20
    for line in told:
        json.loads(line, parse_constant=lambda text: pytest.fail(text))
