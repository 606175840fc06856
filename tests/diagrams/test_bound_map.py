"""Maps of the bound of every system: against the bound of a study, and against what must be."""

import numpy as np
import pytest

from quietfix.diagrams.assembly.find import find, systems
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.mapping import print_map
from quietfix.diagrams.figures.gdop import draw_gdop
from quietfix.diagrams.library.models import beacon_rocket as beacon_rocket_models
from quietfix.diagrams.library.models import bearing_crossing as bearing_crossing_models
from quietfix.diagrams.library.models import dual_satellite as dual_satellite_models
from quietfix.diagrams.library.models import satellite_ranging as satellite_ranging_models
from quietfix.diagrams.library.models import three_satellite as three_satellite_models
from quietfix.diagrams.maps.bounds import last_bound, map_bounds
from quietfix.diagrams.parts.launch import vehicle_block
from quietfix.diagrams.statistics.posterior_bound import posterior_bound
from quietfix.diagrams.studies.whole import run_study
from tests.diagrams.test_command_line import in_process
from tests.fitting import check_fits

SHORT = ["duration_s=60"]


def final(system, estimator, settings, quantity="position"):
    data = run_study(system, estimators=[estimator], trials=1, set=settings, every=10**6)
    return float(data[f"bound_{quantity}"].sel(estimator=estimator)[-1])


def orbit_map(scenario, points):
    return satellite_ranging_models.bound_map(scenario, scenario.target, points)


@pytest.mark.parametrize("name", systems())
def test_every_packaged_system_offers_a_map(name):
    found = find(name).system
    assert found.declare(load_scenario(name)).map is not None


@pytest.mark.parametrize("variant", [None, "manoeuvre"])
def test_bearings_map_is_the_bound_of_studies_with_the_target_there(variant):
    name = "bearing_crossing" + (f":{variant}" if variant else "")
    found = map_bounds(
        bearing_crossing_models.bound_map(load_scenario("bearing_crossing", variant, settings=SHORT), points=6)
    )
    for i, j in ((4, 1), (1, 3)):
        place = [float(found["east"][j]), float(found["north"][i])]
        expected = final(name, "ekf", [*SHORT, f"truth.target_km={place}"])
        assert float(found["position"][0, i, j]) == pytest.approx(expected, rel=1e-9)


def test_bearings_locate_nothing_ahead_of_a_straight_flight():
    scenario = load_scenario("bearing_crossing", settings=SHORT)
    found = map_bounds(bearing_crossing_models.bound_map(scenario, points=7))["position"].sel(set="azimuth")
    east = found["east"].values
    ahead = found.sel(north=0.0, method="nearest").values[(east > 20) | (east < -10)]
    # the range stays what it was assumed to be
    np.testing.assert_allclose(ahead, 30e3, rtol=0.01)
    # and mirror images are alike
    np.testing.assert_allclose(found.values, found.values[::-1], rtol=1e-9)


def test_orbit_map_is_the_bound_of_the_study_of_that_orbit():
    settings = ["duration_s=600", "target.inclination_deg=90", "target.perigee_passage_s=0"]
    found = map_bounds(orbit_map(load_scenario("satellite_ranging", settings=settings), points=(3, 3)))
    for estimator, name in (("bo", "angles"), ("bcr", "angles + rates"), ("iekf", "all six rows")):
        for quantity in ("position", "velocity"):
            value = found[quantity].sel(set=name, inclination=90.0, phase=0.0)
            # the map's Runge-Kutta steps against the study's dense orbit
            assert float(value) == pytest.approx(final("satellite_ranging", estimator, settings, quantity), rel=1e-5)


