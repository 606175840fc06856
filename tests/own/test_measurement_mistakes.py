"""Tables of measurements that cannot be: one line with file and line, and what is only doubtful is said in the note."""

import os
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.schema.errors import UserError
from tests.diagrams.test_command_line import in_process

DRONE = Path(__file__).parent / "drone.yaml"
HEAD = "time_s,kind,receiver,reference,value,unit,sigma"
GOOD = [
    "0,tdoa,alpha,delta,7.4,us,30e-3",
    "0,tdoa,bravo,delta,32.6,us,",
    "0,tdoa,charlie,delta,12.7,us,",
    "2,azimuth,alpha,,60,deg,",
    "5,altitude,,,0.9,km,",
]
FOUND = find(DRONE.as_posix())


def declared(path, *settings):
    sets = [f"measurements.file={path}", *settings]
    return FOUND.model(FOUND.system.load(settings=sets))


def text(*rows, head=HEAD):
    return "\n".join([head, *rows, ""])


def changed(number, old, new):
    rows = list(GOOD)
    assert old in rows[number]
    rows[number] = rows[number].replace(old, new, 1)
    return text(*rows)


WRONG = {
    "a kind": (changed(0, "tdoa", "tdao"), "log.csv:2: kind: tdao is not known (did you mean tdoa?); there are"),
    "a receiver": (
        changed(0, "alpha", "golf"),
        "log.csv:2: receiver: golf is not known; there are alpha, bravo, charl",
    ),
    "no receiver": (changed(3, "alpha", ""), "log.csv:5: receiver: '' is not known; there are alpha"),
    "a reference": (
        changed(1, "delta", "alpha"),
        "log.csv:3: reference: alpha is not allowed for tdoa at bravo; delta",
    ),
    "a unit": (
        changed(4, "km", "kg"),
        "log.csv:6: unit: kg is not allowed; one of m, km, cm",
    ),
    "no unit": (changed(4, "km", ""), "log.csv:6: unit: nothing is not allowed; one of m"),
    "a value": (changed(1, "32.6", "32.6x"), "log.csv:3: value: '32.6x' is not allowed; a number"),
    "a decimal comma": (
        changed(1, "32.6", '"32,6"'),
        "log.csv:3: value: '32,6' is not allowed; a number with a decimal",
    ),
    "infinity": (changed(1, "32.6", "inf"), "log.csv:3: value: inf is not allowed; a number up to 1e+15"),
    "degrees as radians": (
        changed(3, "deg", "rad"),
        "log.csv:5: value: 60 rad is not allowed for azimuth_alpha; at most",
    ),
    "a bearing of more than a turn": (
        changed(3, "azimuth,alpha,,60", "bearing,alpha,,945.5"),
        "log.csv:5: value: 945.5 deg is not allowed for azimuth_alpha; at most",
    ),
    "sigma 0": (changed(0, "30e-3", "0"), "log.csv:2: sigma: 0 is not allowed; > 0, or empty: as the sensor has it"),
    "sigma < 0": (changed(0, "30e-3", "-1"), "log.csv:2: sigma: -1 is not allowed"),
    "a time": (changed(3, "2,", "two,"), "log.csv:5: time_s: 'two' is not allowed; a number"),
    "no time": (changed(3, "2,", ","), "log.csv:5: time_s: nothing is not allowed; seconds"),
    "too early": (changed(3, "2,", "-2,"), "log.csv:5: its time is 2 s before t = 0, which is time_s 0"),
    "too late": (
        changed(3, "2,", "201,"),
        "log.csv:5: its time of 201 s is after the end of the run; duration_s is 200, and",
    ),
    "twice": (text(*GOOD, GOOD[1]), "log.csv:7: tdoa bravo delta is there twice at one time; line 3 has it already"),
    "cut": (text(*GOOD)[:-9], "log.csv:6: 4 fields are not allowed; 7 as names; is the file cut?"),
    "empty": ("", "log.csv: it is empty; a line of names and rows below it"),
    "names alone": (text(), "log.csv: it has no rows; at least one measurement"),
    "nothing measured": (text("0,tdoa,alpha,delta,,us,"), "log.csv: column value has no number in any row"),
    "no column": (text(head="time_s,kind,value"), "log.csv: columns"),
    "both times": (text(head="time,time_s,kind,value,unit"), "log.csv: columns time and time_s are not allowed both"),
    "a column twice": (text(head=f"{HEAD},value"), "log.csv:1: column value is there twice; once"),
    "a near column": (
        text(*GOOD, head=HEAD.replace("sigma", "sgima")),
        "log.csv: column sgima is not known (did you mean",
    ),
    "quotes": (changed(0, "alpha", '"alpha'), "log.csv:"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_is_one_line(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content, message = WRONG[case]
    Path("log.csv").write_text(content)
    with pytest.raises(UserError) as refused:
        declared(tmp_path / "log.csv")
    told = str(refused.value)
    assert told.startswith(message if message != "log.csv: columns" else "log.csv:1: columns time_s, kind, value"), told
    assert "\n" not in told


@pytest.mark.parametrize(
    ("stamp", "message"),
    [
        ("2026-03-01T12:00:00", "log.csv:2: time: '2026-03-01T12:00:00' is not allowed without its zone"),
        ("2026-02-30T12:00:00Z", "log.csv:2: time: "),
        ("2026-03-01T12:00:60Z", "log.csv:2: time: '2026-03-01T12:00:60Z' is not allowed; second 60 is only where UTC"),
        ("yesterday", "log.csv:2: time: 'yesterday' is not allowed; a date with a time of day"),
    ],
)
def test_dates_that_cannot_be(stamp, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    head = HEAD.replace("time_s", "time")
    Path("log.csv").write_text(text(GOOD[0].replace("0", stamp, 1), head=head))
    with pytest.raises(UserError) as refused:
        declared(tmp_path / "log.csv")
    assert str(refused.value).startswith(message), refused.value


def test_bytes_that_are_no_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for content, message in [
        (
            text(*GOOD).replace("bravo", "br\xe4vo").encode("latin-1"),
            "log.csv:3: byte 0xe4 is not allowed; text in UTF-8",
        ),
        (text(*GOOD).encode("utf-16"), "log.csv: it is not allowed as UTF-16; UTF-8"),
    ]:
        Path("log.csv").write_bytes(content)
        with pytest.raises(UserError) as refused:
            declared(tmp_path / "log.csv")
        assert str(refused.value).startswith(message), refused.value


def test_fields_of_the_scenario_that_mean_nothing_with_measurements(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(text(*GOOD))
    for setting, message in [
        (
            "target=null",
            "start: !Prior is drawn about the truth, and with measurements nobody knows where the target is",
        ),
        (
            "platform_errors.sigma_position_m=3",
            "platform_errors.sigma_position_m: 3 is not allowed with measurements; 0",
        ),
        ("measurements.file=''", "measurements.file: none is given; the path of a file"),
        ("measurements.file=none.csv", "none.csv: it cannot be read (No such file or directory)"),
        (
            "measurements.two_way=half",
            "measurements.two_way: half is for a Tracking Data Message only, not log.csv",
        ),
    ]:
        with pytest.raises(UserError) as refused:
            declared(tmp_path / "log.csv", setting)
        assert message in str(refused.value), refused.value


def test_what_is_doubtful_is_said(tmp_path):
    path = tmp_path / "log.csv"
    late = [f"{100 + k},altitude,,,900,m," for k in range(20)]
    rows = [f"{row},7" for row in [GOOD[0], GOOD[2], GOOD[1], *GOOD[3:], *late, "1,altitude,,,nan,m,"]]
    path.write_text("﻿" + text(*rows, head=f"{HEAD},snr").rstrip("\n"), encoding="utf-8")
    note = declared(path).note
    for part in (
        "left out: column snr",
        "its last line has no end",
        "azimuth: taken as counter-clockwise from east",
        "times step back 1 times, at most by 118 s (line 27)",
        "nothing for 95 s before line 7",
    ):
        assert part in note, note


def test_a_unit_that_cannot_be_is_said(tmp_path):
    """Alpha and delta are 9434 m apart, 31.5 us: 7.4 ms are no microseconds, 31.4 us may be."""
    path = tmp_path / "log.csv"
    path.write_text(text("0,tdoa,alpha,delta,7.4,ms,", "1,tdoa,alpha,delta,31.4,us,"))
    assert "tdoa_alpha_delta: 1 of 2 values are larger than the 31.47 us that light takes" in declared(path).note


def test_a_bearing_is_one_from_the_north(tmp_path):
    """An azimuth of a satellite's own axes is none."""
    path = tmp_path / "log.csv"
    path.write_text(text("0,bearing,a,,10,deg,"))
    sets = ["frame=inertial", "platforms={a: !Kepler {}}", "sensors={sight: !Relative {}}", "target=null"]
    sets += ["start=!Given {at: !Kepler {}}", "belief.motion=!Orbital {}", f"measurements.file={path}"]
    with pytest.raises(UserError, match="kind: bearing is not known; there are azimuth, elevation"):
        FOUND.model(FOUND.system.load(settings=sets))


def test_files_cut_and_changed_anywhere(tmp_path):
    """At every tenth byte cut, and 200 times one to three bytes changed: either it is read, or it is one line."""
    path, whole = tmp_path / "log.csv", text(*GOOD).encode()
    random = np.random.default_rng(5)
    cases = [whole[:end] for end in range(0, len(whole), 10)]
    for _ in range(200):
        mutant = bytearray(whole)
        for at in random.integers(len(whole), size=1 + len(cases) % 3):
            mutant[at] = random.choice(list(b'\x00\xff,;"\n\r0-9eE.naN \t#x'))
        cases.append(bytes(mutant))
    refused = 0
    scenario = FOUND.system.load(settings=[f"measurements.file={path}"])
    for stamp, content in enumerate(cases):
        path.write_bytes(content)
        os.utime(path, ns=(stamp, stamp))  # it is read again when its time or its size is another
        try:
            FOUND.model(scenario)
        except UserError as error:
            assert "\n" not in str(error)
            refused += 1
    assert 100 < refused < len(cases)


def test_a_long_name_is_cut_short_and_a_long_message_is_not(tmp_path, monkeypatch, capsys):
    """What is repeated of a file has at most 100 characters; of what is allowed nothing is lost."""
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text(changed(0, "alpha", "golf" * 2000))
    status, _, err = in_process(capsys, "run", str(DRONE), "--measurements", "log.csv")
    assert status == 2 and err.count("\n") == 1 and len(err) < 400
    assert f"receiver: {'golf' * 25}... is not known; there are alpha, bravo, charlie" in err
    Path("log.csv").write_text(changed(1, "delta", "alpha" * 2000))
    status, _, err = in_process(capsys, "run", str(DRONE), "--measurements", "log.csv")
    assert status == 2 and "is not allowed for tdoa at bravo; delta" in err and len(err) < 400
    Path("log.csv").write_text(changed(3, "deg", "rad"))
    status, _, err = in_process(capsys, "run", str(DRONE), "--measurements", "log.csv")
    assert status == 2 and " ... " not in err and "value: 60 rad is not allowed for azimuth_alpha; at most" in err
