"""How a scenario and its estimators are put together."""

from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.commands.catalogue import load_scenario


def test_default_means_the_estimators_of_the_scenario():
    scenario = load_scenario("three_satellite")
    own = list(scenario.estimators)
    assert select_estimators(scenario, None) == own
    assert select_estimators(scenario, ["default", "iekf"]) == own
    assert select_estimators(scenario, ["pf", "default"]) == ["pf", *own]
