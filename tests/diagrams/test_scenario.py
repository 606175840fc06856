"""Scenarios: layers, checks in the user's words, and text that loads back."""

import dataclasses

import pytest

from quietfix.diagrams.assembly.find import find, systems
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.commands.catalogue import load_scenario, variants
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import dump, read_yaml

EVERY = [(name, variant) for name in systems() for variant in [None, *variants(name)]]


@pytest.mark.parametrize(("name", "variant"), EVERY)
def test_printed_scenario_loads_back_as_it_was(name, variant):
    scenario = load_scenario(name, variant)
    for comments in (True, False):
        again = load_scenario(name, text=dump(scenario, comments))
        assert again == scenario
        assert list(again.estimators) == list(scenario.estimators)


@pytest.mark.parametrize("name", systems())
def test_every_field_is_documented(name):
    def walk(value, path):
        for field in dataclasses.fields(value):
            here = f"{path}.{field.name}"
            assert field.metadata.get("doc"), f"{here} has no documentation"
            item = getattr(value, field.name)
            if dataclasses.is_dataclass(item):
                walk(item, here)
            for part in item.values() if isinstance(item, dict) else item if isinstance(item, list) else ():
                if dataclasses.is_dataclass(part):
                    walk(part, here)

    walk(load_scenario(name), name)


def test_settings_change_what_they_name_and_nothing_else():
    plain = load_scenario("three_satellite")
    changed = load_scenario(
        "three_satellite",
        settings=["truth.sigma_tdoa_ns=30", "estimators.iekf.max_iterations=1", "satellites.1.along_km=-50"],
    )
    assert changed.truth.sigma_tdoa_ns == 30
    assert changed.estimators["iekf"].max_iterations == 1
    assert changed.satellites[1].along_km == -50
    assert dataclasses.replace(changed.truth, sigma_tdoa_ns=20.0) == plain.truth
    assert list(changed.estimators) == list(plain.estimators)


def test_tag_replaces_the_block():
    scenario = load_scenario("three_satellite", settings=["truth.motion=!RandomAcceleration {acceleration_mps2: 0.2}"])
    assert scenario.truth.motion.acceleration_mps2 == 0.2
    scenario = load_scenario("three_satellite", settings=["estimators.ekf=!Ukf {alpha: 0.5}"])
    assert scenario.estimators["ekf"].alpha == 0.5


def test_users_file_lies_over_the_packaged_values(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("truth: {height_km: 12}\nestimators: {mine: !Iekf {measurements: [tdoa]}}\n")
    scenario = load_scenario("three_satellite", file=file)
    assert scenario.truth.height_km == 12
    assert scenario.truth.speed_mps == 300
    assert "mine" in scenario.estimators and "iekf" in scenario.estimators


MISTAKES = [
    ("truth.sigma_tdoa_ns=-3", ["truth.sigma_tdoa_ns", "-3", "> 0"]),
    ("truth.sigma_tdoa_ns=.nan", ["truth.sigma_tdoa_ns", "nan", "finite"]),
    ("truth.sigma_tdoa_ns=many", ["truth.sigma_tdoa_ns", "many", "a number"]),
    ("truth.sigma_tdoa_ns=[1, 2]", ["truth.sigma_tdoa_ns", "[1, 2]", "a number"]),
    ("truth.sigma_tdao_ns=3", ["truth.sigma_tdao_ns", "did you mean sigma_tdoa_ns"]),
    ("thruth.height_km=3", ["thruth", "did you mean truth"]),
    ("truth.correlated=maybe", ["truth.correlated", "maybe", "true or false"]),
    ("truth.motion=!Zigzag {}", ["truth.motion", "!Zigzag", "!StraightLine"]),
    ("truth.phase=folded", ["truth.phase", "folded", "wrapped"]),
    ("estimators.iekf.max_iterations=0", ["estimators.iekf.max_iterations", "0", ">= 1"]),
    ("estimators.iekf.max_iterations=2.5", ["estimators.iekf.max_iterations", "2.5", "a whole number"]),
    ("estimators.iekf=3", ["estimators.iekf", "3", "a mapping"]),
    ("satellites=3", ["satellites", "3", "a list"]),
    ("satellites.7.along_km=1", ["7", "list of 3"]),
    ("nonsense", ["--set", "KEY=VALUE"]),
    ("truth.height_km: 3", ["--set", "KEY=VALUE"]),
]


@pytest.mark.parametrize(("setting", "words"), MISTAKES)
def test_mistake_names_field_value_and_what_is_allowed(setting, words):
    with pytest.raises(UserError) as caught:
        load_scenario("three_satellite", settings=[setting])
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_broken_files_are_users_mistakes(tmp_path):
    with pytest.raises(UserError, match="cannot be read"):
        load_scenario("three_satellite", file=tmp_path / "absent.yaml")
    broken = tmp_path / "broken.yaml"
    broken.write_text("truth: {height_km: [1, 2\n")
    with pytest.raises(UserError, match="not valid YAML"):
        load_scenario("three_satellite", file=broken)
    with pytest.raises(UserError, match="a mapping is needed"):
        read_yaml("- 1\n- 2\n")


def test_names_are_checked():
    with pytest.raises(UserError, match="did you mean three_satellite"):
        find("three_satelite")
    with pytest.raises(UserError, match="variant of three_satellite: flat"):
        find("three_satellite:flat")
    with pytest.raises(UserError, match="estimator: iekg"):
        select_estimators(load_scenario("three_satellite"), ["iekg"])


def test_a_registered_estimator_is_added_on_demand():
    scenario = load_scenario("three_satellite", settings=[])
    del scenario.estimators["ukf"]
    assert select_estimators(scenario, ["ukf", "iekf", "ukf"]) == ["ukf", "iekf"]
    assert type(scenario.estimators["ukf"]).__name__ == "Ukf"
