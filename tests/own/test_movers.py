"""Every mover against an independent formula or library; its velocity against its own position; what is refused."""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from sgp4.api import Satrec

from quietfix.diagrams.own.system import own_system
from quietfix.diagrams.paths.functions import ALLOWED, path_of
from quietfix.diagrams.paths.movers import (
    Fixed,
    Geodetic,
    GreatCircle,
    Kepler,
    PositionVelocity,
    Sp3,
    Straight,
    Tle,
    Track,
    Waypoints,
)
from quietfix.diagrams.paths.records import Setting, old_elements
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import load, read_yaml
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.earth.time_scales import to_posix, to_tai
from quietfix.systems.plants.sp3 import read_sp3
from quietfix.systems.plants.sp3_records import in_tai
from quietfix.systems.trajectories.gravity import GravityConstants

HERE = Path(__file__).parent
CONSTANTS = GravityConstants()
START = "2004-04-06T07:51:28.386009Z"
# Vallado, Revisiting Spacetrack Report 3 (AIAA 2006-6753): satellite 00005 of the verification set.
VANGUARD = Tle(
    "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753",
    "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667",
)
EPOCH = "2000-06-27T18:50:19.733568Z"
ROCKET = load(own_system(HERE / "rocket.yaml").scenario, [read_yaml(HERE / "rocket.yaml")]).target


def setting(folder=HERE, duration=300.0, start=EPOCH):
    return Setting(duration, start, folder)


def path(mover, frame, **about):
    return path_of(mover, frame, setting(**about), CONSTANTS, "target")