def test_rocket_map_is_that_of_the_flight_where_the_flight_is():
    scenario = load_scenario("beacon_rocket", settings=["start_s=100", "stop_s=160"])
    of = beacon_rocket_models.bound_map(scenario, points=(3, 5))
    vehicle = vehicle_block(scenario)
    flown = np.array([np.concatenate(vehicle.at(float(t))) for t in np.linspace(100, 160, 400)])
    column = of.truth[:, 0]
    for state in column:
        nearest = flown[np.argmin(np.abs(flown[:, 0] - state[0]))]
        # but for half a step of the flight; place across, velocity and acceleration
        np.testing.assert_allclose(state[2:9], nearest[2:9], rtol=0.02, atol=0.5)
    (model,) = of.sets.values()
    one = posterior_bound(of.truth[[3]], of.platforms, of.times, model, of.motion, of.prior, False)[0, -1]
    np.testing.assert_allclose(last_bound(of, model)[3], one, rtol=1e-9, atol=1e-9)
    # a station below the horizon does not help
    masked = beacon_rocket_models.bound_map(
        load_scenario("beacon_rocket", "masked", settings=["start_s=100", "stop_s=160"]), points=(3, 5)
    )
    assert not masked.present.all()
    whole, less = (map_bounds(m)["position"].values for m in (of, masked))
    assert (less >= whole * (1 - 1e-9))[np.isfinite(whole)].all() and np.nanmax(less / whole) > 1.5


def test_more_rows_never_raise_the_bound_and_no_bound_is_above_the_prior():
    dual = map_bounds(dual_satellite_models.bound_map(load_scenario("dual_satellite", settings=SHORT)))
    whole = dual["position"].sel(set="direction + TDOA + FDOA")
    for name in ("direction", "TDOA + FDOA"):
        part = dual["position"].sel(set=name)
        assert (part.values >= whole.values * (1 - 1e-9))[np.isfinite(whole.values)].all()
    # what the prior becomes in 60 s: 5 km, and 400 m/s as long
    assert float(dual["height"].max()) < np.hypot(5e3, 24e3)
    of = orbit_map(load_scenario("satellite_ranging", settings=["duration_s=600"]), points=(5, 7))
    position = map_bounds(of)["position"].values
    assert (position[2] <= position[1] * (1 + 1e-9)).all() and (position[1] <= position[0] * (1 + 1e-9)).all()


@pytest.mark.parametrize(
    ("make", "system", "settings"),
    [
        (lambda s: bearing_crossing_models.bound_map(s, 6), "bearing_crossing", SHORT),
        (lambda s: beacon_rocket_models.bound_map(s, (3, 4)), "beacon_rocket", ["start_s=100", "stop_s=160"]),
        (lambda s: orbit_map(s, (3, 4)), "satellite_ranging", ["duration_s=100"]),
        (lambda s: three_satellite_models.bound_map(s, {"one": ["tdoa"]}, spacing_km=750.0), "three_satellite", SHORT),
    ],
    ids=["bearings", "rocket", "orbits", "ground"],
)
def test_figures_and_titles_say_noise_and_prior(make, system, settings, tmp_path, capsys, printed_tables):
    found = map_bounds(make(load_scenario(system, settings=settings))).isel(set=[0])
    assert all(found.attrs[name] for name in ("noise", "prior", "target"))
    written = draw_gdop(found, tmp_path)
    assert len(written) == len(found.attrs["quantities"])
    assert all(path.stat().st_size > 10_000 for path in written)
    print_map(found)
    check_fits(printed_tables[-1])
    printed = capsys.readouterr().out
    assert "prior" in printed and "median" in printed


def test_mistakes(monkeypatch, capsys, tmp_path):
    monkeypatch.delenv("QUIETFIX_DATA", raising=False)
    status, _, err = in_process(
        capsys, "gdop", "satellite_ranging", "--set", "target=!Sp3 {file: x}", "--out", str(tmp_path / "g")
    )
    assert status == 2 and "target.file: x is looked for" in err and err.count("\n") == 1
    status, _, err = in_process(capsys, "gdop", "bearing_crossing", "--set", "truth.observer=!Waypoints {}")
    assert status == 2 and "points_km: 0 are given" in err and err.count("\n") == 1
    assert not (tmp_path / "g").exists() and not (tmp_path / "g.partial").exists()
