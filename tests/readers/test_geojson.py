"""GeoJSON: ellipses that hold as many errors as they say, wherever on the Earth, and geometry as RFC 7946 has it."""

import json

import numpy as np
import pytest
from matplotlib.path import Path

from quietfix.diagrams.writers.geojson import EstimatedTrack, geojson_text, horizontal
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef

PLACES = [(48.0, 11.0), (0.0, 180.0), (10.0, -179.9999), (-60.0, 179.99)]
PLACES += [(89.9999, 30.0), (90.0, 0.0), (-89.97, 180.0), (89.9, -90.0)]
COVARIANCE = np.array([[9e6, 2e6, 1e5], [2e6, 1e6, 0.0], [1e5, 0.0, 4e6]])


def track(latitude, longitude, covariance=COVARIANCE, **more):
    latitude, longitude = np.atleast_1d(latitude).astype(float), np.atleast_1d(longitude).astype(float)
    count = latitude.size
    second = 10**9 + np.arange(count)
    matrices = None if covariance is None else np.broadcast_to(covariance, (count, 3, 3))
    columns = {"height": np.full(count, 1000.0), "covariance": matrices, **more}
    return EstimatedTrack("drone", second, np.zeros(count), latitude, longitude, **columns)


def features(one, **options):
    found = json.loads(geojson_text([one], **options))
    assert found["type"] == "FeatureCollection"
    for feature in found["features"]:
        check(feature["geometry"])
    return found["features"]


def rings(geometry):
    return [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]


def check(geometry):
    """Sections 3.1.1, 3.1.6 and 3.1.9: longitudes in range, rings closed and counter-clockwise, nothing across 180."""
    if "Polygon" in geometry["type"]:
        for (ring,) in rings(geometry):
            assert ring[0] == ring[-1] and len(ring) >= 4
            x, y = np.array(ring).T
            x, y = x - x[0], y - y[0]  # small rings: no digits are lost
            assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0
            assert np.all(np.abs(ring) <= [180, 90])


def inside(geometry, longitude, latitude):
    points = np.stack([longitude, latitude], axis=-1)
    return np.any([Path(np.array(ring)).contains_points(points) for (ring,) in rings(geometry)], axis=0)


@pytest.mark.parametrize(("latitude", "longitude"), PLACES)
def test_ellipses_hold_what_they_say(latitude, longitude):
    found = [one for one in features(track(latitude, longitude)) if one["properties"]["kind"] == "ellipse"]
    count = 20_000
    errors = np.random.default_rng(5).multivariate_normal(np.zeros(3), COVARIANCE, count)
    turn = enu_rotation(np.radians(latitude), np.radians(longitude))
    place = geodetic_to_ecef(np.radians(latitude), np.radians(longitude), 1000.0)
    north, east, _ = ecef_to_geodetic(place + errors @ turn)
    for feature, share in zip(found, (1 - np.exp(-0.5), 0.95), strict=True):
        held = inside(feature["geometry"], np.degrees(east), np.degrees(north)).mean()
        # 4 standard deviations of a share of 20 000; 64 corners hold 0.2 % less than the ellipse
        assert abs(held - share) < 4 * np.sqrt(share * (1 - share) / count) + 2e-3


def test_axes_of_an_ellipse():
    """At the equator: a degree of longitude is a pi/180, one of latitude a (1 - e^2) pi/180."""
    matrix = np.diag([4e6, 1e6, 1.0])
    one = features(track(0.0, 20.0, matrix, height=np.zeros(1)))[1]
    assert one["properties"]["size"] == "1 sigma"
    ring = np.array(one["geometry"]["coordinates"][0])
    half = 0.5 * np.ptp(ring, axis=0)
    axis, square = 6378137.0, 6.69437999014e-3
    np.testing.assert_allclose(half, np.degrees([2000 / axis, 1000 / (axis * (1 - square))]), rtol=1e-6)


