"""Blocks as they stand in diagrams: of packaged systems, of files of one's own, and what only recordings need."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.statistics.score import Score
from quietfix.systems.ambiguity.prefilter import Everything
from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.estimators.arrival_gate import ArrivalGate
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.lagging.fixed_lag import FixedLag
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.plants.checked_truth import CheckedTruth
from quietfix.systems.plants.emitter import GreatCircle, StraightLine
from quietfix.systems.plants.orbit import Orbit
from quietfix.systems.plants.recorded import RecordedTruth
from quietfix.systems.plants.recorded_flight import RecordedFlight
from quietfix.systems.playback.track_paths import TrackPaths
from quietfix.systems.playback.track_truth import TrackTruth
from quietfix.systems.recorder import Recorder
from quietfix.systems.sensors.handed_rows import HandedRows
from quietfix.systems.sensors.played_late import PlayedLate
from quietfix.systems.sensors.played_rows import PlayedRows, TableTrack
from quietfix.systems.sensors.recorded import RecordedMeasurements, Recording
from quietfix.systems.signal_chain.channel_phases import ChannelPhaseSensor
from quietfix.systems.signal_chain.recorded_iq import RecordedIq
from quietfix.systems.signals import EnsembleBlock, leaf_systems
from quietfix.systems.trajectories.planar_flight import fit_planar_flight

from .tags import ROOT

__all__ = ["TRIALS", "Standing", "made_by", "standing"]

TRIALS = 3

_ERRORS = [
    f"truth.errors.{one}" for one in ("attitude_roll_deg=0.1", "sigma_platform_position_m=5", "outlier_rate=0.01")
]
_SYSTEMS: Sequence[tuple[str, Sequence[str]]] = (
    ("three_satellite", ()),
    ("three_satellite", [*_ERRORS, "estimators.iekf.gate.probability=0.999"]),
    ("three_satellite", ["estimators={batch: !Batch {}}"]),
    ("three_satellite:coplanar", ()),
    ("three_satellite", ["truth.motion=!GreatCircle {}"]),
    ("bearing_crossing", ()),
    ("bearing_crossing:navigation", ()),
    ("beacon_rocket", ()),
    ("satellite_ranging", ()),
    ("dual_satellite", ()),
    ("dual_satellite:signal", ()),
    ("tests/own/crossing.yaml", ()),
    ("tests/own/crossing.yaml", ["estimators={looking_back: !Smoothed {filter: !Ukf {}}}"]),
    ("tests/own/turning_drone.yaml", ()),
    ("tests/own/drone.yaml", ()),
)
_MADE: dict[type, type] = {}
"""The block that each class of options has made first."""


class Standing(NamedTuple):
    """A block, its name there, and the diagram that it is in."""

    block: EnsembleBlock
    name: str
    where: str


def _built() -> Iterator[Standing]:
    for reference, changes in _SYSTEMS:
        path = str(ROOT / reference) if reference.endswith(".yaml") else reference
        found = find(path)
        scenario = found.system.resolve(found.variant, None, list(changes))
        builder = DiagramBuilder()
        assembly = found.system.build(builder, scenario, list(scenario.estimators), TRIALS)
        for name, options in scenario.estimators.items():
            _MADE.setdefault(type(options), type(assembly.estimators[name]))
        for leaf in leaf_systems(assembly.finish(reference)):
            if isinstance(leaf, EnsembleBlock):
                yield Standing(leaf, leaf.get_name(), reference.rpartition("/")[2])


def _flight() -> Any:
    t = np.arange(0.0, 60.0, 0.1)
    speed, height = 12.0 * t, 5.9 * t**2
    return fit_planar_flight(t, speed, height, [30.0], 6371e3, 4.0)


def _alone() -> Iterator[EnsembleBlock]:
    """Make what plays recordings and what is put into a diagram by hand."""
    clock, times, rows = Periodic(1.0), np.arange(5.0), 4
    tdoa = Tdoa(50e-9, receivers=(1, 2, 3, 4), correlated=True)
    samples = IqBlock(np.zeros((1, 100), dtype=complex), 1e3, 0.0)
    state = geodetic_state(0.8, 0.1, 1e4, 1.0, 250.0)
    yield ArrivalGate(Stack([tdoa, Altitude(100.0)]), tdoa, TRIALS, 5, "altitude")
    yield ChannelPhaseSensor(Everything(), clock, TRIALS)
    yield CheckedTruth("mine:Plant", TRIALS, 8)
    yield GreatCircle(state)
    yield StraightLine(state)
    yield HandedRows(np.eye(rows), scaled=True)
    yield Orbit(np.tile([7e6, 0, 0, 0, 7.5e3, 0], (2, 1)))
    yield PlayedLate(
        [TableTrack(Times(times), np.zeros((5, rows)), np.ones((5, rows)), arrival=np.zeros((5, rows)))], 9.0
    )
    yield PlayedRows([TableTrack(Times(times), np.zeros((5, rows)), np.ones((5, rows)))], np.eye(rows))
    yield PlayedLate([TableTrack(Times(times), np.zeros((5, rows)), None, np.tile(times[:, None], rows) + 1)], 3.0)
    yield RecordedFlight(_flight())
    yield RecordedIq(samples, clock, 10)
    yield RecordedMeasurements(
        [Recording(times, np.zeros((5, rows)), np.zeros((2, 6)), np.tile(np.eye(rows), (5, 1, 1)))]
    )
    yield RecordedTruth(times, np.zeros((5, 6)))
    yield Recorder({"estimate": (TRIALS, 6), "nis": (TRIALS, 1)}, clock)
    yield Score("nees", TRIALS, 1, ["x", "y", "vx", "vy"], ["x", "y", "vx", "vy"])
    yield TrackPaths([Times(times)], [lambda time: np.zeros(6)])
    yield TrackTruth([Times(times)], [np.zeros((5, 6))])


@cache
def standing() -> dict[type, Standing]:
    """Return one of every kind of block, the first that is met."""
    found: dict[type, Standing] = {}
    for one in _built():
        found.setdefault(type(one.block), one)
        if one.where == "drone.yaml" and one.name == "ekf":
            found.setdefault(
                FixedLag, Standing(FixedLag(one.block, 10.0, 100.0), "fixed_lag", "behind ekf of drone.yaml")
            )
    for block in _alone():
        found.setdefault(type(block), Standing(block, block.get_name(), ""))
    return found


def made_by(options: type) -> type | None:
    """Return the block that a class of options makes; None where it has made none in the diagrams that stand."""
    standing()
    return _MADE.get(options)
