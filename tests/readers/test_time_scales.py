"""One instant in every file and scale: what passes 2016-12-31T23:59:60Z is where it was, whoever wrote its time."""

import numpy as np
import pytest
from sgp4.api import Satrec

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.paths.functions import path_of
from quietfix.diagrams.paths.movers import Gpx, Oem, Platform, Sp3, Tle, Track
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.quantities.frame import EARTH_FIXED
from quietfix.diagrams.readers.ccsds.tdm_table import tdm_measurements
from quietfix.diagrams.readers.measurements import read_measurements
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.earth.time_scales import from_tai, to_tai
from quietfix.systems.trajectories.gravity import GravityConstants

LEAP = to_tai("2016-12-31T23:59:60")[0]
SCALES = ("UTC", "TAI", "GPS", "TT")
SPEED = np.array([3000.0, -5000.0, 4000.0])


def place(second):
    """A straight line, of seconds of TAI after the leap second's beginning: no spline is off it."""
    return np.array([6.9e6, 1e5, -2e5]) + np.multiply.outer(np.asarray(second, dtype=float), SPEED)


def at(mover, folder, start, duration=40.0):
    return path_of(mover, EARTH_FIXED, Setting(duration, start, folder), GravityConstants(), "target")


def stamp(second, scale):
    return from_tai(LEAP + second, 0.0, scale)


def oem(folder, scale):
    rows = [f"{stamp(k, scale)} {' '.join(map(repr, (place(k) / 1e3).tolist()))} 3 -5 4" for k in range(-60, 61, 5)]
    head = ["CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2017-01-02T00:00:00", "ORIGINATOR = ME", "META_START"]
    head += ["OBJECT_NAME = A", "OBJECT_ID = 2016-001A", "CENTER_NAME = EARTH", "REF_FRAME = ITRF2008"]
    head += [f"TIME_SYSTEM = {scale}", f"START_TIME = {stamp(-60, scale)}", f"STOP_TIME = {stamp(60, scale)}"]
    (folder / "a.oem").write_text("\n".join([*head, "META_STOP", *rows, ""]))
    return Oem("a.oem")


def table(folder, scale):
    rows = [f"a;{stamp(k, 'UTC')}Z;{';'.join(map(repr, place(k).tolist()))}" for k in range(-60, 61, 5)]
    (folder / "p.csv").write_text("\n".join(["name;time;x_m;y_m;z_m", *rows, ""]))
    return Platform("p.csv", "a")


def track(folder, scale):
    rows = [f"{stamp(k, 'UTC')}Z,{','.join(map(repr, place(k).tolist()))}" for k in range(-60, 61, 5)]
    (folder / "t.csv").write_text("\n".join(["time,x_m,y_m,z_m", *rows, ""]))
    return Track("t.csv")


def gpx(folder, scale):
    points = []
    for k in range(-60, 61, 5):
        b, l, h = ecef_to_geodetic(place(k))  # noqa: E741
        points.append(
            f'<trkpt lat="{float(np.degrees(b))!r}" lon="{float(np.degrees(l))!r}"><ele>{float(h)!r}</ele>'
            f"<time>{stamp(k, 'UTC')}Z</time></trkpt>"
        )
    head = '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    (folder / "a.gpx").write_text(f"{head}{''.join(points)}</trkseg></trk></gpx>")
    return Gpx("a.gpx")


WRITERS = {f"OEM in {scale}": (oem, scale) for scale in SCALES}
WRITERS |= {"platforms.csv": (table, "UTC"), "track": (track, "UTC"), "GPX": (gpx, "UTC")}


@pytest.mark.parametrize("start", ["2016-12-31T23:59:50Z", "2016-12-31T23:59:60.500Z", "2017-01-01T01:00:10.25+01:00"])
@pytest.mark.parametrize("case", WRITERS)
def test_where_it_was_before_in_and_after_the_leap_second(case, start, tmp_path):
    write, scale = WRITERS[case]
    path = at(write(tmp_path, scale), tmp_path, start)
    second, rest = to_tai(start, offsets=True)
    for t in (0.0, 9.75, 10.5, 11.0, 31.25):
        # doubles of Earth-fixed metres and the files' digits: a false second is 7 km
        np.testing.assert_allclose(path(t)[:3], place(second - LEAP + rest + t), atol=0.02)


def sp3(folder, system):
    """Epochs 60 s apart from 23:50 to 00:10 of the file's own scale, as precise orbits have them."""
    lines = [
        "#cP2016 12 31 23 50  0.00000000      21 ORBIT IGS14 FIT  TST",
        "## 1930      0.0    60.00000000 57753 0.0",
    ]
    lines += ["+    1   L27" + "  0" * 16, f"%c L  cc {system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc"]
    for k in range(21):
        day, hour, minute = ("2016-12-31", 23, 50 + k) if k < 10 else ("2017-01-01", 0, k - 10)
        second, rest = to_tai(f"{day}T{hour:02d}:{minute:02d}:00", system)
        lines.append(f"*  {day.replace('-', ' ')} {hour:2d} {minute:2d}  0.00000000")
        x = place(second - LEAP + rest) / 1e3
        lines.append("PL27" + "".join(f"{v:14.6f}" for v in x) + f"{0.0:14.6f}")
    (folder / "o.sp3").write_text("\n".join([*lines, "EOF", ""]))
    return Sp3("o.sp3", "L27")


