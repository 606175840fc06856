"""Satellites of a system of one's own that are ahead of their elements: states of their own, and rows that see them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.kinds.frequency import Frequency
from quietfix.diagrams.own.kinds.kind import MeasurementKind
from quietfix.diagrams.own.kinds.range import Range
from quietfix.diagrams.own.kinds.range_rate import RangeRate
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.paths.movers import Kepler, Oem, Offset, PositionVelocity, Sp3, Tle
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.along_track.ahead import Ahead
from quietfix.systems.along_track.anew import Anew
from quietfix.systems.clocks import Clock
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.random_walk import RandomWalk
from quietfix.systems.plants.model_plant import ModelPlant

__all__ = ["add_plants", "ahead_motions", "ahead_sigmas", "check_along_track", "seen_ahead"]

_SATELLITES = (Tle, Sp3, Oem, Kepler, PositionVelocity, Offset)
_KINDS = (Range, RangeRate, Frequency)


def check_along_track(scenario: OwnScenario) -> None:
    """Refuse platforms that are none, and such as do not fall."""
    for name in scenario.along_track:
        mover = scenario.platforms[choose("along_track", name, scenario.platforms)]
        if scenario.axes.flat or not isinstance(mover, _SATELLITES):
            raise UserError(
                f"along_track.{name}: a !{type(mover).__name__} in frame {scenario.frame} is not allowed; a satellite "
                "in frame earth_fixed or inertial"
            )


def ahead_sigmas(scenario: OwnScenario) -> list[float]:
    """Return the standard deviation of each such state [s]."""
    return [one.sigma_s for one in scenario.along_track.values()]


def ahead_motions(scenario: OwnScenario) -> list[MotionModel]:
    """Return how each such state moves."""
    return [
        Anew(RandomWalk([one.walk_s2ps], [f"ahead_{name}"], ["s"]), [one.sigma_s], one.pause_s)
        for name, one in scenario.along_track.items()
    ]


def _first(scenario: OwnScenario) -> int:
    """Return where these states begin: behind the target's and its oscillator's."""
    if scenario.oscillator is None:
        return 6
    return 7 if scenario.oscillator.drift_hzps is None else 8


def seen_ahead(
    model: MeasurementModel, kind: MeasurementKind, scenario: OwnScenario, places: Places, where: str
) -> MeasurementModel:
    """Return a sensor's model with satellites that are ahead; as it is where it needs none of them.

    Raises
    ------
    UserError
        If it is of a kind that does not know of them.
    """
    first, count = _first(scenario), len(places.platforms)
    ahead = {places.platforms[name]: first + i for i, name in enumerate(scenario.along_track)}
    used = model.platforms_used(count)
    mine = {number: component for number, component in ahead.items() if used[:, number].any()}
    if not mine:
        return model
    if not isinstance(kind, _KINDS):
        names = ", ".join(name for name in scenario.along_track if places.platforms[name] in mine)
        raise UserError(
            f"along_track: {names} is not allowed with {where}, a !{type(kind).__name__}; !Range, !RangeRate, "
            "!Frequency"
        )
    return Ahead(model, mine, count, gravity_constants(scenario.constants), scenario.axes.geodetic)


def add_plants(bus: Bus, scenario: OwnScenario, clock: Clock) -> Sequence[str]:
    """Add what is true of them in a simulation, drawn or given; return the names of the blocks."""
    names = []
    for (name, field), motion in zip(scenario.along_track.items(), ahead_motions(scenario), strict=True):
        mean = 0.0 if field.true_s is None else field.true_s
        variance = np.array([[field.sigma_s**2 if field.true_s is None else 0.0]])
        trials = bus.trials if field.true_s is None or field.walk_s2ps else 1
        block = f"ahead of {name}"
        bus.add(ModelPlant(motion, clock, [mean], variance, trials, name=block))
        names.append(block)
    return names
