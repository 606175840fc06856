"""Times of arrival as a kind of measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import wave_of
from quietfix.diagrams.own.kinds.kind import ExcessPath, MeasurementKind, Row
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import documented, number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.tdoa import Tdoa as TdoaModel

__all__ = ["Toa"]


@dataclass
class Toa(MeasurementKind):
    r"""Times of arrival of a signal whose time of emission nobody knows.

    :math:`t_i = t_e + r_i/c + n_i` with independent errors of standard deviation s. Weighted least squares over
    :math:`t_e` leaves the same of :math:`t_i - t_0`, whose errors all have :math:`n_0` in them:
    :math:`R = s^2 (I + 1 1^T)`, that is correlated differences of :math:`\sigma = \sqrt 2 s`. Nothing is lost, and
    it does not matter which station is the first, unless that one hears nothing: then there are no rows at all.
    """

    compares_clocks = True

    stations: list[str] = documented(
        "platforms that hear it, the first of them the reference; empty: all", factory=list
    )
    sigma_ns: float = number("standard deviation of a time of arrival [ns]", 50.0, above=0)
    light_time: bool = documented("of one wave front, instead of the geometry of one instant", False)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``toa_STATION_REFERENCE`` [s]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        if len(stations) < 2:
            raise UserError(f"{where}.stations: {list(stations)} is not allowed; at least two, to tell the emission")
        reference, *others = stations.values()
        common = {"correlated": True, **wave_of(self.light_time, places, where)}
        return TdoaModel(math.sqrt(2) * self.sigma_ns * 1e-9, others, reference, **common)

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`."""
        reference, *others = self.stations or list(places.platforms)
        return [Row("toa", station, reference, "s", compares_clocks=True) for station in others]

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        return ExcessPath(1.0 / SPEED_OF_LIGHT)
