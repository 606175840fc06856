"""A study's measurements through a Tracking Data Message, the same estimates."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.running import _write_message
from quietfix.diagrams.own.messages import write_message
from quietfix.diagrams.own.writing import write_measurements
from quietfix.diagrams.schema.errors import UserError

SYSTEM = """frame: earth_fixed
start_utc: 2016-12-31T23:59:50.5Z
duration_s: 20
platforms:
  a: !Geodetic {latitude_deg: 48, longitude_deg: 11, height_m: 500}
  b: !Geodetic {latitude_deg: 48.2, longitude_deg: 11, height_m: 520}
  c: !Geodetic {latitude_deg: 48.1, longitude_deg: 11.3, height_m: 480}
  d: !Geodetic {latitude_deg: 48.1, longitude_deg: 11.1, height_m: 700}
target: !GreatCircle {latitude_deg: 48.1, longitude_deg: 11.05, height_m: 3000, course_deg: 70, speed_mps: 80}
sensors:
  tdoa: !Tdoa {reference: a, sigma_ns: 30, every_s: 1}
  range: !Range {stations: [d], sigma_m: 20, every_s: 2}
  eyes: !Bearing {platform: b, sigma_deg: 0.5, sigma_elevation_deg: 0.5, every_s: 4}
start: !Prior {sigma_position_m: 500, sigma_velocity_mps: 20}
estimators:
  iekf: !Iekf {}
"""


def study(folder, text):
    """Write and run a system, and its measurements as a table; return the file, the scenario and the result."""
    file = folder / "m.yaml"
    file.write_text(text)
    result = run_study(str(file), trials=1, keep="measurements")
    scenario = find(str(file)).system.load()
    write_measurements(result, scenario, folder / "measurements.csv")
    return str(file), scenario, result


def test_a_message_gives_the_estimates_of_the_table(tmp_path):
    file, scenario, _ = study(tmp_path, SYSTEM)
    assert not write_message(tmp_path / "measurements.csv", scenario, tmp_path / "measurements.tdm")
    message = (tmp_path / "measurements.tdm").read_text()
    assert "RANGE = 2016-12-31T23:59:60.5 " in message and "ANGLE_TYPE = AZEL" in message
    assert "PATH_1 = 1,3\nPATH_2 = 1,2\n" in message and "MODE = SINGLE_DIFF" in message
    given = ["start=!Given {at: !Geodetic {latitude_deg: 48.1, longitude_deg: 11.06, height_m: 2500}}"]
    table, again = (
        run_study(file, set=[*given, f"measurements.file={tmp_path / name}"])["estimate"].values
        for name in ("measurements.csv", "measurements.tdm")
    )
    assert again.shape == table.shape and np.isfinite(table).all()
    # times to a nanosecond at 80 m/s, ranges in km and angles in degrees to a double: micrometres
    np.testing.assert_allclose(again, table, rtol=1e-11, atol=1e-5)


def test_what_no_message_has_is_told(tmp_path, capsys):
    tdoa = "  tdoa: !Tdoa {reference: a, sigma_ns: 30, every_s: 1}\n"
    text = SYSTEM.replace(tdoa, "  height: !Altitude {sigma_m: 10}\n")
    _, scenario, _ = study(tmp_path, text)
    _write_message(scenario, tmp_path)
    assert "measurements.tdm: a Tracking Data Message has no altitude; left out." in capsys.readouterr().out
    (tmp_path / "measurements.tdm").unlink()
    only = "".join(line for line in text.splitlines(True) if "!Range" not in line and "!Bearing" not in line)
    _, scenario, _ = study(tmp_path, only)
    _write_message(scenario, tmp_path)
    said = "measurements.tdm: not written: a message without observations is not allowed"
    assert said in " ".join(capsys.readouterr().out.split())
    assert not (tmp_path / "measurements.tdm").exists()
    scenario.start_utc = None
    with pytest.raises(UserError, match="start_utc: null is not allowed for a Tracking Data Message"):
        write_message(tmp_path / "measurements.csv", scenario, tmp_path / "measurements.tdm")
