"""`quietfix live`: lines of JSON in, estimates out, the same as of a table to the last bit."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.live.session import Session
from quietfix.diagrams.own.fields.measurements import Measurements
from quietfix.diagrams.own.writing import write_measurements
from quietfix.diagrams.writers.estimates import estimate_columns

DRONE = Path(__file__).parents[1] / "own" / "drone.yaml"
STATES = ("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps")
ESTIMATORS = ("ekf", "ukf", "pf")
PARTICLES = "estimators.pf=!Pf {particles: 200}"


def session_of(write, estimators=("ekf",), settings=(), **options):
    """A session on the drone."""
    scenario = find(DRONE.as_posix()).system.load(settings=[PARTICLES, *settings])
    scenario.measurements = scenario.measurements or Measurements()
    return Session(Bench(scenario, DRONE.parent, estimators), write, **options)


def play(rows, now=0.0, **options):
    """What is told of rows, as dictionaries, and the session."""
    told = []
    session = session_of(told.append, **options)
    for row in rows:
        session.hear(row if isinstance(row, bytes) else json.dumps(row).encode(), now)
    session.settle()
    session.finish(now)
    return [json.loads(line) for line in told], session


def estimates(told):
    """The last that was said of each target, estimator and time."""
    return {(one["target"], one["estimator"], one["time_s"]): [one[name] for name in STATES] for one in told}


@pytest.fixture(scope="module")
def studied(table):
    """What `quietfix run --measurements` makes of it."""
    sets = {"measurements.file": str(table), "estimators.pf": "!Pf {particles: 200}"}
    return run_study(DRONE.as_posix(), set=sets, estimators=list(ESTIMATORS))


def compared(told, studied):
    """How many estimates are bit for bit those of a study."""
    for one in told:
        k = int(one["target"])
        epoch = int(np.flatnonzero(studied["time"].values[k] == one["time_s"])[0])
        same = studied.sel(estimator=one["estimator"]).isel(trial=k, epoch=epoch)
        assert [one[name] for name in STATES] == same["estimate"].values.tolist()
        assert one["cov_x_y"] == same["covariance"].values[0, 1]
        np.testing.assert_array_equal(np.nan if one["nis"] is None else one["nis"], float(same["nis"]))
    return len(told)


def test_it_is_the_same_as_of_a_table_bit_by_bit(rows, studied):
    told, session = play(rows, estimators=ESTIMATORS)
    assert compared(told, studied) == 3 * 2 * 21
    assert not session.refusals.total
    assert told[0]["target"] == "0" and told[0]["rows"] == 4  # three TDOAs and a height


@pytest.mark.parametrize("name", ["three_satellite", "geostationary", "ship"])
def test_other_systems_are_the_same_bit_by_bit(name, tmp_path):
    """Phases that are resolved, a height that is drawn, places by latitude, rows below the horizon: every number."""
    path = DRONE.with_name(f"{name}.yaml")
    settings = ["duration_s=8"]
    scenario = find(path.as_posix()).system.load(settings=settings)
    simulated = run_study(path.as_posix(), trials=1, set=settings, keep="all")
    write_measurements(simulated, scenario, tmp_path / "rows.csv")
    fed = run_study(path.as_posix(), set=[*settings, f"measurements.file={tmp_path / 'rows.csv'}"], keep="all")
    columns = estimate_columns(fed)
    listed = (column if isinstance(column, list) else column.tolist() for column in columns.values())
    table = [dict(zip(columns, row, strict=True)) for row in zip(*listed, strict=True)]

    scenario.measurements, told = Measurements(), []
    session = Session(Bench(scenario, path.parent, list(scenario.estimators)), told.append)
    with (tmp_path / "rows.csv").open() as file:
        for row in sorted(csv.DictReader(file), key=lambda row: float(row["time_s"])):
            session.hear(json.dumps(row).encode(), 0.0)
    session.finish(0.0)
    said = {(one["estimator"], one["time_s"]): one for one in map(json.loads, told)}
    assert len(said) == len(table) > 8
    for row in table:
        line = said[row["estimator"], row["time_s"]]
        numbers = {key for key in line if key in row and key not in ("estimator", "target")}
        assert len(numbers) > 25
        for key in numbers:
            np.testing.assert_array_equal(np.nan if line[key] is None else line[key], row[key], err_msg=key)


def test_where_nobody_knows_a_target_no_start_is_drawn_about_it(rows, tmp_path):
    (tmp_path / "truth.csv").write_text("time_s,target,x_m,y_m,z_m\n0,0,-5000,2000,900\n20,0,-4000,2000,900\n")
    told, session = play(rows, settings=["target=null", f"measurements.truth.file={tmp_path / 'truth.csv'}"])
    assert {one["target"] for one in told} == {"0"}
    assert session.refusals.counts == {"target": sum(row["target"] == "1" for row in rows)}


def test_sigmas_that_come_late_change_the_diagram_and_nothing_else(rows, table, tmp_path):
    """From 10 s on rows say that they are worse: the estimators get R with them, in a table from the beginning."""
    worse = [{**row, "sigma": 2 * float(row["sigma"])} if float(row["time_s"]) > 10 else row for row in rows]
    path = tmp_path / "worse.csv"
    with path.open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(worse)
    sets = {"measurements.file": str(path)}
    told, session = play(worse, estimators=["ekf", "ukf"])
    assert session.scaled
    assert compared(told, run_study(DRONE.as_posix(), set=sets, estimators=["ekf", "ukf"])) == 2 * 2 * 21


def test_dates_are_told_as_dates(rows):
    """t = 0 is the first line's; 23:59:50 and 15 s, with a leap second between, are 00:00:04."""

    def dated(row):
        second = int(float(row["time_s"])) + 50
        clock = f"23:59:{second}" if second <= 60 else f"00:00:{second - 61:02d}"
        day = "2016-12-31" if second <= 60 else "2017-01-01"
        return {"time": f"{day}T{clock}Z", **{k: v for k, v in row.items() if k != "time_s"}}

    told, _ = play([dated(row) for row in rows])
    plain, _ = play(rows)
    assert estimates(told) == estimates(plain)
    assert [one["time"] for one in told if one["time_s"] == 15.0] == ["2017-01-01T00:00:04Z"] * 2
    assert all("time" not in one for one in plain)


