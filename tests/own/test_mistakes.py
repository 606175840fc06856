"""Mistakes in a system of YAML: one line that names file, line, field, value and what is allowed; exit status 2.

No study is run: each is found while the file is read, or while the system is declared.
"""

import os
import re
import sys

import pytest

from quietfix.diagrams.commands.new import new_files
from tests.diagrams.test_command_line import in_process

DRONE = new_files("drone")["drone.yaml"]
LINES = DRONE.splitlines()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def line_of(begin):
    """Number of the one line of the template that begins so."""
    (number,) = [i for i, line in enumerate(LINES, 1) if line.startswith(begin)]
    return number


def refused(capsys, *arguments):
    """The one line of a command that is refused."""
    status, out, err = in_process(capsys, *arguments)
    assert status == 2 and not out, (status, out)
    assert err.startswith("quietfix: ") and err.count("\n") == 1 and len(err) < 700, err
    return err.removeprefix("quietfix: ").rstrip("\n")


def told(capsys, folder, text):
    (folder / "e.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    return refused(capsys, "run", "e.yaml", "--trials", "2")


TDOA, ALPHA, EKF, BEARING = "  tdoa:", "  alpha:", "  ekf:", "  bearing:"
BAROMETER, START, MOTION, DURATION = "  barometer:", "start:", "  motion:", "duration_s:"

# begin of the line, what it becomes, and what is said after FILE:LINE
CHANGED = [
    # kinds, names and platforms that are not there
    (TDOA, "  tdoa: !Tdo {}", "sensors.tdoa: !Tdo is not known (did you mean !Tdoa?)"),
    (ALPHA, "  alpha: !Fixd {}", "platforms.alpha: !Fixd is not known (did you mean !Fixed?)"),
    (EKF, "  ekf: !Efk {}", "estimators.ekf: !Efk is not known (did you mean !Ekf?)"),
    (EKF, "  ekf: !Ekf", "estimators.ekf: a mapping must follow !Ekf, such as !Ekf {}"),
    (MOTION, "  motion: !Straight {}", "belief.motion: !Straight is not known"),
    ("frame:", "frame: Local", "frame: 'Local' is not allowed; one of local"),
    ("frame:", "frame: earth_fixed", None),
    (BEARING, "  bearing: !Bearing {platform: zulu}", "sensors.bearing.platform: zulu is not known; there are alpha"),
    (TDOA, "  tdoa: !Tdoa {receivers: [alpha, zulu]}", "sensors.tdoa.receivers.1: zulu is not known"),
    (TDOA, "  tdoa: !Tdoa {reference: delta, receivers: [delta]}", "delta is not allowed; it is the reference"),
    (TDOA, "  tdoa: !Tdoa {receivers: [bravo, bravo]}", "a platform is named twice"),
    (EKF, "  ekf: !Ekf {measurements: [zulu]}", "estimators.ekf.measurements: zulu is not known"),
    (ALPHA, "  alpha: !Geodetic {latitude_deg: 5}", "platforms.alpha: !Geodetic is not allowed in frame local"),
    (BAROMETER, "  barometer: !Relative {}", "!Relative is for frame inertial only, this is local"),
    (BAROMETER, "  other: !Tdoa {reference: delta}", "row tdoa_alpha_delta is not allowed; sensors.tdoa has it"),
    (MOTION, "  sensors: {zulu: !Altitude {}}", "belief.sensors: zulu is not known"),
    (MOTION, "  sensors: {bearing: !Altitude {}}", "belief.sensors.bearing: rows ['altitude'] are not allowed"),
    (MOTION, "  sensors: {tdoa: !Tdoa {reference: delta, receivers: [alpha]}}", "belief.sensors.tdoa: rows ["),
    (EKF, "  ekf: !Crossing {}", "ekf: it locates by bearings in a plane"),
    *((EKF, f"  ekf: !{kind} {{}}", "ekf: ranging needs all rows of one sensor: azimuth") for kind in ("Bank", "Ra")),
    (EKF, "  ekf: !RangeBank {}", "ekf: hypotheses of range need a start from the first bearing"),
    (EKF, "  ekf: !Custom {class: nowhere:X}", "estimators.ekf.class: nowhere:X cannot be imported"),
    (START, "start: !Snapshot {sensors: [zulu]}", "start.sensors: zulu is not known"),
    # names
    (BRAVO := "  bravo:", "  alpha: !Fixed {}", "has platforms.alpha twice, the first time in line 12"),
    ("  ukf:", "  ekf: !Ukf {}", "has estimators.ekf twice"),
    (DURATION, "frame: local", "has frame twice"),
    *((TDOA, f"  {name}: !Tdoa {{}}", f"sensors.{name}: the name {name} is not allowed")
      for name in ("truth", "recorder", "course", "score_ekf", "carriers", "target", "plant", "x_raw")),
    (TDOA, "  't d': !Tdoa {}", "sensors.t d: the name 't d' is not allowed"),
    # numbers
    *((TDOA, f"  tdoa: !Tdoa {{sigma_ns: {value}}}", "sensors.tdoa.sigma_ns: ")
      for value in ("-30", "0", ".nan", ".inf", "1e300", "1" + "0" * 400, "thirty", "null", "[30]", "{a: 1}", "true")),
    (BEARING, "  bearing: !Bearing {platform: alpha, every_s: 0}", "sensors.bearing.every_s: 0 is not allowed"),
    (BEARING, "  bearing: !Bearing {platform: alpha, offset_s: 999}", "sensors.bearing.offset_s: 999 is not allowed"),
    (DURATION, "duration_s: 0", "duration_s: 0 is not allowed; a finite number > 0"),
    (DURATION, "duration_s: .nan", "duration_s: nan is not allowed"),
    (DURATION, "duration_s: 1.0e+9", "at most 1e+06, 1000000 epochs of period_s 1"),
    (START, "start: !Prior {sigma_position_m: -1}", "start.sigma_position_m: -1 is not allowed"),
    (ALPHA, "  alpha: !Straight {position_km: [1, 2]}", "platforms.alpha.position_km: [1.0, 2.0] is not allowed"),
    (ALPHA, "  alpha: !Straight {position_km: 5}", "platforms.alpha.position_km: 5 is not allowed; a list"),
    (ALPHA, "  alpha: 5", "platforms.alpha: 5 is not allowed; a mapping of fields"),
    (ALPHA, "  alpha: !Fixed {east: 5}", "platforms.alpha.east: east is not known (did you mean east_km?)"),
    ("divergence_m:", "start_utc: 2026-19-20", "start_utc: 2026-19-20: month must be in 1..12"),
    ("divergence_m:", "start_utc: yesterday", "start_utc: 'yesterday' is not allowed"),
    # files
    (ALPHA, "  alpha: !Track {file: no.csv}", "platforms.alpha.file: no.csv cannot be read (No such file"),
    (ALPHA, "  alpha: !Track {}", "platforms.alpha.file: none is given"),
    (ALPHA, "  alpha: !Track {file: e.yaml}", "platforms.alpha.file: e.yaml: columns ["),
    (ALPHA, "  alpha: !Track {file: .}", "platforms.alpha.file: . cannot be read (it is a folder)"),
    (ALPHA, "\talpha: !Fixed {}", "a tab, where there must be spaces"),
]  # fmt: skip


@pytest.mark.parametrize(("begin", "line", "said"), CHANGED, ids=[str(i) for i in range(len(CHANGED))])
def test_one_line_that_is_wrong(capsys, folder, begin, line, said):
    number = line_of(begin)
    text = "\n".join([*LINES[: number - 1], line, *LINES[number:]]) + "\n"
    message = told(capsys, folder, text)
    if said is None:  # it is another line that does not fit any more
        assert message.startswith(
            f"e.yaml:{line_of(ALPHA)}: platforms.alpha: !Fixed is not allowed in frame earth_fixed"
        )
        return
    assert message.startswith(f"e.yaml:{number}: ") and said in message, message


def without(begin, end):
    a, b = line_of(begin) - 1, line_of(end) - 1 if end else len(LINES)
    return "\n".join([*LINES[:a], *LINES[b:]]) + "\n"


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(['*' + before] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
WHOLE = [
    ("", "system: e.yaml is empty"),
    ("# nothing\n", "system: e.yaml is empty"),
    ("- 1\n", "system: e.yaml holds list; a mapping is needed"),
    ("text\n", "system: e.yaml holds str; a mapping is needed"),
    (b"\x00\x01", "e.yaml is not valid YAML"),
    ("# ä\n".encode("latin-1"), "system: e.yaml cannot be read (not utf-8: byte 2"),
    (DRONE.encode("utf-16"), "system: e.yaml cannot be read (not utf-8"),
    (BOMB, "is too large (at most 50000 values are allowed, aliases written out)"),
    ("[" * 1000, "is too deep (line 1"),
    ("a: &a [*a]\n", "has no end"),
    ("platforms: {a: 1", "e.yaml:1: the system is not valid YAML"),
    (DRONE + "\n---\n" + DRONE, "expected a single document in the stream, but found another document"),
    ("platforms: !!python/object/apply:os.system ['true']\n", "e.yaml:1: the system is not valid YAML"),
    (without("platforms:", "target:"), "e.yaml: platforms: none is given; at least one is needed"),
    (without("target:", "sensors:"), "e.yaml: target: none is given; one is needed"),
    (without("sensors:", "belief:"), "e.yaml: sensors: none is given; at least one is needed"),
    (without("estimators:", ""), "e.yaml: estimators: none is given; at least one is needed"),
]


@pytest.mark.parametrize(("text", "said"), WHOLE, ids=[str(i) for i in range(len(WHOLE))])
def test_a_file_that_is_wrong_as_a_whole(capsys, folder, text, said):
    assert said in told(capsys, folder, text)


@pytest.mark.parametrize("kind", ["folder", "fifo", "link to nothing", "link to itself", "nothing"])
def test_what_is_no_file(capsys, folder, kind):
    path = folder / "e.yaml"
    make = {
        "folder": path.mkdir,
        "fifo": lambda: os.mkfifo(path),
        "link to nothing": lambda: path.symlink_to("no.yaml"),
        "link to itself": lambda: path.symlink_to("e.yaml"),
        "nothing": lambda: None,
    }
    make[kind]()
    assert refused(capsys, "run", "e.yaml").startswith("system: e.yaml cannot be read (")


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("sensors.tdoa.sigma_ns=-1", "sensors.tdoa.sigma_ns: -1 is not allowed"),  # no line: it is not the file's
        ("sensors.tdoa={", "--set: 'sensors.tdoa={' is not valid YAML"),
        ("frame=[1", "--set: 'frame=[1' is not valid YAML"),
        ("frame=1\nx: 2", "--set: 'frame=1\\nx: 2' is not allowed; one value"),
        ("frame", "--set: 'frame' is not allowed; KEY=VALUE"),
    ],
)
def test_a_setting_is_not_told_as_a_line_of_the_file(capsys, folder, setting, said):
    (folder / "e.yaml").write_text(DRONE)
    assert refused(capsys, "run", "e.yaml", "--set", setting).startswith(said)