def circle(times):
    """Return Earth-fixed positions of something that climbs and turns."""
    angle = 0.01 * np.asarray(times)
    return np.stack([6.4e6 + 50 * angle, 2000 * np.cos(angle), 2000 * np.sin(angle)], axis=-1)


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a record of each kind, 310 s long."""
    times = np.arange(-10.0, 311.0, 5.0)
    rows = "\n".join(f"{t},{x!r},{y!r},{z!r}" for t, (x, y, z) in zip(times, circle(times).tolist(), strict=True))
    (tmp_path / "track.csv").write_text(f"time_s,x_m,y_m,z_m\n{rows}\n")
    lines = [f"{t},{48 + 1e-3 * t / 10!r},{11 - 2e-3 * t / 10!r},{900 + t}" for t in times.tolist()]
    (tmp_path / "degrees.csv").write_text("\n".join(["time_s,latitude_deg,longitude_deg,height_m", *lines]) + "\n")
    write_sp3(tmp_path / "orbit.sp3")
    return tmp_path


def write_sp3(file, every=60, count=15):
    """Write an orbit of our own in the format, positions only; the first epoch is 120 s before `EPOCH` in GPS time."""
    truth = path(Kepler(inclination_deg=50), "earth_fixed", duration=3000.0)
    lines = [f"#cP2000  6 27 18 48 19.73356800 {count:7d} ORBIT IGS14 FIT  TST", "+    1   L27", "%c L  cc UTC ccc"]
    for k in range(count):
        seconds = 48 * 60 + 19.733568 + every * k
        hour, rest = divmod(seconds + 18 * 3600, 3600)
        lines.append(f"*  2000  6 27 {int(hour):2d} {int(rest // 60):2d} {rest % 60:11.8f}")
        x, y, z = truth(every * k)[:3] / 1e3
        lines.append(f"PL27{x:14.6f}{y:14.6f}{z:14.6f}{999999.999999:14.6f}")
    file.write_text("\n".join([*lines, "EOF", ""]))


WAY = [[47.0, 10.0], [47.3, 10.1], [47.35, 10.6], [47.1, 10.7]]
MOVERS = [
    Fixed(1, 2, 3),
    Straight([6400.0, 2.0, 3.0], [40.0, -50.0, 6.0]),
    Waypoints(points_km=[[0, 0], [4, 1], [5, -4]], height_m=500, speed_mps=60),
    Waypoints(points_deg=WAY, height_m=9000, speed_mps=400, turn_rate_degps=1.5),
    Geodetic(48, 11, 500),
    GreatCircle(40, 10, 1000, 60, 250),
    Kepler(eccentricity=0.05),
    PositionVelocity(),
    VANGUARD,
    Sp3("orbit.sp3"),
    Track("track.csv"),
    Track("degrees.csv"),
    ROCKET,
]
CASES = [
    (mover, frame)
    for mover in MOVERS
    for frame in ALLOWED
    if isinstance(mover, ALLOWED[frame])
    and not (frame == "local" and getattr(mover, "file", "") == "degrees.csv")
    and not (isinstance(mover, Waypoints) and bool(mover.points_km) != (frame == "local"))
]


@pytest.mark.parametrize(("mover", "frame"), CASES, ids=[f"{type(m).__name__}-{f}" for m, f in CASES])
def test_velocity_is_the_derivative_of_the_place(mover, frame, folder):
    at = path(mover, frame, folder=folder)
    step = 0.05
    for t in (1.0, 33.3, 151.5, 251.7):
        slope = (at(t + step)[:3] - at(t - step)[:3]) / (2 * step)
        # rounding of 7e6 m over 0.1 s: 2e-8; step^2/6 of the largest third derivative (turns, orbits: 0.3 m/s^3): 1e-4
        # SGP4's own velocity is off the derivative of its own position by 1.2 m/s at most at this eccentricity of 0.19
        np.testing.assert_allclose(slope, at(t)[3:], atol=1.5 if isinstance(mover, Tle) else 3e-4)


@pytest.mark.parametrize(
    "mover",
    [mover for mover, frame in CASES if frame == "inertial" and mover != Track("track.csv")],
    ids=lambda m: type(m).__name__,
)
def test_the_frames_agree(mover, folder):
    fixed, inertial = path(mover, "earth_fixed", folder=folder), path(mover, "inertial", folder=folder)
    np.testing.assert_allclose(fixed(0.0)[:3], inertial(0.0)[:3], atol=1e-6)
    angle = EARTH_RATE * 200.0
    c, s = math.cos(angle), math.sin(angle)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ inertial(200.0)[:3]
    np.testing.assert_allclose(fixed(200.0)[:3], turned, atol=1e-6)


# ------------------------------------------------------------------------------------------------------- !Tle


def test_elements_fly_as_printed():
    """The verification set's TEME states, at the epoch and 360 minutes later, turned by Greenwich's sidereal time."""
    printed = {
        0.0: [7022.46529266, -1400.08296755, 0.03995155, 1.893841015, 6.405893759, 4.534807250],
        21600.0: [-7154.03120202, -3783.17682504, -3536.19412294, 4.741887409, -4.151817765, -2.093935425],
    }
    inertial = path(VANGUARD, "inertial", duration=21600.0)
    # Meeus, Astronomical Algorithms, ch. 12: mean sidereal time of the date, in degrees
    days = (
        datetime(2000, 6, 27, 18, 50, 19, 733568, UTC) - datetime(2000, 1, 1, 12, tzinfo=UTC)
    ).total_seconds() / 86400
    century = days / 36525
    sidereal = math.radians(280.46061837 + 360.98564736629 * days + 0.000387933 * century**2)
    c, s = math.cos(sidereal), math.sin(sidereal)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    for t, state in printed.items():
        teme = 1e3 * np.array(state)
        # epoch given to 1 us: 0.01 m; a Julian date as one double: 40 us of the Earth's rotation, 0.02 m
        np.testing.assert_allclose(inertial(t)[:3], turn @ teme[:3], atol=0.1)
        np.testing.assert_allclose(inertial(t)[3:], turn @ teme[3:], atol=1e-4)


def test_satellite_over_a_station_at_the_right_time():
    """Earth-fixed hours later by the sidereal time of that moment: a station and a satellite share the Earth."""
    fixed, later = path(VANGUARD, "earth_fixed", duration=7200.0), 7200.0
    moment = "2000-06-27T20:50:19.733568Z"
    other = path(VANGUARD, "earth_fixed", start=moment)
    # mean sidereal time gains 8.5e-12 rad/s on the constant rate: 0.6 m in two hours at 9800 km
    np.testing.assert_allclose(fixed(later), other(0.0), atol=1.0)


def test_distance_between_a_satellite_and_a_station():
    """The station carried to SGP4's axes by the sidereal time of the moment, not the satellite to the Earth's."""
    scenario = load(own_system(HERE / "elements.yaml").scenario, [read_yaml(HERE / "elements.yaml")])
    elements, place, t = scenario.platforms["station"], scenario.platforms["west"], 250.0
    latitude, longitude = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    semi_major, flattening = 6378137.0, 1 / 298.257223563
    square = flattening * (2 - flattening)
    prime = semi_major / math.sqrt(1 - square * math.sin(latitude) ** 2)
    out, up = (
        (prime + place.height_m) * math.cos(latitude),
        (prime * (1 - square) + place.height_m) * math.sin(latitude),
    )

    def station(since):
        days = (datetime(2008, 9, 20, 20, 18, 30) - datetime(2000, 1, 1, 12)).total_seconds() / 86400 + since / 86400
        angle = math.radians(280.46061837 + 360.98564736629 * days + 0.000387933 * (days / 36525) ** 2) + longitude
        return np.array([out * math.cos(angle), out * math.sin(angle), up])

    minutes = (datetime(2008, 9, 20, 20, 18, 30) - datetime(2008, 9, 20)).total_seconds() / 60 - 0.51782528 * 1440
    satellite = Satrec.twoline2rv(elements.line_1, elements.line_2)
    _, position, velocity = satellite.sgp4_tsince(minutes + t / 60)
    apart = 1e3 * np.array(position) - station(t)
    closing = 1e3 * np.array(velocity) - (station(t + 0.5) - station(t - 0.5))
    for frame in ("earth_fixed", "inertial"):
        one, two = (path(mover, frame, start=scenario.start_utc)(t) for mover in (elements, place))
        gap = one - two
        # 0.1 m: a Julian date as one double, 40 us of the Earth's rotation
        assert abs(np.linalg.norm(gap[:3]) - np.linalg.norm(apart)) < 0.1
        rate = gap[:3] @ gap[3:] / np.linalg.norm(gap[:3])
        assert abs(rate - apart @ closing / np.linalg.norm(apart)) < 1e-3


@pytest.mark.parametrize(
    ("change", "start", "said"),
    [
        (
            {"line_1": VANGUARD.line_1[:-1] + "4"},
            EPOCH,
            "target.line_1: checksum 4 is not allowed; that of the line is 3",
        ),
        ({"line_2": VANGUARD.line_2[:-1] + "0"}, EPOCH, "target.line_2: checksum 0"),
        ({"line_2": VANGUARD.line_2[:-1]}, EPOCH, "target.line_2: 68 characters are not allowed; 69"),
        ({"line_1": VANGUARD.line_2}, EPOCH, "target.line_1: '2 00005 "),
        ({"line_1": ""}, EPOCH, "target.line_1: 0 characters"),
        (
            {"line_2": "2 00006" + VANGUARD.line_2[7:-1] + "8"},
            EPOCH,
            "target.line_2: catalogue number 00006 is not allowed; line_1 has 00005",
        ),
        (
            {"line_1": "1 00005U 58002B   00179.78495062  .00000023  0000--0  28098-4 0  4754"},
            EPOCH,
            "target.line_1: '1 00005U 58002B   00179.78495062  .00000023  0000--0  28098-4 0  4754' is not allowed; ",
        ),
        ({}, None, "start_utc: null is not allowed with !Tle"),
        ({}, "yesterday", "start_utc: 'yesterday' is not allowed"),
        ({}, "2000-08-27T18:50:19Z", "target.line_1: epoch 61.0 days before start_utc is not allowed; at most 30"),
        ({}, "2000-05-20T18:50:19Z", "target.line_1: epoch 38.0 days after start_utc"),
    ],
)
def test_bad_elements_are_refused_in_one_line(change, start, said):
    mover = Tle(change.get("line_1", VANGUARD.line_1), change.get("line_2", VANGUARD.line_2))
    with pytest.raises(UserError) as caught:
        path(mover, "earth_fixed", start=start)
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


def test_old_elements_are_noted():
    assert old_elements(VANGUARD, setting(), "target") == ""
    note = old_elements(VANGUARD, setting(start="2000-07-05T18:50:19Z"), "target")
    assert note.startswith("target: epoch 8.0 days before start_utc")


# ------------------------------------------------------------------------------------------------------- !Sp3


@pytest.mark.parametrize(("start_s", "start", "shift"), [(0.0, EPOCH, 0.0), (47.5, None, 47.5), (None, EPOCH, 120.0)])
def test_precise_orbit_is_the_one_that_was_written(folder, start_s, start, shift):
    at = path(Sp3("orbit.sp3", "L27", start_s), "earth_fixed", folder=folder, start=start)
    truth = path(Kepler(inclination_deg=50), "earth_fixed", duration=3000.0)
    for t in (0.0, 100.0, 217.3, 300.0):
        # the spline between epochs 60 s apart: h^4/384 and some h^3/125 of the fourth derivative, 7e-6 m/s^4
        np.testing.assert_allclose(at(t)[:3], truth(t + shift)[:3], atol=0.3)
        np.testing.assert_allclose(at(t)[3:], truth(t + shift)[3:], atol=0.03)


def test_recorded_precise_orbit(recorded):
    folder = recorded("sp3")
    name = next(folder.glob("*.sp3")).name
    orbit = read_sp3(folder / name, "G05") if "G05" in (folder / name).read_text()[:4000] else read_sp3(folder / name)
    at = path(Sp3(name, orbit.satellite, 600.0), "earth_fixed", folder=folder, start=None)
    i = int(np.searchsorted(orbit.times, 660.0))
    np.testing.assert_allclose(at(orbit.times[i] - 600.0), orbit.states[i], atol=1e-6)


def test_time_systems_of_precise_orbits():
    """GPS was 14 s ahead of UTC from 2006 to 2008, 13 s before, and TAI another 19 s."""
    for epoch, system, utc in [
        (datetime(2008, 8, 30, 0, 0, 14), "GPS", "2008-08-30T00:00:00"),
        (datetime(2006, 1, 1, 0, 0, 13), "GPS", "2005-12-31T23:59:60"),
        (datetime(2006, 1, 1, 0, 0, 14), "GPS", "2006-01-01T00:00:00"),
        (datetime(2005, 12, 31, 23, 59, 59), "GPS", "2005-12-31T23:59:46"),
        (datetime(2020, 1, 1, 0, 0, 37), "TAI", "2020-01-01T00:00:00"),
        (datetime(2020, 1, 1, 0, 0, 4), "BDT", "2020-01-01T00:00:00"),
        (datetime(2020, 1, 1, 0, 0, 0, 250000), "UTC", "2020-01-01T00:00:00.25"),
    ]:
        assert in_tai(epoch, system) == to_tai(utc)


@pytest.mark.parametrize(
    ("mover", "start", "said"),
    [
        (Sp3(), None, "target.file: none is given"),
        (Sp3("none.sp3"), None, "target.file: "),
        (Sp3("track.csv"), None, "target.file: track.csv: not an SP3 file"),
        (Sp3("orbit.sp3", "G99"), None, "target.file: orbit.sp3: satellite G99 is not in it"),
        (Sp3("orbit.sp3", start_s=700.0), None, "target.file: a run from 700 to 1000 s after the first epoch is not"),
        (Sp3("orbit.sp3"), "2000-06-26T00:00:00Z", "target.file: a run from -"),
    ],
)
def test_bad_orbits_are_refused_in_one_line(folder, mover, start, said):
    with pytest.raises(UserError) as caught:
        path(mover, "earth_fixed", folder=folder, start=start)
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


# ----------------------------------------------------------------------------------------------------- !Track


def test_track_is_the_one_that_was_written(folder):
    at = path(Track("track.csv"), "local", folder=folder)
    for t in (0.0, 5.0, 101.0, 300.0):
        # h^4/384 of the fourth derivative (2e-5 m/s^4), and its velocities' h^4/30 of the fifth: micrometres
        np.testing.assert_allclose(at(t)[:3], circle(t), atol=1e-4)
    degrees = path(Track("degrees.csv"), "earth_fixed", folder=folder)
    latitude, longitude, height = ecef_to_geodetic(degrees(123.0)[:3])
    np.testing.assert_allclose(np.degrees([latitude, longitude]), [48.0123, 10.9754], atol=1e-9)
    np.testing.assert_allclose(height, 1023.0, atol=1e-3)


def test_track_by_date_and_with_velocities(tmp_path):
    times = np.arange(0.0, 61.0, 10.0)
    lines = [f"2026-03-01T14:{int(t) // 60:02d}:{t % 60:04.1f}+02:00,{3 * t},{t * t},0,3,{2 * t},0" for t in times]
    head = "time,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps"
    (tmp_path / "t.csv").write_text("\n".join([head, *lines]))
    at = path(Track("t.csv"), "local", folder=tmp_path, duration=20.0, start="2026-03-01T12:00:15Z")
    np.testing.assert_allclose(at(4.0), [57, 361, 0, 3, 38, 0], atol=1e-9)  # 19 s: a parabola is a spline
    from_first = path(Track("t.csv"), "local", folder=tmp_path, duration=60.0, start=None)
    np.testing.assert_allclose(from_first(19.0), [57, 361, 0, 3, 38, 0], atol=1e-9)


HEAD = "time_s,x_m,y_m,z_m\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "target.file: t.csv: columns [] are not allowed"),
        ("time_s,x_m,y_m\n0,1,2\n", "target.file: t.csv: columns ['time_s', 'x_m', 'y_m'] are not allowed"),
        (HEAD + "0,1,2,3\n500,1,2\n", "target.file: t.csv: row 3 ['500', '1', '2'] is not allowed; 4 finite values"),
        (HEAD + "0,1,2,3\n500,1,nan,2\n", "target.file: t.csv: row 3"),
        (HEAD + "0,1,2,3\n", "target.file: t.csv: track times: shape (1,)"),
        (HEAD + "0,1,2,3\n400,1,2,3\n400,1,2,3\n", "target.file: t.csv: track times: they must increase strictly"),
        (HEAD + "0,1,2,3\n299,1,2,3\n", "target.file: t.csv: a run from 0 to 300 s is not allowed; it has 0 to 299 s"),
        (HEAD + "1,1,2,3\n400,1,2,3\n", "target.file: t.csv: a run from 0 to 300 s is not allowed; it has 1 to 400 s"),
        (
            "time_s,latitude_deg,longitude_deg,height_m\n0,91,2,3\n400,1,2,3\n",
            "target.file: t.csv: a latitude beyond 90",
        ),
        ("time,x_m,y_m,z_m\nnoon,1,2,3\n", "target.file: t.csv: time 'noon' is not allowed"),
    ],
)
def test_bad_tracks_are_refused_in_one_line(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(UserError) as caught:
        path(Track("t.csv"), "earth_fixed", folder=tmp_path)
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


def test_dates_need_no_quotes():
    whole, rest = to_posix(read_yaml("start_utc: 2000-06-27T18:50:19.733568Z")["start_utc"])
    assert (whole, rest) == to_posix(EPOCH)


def test_a_gap_in_the_run_is_refused_and_one_behind_it_is_not(folder):
    write_sp3(folder / "gap.sp3", every=60, count=40)
    text = (folder / "gap.sp3").read_text().splitlines()
    at = [i for i, line in enumerate(text) if line.startswith("PL27")][15]
    text[at] = f"PL27{0:14.6f}{0:14.6f}{0:14.6f}{999999.999999:14.6f}"
    (folder / "gap.sp3").write_text("\n".join(text) + "\n")
    with pytest.raises(UserError, match=r"^target.file: gap.sp3 has a gap at 900 s of a run of 1000 s$"):
        path(Sp3("gap.sp3", start_s=0.0), "earth_fixed", folder=folder, duration=1000.0)
    path(Sp3("gap.sp3", start_s=0.0), "earth_fixed", folder=folder, duration=800.0)
