"""Measurements of two simulated drones, as a table and as rows."""

import csv
from pathlib import Path

import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.own.writing import write_measurements

DRONE = Path(__file__).parents[1] / "own" / "drone.yaml"


@pytest.fixture(scope="session")
def table(tmp_path_factory):
    """A simulated study of two trials as a table, by its path."""
    path = tmp_path_factory.mktemp("live") / "measurements.csv"
    result = run_study(DRONE.as_posix(), trials=2, set={"duration_s": 20}, keep="measurements")
    write_measurements(result, find(DRONE.as_posix()).system.load(settings=["duration_s=20"]), path)
    return path


@pytest.fixture(scope="session")
def rows(table):
    """Its rows in order of time, of both targets mixed."""
    with table.open() as file:
        return sorted(csv.DictReader(file), key=lambda row: float(row["time_s"]))