def test_a_file_laid_over_is_told_as_itself(capsys, folder):
    (folder / "e.yaml").write_text(DRONE)
    (folder / "over.yaml").write_text("\n\nsensors:\n  tdoa: {sigma_ns: x}\n")
    said = refused(capsys, "run", "e.yaml", "--scenario", "over.yaml")
    assert said == "over.yaml:4: sensors.tdoa.sigma_ns: 'x' is not allowed; a number"
    (folder / "over.yaml").write_text("\ntruth:\n  cross_km: x\n")
    assert refused(capsys, "run", "three_satellite", "--scenario", "over.yaml").startswith(
        "over.yaml:3: truth.cross_km: "
    )


def test_a_requirements_file_is_told_with_its_line(capsys, folder):
    (folder / "drone.yaml").write_text(DRONE)
    text = new_files("drone")["drone.requirements.yaml"].replace("percent: 90", "percent: 190")
    (folder / "r.requirements.yaml").write_text(text)
    number = next(i for i, line in enumerate(text.splitlines(), 1) if "percent: 190" in line)
    said = refused(capsys, "verify", "r.requirements.yaml")
    assert re.match(rf"r.requirements.yaml:{number}: requirements.1.metric.percent: 190 is not allowed", said)
    # what only the built system knows
    (folder / "r.requirements.yaml").write_text(text.replace("percent: 190, time_s: 120", "percent: 90, time_s: 121"))
    said = refused(capsys, "verify", "r.requirements.yaml")
    assert said.startswith(f"r.requirements.yaml:{number}: case as_it_is: requirements.1.metric.time_s: 121 is not ")


@pytest.mark.parametrize("option", ["--seed", "--first-trial", "--trials"])
def test_a_whole_number_has_both_limits(capsys, folder, option):
    (folder / "e.yaml").write_text(DRONE)
    said = refused(capsys, "run", "e.yaml", option, str(2**70))
    assert f"{2**70} is not allowed; a whole number from" in said and said.endswith(str(2**53 - 1))
