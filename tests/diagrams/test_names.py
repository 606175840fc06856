"""Results speak of names: platforms, rows, states and their units; and which results are read."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr

from quietfix.diagrams import run_study
from quietfix.diagrams.experiments.sweep import Sweep
from quietfix.diagrams.maps.bounds import map_bounds
from quietfix.diagrams.maps.default import default_maps
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import causal
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.rerun import ask_again
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study
from tests.diagrams.drone_module import DRONE

OWN = Path(__file__).parents[1] / "own"
FEW = "estimators.few=!Iekf {measurements: [bearing, barometer]}"
DRONE_ROWS = ["tdoa_alpha_delta", "tdoa_bravo_delta", "tdoa_charlie_delta", "azimuth_alpha", "altitude"]
NAMED = {
    "three_satellite": ["satellite_0", "satellite_1", "satellite_2"],
    "dual_satellite": ["main", "auxiliary"],
    "satellite_ranging": ["observer"],
    "bearing_crossing": ["observer"],
    "beacon_rocket": [f"station_{i}" for i in range(8)],
}


@pytest.fixture(scope="module")
def drone():
    return Study(str(OWN / "drone.yaml"), trials=3, set=["duration_s=10", FEW], keep="all", chunk=2)


@pytest.fixture(scope="module")
def stored(drone, tmp_path_factory):
    out = tmp_path_factory.mktemp("names") / "out"
    with OutputFolder(out) as folder:
        for chunk in drone.chunks():
            folder.append(chunk)
        folder.finish()
    return out


def test_platforms_and_rows_of_a_result_have_their_names(stored):
    found = open_result(stored)
    assert list(found["platform"].values) == ["alpha", "bravo", "charlie", "delta"]
    assert list(found["coordinate"].values) == ["x", "y", "z", "vx", "vy", "vz"]
    assert list(found["row"].values) == list(found["innovation_row"].values) == DRONE_ROWS
    assert list(found["row_units"].values) == list(found["innovation_row_units"].values) == ["s"] * 3 + ["rad", "m"]
    np.testing.assert_array_equal(found["platforms"].sel(platform="bravo", coordinate="z", time=4.0), 120.0)


def test_an_innovation_is_at_the_name_of_its_row_whatever_else_the_estimator_uses(stored):
    found = open_result(stored).load()
    few = found["innovation"].sel(estimator="few")
    assert few.sel(innovation_row=DRONE_ROWS[:3]).isnull().all()
    # the altitude is z itself: measurement less prediction, to the last bit but for the order of two subtractions
    expected = found["measurement"].sel(row="altitude") - found["prediction"].sel(state="z")
    np.testing.assert_allclose(
        found["innovation"].sel(innovation_row="altitude"), expected.transpose("estimator", "trial", "time"), rtol=1e-12
    )
    assert few.sel(innovation_row="altitude").notnull().any()
    np.testing.assert_array_equal(found["in_innovation"].sel(estimator="few"), [False] * 3 + [True] * 2)


@pytest.mark.parametrize("system", [*NAMED, str(OWN / "drone.yaml")])
def test_everything_has_units_and_a_line_that_says_what_it_is(system):
    short = {"beacon_rocket": ["stop_s=50.1"], "satellite_ranging": ["duration_s=50"]}.get(system, ["duration_s=2"])
    one = {"satellite_ranging": "ukf", "bearing_crossing": "raw_first"}.get(system, "iekf")
    found = run_study(system, trials=2, set=short, estimators=[one], keep="all")
    lacking = [n for n in found.variables if not (found[n].attrs.get("units") and found[n].attrs.get("long_name"))]
    assert lacking == []
    assert list(found["platform"].values) == NAMED.get(system, ["alpha", "bravo", "charlie", "delta"])
    assert "unknown" not in {found[n].attrs["units"] for n in found.variables}
    assert found["bound_position"].attrs["units"] == "m" and found["time"].attrs["units"] == "s"


@pytest.mark.slow
def test_rows_that_come_from_samples_have_units():
    """Time and frequency differences of a cross-ambiguity block, joined with what other blocks measure."""
    found = run_study("dual_satellite:signal", trials=1, set=["duration_s=1"], estimators=["iekf"], keep="all")
    assert "unknown" not in {found[n].attrs["units"] for n in found.variables}
    assert list(found["row_units"].values) == ["rad", "rad", "s", "Hz"]


def test_points_of_a_sweep_and_maps_say_what_they_are():
    options = {"estimators": ["iekf"], "trials": 2, "set": ["duration_s=2"]}
    sweep = Sweep(str(OWN / "drone.yaml"), "sensors.tdoa.sigma_ns=20:40:2", **options)
    scenario = DRONE.load()
    (of, *_) = default_maps(DRONE.model(scenario), scenario.estimators, points=3)
    found = map_bounds(of)
    for dataset in (next(iter(sweep.points())), found):
        assert [n for n in dataset.variables if not {"units", "long_name"} <= set(dataset[n].attrs)] == []
    assert list(found["curve"].values) == ["platform_0", "platform_1", "platform_2", "platform_3"]
    assert found["position"].attrs == {"units": "m", "long_name": "bound of the position"}


def test_names_of_platforms_must_fit():
    model = DRONE.model(DRONE.load())
    for names in (["a"], ["a"] * 4, "abcd", [1, 2, 3, 4]):
        with pytest.raises(UserError, match=r"platforms: .* is not allowed; 4 different names"):
            Study(DRONE, model=replace(model, platforms=names))
    assert Study(DRONE, model=model).probe.platform_names == tuple(f"platform_{i}" for i in range(4))


# ---------------------------------------------------------------------------------------------------- versions


def changed(stored, tmp_path, **attributes):
    """Copy a result and change attributes of its store; None takes one out."""
    copy = tmp_path / "copy"
    shutil.copytree(stored, copy)
    group = zarr.open_group(copy / "results.zarr", mode="r+", use_consolidated=False)
    for name, value in attributes.items():
        if value is None:
            del group.attrs[name]
        else:
            group.attrs[name] = value
    return copy


def test_a_result_says_its_schema(stored):
    assert open_result(stored).attrs["schema_version"] == SCHEMA_VERSION


@pytest.mark.parametrize("version", [SCHEMA_VERSION + 1, 0, "2", True])
def test_a_result_of_another_schema_is_refused_in_one_line(stored, tmp_path, version):
    copy = changed(stored, tmp_path, schema_version=version)
    for read in (open_result, lambda path: ask_again(path, None, {}, False)):
        with pytest.raises(UserError, match=r"schema_version: .* is not allowed; 1 to 2") as caught:
            read(copy)
        assert "\n" not in str(caught.value)


def test_a_result_without_a_schema_is_read(stored, tmp_path):
    copy = changed(stored, tmp_path, schema_version=None, looks_ahead="ekf,few")
    group = zarr.open_group(copy / "results.zarr", mode="r+", use_consolidated=False)
    del group["causal"]
    found = open_result(copy)
    assert {name: causal(found, name) for name in ("ekf", "iekf", "ukf", "few")} == {
        "ekf": False,
        "iekf": True,
        "ukf": True,
        "few": False,
    }
    assert ask_again(copy, None, {}, False)[1]["trials"] == 3


def test_a_late_clock_of_an_earlier_result_has_its_name(stored, tmp_path):
    text = open_result(stored).attrs["scenario"].replace("clock_offset_platform: ''", "clock_offset_platform: 3", 1)
    assert text.count("clock_offset_platform: 3") == 1
    copy = changed(stored, tmp_path, schema_version=None, scenario=text)
    scenario = ask_again(copy, None, {}, False)[1]["scenario"]
    assert [one.errors.clock_offset_platform for one in scenario.sensors.values()] == ["delta", "", ""]
