"""The map that a system of a user's own asks for: every point is the bound of a study whose target starts there."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands.mapping import bound_maps
from quietfix.diagrams.maps.bounds import map_bounds
from quietfix.diagrams.own.system import own_system
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef

HERE = Path(__file__).parent
SHORT = {"drone.yaml": ["duration_s=12"], "geostationary.yaml": ["duration_s=20"], "three_satellite.yaml": []}
STILL = {"drone.yaml": "!Fixed {east_km: -5, north_km: 2, up_m: 900}"}


def maps(name, *settings):
    system = own_system(HERE / name)
    still = [f"target={STILL[name]}"] if name in STILL else []
    return bound_maps(system, system.load(settings=[*SHORT[name], *still, *settings]))


def bound_of(name, target):
    """Return the bounds at the end of a study of a target at rest [m], by quantity."""
    changes = dict(one.split("=") for one in SHORT[name]) | {"target": target}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = run_study(str(HERE / name), set=changes, trials=1, estimators=["iekf"])
    return {q: float(result[f"bound_{q}"].isel(time=-1, estimator=0)) for q in ("position", "height", "velocity")}


def check_point(name, of, i, j, target):
    found = map_bounds(of)
    for quantity, expected in bound_of(name, target).items():
        assert float(found[quantity][0, i, j]) == pytest.approx(expected, rel=1e-6), quantity


def test_a_level_map_in_local_axes():
    (of,) = maps(
        "drone.yaml",
        "map={extent_km: 6, spacing_km: 2.5, centre: !Fixed {east_km: 1, north_km: -2, up_m: 7}, height_m: 500}",
    )
    np.testing.assert_allclose(of.plane.values[0], [-7, -4.5, -2, 0.5, 3])
    np.testing.assert_allclose(of.plane.values[1], [-4, -1.5, 1, 3.5, 6])
    assert of.plane.names == ("north", "east") and "at a height of 500 m" in of.stated["target"]
    np.testing.assert_allclose(of.points, [[2, -5]])  # the scenario's own target, off the map's side
    check_point("drone.yaml", of, 3, 1, "!Fixed {east_km: -1.5, north_km: 0.5, up_m: 500}")


@pytest.mark.parametrize(("plane", "east", "north"), [("east_up", 4, 0), ("north_up", 0, 4)])
def test_an_upright_map_in_local_axes(plane, east, north):
    (of,) = maps("drone.yaml", f"map={{plane: {plane}, extent_km: 8, spacing_km: 4, top_km: 2}}")
    np.testing.assert_allclose(of.plane.values[0], [0, 0.5, 1, 1.5, 2])
    np.testing.assert_allclose(of.plane.values[1], [-8, -4, 0, 4, 8])
    assert of.plane.names == ("up", plane.removesuffix("_up")) and not of.equal
    np.testing.assert_allclose(of.points, [[0.9, 0]], atol=1e-12)
    check_point("drone.yaml", of, 3, 3, f"!Fixed {{east_km: {-5 + east}, north_km: {2 + north}, up_m: 1500}}")


@pytest.mark.parametrize("plane", ["level", "north_up"])
def test_maps_over_the_ellipsoid(plane):
    """Places are arcs on the sphere through the middle, 11 km off those of the ellipsoid at most; bounds are exact."""
    settings = "extent_km: 900, spacing_km: 450, centre: !Geodetic {latitude_deg: 40, longitude_deg: 5}"
    (of,) = maps("geostationary.yaml", f"map={{plane: {plane}, {settings}, height_m: 2000}}")
    place = of.truth[:, 0, :3].reshape(5, 5, 3)
    latitude, longitude, height = ecef_to_geodetic(place)
    middle = geodetic_to_ecef(np.radians(40), np.radians(5), 2000.0)
    if plane == "level":
        np.testing.assert_allclose(height, 2000.0, atol=1e-6)
        np.testing.assert_allclose(place[2, 2], middle, atol=1e-6)
        assert np.linalg.norm(place[3, 2] - middle) == pytest.approx(450e3, rel=0.01)
        assert latitude[3, 2] > latitude[2, 2] and longitude[2, 3] > longitude[2, 2]
    else:
        # twice the height is less than a quarter of the base
        np.testing.assert_allclose(height, np.linspace(0, 225e3, 5)[:, None] * np.ones(5), atol=1e-3)
        np.testing.assert_allclose(latitude[:, 2], np.radians(40), atol=1e-12)
    angles = [float(np.degrees(angle[3, 1])) for angle in (latitude, longitude)]
    there = f"latitude_deg: {angles[0]!r}, longitude_deg: {angles[1]!r}, height_m: {float(height[3, 1])!r}"
    check_point("geostationary.yaml", of, 3, 1, f"!Geodetic {{{there}}}")


def test_an_orbit_is_turned_about_the_earth():
    text = (HERE / "three_satellite.yaml").read_text()
    assert "map" not in text  # the default one stays
    system = own_system(HERE / "three_satellite.yaml")
    ships = ["frame=inertial", "sensors={r: !Relative {sigma_elevation_deg: 0.1}}", "estimators={iekf: !Iekf {}}"]
    ships += ["target=!Kepler {true_anomaly_deg: 3}", "start=!Prior {}", "belief={motion: !Orbital {}}"]
    ships += ["map={extent_km: 100, spacing_km: 100, centre: !Kepler {true_anomaly_deg: 20}}", "duration_s=10"]
    (of,) = bound_maps(system, system.load(settings=ships))
    angle = np.radians(20)
    expected = 7078137.0 * np.array([np.cos(angle), np.sin(angle) / 2, np.sin(angle) * np.sqrt(3) / 2])
    np.testing.assert_allclose(of.truth[4, 0, :3], expected, atol=1e-3)
    assert of.plane.labels[0].startswith("across the target's orbit")


def test_without_a_map_it_is_the_default_one():
    (of,) = maps("drone.yaml")
    assert of.equal and of.plane.values[0].size == 31 and "height of" not in of.stated["target"]


MISTAKES = {
    "a spacing beyond the extent": ("{extent_km: 5, spacing_km: 6}", "map: a spacing of 6 km is not allowed; at most"),
    "too fine": ("{extent_km: 50, spacing_km: 0.01}", "map: a spacing of 0.01 km is not allowed up to 50 km; "),
    "no extent": ("{extent_km: 0}", "map.extent_km: 0"),
    "no such plane": ("{plane: tilted}", "map.plane: 'tilted' is not allowed; one of level, east_up, north_up"),
    "a top of a level plane": ("{top_km: 5}", "map.top_km: 5 is not allowed on a level plane"),
    "a centre of another frame": (
        "{centre: !Geodetic {}}",
        "map.centre: !Geodetic is not allowed in frame local; !Fixed",
    ),
    "a field that is not there": ("{width_km: 5}", "map.width_km"),
}


@pytest.mark.parametrize("title", MISTAKES)
def test_mistakes_are_one_clear_line(title):
    field, words = MISTAKES[title]
    with pytest.raises(UserError) as caught:
        maps("drone.yaml", f"map={field}")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_what_other_frames_have_not():
    with pytest.raises(UserError, match="map: an extent of 5000 km is not allowed; at most 31"):
        maps("geostationary.yaml", "map.extent_km=5000")
    inertial = ["frame=inertial", "sensors={r: !Relative {}}", "start=!Prior {}", "estimators={iekf: !Iekf {}}"]
    for field, value in (("height_m", "5"), ("plane", "east_up")):
        with pytest.raises(UserError, match=f"map.{field}: {value} is not allowed in frame inertial"):
            maps("geostationary.yaml", *inertial, "target=!Kepler {}", f"map.{field}={value}")
