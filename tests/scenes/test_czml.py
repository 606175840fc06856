"""CZML of a scene: read back, it has the places of the result, in Earth-fixed axes, and the ellipsoids."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from quietfix.diagrams.quantities.frame import EARTH_FIXED, FRAMES
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.scenes.ellipsoids import ellipsoids
from quietfix.diagrams.scenes.globe import globe_of
from quietfix.diagrams.scenes.scene import Estimated, Scene, Track
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.results import open_result
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from tests.results.made import quietfix, refused

czml = pytest.importorskip("quietfix.diagrams.scenes.czml")

EPOCHS = 8
TIMES = np.linspace(0.0, 700.0, EPOCHS)
RANDOM = np.random.default_rng(5)
FIX = 2  # an epoch without an estimate


def scene(frame=EARTH_FIXED, around=(7e6, 1e6, 3e5)):
    """A scene of random places and covariances, some of them missing."""
    target = np.asarray(around) + np.cumsum(RANDOM.normal(size=(EPOCHS, 3)), axis=0) * 1e3
    sizes = RANDOM.normal(size=(EPOCHS, 3, 3)) * 300
    covariance = sizes @ np.swapaxes(sizes, 1, 2)
    errors, cloud = RANDOM.normal(size=(EPOCHS, 3)) * 200, RANDOM.normal(size=(2, EPOCHS, 3)) * 200
    errors[FIX] = np.nan
    estimated = Estimated("filter", errors, cloud, (4, 7), *ellipsoids(covariance))
    platforms = (
        Track("#1", "platform", target + 5e5 + np.cumsum(RANDOM.normal(size=(EPOCHS, 3)), axis=0) * 1e3),
        Track("base", "station", np.broadcast_to(np.asarray(around) * 0.97, (EPOCHS, 3))),
    )
    made = Scene("made", frame, 3, TIMES, Track("target", "target", target), True, platforms, (estimated,), ("a note",))
    return made, covariance


def packets(made, origin=None, scenario=None, began=None):
    globe = globe_of(made, origin, scenario or {})
    return {one["id"]: one for one in json.loads(czml.czml_of(made, globe, began))}, globe


def samples(found, width=3):
    """Times and values of a property."""
    (values,) = (found[key] for key in ("cartesian", "unitQuaternion") if key in found)
    rows = np.reshape(values, (-1, width + 1))
    return rows[:, 0], rows[:, 1:]


def test_places_read_back_are_those_of_the_scene():
    made, _ = scene()
    found, _ = packets(made)
    assert next(iter(found)) == "document" and found["document"]["version"] == "1.0"
    for name, places in (("target/target", made.target.places), ("platform/_1", made.platforms[0].places)):
        position = found[name]["position"]
        assert position["referenceFrame"] == "FIXED"
        times, values = samples(position)
        assert np.array_equal(times, TIMES) and np.array_equal(values, places)
    assert np.array_equal(found["station/base"]["position"]["cartesian"], made.platforms[1].places[0])
    (one,) = made.estimates
    times, values = samples(found["estimate/filter"]["position"])
    kept = np.delete(np.arange(EPOCHS), FIX)
    assert np.array_equal(times, TIMES[kept])
    assert np.array_equal(values, (made.target.places + one.errors)[kept])
    assert np.array_equal(samples(found["other/filter/7"]["position"])[1], made.target.places + one.cloud[1])
    assert len(found["estimate/filter"]["availability"]) == 2  # before and after what is missing


def test_ellipsoids_read_back_are_the_covariances():
    made, covariance = scene()
    found, _ = packets(made)
    packet = found["ellipsoid/filter"]
    times, radii = samples(packet["ellipsoid"]["radii"])
    again, turns = samples(packet["orientation"], width=4)
    kept = np.delete(np.arange(EPOCHS), FIX)
    assert np.array_equal(times, TIMES[kept]) and np.array_equal(again, times)
    axes = Rotation.from_quat(turns).as_matrix()
    matrices = axes * radii[:, None, :] ** 2 @ np.swapaxes(axes, 1, 2) / chi2.ppf(0.99, 3)
    assert np.allclose(matrices, covariance[kept], rtol=1e-9, atol=1e-6)
    assert ((turns[1:] * turns[:-1]).sum(axis=-1) >= 0).all()  # what is between two epochs takes the short way


def test_places_in_axes_that_do_not_turn_are_turned_into_those_of_the_earth():
    made, covariance = scene(FRAMES["inertial"])
    found, _ = packets(made)
    times, values = samples(found["target/target"]["position"])
    longitude = np.arctan2(values[:, 1], values[:, 0])
    before = np.arctan2(made.target.places[:, 1], made.target.places[:, 0])
    assert np.allclose(longitude, before - EARTH_RATE * times, atol=1e-12)
    assert np.allclose(values[:, 2], made.target.places[:, 2])
    _, turns = samples(found["ellipsoid/filter"]["orientation"], width=4)
    back = Rotation.from_euler("z", EARTH_RATE * times[-1]).as_matrix() @ Rotation.from_quat(turns[-1]).as_matrix()
    radii = samples(found["ellipsoid/filter"]["ellipsoid"]["radii"])[1][-1]
    assert np.allclose(back * radii**2 @ back.T / chi2.ppf(0.99, 3), covariance[-1], rtol=1e-9, atol=1e-6)


def test_flat_axes_stand_where_they_are_told_to():
    made, _ = scene(FRAMES["local"], (3000.0, 4000.0, 500.0))
    with pytest.raises(UserError, match=r"--origin"):
        globe_of(made, None, {})
    found, _ = packets(made, "48,11,100")
    _, values = samples(found["target/target"]["position"])
    latitude, longitude, height = ecef_to_geodetic(values[0])
    east, north, up = made.target.places[0]
    assert np.degrees(latitude) == pytest.approx(48 + north / 111_194, abs=1e-4)
    assert np.degrees(longitude) == pytest.approx(11 + east / 111_320 / np.cos(np.radians(48)), abs=1e-4)
    assert height == pytest.approx(100 + up, abs=5)  # a flat Earth falls off it by 2 m in 5 km


def test_a_launch_frame_stands_at_its_site():
    made, _ = scene(FRAMES["launch"], (9000.0, 20000.0, 1000.0))
    site = {"site": {"latitude_deg": 38.85, "longitude_deg": 111.61, "azimuth_deg": 190.0}}
    found, globe = packets(made, None, site)
    down, up, right = (globe.rotations @ axis for axis in np.eye(3))
    normal = globe.origin / np.linalg.norm(globe.origin)
    assert normal @ up > 0.999 and np.allclose(np.cross(down, up), right)
    _, values = samples(found["target/target"]["position"])
    latitude, longitude, _ = np.degrees(ecef_to_geodetic(values[0]))
    assert latitude < 38.85 - 0.05 and longitude < 111.61  # 190 deg: to the south, a little west; right of it is west
    with pytest.raises(UserError, match="--origin"):
        globe_of(scene()[0], "48,11", {})


@pytest.mark.parametrize("text", ["48", "a,b", "91,0", "1,2,3,4", "nan,0", "0,0,1e9"])
def test_an_origin_that_is_none_is_refused(text):
    with pytest.raises(UserError, match=r"--origin: .* is not allowed; LATITUDE,LONGITUDE"):
        globe_of(scene(FRAMES["local"])[0], text, {})


def test_the_clock_is_that_of_the_result():
    made, _ = scene()
    found, _ = packets(made, began=datetime(2026, 3, 1, tzinfo=UTC))
    clock = found["document"]["clock"]
    assert clock["interval"] == "2026-03-01T00:00:00.000000Z/2026-03-01T00:11:40.000000Z"
    assert found["target/target"]["position"]["epoch"] == clock["currentTime"] == "2026-03-01T00:00:00.000000Z"
    assert "2000-01-01T12:00:00Z" in packets(made)[0]["document"]["description"]


def test_a_line_of_sight_is_there_where_the_earth_is_not_between():
    made, _ = scene()
    found, _ = packets(made)
    line = found["sight/_1"]
    assert line["polyline"]["positions"]["references"] == ["platform/_1#position", "target/target#position"]
    assert line["polyline"]["arcType"]["arcType"] == "NONE"
    behind = Track("behind", "station", np.broadcast_to([-7e6, 0.0, 0.0], (EPOCHS, 3)))
    hidden = Scene(
        *(getattr(made, one) for one in made.__dataclass_fields__ if one not in ("platforms", "estimates", "notes")),
        (behind,),
        (),
        (),
    )
    assert "sight/behind" not in packets(hidden)[0]


def test_the_command_writes_the_places_of_the_result(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = ["run", "three_satellite", "--trials", 3, "--estimator", "iekf", "--set", "duration_s=6"]
    assert quietfix(*asked, "--keep", "covariance", "--out", "three") == 0
    assert quietfix("play", "three", "--trial", 1, "--czml", "scene.czml") == 0
    found = {one["id"]: one for one in json.loads((tmp_path / "scene.czml").read_text())}
    dataset = open_result(tmp_path / "three").load()
    one = dataset["estimate"].sel(estimator="iekf", trial=1, state=list(POSITION)).values
    _, values = samples(found["estimate/iekf"]["position"])
    assert np.abs(values - one).max() < 1e-8  # truth and error are added up again
    assert quietfix("play", "three", "--czml", "scene.czml") == 0  # its own file is replaced
    assert "replaced scene.czml" in capsys.readouterr().out
    (tmp_path / "mine.czml").write_text("[]")
    assert "mine.czml exists and is no" in refused(capsys, "play", "three", "--czml", "mine.czml")
    assert "--czml: a.txt is not allowed" in refused(capsys, "play", "three", "--czml", "a.txt")
    assert "--origin" in refused(capsys, "play", "three", "--origin", "1,2")
    assert (tmp_path / "mine.czml").read_text() == "[]"