@pytest.mark.parametrize("start", ["2016-12-31T23:57:00Z", "2016-12-31T23:59:60.5Z", "2017-01-01T00:01:00Z"])
@pytest.mark.parametrize("system", ["GPS", "TAI", "UTC"])
def test_precise_orbits_on_both_sides_of_the_leap_second(system, start, tmp_path):
    """A run that begins after the leap second, of a file that begins before it, was a second (7 km) off in UTC."""
    path = at(sp3(tmp_path, system), tmp_path, start, 150.0)
    second, rest = to_tai(start)
    for t in (0.0, 30.0, 149.0):
        # digits of a millimetre, and the spline of 60 s through a line that turns with the Earth
        np.testing.assert_allclose(path(t)[:3], place(second - LEAP + rest + t), atol=0.5)


def test_elements_on_both_sides_of_the_leap_second(tmp_path):
    """SGP4 counts days of 86400 s: with an epoch before the leap second it is asked of one second more."""
    lines = (
        "1 25544U 98067A   16366.50000000  .00000000  00000-0  00000-0 0    02",
        "2 25544  51.6000 100.0000 0005000 100.0000 260.0000 15.50000000    03",
    )
    lines = tuple(line[:68] + str(sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10) for line in lines)
    satellite = Satrec.twoline2rv(*lines)
    for start, minutes in [("2016-12-31T23:59:59Z", 720 - 1 / 60), ("2017-01-01T00:00:00Z", 720 + 1 / 60)]:
        radius = np.linalg.norm(at(Tle(*lines), tmp_path, start)(0.0)[:3])
        height = at(Tle(*lines), tmp_path, start)(0.0)[2]
        _, r, _ = satellite.sgp4_tsince(minutes)
        assert radius == pytest.approx(1e3 * np.linalg.norm(r), abs=1e-3)
        assert height == pytest.approx(1e3 * r[2], abs=0.01)


HEAD = "time,kind,receiver,reference,value,unit\n"


def test_tables_of_measurements(tmp_path):
    """Rows before, in and after it, in three zones: one second apart."""
    stamps = ["2016-12-31T23:59:59.5Z", "2017-01-01T05:29:60.5+05:30", "2016-12-31T19:00:00.5-05:00"]
    (tmp_path / "m.csv").write_text(HEAD + "".join(f"{one},range,a,,1,m\n" for one in stamps))
    table = read_measurements(tmp_path / "m.csv")
    np.testing.assert_array_equal(table.seconds(to_tai("2016-12-31T23:59:59")), [0.5, 1.5, 2.5])


@pytest.mark.parametrize("scale", SCALES)
def test_tracking_data_messages(scale, tmp_path):
    rows = [f"RANGE = {stamp(k, scale)} {k + 10}" for k in (-1, 0, 1)]
    head = ["CCSDS_TDM_VERS = 2.0", "CREATION_DATE = 2017-01-02T00:00:00", "ORIGINATOR = ME", "META_START"]
    head += [f"TIME_SYSTEM = {scale}", "PARTICIPANT_1 = a", "PARTICIPANT_2 = t", "MODE = SEQUENTIAL", "PATH = 2,1"]
    head += ["RANGE_UNITS = km", "META_STOP", "DATA_START"]
    (tmp_path / "m.tdm").write_text("\n".join([*head, *rows, "DATA_STOP", ""]))
    table = tdm_measurements(tmp_path / "m.tdm")
    np.testing.assert_allclose(table.seconds((LEAP, 0.0)), [-1, 0, 1], atol=1e-12)


@pytest.mark.parametrize("scale", ["UT1", "TDB", "TCB", "GMST", "utc2"])
def test_other_scales_are_refused_by_name(scale, tmp_path):
    mover = oem(tmp_path, "UTC")
    file = tmp_path / "a.oem"
    file.write_text(file.read_text().replace("TIME_SYSTEM = UTC", f"TIME_SYSTEM = {scale}"))
    with pytest.raises(UserError, match=rf"TIME_SYSTEM '?{scale}.* is not allowed; UTC, TAI, GPS, TT"):
        at(mover, tmp_path, "2016-12-31T23:59:50Z")


def test_a_run_that_begins_in_the_leap_second(tmp_path):
    """t = 0 is the first row, in the leap second; what is written says so, and the scale."""
    stamps = [f"{stamp(k, 'UTC')}.25Z" for k in range(8)]
    rows = [
        f"{one},range,{name},,{np.linalg.norm([4e3 - x, 3e3 - y, 9e2]):.6f},m\n"
        for one in stamps
        for name, x, y in [("a", 0, 0), ("b", 9e3, 0), ("c", 0, 9e3), ("d", 8e3, 9e3)]
    ]
    (tmp_path / "m.csv").write_text(HEAD + "".join(rows))
    (tmp_path / "mine.yaml").write_text(
        """frame: local
duration_s: 10
platforms:
  a: !Fixed {}
  b: !Fixed {east_km: 9}
  c: !Fixed {north_km: 9}
  d: !Fixed {east_km: 8, north_km: 9}
sensors: {range: !Range {sigma_m: 5}}
start: !Given {at: !Fixed {east_km: 4.1, north_km: 3.1, up_m: 800}}
estimators: {ekf: !Ekf {}}
measurements: {file: m.csv}
"""
    )
    found = find(str(tmp_path / "mine.yaml"))
    model = found.model(found.system.load())
    np.testing.assert_array_equal(model.clock.ticks(100.0), np.arange(8.0))
