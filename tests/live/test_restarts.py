"""`quietfix live`: what is known is kept in a file, and a restart goes on to the bit; signals end it in order."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.command_line import app
from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.live.session import Session
from quietfix.diagrams.live.sources import Datagrams, Followed, Splitter, StandardInput
from quietfix.diagrams.live.state_file import digest_of, read_state, restore, write_state
from quietfix.diagrams.own.fields.measurements import Measurements
from quietfix.diagrams.schema.errors import UserError
from tests.interrupts import listening

PROJECT = Path(__file__).parents[2]
DRONE = PROJECT / "tests" / "own" / "drone.yaml"
ESTIMATORS = ["ekf", "pf"]


def begun(told, path=None, lag=0.0):
    """A session on the drone, that goes on from a file."""
    scenario = find(DRONE.as_posix()).system.load(settings=["estimators.pf=!Pf {particles: 50}"])
    scenario.measurements = Measurements()
    session = Session(Bench(scenario, DRONE.parent, ESTIMATORS), told.append, lag=lag)
    if path is not None:
        restore(session, read_state(path, "same"), path)
    return session


def hear(session, rows):
    for row in rows:
        session.hear(json.dumps(row).encode(), 0.0)
    session.settle()


def by_tick(told):
    """What was said last of each tick."""
    found = {}
    for line in told:
        said = json.loads(line)
        key = (said["target"], said["estimator"], said["time_s"])
        found[key] = {name: value for name, value in said.items() if name not in ("revised", "left_out")}
    return found


@pytest.fixture(scope="module")
def swapped(rows):
    """Rows some of which are late, and others that say their sigma."""
    mixed = list(rows)
    for i in range(0, len(mixed) - 9, 9):
        mixed[i], mixed[i + 8] = mixed[i + 8], mixed[i]
    return [
        {**row, "sigma": ""} if i < 70 else {**row, "sigma": 2 * float(row["sigma"])} for i, row in enumerate(mixed)
    ]


@pytest.mark.parametrize("cut", [5, 60, 100])
def test_cut_anywhere_and_gone_on_with_it_is_the_same_bit_by_bit(swapped, tmp_path, cut):
    whole = []
    session = begun(whole, lag=5.0)
    hear(session, swapped)
    session.finish(0.0)

    first, second, path = [], [], tmp_path / "state"
    session = begun(first, lag=5.0)
    hear(session, swapped[:cut])
    write_state(path, session, "same", {})
    session.finish(0.0)  # as at the end of a stream: what is told of the last tick is told again by the next
    session = begun(second, path, lag=5.0)
    hear(session, swapped[cut:])
    session.finish(0.0)
    assert by_tick([*first, *second]) == by_tick(whole)
    assert session.refusals.total == 0 and session.lines == len(swapped)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["state"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "it is no state of quietfix live"),
        ("[]", "it is no state of quietfix live"),
        ('{"quietfix_live": 99}', "of version 99"),
        ('{"quietfix_live": 1, "digest": "x"}', "it is of another scenario or other estimators"),
        (b"\xff\x00", "it is no state of quietfix live"),
    ],
)
def test_what_is_no_state_is_refused(tmp_path, content, words):
    path = tmp_path / "state"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError, match=words):
        read_state(path, "same")


def test_a_broken_state_is_told_in_one_line(rows, tmp_path):
    """Each field of it removed or turned into something else."""
    path = tmp_path / "state"
    session = begun([], lag=3.0)
    hear(session, rows[:20])
    write_state(path, session, "same", {})
    whole = json.loads(path.read_text())
    keys = [key for key in whole if key not in ("quietfix_live", "digest", "place")]
    targets = whole["targets"][0]
    broken = [{k: v for k, v in whole.items() if k != key} for key in keys]
    broken += [{**whole, "targets": [{k: v for k, v in targets.items() if k != key}]} for key in targets]
    moment = targets["moment"]
    for key in moment:
        broken.append({**whole, "targets": [{**targets, "moment": {**moment, key: ["x"]}}]})
    broken.append({**whole, "targets": [{**targets, "moment": {**moment, "discrete": [[1.0]]}}]})
    session = begun([])
    for said in broken:
        path.write_text(json.dumps(said))
        with pytest.raises(UserError, match=r"broken|it is of other"):
            restore(session, read_state(path, "same"), path)


def test_another_scenario_has_another_digest():
    system = find(DRONE.as_posix()).system
    first, other = system.load(), system.load(settings=["sensors.tdoa.sigma_ns=31"])
    digests = {digest_of(first, ["ekf"]), digest_of(other, ["ekf"]), digest_of(first, ["ukf"])}
    assert len(digests) == 3 and digest_of(system.load(), ["ekf"]) in digests


def test_lines_are_cut_from_pieces():
    splitter = Splitter()
    assert splitter.feed(b"ab") == [] and splitter.feed(b"c\nde\n\nf") == [b"abc", b"de", b""]
    assert splitter.waiting == 1 and splitter.end() == [b"f"] and splitter.end() == []
    for _ in range(30):
        assert splitter.feed(b"x" * 10_000) == []
        assert splitter.waiting <= 1 << 16  # what is too long is not kept
    (long, good) = splitter.feed(b"x\ngood\n")
    assert len(long) > 1 << 16 and good == b"good"


def drained(source):
    """Lines until none comes at two looks."""
    found = []
    idle = 0
    while idle < 2:
        lines = source.read(0.0)
        idle = 0 if lines else idle + 1
        found += lines
    return found


def test_a_file_is_followed_through_rotation_and_truncation(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"1\n2\n3")
    source = Followed(path)
    assert drained(source) == [b"1", b"2"]
    place = source.place()
    with path.open("ab") as file:
        file.write(b"3\n")
    assert drained(source) == [b"33"]
    path.rename(tmp_path / "log.1")
    with (tmp_path / "log.1").open("ab") as file:
        file.write(b"4\n")
    assert drained(source) == [b"4"]
    path.write_bytes(b"5\n")
    assert drained(source) == [b"5"]
    path.write_bytes(b"")
    assert drained(source) == []
    path.write_bytes(b"6\n")
    assert drained(source) == [b"6"]
    source.close()
    again = Followed(tmp_path / "log.1", place)
    assert drained(again) == [b"33", b"4"]
    again.close()
    (tmp_path / "log.1").write_bytes(b"9\n9\n9\n9\n")  # the same file by its number, with something else in it
    other = Followed(tmp_path / "log.1", place)
    assert len(drained(other)) == 4
    other.close()


def test_lines_come_in_datagrams(capsys):
    source = Datagrams("127.0.0.1:0")
    assert str(source.port) in capsys.readouterr().err
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"1\n2", ("127.0.0.1", source.port))
        sender.sendto(b"", ("127.0.0.1", source.port))
        sender.sendto(b"3\n", ("127.0.0.1", source.port))
    found = []
    while b"3" not in found:
        lines = source.read(5.0)
        assert lines, "a datagram to oneself is there at once"
        found += [line for line in lines if line]
    assert found == [b"1", b"2", b"3"]
    assert source.read(0.0) == []
    with pytest.raises(UserError, match="cannot be had"):
        Datagrams(f"127.0.0.1:{source.port}")
    source.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["x"], "source: x is not allowed"),
        (["-", "--udp", "127.0.0.1:0"], "not several"),
        (["--udp", "127.0.0.1"], "HOST:PORT"),
        (["--udp", "127.0.0.1:99999"], "a port from 0 to 65535"),
        (["--follow", "nowhere"], "nowhere cannot be read"),
        (["--follow", "."], ". is not allowed; a file"),
        (["--state", "no/folder/state"], "there is no such folder"),
        (["--lag", "-1"], "--lag: -1 is not allowed"),
        (["--wait", "nan"], "--wait: nan is not allowed"),
        (["--jump", "inf"], "--jump: inf is not allowed"),
        (["--estimator", "ekff"], "did you mean ekf"),
        (["--set", "sensors.tdoa.sigma_ns=-1"], "sigma_ns"),
        (["--set", "target=null"], "start: !Prior is drawn about the truth"),
    ],
)
def test_mistakes_in_what_is_asked_for(options, words):
    told = CliRunner().invoke(app, ["live", str(DRONE), *options])
    assert isinstance(told.exception, UserError) and words in str(told.exception), told.exception
    assert "\n" not in str(told.exception)


def test_it_is_for_systems_in_yaml():
    told = CliRunner().invoke(app, ["live", "three_satellite"])
    assert "a system of one's own in YAML" in str(told.exception)


def running(folder, *options):
    """The command in a process of its own, its output in files."""
    command = [sys.executable, "-m", "quietfix", "live", str(DRONE), "--estimator", "ekf", *options]
    environment = os.environ | {"PYTHONPATH": str(PROJECT)}
    folder.mkdir()
    with (folder / "out").open("w") as out, (folder / "err").open("w") as err:
        return subprocess.Popen(command, env=environment, cwd=PROJECT, preexec_fn=listening, stdout=out, stderr=err)


def ended(process, folder, count, number):
    """What a process says that gets a signal as soon as it has written so many lines."""
    waited = time.monotonic() + 60
    while len((folder / "out").read_text().splitlines()) < count:
        assert process.poll() is None and time.monotonic() < waited, (folder / "err").read_text()
        time.sleep(0.02)
    process.send_signal(number)
    assert process.wait(timeout=60) == 130
    err = (folder / "err").read_text()
    assert "Traceback" not in err and err.endswith("quietfix: interrupted\n")
    return (folder / "out").read_text().splitlines(), err


@pytest.mark.slow
def test_processes_end_by_signals_with_their_state_and_go_on(rows, tmp_path):
    """A file is followed; the second run begins in it where the first one stopped, and tells the rest."""
    log, state = tmp_path / "log", tmp_path / "state"
    lines = [json.dumps(row) + "\n" for row in rows]
    log.write_text("".join(lines[:80]))
    options = ["--follow", str(log), "--state", str(state), "--wait", "60"]
    first, err = ended(running(tmp_path / "1", *options), tmp_path / "1", 18, signal.SIGINT)
    assert re.search(r"80 lines, \d+ ticks, 2 targets", err)
    with log.open("a") as file:
        file.write("garbage\n" + "".join(lines[80:]))
    second, err = ended(running(tmp_path / "2", *options), tmp_path / "2", 18, signal.SIGTERM)
    assert f"{len(lines) + 1} lines" in err and "left out: 1 not JSON" in err
    assert by_tick([*first, *second]) == straight(rows)


class Interrupted:
    """A source of lines while which a signal comes."""

    def __init__(self, lines, number):
        self.lines, self.number = lines, number

    def read(self, timeout):
        signal.raise_signal(self.number)
        return self.lines

    def place(self):
        return {}

    def close(self):
        pass


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_its_state(rows, tmp_path, monkeypatch, number):
    """What was read is heard, told and kept before it ends; the rest goes on with it."""
    told, state = [], tmp_path / "state"
    handlers = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]
    for part in (rows[:80], rows[80:]):
        lines = [json.dumps(row).encode() for row in part]
        monkeypatch.setattr(
            "quietfix.diagrams.live.command.StandardInput", lambda lines=lines: Interrupted(lines, number)
        )
        run = CliRunner().invoke(app, ["live", str(DRONE), "--estimator", "ekf", "--state", str(state)])
        assert run.exit_code == 130 or isinstance(run.exception, KeyboardInterrupt)
        told += run.stdout.splitlines()
    assert by_tick(told) == straight(rows)
    assert [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)] == handlers


def straight(rows):
    """What is told of rows by the extended Kalman filter."""
    told = []
    scenario = find(DRONE.as_posix()).system.load()
    scenario.measurements = Measurements()
    session = Session(Bench(scenario, DRONE.parent, ["ekf"]), told.append)
    hear(session, rows)
    session.finish(0.0)
    return by_tick(told)


def test_standard_input_to_its_end(rows, tmp_path, monkeypatch):
    (tmp_path / "in").write_text("".join(json.dumps(row) + "\n" for row in rows) + '{"time_s": 3')
    with (tmp_path / "in").open("rb") as file:
        monkeypatch.setattr("quietfix.diagrams.live.command.StandardInput", lambda: StandardInput(file.fileno()))
        run = CliRunner().invoke(app, ["live", str(DRONE), "-", "--estimator", "ekf", "--state", str(tmp_path / "s")])
    assert run.exit_code == 0, run.output
    assert by_tick(run.stdout.splitlines()) == straight(rows)
    last = run.stderr.splitlines()[-1]
    assert last.startswith(f"quietfix: live: {len(rows) + 1} lines, 42 ticks, 2 targets")
    assert last.endswith("left out: 1 not JSON")