def test_covariance_of_earth_fixed_axes():
    """At latitude 0 and longitude 90 deg east is -x, north z and up y."""
    fixed = np.diag([1.0, 4.0, 9.0])[None]
    np.testing.assert_allclose(
        horizontal(fixed, np.zeros(1), np.array([90.0]))[0], np.diag([1.0, 9.0, 4.0]), atol=1e-12
    )
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    turned = horizontal((root @ root.T)[None], np.array([47.0]), np.array([11.0]))[0]
    np.testing.assert_allclose(np.linalg.eigvalsh(turned), np.linalg.eigvalsh(root @ root.T), rtol=1e-10)


def test_a_line_is_cut_at_the_date_line():
    (line,) = (f for f in features(track([10, 12, 13], [179, -179, -178], None)) if f["properties"]["kind"] == "track")
    assert line["geometry"]["type"] == "MultiLineString"
    west, east = line["geometry"]["coordinates"]
    assert [p[:2] for p in west] == [[179.0, 10.0], [180.0, 11.0]]
    assert [p[:2] for p in east] == [[-180.0, 11.0], [-179.0, 12.0], [-178.0, 13.0]]


@pytest.mark.parametrize(
    ("longitude", "parts"),
    [
        ([179, 180, 179], [[179, 180, 179]]),
        ([179, 180, -179], [[179, 180], [-180, -179]]),
        ([-179, -180, 179], [[-179, -180], [180, 179]]),
        ([179, -179, 179], [[179, 180], [-180, -179, -180], [180, 179]]),
        ([181, 182], [[-179, -178]]),
    ],
)
def test_lines_along_the_date_line(longitude, parts):
    found = features(track([0] * len(longitude), longitude, None))[0]["geometry"]
    lines = found["coordinates"] if found["type"] == "MultiLineString" else [found["coordinates"]]
    assert [[p[0] for p in line] for line in lines] == parts


def test_properties_and_what_is_missing():
    matrix = np.stack([COVARIANCE, np.full((3, 3), np.nan), COVARIANCE])
    one = track([1, 2, 3], [5, 6, np.nan], matrix, nis=np.array([2.5, np.nan, 1.0]))
    found = features(one)
    points = [f for f in found if f["properties"]["kind"] == "estimate"]
    assert [p["properties"]["nis"] for p in points] == [2.5, None]
    first = points[0]["properties"]
    assert first["time"] == "2001-09-09T01:46:08Z" and first["height_m"] == 1000.0  # 10^9 s of TAI, 32 s ahead
    assert (first["sigma_east_m"], first["sigma_north_m"], first["sigma_up_m"]) == (3000.0, 1000.0, 2000.0)
    assert points[1]["properties"]["sigma_east_m"] is None
    assert sum(f["properties"]["kind"] == "ellipse" for f in found) == 2
    assert points[0]["geometry"]["coordinates"] == [5.0, 1.0, 1000.0]


def test_ellipses_beyond_reason():
    huge = features(track(20.0, 30.0, 1e16 * np.eye(3)))
    assert all(f["properties"]["clipped"] for f in huge if f["properties"]["kind"] == "ellipse")
    flat = features(track(20.0, 30.0, np.zeros((3, 3))))
    assert sum(f["properties"]["kind"] == "ellipse" for f in flat) == 2
    for bad in (np.diag([-1.0, 1.0, 1.0]), np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]])):
        with pytest.raises(ValueError, match="is not allowed"):
            geojson_text([track(20.0, 30.0, bad)])
    with pytest.raises(ValueError, match="latitude beyond 90"):
        geojson_text([track(90.1, 30.0)])


def test_every_so_many_points():
    found = features(track(np.zeros(10), np.arange(10.0)), every=4)
    assert [f["geometry"]["coordinates"][0] for f in found if f["properties"]["kind"] == "estimate"] == [0, 4, 8]
    assert len(found[0]["geometry"]["coordinates"]) == 10
