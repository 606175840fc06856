"""Where a station is that heard a known satellite: its ellipse holds it, or the program says why not."""

import json

import numpy as np
import pytest

from quietfix.diagrams.identification.command import Asked, find_station
from quietfix.diagrams.identification.station_report import station_verdict
from tests.identification.doppler import CARRIER, STATION, lines_of, received
from tests.identification.test_identify import OBJECTS, TIMES, elements, quietfix, write


def off(place, latitude, longitude):
    """How far a place is off, east and north [m]."""
    metres = np.radians(1.0) * 6.371e6
    return metres * np.array([(longitude - place[1]) * np.cos(np.radians(latitude)), latitude - place[0]])


def held(one, latitude, longitude):
    """Whether the 99 % ellipse of a place holds another one."""
    d = off((one.latitude, one.longitude), latitude, longitude)
    return bool(d @ np.linalg.solve(one.covariance, d) <= one.radius)


def test_the_station_that_heard_fox_1d_is_in_an_ellipse_and_the_other_side_is_named(recorded, capsys, tmp_path):
    folder = recorded("fox1d_doppler")
    (file,) = folder.glob("*.csv")
    place = json.loads(file.with_suffix(".md").read_text())
    asked = file, "--tle", folder / "pslv40_st.tle", "--object", "43137", "--carrier-mhz", 145.88
    status, shown = quietfix(capsys, *asked, "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "station.json").read_text())
    assert status == 0
    assert not found["vouched"]
    assert "cannot vouch" in shown
    assert "the other side of the track" in shown
    assert len(found["places"]) == 2
    near = min(found["places"], key=lambda one: abs(one["longitude_deg"] - place["gs_lon"]))
    d = off((near["latitude_deg"], near["longitude_deg"]), place["gs_lat"], place["gs_lon"])
    # at 22 m/s per block of four seconds, with drift and drift rate free: 15 km
    assert np.linalg.norm(d) < 20e3
    assert d @ np.linalg.solve(near["covariance_east_north_m2"], d) < 9.21
    assert near["half_axes_99_m"][0] < 40e3
    shapes = json.loads((tmp_path / "out" / "station.geojson").read_text())["features"]
    assert [one["geometry"]["type"] for one in shapes] == ["Point", "MultiPolygon"] * 2


def test_an_oscillator_that_does_more_than_is_asked_for_is_told(tmp_path):
    times = TIMES[::2]
    since = (times - times.mean()) / 100.0
    shift = CARRIER / 299_792_458.0 * 60.0 * since**2  # m/s
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], times, noise=1.0) - shift, times)
    asked = Asked(file, elements(tmp_path, [90001]), height=520.0, carrier_mhz=CARRIER / 1e6, oscillator="bias")
    located, _, _ = find_station(asked)
    assert any("one more state" in doubt for doubt in located.doubts)
    assert "cannot vouch" in station_verdict(located)


@pytest.mark.parametrize("seed", range(3))
def test_ellipses_hold_the_station(seed, tmp_path):
    times = TIMES[::2]
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], times, noise=3.0, ahead=0.1, seed=seed), times)
    asked = Asked(file, elements(tmp_path, [90001]), height=520.0, carrier_mhz=CARRIER / 1e6)
    located, _, _ = find_station(asked)
    assert any(held(one, *STATION[:2]) for one in located.places)
    assert located.places[0].axes[0] < 60e3
    if not located.doubts:
        assert held(located.places[0], *STATION[:2])


def test_the_wrong_satellite_is_not_vouched_for(tmp_path):
    stranger = lines_of(90009, 309.0, 111.5, inclination=63.0)
    file = write(tmp_path, CARRIER + received(stranger, TIMES, noise=1.0))
    located, _, _ = find_station(Asked(file, elements(tmp_path, [90001]), carrier_mhz=CARRIER / 1e6))
    assert located.doubts or not any(held(one, *STATION[:2]) for one in located.places)


def test_which_object_must_be_said(capsys, tmp_path):
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES))
    status, shown = quietfix(capsys, file, "--tle", elements(tmp_path))
    assert status == 2
    assert "--object: none is given, and all.tle has 6" in shown
