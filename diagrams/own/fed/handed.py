"""Measurements that come one by one in the place of sensors: nobody knows them before a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.own.declaring.sensing import Measured
from quietfix.diagrams.own.fed.measured import believed_noise, refuse_simulated
from quietfix.diagrams.own.fields.schema import OwnScenario, Prior
from quietfix.diagrams.own.fields.starts import KnownHeight
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.paths.functions import Path
from quietfix.diagrams.paths.movers import (
    Fixed,
    Geodetic,
    GreatCircle,
    Platform,
    Straight,
    StraightLine,
    Tle,
    Waypoints,
)
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.paths.tables import stands
from quietfix.systems.clocks import Clock, Driven
from quietfix.systems.sensors.handed_rows import HandedRows

__all__ = ["Handed", "handed"]

Array = NDArray[np.float64]

_ENDLESS = (Fixed, Geodetic, GreatCircle, Straight, StraightLine, Tle, Waypoints)
"""Movers whose path is known at all times, not only up to the end of a run."""


@dataclass(frozen=True, eq=False)
class Handed:
    """What can be measured, and what is known of the targets: a part of a diagram.

    Publishes ``measurement`` and ``raw``, ``noise_covariance`` if it is scaled, ``target`` and ``truth``.

    Attributes
    ----------
    rows : sequence of Row
        Of the stream of measurements.
    noise_covariance : ndarray, shape (m, m)
        As the estimators believe it to be.
    clock : Driven
    scaled : bool
        Whether R comes with the measurement.
    scalable : bool
        Whether it could: not where phases are resolved.
    drawn : bool
        Whether the start is drawn about the truth.
    end : float
        Until when the platforms are known [s].
    known : float
        Until when the targets are, if at all [s].
    paths : mapping of str to callable
        Where targets are, by their names, of all under the empty one.
    platforms : mapping of str to int
        Number of each platform.
    carriers : callable
        States (6 p,) of all of them at a time [s].
    """

    rows: Sequence[Row]
    noise_covariance: Array
    clock: Driven
    scaled: bool
    scalable: bool
    drawn: bool
    end: float
    known: float
    paths: Mapping[str, Path]
    platforms: Mapping[str, int]
    carriers: Path
    notes: Sequence[str] = ()

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        block = bus.add(HandedRows(self.noise_covariance, self.scaled))
        port, state = block.GetOutputPort("measurement"), block.GetOutputPort("state")
        bus.publish(raw=port, measurement=port, target=state, truth=state)
        if self.scaled:
            bus.publish(noise_covariance=block.GetOutputPort("noise_covariance"))

    def with_scales(self) -> Handed:
        """Return the same where R comes with the measurement."""
        return replace(self, scaled=True)

    @property
    def recorded(self) -> Recorded:
        """What makes a model of it a recording."""
        return Recorded(truth=bool(self.paths))


def handed(
    scenario: OwnScenario,
    setting: Setting,
    kinds: Sequence[Measured],
    places: Places,
    truth: Mapping[str, Path],
    usual: Clock,
    carriers: Path,
) -> Handed:
    """Return what stands in the place of the sensors of a scenario.

    Parameters
    ----------
    scenario : OwnScenario
    setting : Setting
        Where files are.
    kinds : sequence of Measured
        All that is measured.
    places : Places
    truth : mapping of str to callable
        As `quietfix.diagrams.own.fed.measured.true_paths`.
    usual : Clock
        When the sensors measure as a rule.
    carriers : callable
        States (6 p,) of all platforms at a time [s].

    Raises
    ------
    UserError
        As `quietfix.diagrams.own.fed.measured.refuse_simulated`.
    """
    refuse_simulated(scenario, bool(truth))
    endless = all(
        isinstance(one, _ENDLESS) or (isinstance(one, Platform) and stands(one, setting, f"platforms.{name}"))
        for name, one in scenario.platforms.items()
    )
    return Handed(
        rows=[row for kind in kinds for row in kind.rows],
        noise_covariance=believed_noise(kinds),
        clock=Driven(usual),
        scaled=False,
        scalable=not any(kind.resolved for kind in kinds),
        drawn=isinstance(scenario.start, Prior | KnownHeight),
        end=np.inf if endless else scenario.duration_s,
        known=scenario.duration_s,
        paths=dict(truth),
        platforms=places.platforms,
        carriers=carriers,
    )
