"""A smoother looks back when a run is over, and a run that goes on has none."""

from pathlib import Path

import pytest

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.schema.errors import UserError

DRONE = Path(__file__).parents[1] / "own" / "drone.yaml"


def test_refused():
    scenario = find(DRONE.as_posix()).system.load(None, None, [])
    names = select_estimators(scenario, ["ekf_smoothed"])
    with pytest.raises(UserError, match=r"estimators\.ekf_smoothed: a smoother is not allowed live"):
        Bench(scenario, DRONE.parent, names)