def test_rows_of_an_instant_wait_for_each_other(rows):
    told = []
    session = session_of(told.append)
    mine = [row for row in rows if row["target"] == "0"]
    at_zero = [row for row in mine if float(row["time_s"]) == 0]
    for i, row in enumerate(at_zero):
        session.hear(json.dumps(row).encode(), float(i))
        session.idle(float(i) - 0.5)
    assert not told
    session.idle(len(at_zero) - 1.0)
    assert json.loads(told[0])["rows"] == len(at_zero)
    session.hear(json.dumps(at_zero[0]).encode(), 9.0)
    assert session.refusals.counts == {"late": 1}


@pytest.mark.parametrize("seed", [0, 1])
def test_late_rows_are_run_again_to_the_bit(rows, seed):
    """Rows up to 3 s late, in any order: what is told last is what is told of rows in order."""
    random = np.random.default_rng(seed)
    when = [float(row["time_s"]) + random.uniform(0, 3) for row in rows]
    shuffled = [rows[i] for i in np.argsort(when)]
    told, session = play(shuffled, lag=4.0, estimators=ESTIMATORS)
    straight, _ = play(rows, estimators=ESTIMATORS)
    assert not session.refusals.total
    # targets are numbered, for what is drawn, as they come
    first = [next(row["target"] for row in stream) for stream in (shuffled, rows)]
    kept = [one for one in told if first[0] == first[1] or one["estimator"] != "pf"]
    wanted = estimates(one for one in straight if first[0] == first[1] or one["estimator"] != "pf")
    assert estimates(kept) == wanted
    assert any(one.get("revised") for one in told)
    assert not any(one.get("revised") for one in straight)


def test_without_lag_late_rows_are_left_out(rows):
    mine = [row for row in rows if row["target"] == "0"]
    late = [*mine[10:], *mine[:10]]
    told, session = play(late)
    assert estimates(told) == estimates(play(mine[10:])[0])
    assert session.refusals.counts == {"late": 10}


GOOD = {"time_s": 1, "kind": "tdoa", "receiver": "alpha", "reference": "delta", "value": 1e-6, "unit": "s"}
GARBAGE = [
    (b"\xff\xfe\x00", "not JSON", "an object of JSON"),
    (b"[" * 100_000, "too long", "65536 bytes"),
    (b"[" * 60_000, "not JSON", "an object of JSON"),
    (b'{"time_s": 1', "not JSON", "an object of JSON"),
    (b"[1, 2]", "not an object", "an object of JSON"),
    (b"{}", "kind", "it is missing"),
    ({**GOOD, "value": "abc"}, "value", "'abc' is not allowed; a number"),
    ({**GOOD, "value": [1]}, "value", "a number"),
    ({**GOOD, "value": True}, "value", "a number"),
    ({**GOOD, "value": 1e300}, "value", "up to 1e+15"),
    (b'{"time_s":1,"kind":"tdoa","value":' + b"9" * 5000 + b',"unit":"s"}', "not JSON", "an object"),
    ({**GOOD, "time_s": None}, "time", "seconds"),
    ({**GOOD, "time_s": -1}, "before t = 0", "1 s before t = 0"),
    ({**GOOD, "time": "2020-01-01T00:00:00Z"}, "time", "both"),
    ({**GOOD, "kind": "tdo"}, "kind", "did you mean tdoa"),
    ({**GOOD, "receiver": "echo"}, "receiver", "echo is not known"),
    ({**GOOD, "reference": "bravo"}, "reference", "bravo is not allowed"),
    ({**GOOD, "unit": "deg"}, "unit", "deg"),
    ({**GOOD, "sigma": 0}, "sigma", "> 0"),
    ({**GOOD, "target": {"a": 1}}, "target", "text"),
    ({**GOOD, "target": "x" * 1000}, "target", "at most 200 letters"),
    ({**GOOD, "kind": "azimuth", "reference": "", "value": 1e6, "unit": "deg"}, "value", "at most a turn"),
    ({**GOOD, "kind": "bearing", "reference": "", "value": 945.5, "unit": "deg"}, "value", "at most a turn"),
    ({**GOOD, "sigma": 1e-300}, "unusable", "it cannot be used"),
]


