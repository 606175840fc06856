"""Movers from OEM and GPX files: axes, time systems, segments, gaps, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sgp4.api import Satrec

from quietfix.diagrams.paths.functions import path_of
from quietfix.diagrams.paths.movers import Gpx, Kepler, Oem, Sp3, Tle
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.quantities.frame import EARTH_FIXED, INERTIAL
from quietfix.diagrams.readers.ccsds.oem import EphemerisMessage, EphemerisSegment
from quietfix.diagrams.readers.gpx import GpxTrack
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.gpx import gpx_text
from quietfix.diagrams.writers.oem import oem_text
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.earth.time_scales import from_tai, posix_of, to_tai
from quietfix.systems.plants.sp3 import read_sp3
from quietfix.systems.trajectories.gravity import GravityConstants

CONSTANTS = GravityConstants()
START = "2000-06-27T18:50:19.733568Z"
VANGUARD = Tle(
    "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753",
    "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667",
)


def path(mover, folder=Path(), duration=300.0, start=START, frame=EARTH_FIXED):
    return path_of(mover, frame, Setting(duration, start, folder), CONSTANTS, "target")


def segment(times, states, frame="ITRF2000", scale="UTC", start=START, **more):
    """Return a segment of states [m, m/s] at times after the start."""
    second, rest = to_tai(start)
    moments = [(second + int(np.floor(rest + t)), float((rest + t) % 1)) for t in times]
    metadata = {"OBJECT_NAME": "A", "OBJECT_ID": "1", "CENTER_NAME": "EARTH", "REF_FRAME": frame, "TIME_SYSTEM": scale}
    metadata |= {"START_TIME": from_tai(*moments[0], scale), "STOP_TIME": from_tai(*moments[-1], scale), **more}
    columns = (np.array([m[0] for m in moments]), np.array([m[1] for m in moments]), np.asarray(states) / 1e3)
    return EphemerisSegment(metadata, *columns, np.full((len(moments), 3), np.nan))


def write(file, *segments):
    header = {"CREATION_DATE": "2026-01-01T00:00:00", "ORIGINATOR": "ME"}
    file.write_text(oem_text(EphemerisMessage(header, segments)))
    return file


@pytest.fixture(scope="module")
def truth():
    """Return an Earth-fixed orbit from 1000 s before t = 0 on."""
    orbit = path(Kepler(inclination_deg=50, eccentricity=0.02), duration=6000.0)
    return lambda t: orbit(t + 1000.0)


@pytest.mark.parametrize("scale", ["UTC", "TAI", "GPS", "TT"])
@pytest.mark.parametrize(("step", "count"), [(60.0, 20), (60.0, 6), (240.0, 16), (100.0, 4)])
def test_an_orbit_is_the_one_that_was_written(tmp_path, truth, scale, step, count):
    times = step * np.arange(count) - 1e-3
    write(tmp_path / "a.oem", segment(times + 1e-3, [truth(t) for t in times + 1e-3], scale=scale))
    at = path(Oem("a.oem"), tmp_path, duration=300.0 if step * (count - 1) >= 300 else step * (count - 1))
    for t in (0.0, 0.4 * step, 100.0, 217.3, 299.0):
        if t <= step * (count - 1):
            # a spline that is at most 0.5 m off between samples; 4 h/|r| of that in the velocity
            np.testing.assert_allclose(at(t)[:3], truth(t)[:3], atol=0.5)
            np.testing.assert_allclose(at(t)[3:], truth(t)[3:], atol=0.05)


def test_true_equator_and_mean_equinox_are_those_of_elements(tmp_path):
    satellite = Satrec.twoline2rv(VANGUARD.line_1, VANGUARD.line_2)
    times = np.arange(-600.0, 1000.0, 60.0)
    states = [1e3 * np.concatenate(satellite.sgp4_tsince(t / 60.0)[1:]) for t in times]
    write(tmp_path / "a.oem", segment(times, states, "TEME"))
    at, elements = path(Oem("a.oem"), tmp_path), path(VANGUARD)
    for t in (0.0, 150.0, 300.0):
        # a Julian date as one double: 40 us of the Earth's rotation, 0.03 m; sidereal time: 0.02 m
        np.testing.assert_allclose(at(t)[:3], elements(t)[:3], atol=0.2)
        # SGP4's velocity is off the derivative of its position by 1.2 m/s at most
        np.testing.assert_allclose(at(t)[3:], elements(t)[3:], atol=1.5)


# Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., example 3-15: one state in four axes, 2004-04-06.
MOMENT, UT1 = "2004-04-06T07:51:28.386009Z", -0.4399619
J2000 = [5102.509600, 6123.011520, 6378.136300, -4.7432196000, 0.7905366000, 5.5337561900]
GCRF = [5102.508959, 6123.011403, 6378.136925, -4.7432201570, 0.7905364970, 5.5337557270]
TEME = [5094.180162, 6127.644659, 6380.344533, -4.7461314870, 0.7858180410, 5.5319312880]
PSEUDO_FIXED = [-1033.4750313, 7901.3055856, 6380.3445328, -3.2256327470, -2.8724425110, 5.5319312880]
ITRF = [-1033.4793830, 7901.2952754, 6380.3565958, -3.2256365200, -2.8724514500, 5.5319244460]


@pytest.mark.parametrize(
    ("frame", "state", "wanted", "off"),
    [
        ("EME2000", J2000, PSEUDO_FIXED, 0.3),  # m: terms of the nutation that are left out
        ("J2000", J2000, ITRF, 20.0),  # the pole, 0.36 arcseconds of 10 200 km
        ("GCRF", GCRF, PSEUDO_FIXED, 2.0),  # the frame bias and the corrections of the IERS, 0.06 arcseconds
        ("ICRF", GCRF, ITRF, 20.0),
        ("TEME", TEME, PSEUDO_FIXED, 0.02),  # the reference's Julian date: 20 us
        ("ITRF-97", ITRF, ITRF, 1e-6),
        ("EFG", PSEUDO_FIXED, PSEUDO_FIXED, 1e-6),
    ],
)
def test_axes(tmp_path, frame, state, wanted, off):
    state = 1e3 * np.array(state)
    steps = np.arange(-1.0, 2.0)
    # two-body motion to third order about the moment: 3 s are within a micrometre
    fixed = frame in ("ITRF-97", "EFG")
    gravity = np.zeros(3) if fixed else -3.986004418e14 * state[:3] / np.linalg.norm(state[:3]) ** 3
    states = [
        np.concatenate([state[:3] + t * state[3:] + 0.5 * t * t * gravity, state[3:] + t * gravity]) for t in steps
    ]
    write(tmp_path / "a.oem", segment(steps, states, frame, start=MOMENT))
    at = path(Oem("a.oem", ut1_minus_utc_s=UT1), tmp_path, 1.0, MOMENT)
    np.testing.assert_allclose(at(0.0)[:3], 1e3 * np.array(wanted[:3]), atol=off)
    np.testing.assert_allclose(at(0.0)[3:], 1e3 * np.array(wanted[3:]), atol=2e-3 * off + 1e-4)
    if frame in ("EME2000", "TEME"):
        late = path(Oem("a.oem"), tmp_path, 1.0, MOMENT)  # UT1 = UTC turns the Earth 0.44 s too far
        assert abs(np.linalg.norm(late(0.0)[:3] - at(0.0)[:3]) / (7.292115e-5 * 0.4399619 * 7.9686e6) - 1) < 1e-3


def test_recorded_orbit_as_a_message(tmp_path, recorded):
    orbit = read_sp3(next(recorded("sp3").glob("*.sp3")), "L27")
    rows = slice(0, 60)
    began = f"{orbit.first_epoch.isoformat()}"
    scale = {"UTC": "UTC", "TAI": "TAI", "GPS": "GPS"}[orbit.time_system]
    start = f"{from_tai(*to_tai(began, scale))}Z"
    write(tmp_path / "a.oem", segment(orbit.times[rows], orbit.states[rows], orbit.coordinate_system, scale, start))
    name = next(recorded("sp3").glob("*.sp3"))
    one = path(Oem("a.oem"), tmp_path, 3000.0, start, INERTIAL)
    other = path(Sp3(str(name), "L27"), recorded("sp3"), 3000.0, start, INERTIAL)
    for t in (0.0, 77.7, 1500.0, 2999.0):
        np.testing.assert_allclose(one(t)[:3], other(t)[:3], atol=1e-5)
        np.testing.assert_allclose(one(t)[3:], other(t)[3:], atol=1e-7)


def test_a_run_over_a_leap_second(tmp_path):
    start = "2016-12-31T23:59:30Z"
    times = np.arange(0.0, 61.0, 10.0)
    line = np.array([7e6, 0.0, 0.0, 0.0, 100.0, 0.0])
    states = [np.concatenate([line[:3] + t * line[3:], line[3:]]) for t in times]
    write(tmp_path / "a.oem", segment(times, states, start=start))
    assert "2016-12-31T23:59:60 " in (tmp_path / "a.oem").read_text()
    at = path(Oem("a.oem"), tmp_path, 60.0, start)
    for t in (29.0, 30.5, 31.0, 45.0):
        # in axes that do not turn it is a curve; the cubic spline between samples of 10 s is off by h^4/384 (w^2)^2 |x|
        np.testing.assert_allclose(at(t)[:3], line[:3] + t * line[3:], atol=1e-3)


BURN = np.array([0.0, 0.0, 2.0])


def burnt(truth, t):
    """Return the state after a burn of 2 m/s at 150 s, as if the Earth did not pull for a while."""
    state = truth(t)
    return np.concatenate([state[:3] + (t - 150) * BURN, state[3:] + BURN])


def test_segments_meet_at_a_manoeuvre(tmp_path, truth):
    before, after = np.arange(-300.0, 151.0, 30.0), np.arange(150.0, 601.0, 30.0)
    one = segment(before, [truth(t) for t in before])
    two = segment(after, [burnt(truth, t) for t in after])
    write(tmp_path / "a.oem", one, two)
    at = path(Oem("a.oem"), tmp_path)
    np.testing.assert_allclose(at(149.0)[:3], truth(149.0)[:3], atol=0.1)
    np.testing.assert_allclose(at(151.0)[:3], truth(151.0)[:3] + BURN, atol=0.1)
    np.testing.assert_allclose(at(151.0)[3:] - truth(151.0)[3:], BURN, atol=0.01)
    write(tmp_path / "b.oem", one, segment(after[1:], [burnt(truth, t) for t in after[1:]]))
    with pytest.raises(
        UserError, match=r"^target.file: b.oem: a run from 0 to 300 s is not allowed; it has -300 to 150, 180"
    ):
        path(Oem("b.oem"), tmp_path)


def test_useable_times_bound_the_run(tmp_path, truth):
    times = np.arange(-60.0, 421.0, 30.0)
    more = {"USEABLE_STOP_TIME": from_tai(*to_tai(START), "UTC").replace("18:50", "18:55")}
    write(tmp_path / "a.oem", segment(times, [truth(t) for t in times], **more))
    path(Oem("a.oem"), tmp_path)
    with pytest.raises(UserError, match="a run from 0 to 301 s is not allowed; it has -60 to 300 s"):
        path(Oem("a.oem"), tmp_path, 301.0)


def test_start_after_the_first_epoch(tmp_path, truth):
    times = np.arange(0.0, 421.0, 30.0)
    write(tmp_path / "a.oem", segment(times, [truth(t) for t in times]))
    at = path(Oem("a.oem", start_s=40.75), tmp_path, 100.0, None)
    np.testing.assert_allclose(at(7.0)[:3], truth(47.75)[:3], atol=0.1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"CENTER_NAME": "MARS BARYCENTER"}, "a.oem: segment 1: CENTER_NAME MARS BARYCENTER is not allowed; EARTH"),
        ({"REF_FRAME": "RTN"}, "a.oem: segment 1: REF_FRAME RTN is not allowed; Earth-fixed (ITRF2000 or another"),
        ({"TIME_SYSTEM": "TDB"}, "a.oem, line 10: TIME_SYSTEM 'TDB' is not allowed; UTC, TAI, GPS, TT: it departs"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path, truth, change, said):
    times = np.arange(0.0, 421.0, 30.0)
    write(tmp_path / "a.oem", segment(times, [truth(t) for t in times]))
    text = (tmp_path / "a.oem").read_text()
    for name, value in change.items():
        line = next(one for one in text.splitlines() if one.startswith(name))
        text = text.replace(line, f"{name} = {value}")
    (tmp_path / "a.oem").write_text(text)
    with pytest.raises(UserError) as caught:
        path(Oem("a.oem"), tmp_path)
    assert str(caught.value).startswith("target.file: ") and said in str(caught.value)


def test_gaps_and_wrong_velocities_are_refused(tmp_path, truth):
    times = np.concatenate([np.arange(-600.0, 61.0, 60.0), np.arange(2100.0, 2801.0, 60.0)])
    write(tmp_path / "a.oem", segment(times, [truth(t) for t in times]))
    with pytest.raises(UserError, match=r"^target.file: a.oem has a gap at 1080 s of a run of 1500 s: its samples"):
        path(Oem("a.oem"), tmp_path, 1500.0)
    path(Oem("a.oem"), tmp_path, 60.0)
    times = np.arange(-600.0, 901.0, 60.0)
    states = np.array([truth(t) for t in times])
    states[14, 3:] *= 1.01
    write(tmp_path / "b.oem", segment(times, states))
    with pytest.raises(UserError, match=r"^target.file: b.oem: segment 1: the velocity at sample 1\d is .* m/s off"):
        path(Oem("b.oem"), tmp_path)


# ------------------------------------------------------------------------------------------------------------ GPX


def walk(times, part=None, name="walk", geoid=46.5, start="2026-03-01T12:00:00"):
    second, rest = to_tai(start)
    times = np.asarray(times)
    whole = np.floor(rest + times).astype(np.int64)
    columns = 48 + 1e-5 * times, 11 + 2e-5 * times, 500 + 0.1 * times, np.full(times.size, geoid)
    part = np.zeros(times.size, dtype=np.int64) if part is None else np.asarray(part)
    return GpxTrack(name, second + whole, rest + times - whole, *columns, part)


@pytest.mark.parametrize(
    ("field", "height"),
    [
        ({}, 46.5 + 500 + 12.34),
        ({"geoid_m": 10.0}, 46.5 + 500 + 12.34),  # the file's own goes first
        ({"height_m": 700.0}, 700.0),
        ({"file": "none.gpx", "geoid_m": 10.0}, 510 + 12.34),
        ({"file": "two.gpx", "track": "walk"}, 46.5 + 500 + 12.34),
    ],
)
def test_a_track(tmp_path, field, height):
    times = np.arange(0.0, 200.0, 2.5)
    (tmp_path / "a.gpx").write_text(gpx_text([walk(times)]))
    (tmp_path / "none.gpx").write_text(gpx_text([walk(times, geoid=np.nan)]))
    (tmp_path / "two.gpx").write_text(gpx_text([walk(times, name="other", geoid=3.0), walk(times)]))
    at = path(Gpx(**{"file": "a.gpx", **field}), tmp_path, 150.0, "2026-03-01T13:00:23.4+01:00")
    latitude, longitude, found = ecef_to_geodetic(at(100.0)[:3])
    np.testing.assert_allclose(np.degrees([latitude, longitude]), [48 + 1.234e-3, 11 + 2.468e-3], atol=1e-9)
    np.testing.assert_allclose(found, height, atol=1e-3)


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ({"file": "gap.gpx"}, "target.file: gap.gpx has a gap at 50 s of a run of 100 s"),
        ({"file": "two.gpx"}, "target.file: two.gpx: no track is not allowed; one of 'a', 'b', and the only one"),
        ({"file": "two.gpx", "track": "c"}, "target.file: two.gpx: track 'c' is not allowed; one of 'a', 'b'"),
        ({"file": "flat.gpx"}, "target.file: flat.gpx: 60 points have no <ele>; height_m says how high they are"),
        ({"file": "short.gpx"}, "target.file: short.gpx: a run from 0 to 100 s is not allowed; it has 0 to 90 s"),
        ({"file": "not.gpx"}, "target.file: "),
        ({"file": ""}, "target.file: none is given; the path of a file"),
    ],
)
def test_bad_tracks_are_refused_in_one_line(tmp_path, field, said):
    times = np.arange(0.0, 300.0, 5.0)
    whole = walk(times)
    (tmp_path / "gap.gpx").write_text(gpx_text([walk([0, 20, 40, 60, 120], [0, 0, 0, 1, 1])]))
    (tmp_path / "two.gpx").write_text(gpx_text([walk(times, name="a"), walk(times, name="b")]))
    bare = replace(whole, elevation=np.full(times.size, np.nan))
    (tmp_path / "flat.gpx").write_text(gpx_text([bare]))
    (tmp_path / "short.gpx").write_text(gpx_text([walk([0, 30, 60, 90])]))
    (tmp_path / "not.gpx").write_text("<kml/>")
    with pytest.raises(UserError) as caught:
        path(Gpx(**field), tmp_path, 100.0, "2026-03-01T12:00:00Z")
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


def test_seconds_of_universal_time():
    assert posix_of(to_tai("1970-01-01T00:00:00", "TAI")[0] + 10**9) == 10**9 - 32
