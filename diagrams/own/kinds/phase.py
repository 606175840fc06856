"""Phase differences of an interferometer as a kind of measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

from quietfix.diagrams.own.kinds.by_platform import AtPlatform
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.parts.impairment import Mount
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import documented, number, text
from quietfix.systems.estimators.phase_resolver import PhaseResolver
from quietfix.systems.geometry.body_frame import NadirAxes
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Phase"]


@dataclass
class Phase(AtPlatform):
    """Phase differences of an interferometer that points to nadir: baseline a along the satellite's track, b across."""

    directions = "a !Phase"

    axes: list[str] = documented("its baselines: a, b or both", factory=lambda: ["a", "b"])
    sigma_deg: float = number("standard deviation of a phase [deg]", 15.0, above=0)
    baseline_m: float = number("length of a baseline [m]", 3.0, above=0)
    carrier_mhz: float = number("carrier frequency [MHz]", 1000.0, above=0)
    wrapped: bool = documented(
        "reported in [-180, 180) deg; unless they are resolved, an estimator takes the cycles next to its own", False
    )
    resolved_by: str = text(
        "a !Tdoa of two rows that resolves wrapped phases: by its fix at the height that the first estimator predicts"
    )
    chain_m: list[float] = documented(
        "shorter baselines that resolve wrapped phases one after the other, from the shortest [m]", factory=list
    )

    def model(self, places: Places, where: str) -> InterferometerPhase:
        """Return the measurement model; rows ``phase_AXIS_PLATFORM`` [rad]."""
        if places.frame.flat:
            raise UserError(f"{where}: !Phase is not allowed in frame {places.frame.name}; earth_fixed or inertial")
        if len(set(self.axes)) < len(self.axes):
            raise UserError(f"{where}.axes: {self.axes} is not allowed; an axis is named twice")
        return InterferometerPhase(
            math.radians(self.sigma_deg),
            self.baseline_m,
            SPEED_OF_LIGHT / (self.carrier_mhz * 1e6),
            cast(Any, self.axes),
            self.number(places, where),
            self.wrapped,
            places.constants.earth_rate if places.frame.geodetic else 0.0,  # inertial velocities are so already
        )

    def mounts(self, model: MeasurementModel, rows: Sequence[str], frame: Frame) -> list[Mount]:
        """See `MeasurementKind.mounts`."""
        assert isinstance(model, InterferometerPhase)
        return [Mount(rows, model.platform, NadirAxes(model.earth_rate))]

    def chain(self, places: Places, where: str) -> list[tuple[InterferometerPhase, list[Row]]]:
        """Return the shorter baselines, from the shortest; rows ``phase_AXIS_PLATFORM_1`` ... [rad]."""
        if not self.chain_m:
            return []
        long, half = self.placed(places, where)[0], SPEED_OF_LIGHT / (self.carrier_mhz * 1e6) / 2
        assert isinstance(long, InterferometerPhase)
        lengths = [*self.chain_m, self.baseline_m]
        if not all(0 < a < b for a, b in pairwise(lengths)):
            raise UserError(
                f"{where}.chain_m: {self.chain_m} is not allowed; rising lengths > 0, below baseline_m "
                f"{self.baseline_m:g}"
            )
        if self.chain_m[0] > half:
            raise UserError(
                f"{where}.chain_m.0: {self.chain_m[0]:g} is not allowed; at most half a wavelength, {half:g} m"
            )
        found = []
        for i, length in enumerate(self.chain_m):
            link = replace(self, baseline_m=length).model(places, where)
            names = PhaseResolver.link_names(long, i)
            rows = [
                replace(row, kind=f"{row.kind}_{i + 1}", label=name)
                for row, name in zip(self.rows(places, link), names, strict=True)
            ]
            link.names = names
            found.append((link, rows))
        return found