@pytest.mark.parametrize(("line", "kind", "words"), GARBAGE)
def test_garbage_is_counted_and_named_and_ends_nothing(rows, line, kind, words, capsys):
    mine = [row for row in rows if row["target"] == "0" and float(row["time_s"]) < 3]
    _, session = play([line, *({**row, "time_s": float(row["time_s"]) + 5} for row in mine)])
    assert set(session.refusals.counts) == {kind}
    err = [one for one in capsys.readouterr().err.splitlines() if "doubtful: azimuth" not in one]
    assert len(err) == 1 and re.fullmatch(rf"quietfix: live: left out: .*{re.escape(words)}.*", err[0])
    assert session.ticks >= 3


def test_what_is_doubtful_counts_all_the_same(rows, capsys):
    """Light needs 47 us from alpha to delta; a column that nobody knows means nothing."""
    early = [{**row, "sigm": 1} for row in rows if row["target"] == "0" and float(row["time_s"]) < 3]
    far = {**GOOD, "time_s": 4, "value": 60, "unit": "us"}
    _, session = play([*early, {**far, "value": 30}, {**far, "time_s": 5}])
    assert session.doubts.counts == {"column sigm": len(early), "beyond light": 1}
    err = capsys.readouterr().err
    assert "tdoa_alpha_delta: 60 us is more than the" in err and "did you mean sigma?" in err
    assert not session.refusals.total and session.ticks == 5


def test_seconds_after_dates_are_garbage():
    dated = {**{k: v for k, v in GOOD.items() if k != "time_s"}, "time": "2020-01-01T00:00:00Z"}
    _, session = play([dated, {**dated, "receiver": "bravo"}, GOOD, {**dated, "time": "2020-01-01T00:00:00"}])
    assert session.refusals.counts == {"time": 2}


def test_one_false_stamp_far_ahead_costs_itself_only(rows):
    mine = [row for row in rows if row["target"] == "0"]
    false = {**mine[30], "time_s": 1e9}
    told, session = play([*mine[:30], false, *mine[30:]])
    assert estimates(told) == estimates(play(mine)[0])
    assert session.refusals.counts == {"ahead": 1}


@pytest.mark.parametrize("stamp", ["1980-01-06T00:00:00Z", "2038-01-19T03:14:07Z"])
def test_a_first_stamp_before_the_clock_was_set_costs_itself_only(rows, stamp):
    mine = [{k: v for k, v in row.items() if k != "time_s"} for row in rows if row["target"] == "0"]
    times = [float(row["time_s"]) for row in rows if row["target"] == "0"]
    dated = [{**row, "time": f"2026-03-01T12:00:{t:02.0f}Z"} for row, t in zip(mine, times, strict=True)]
    told, session = play([{**dated[0], "time": stamp}, *dated])
    straight, _ = play(dated)
    assert estimates(told) == estimates(straight) and told[0]["time"] == "2026-03-01T12:00:00Z"
    assert session.refusals.counts == {"apart": 1}
    alone, _ = play(dated[:1])  # nothing comes after it that says otherwise
    assert [one["time"] for one in alone] == ["2026-03-01T12:00:00Z"]


def test_a_long_gap_is_believed_when_a_second_row_says_so(rows, capsys):
    mine = [row for row in rows if row["target"] == "0"]
    later = [{**row, "time_s": float(row["time_s"]) + (7200 if i >= 30 else 0)} for i, row in enumerate(mine)]
    told, session = play(later)
    assert not session.refusals.total and "nothing from" in capsys.readouterr().err
    assert estimates(told) == estimates(play(later, jump=1e6)[0])


def test_targets_without_end_fill_no_memory(monkeypatch):
    monkeypatch.setattr("quietfix.diagrams.live.session.MOST_TARGETS", 5)
    told, session = play([{**GOOD, "target": f"t{i}"} for i in range(12)])
    assert len(session.tracks) == 5 and session.given_up == 7
    assert len(told) == 12  # those that were given up are told first
