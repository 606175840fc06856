"""Kinds of measurement of a system of one's own, as scenario fields, and the measurement models that they are."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

from quietfix.diagrams.own.classes.custom import Custom
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.quantities.frame import INERTIAL
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.bearing import Bearing as BearingModel
from quietfix.systems.angles.horizon import HorizonBearing
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import documented, number, text
from quietfix.systems.estimators.phase_resolver import PhaseResolver
from quietfix.systems.measurement.altitude import Altitude as AltitudeModel
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.component import Component
from quietfix.systems.measurement.distance import Range as RangeModel
from quietfix.systems.measurement.fdoa import Fdoa as FdoaModel
from quietfix.systems.measurement.frequency import Frequency as FrequencyModel
from quietfix.systems.measurement.range_rate import RangeRate as RangeRateModel
from quietfix.systems.measurement.received_power import ReceivedPower
from quietfix.systems.measurement.tdoa import Tdoa as TdoaModel

__all__ = [
    "Altitude",
    "Bearing",
    "Custom",
    "Fdoa",
    "Frequency",
    "Kind",
    "Phase",
    "Range",
    "RangeRate",
    "Relative",
    "Rss",
    "Tdoa",
    "Toa",
]


@dataclass
class _Differenced:
    reference: str = text("platform that the others are compared with; empty: the first one")
    receivers: list[str] = documented("the others; empty: all but the reference", factory=list)
    correlated: bool = documented("errors of differences correlated through the reference", False)
    light_time: bool = documented("of one wave front, instead of the geometry of one instant", False)

    def _pairs(self, places: Places, where: str) -> tuple[str, int, dict[str, int]]:
        reference = self.reference or next(iter(places.platforms))
        number_ = places.number(reference, f"{where}.reference")
        receivers = places.numbers(self.receivers, f"{where}.receivers", reference)
        if reference in receivers:
            raise UserError(f"{where}.receivers: {reference} is not allowed; it is the reference")
        return reference, number_, receivers

    def _common(self, places: Places, where: str) -> dict[str, Any]:
        return {"correlated": self.correlated, **_wave(self.light_time, places, where)}


def _wave(light_time: bool, places: Places, where: str) -> dict[str, Any]:
    if light_time and not places.frame.geodetic:
        raise UserError(f"{where}.light_time: true is for frame earth_fixed only, this is {places.frame.name}")
    return {"light_time": light_time, "earth_rate": places.constants.earth_rate, "constants": places.constants}


@dataclass
class Tdoa(_Differenced):
    """Time differences of arrival against a reference."""

    sigma_ns: float = number("standard deviation of a difference [ns]", 50.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``tdoa_RECEIVER_REFERENCE`` [s]."""
        name, reference, receivers = self._pairs(places, where)
        model = TdoaModel(self.sigma_ns * 1e-9, list(receivers.values()), reference, **self._common(places, where))
        model.names = tuple(f"tdoa_{receiver}_{name}" for receiver in receivers)
        return model


@dataclass
class Toa:
    r"""Times of arrival of a signal whose time of emission nobody knows.

    :math:`t_i = t_e + r_i/c + n_i` with independent errors of standard deviation s. Weighted least squares over
    :math:`t_e` leaves the same of :math:`t_i - t_0`, whose errors all have :math:`n_0` in them:
    :math:`R = s^2 (I + 1 1^T)`, that is correlated differences of :math:`\sigma = \sqrt 2 s`. Nothing is lost, and
    it does not matter which station is the first, unless that one hears nothing: then there are no rows at all.
    """

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
        (name, reference), *others = stations.items()
        common = {"correlated": True, **_wave(self.light_time, places, where)}
        model = TdoaModel(math.sqrt(2) * self.sigma_ns * 1e-9, [i for _, i in others], reference, **common)
        model.names = tuple(f"toa_{station}_{name}" for station, _ in others)
        return model


@dataclass
class Fdoa(_Differenced):
    """Differences of the received frequency against a reference."""

    sigma_hz: float = number("standard deviation of a difference [Hz]", 1.0, above=0)
    carrier_mhz: float = number("carrier frequency [MHz]", 1000.0, above=0)
    paper_sign: bool = documented(
        "as a difference of range rates over the wavelength, which is the negative of that of frequencies", False
    )

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``fdoa_RECEIVER_REFERENCE`` [Hz]."""
        name, reference, receivers = self._pairs(places, where)
        carrier = self.carrier_mhz * 1e6
        model = FdoaModel(
            self.sigma_hz,
            carrier,
            list(receivers.values()),
            reference,
            paper_sign=self.paper_sign,
            **self._common(places, where),
        )
        model.names = tuple(f"fdoa_{receiver}_{name}" for receiver in receivers)
        return model


@dataclass
class Range:
    """Distances."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_m: float = number("standard deviation [m]", 10.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_PLATFORM`` [m]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = RangeModel(self.sigma_m, list(stations.values()))
        model.names = tuple(f"range_{station}" for station in stations)
        return model


@dataclass
class RangeRate:
    """Rates of the distances, positive away."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_mps: float = number("standard deviation [m/s]", 0.1, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_rate_PLATFORM`` [m/s]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = RangeRateModel(self.sigma_mps, list(stations.values()), places.bias)
        model.names = tuple(f"range_rate_{station}" for station in stations)
        return model


@dataclass
class Frequency:
    """Received frequencies, less the carrier: Doppler and, where the scenario has one, the emitter's oscillator."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_hz: float = number("standard deviation [Hz]", 1.0, above=0)
    carrier_mhz: float = number("nominal carrier frequency [MHz]", 400.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``frequency_PLATFORM`` [Hz]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = FrequencyModel(self.sigma_hz, self.carrier_mhz * 1e6, list(stations.values()), places.bias)
        model.names = tuple(f"frequency_{station}" for station in stations)
        return model


@dataclass
class Bearing:
    """Azimuth and elevation at one platform, in local axes or over its horizon."""

    platform: str = text("which one; empty: the first")
    sigma_deg: float = number("standard deviation of the azimuth [deg]", 1.0, above=0)
    sigma_elevation_deg: float | None = number("that of the elevation [deg]; null: none is measured", None, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``azimuth_PLATFORM``, ``elevation_PLATFORM`` [rad]."""
        if places.frame.up is None:
            raise UserError(f"{where}: !Bearing is not allowed in frame {places.frame.name}; local or earth_fixed")
        name = self.platform or next(iter(places.platforms))
        number_ = places.number(name, f"{where}.platform")
        kind = BearingModel if places.frame.flat else HorizonBearing
        elevation = None if self.sigma_elevation_deg is None else math.radians(self.sigma_elevation_deg)
        model = kind(math.radians(self.sigma_deg), elevation, number_)
        model.names = tuple(f"{row}_{name}" for row in model.names)
        return model


@dataclass
class Altitude:
    """The target's height, as it reports it or as it is assumed: above the ellipsoid, or z in local axes."""

    sigma_m: float = number("standard deviation [m]", 30.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; row ``altitude`` [m]."""
        if places.frame.height is None:
            raise UserError(f"{where}: !Altitude is not allowed in frame {places.frame.name}; local or earth_fixed")
        return Component(2, self.sigma_m, "altitude", "m") if places.frame.flat else AltitudeModel(self.sigma_m)


@dataclass
class Rss:
    """Received powers of an emitter of known power, by the log-distance law."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_db: float = number("standard deviation of the shadowing [dB]", 4.0, above=0)
    power_dbm: float = number("power received at 1 m, extrapolated from the far field [dBm]", -30.0)
    exponent: float = number("exponent of the path loss; 2 in free space", 2.0, above=0, at_most=10)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``rss_PLATFORM`` [dBm]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = ReceivedPower(self.sigma_db, self.power_dbm, self.exponent, list(stations.values()))
        model.names = tuple(f"rss_{station}" for station in stations)
        return model


@dataclass
class Phase:
    """Phase differences of an interferometer that points to nadir: baseline a along the satellite's track, b across."""

    platform: str = text("which one; empty: the first")
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
        name = self.platform or next(iter(places.platforms))
        model = InterferometerPhase(
            math.radians(self.sigma_deg),
            self.baseline_m,
            SPEED_OF_LIGHT / (self.carrier_mhz * 1e6),
            cast(Any, self.axes),
            places.number(name, f"{where}.platform"),
            self.wrapped,
            places.constants.earth_rate if places.frame.geodetic else 0.0,  # inertial velocities are so already
        )
        model.names = tuple(f"{row}_{name}" for row in model.names)
        return model

    def chain(self, places: Places, where: str) -> list[InterferometerPhase]:
        """Return the models of the shorter baselines, from the shortest; rows ``phase_AXIS_PLATFORM_1`` ... [rad]."""
        if not self.chain_m:
            return []
        long, half = self.model(places, where), SPEED_OF_LIGHT / (self.carrier_mhz * 1e6) / 2
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
        links = [replace(self, baseline_m=length).model(places, where) for length in self.chain_m]
        for i, link in enumerate(links):
            link.names = PhaseResolver.link_names(long, i)
        return links


@dataclass
class Relative:
    """What a satellite measures of another one, in inertial axes; null: that is not measured."""

    platform: str = text("the one that measures; empty: the first")
    sigma_azimuth_deg: float | None = number("standard deviation of the azimuth [deg]", 0.05, above=0)
    sigma_elevation_deg: float | None = number("of the elevation [deg]", 0.05, above=0)
    sigma_azimuth_rate_degps: float | None = number("of the azimuth's rate [deg/s]", None, above=0)
    sigma_elevation_rate_degps: float | None = number("of the elevation's rate [deg/s]", None, above=0)
    sigma_radial_velocity_mps: float | None = number("of the radial velocity [m/s]", None, above=0)
    sigma_radial_acceleration_mps2: float | None = number(
        "of the radial acceleration, of a target that falls [m/s^2]", None, above=0
    )

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``azimuth_PLATFORM`` [rad] to ``radial_acceleration_PLATFORM`` [m/s^2]."""
        if places.frame is not INERTIAL:
            raise UserError(f"{where}: !Relative is for frame inertial only, this is {places.frame.name}")
        name = self.platform or next(iter(places.platforms))
        suffixes = {"rad": ("deg", math.radians(1.0)), "rad/s": ("degps", math.radians(1.0)), "m/s": ("mps", 1.0)}
        sigmas = {}
        for row, unit in ROWS.items():
            suffix, scale = suffixes.get(unit, ("mps2", 1.0))
            sigma = getattr(self, f"sigma_{row}_{suffix}")
            if sigma is not None:
                sigmas[row] = sigma * scale
        if not sigmas:
            raise UserError(f"{where}: nothing is measured; at least one sigma_ is needed")
        observer = places.number(name, f"{where}.platform")
        model = RelativeKinematics(sigmas, places.constants, places.constants.j2 != 0, observer)
        model.names = tuple(f"{row}_{name}" for row in model.names)
        return model


Kind = Tdoa | Toa | Fdoa | Range | RangeRate | Frequency | Bearing | Altitude | Rss | Phase | Relative | Custom
"""Whatever is measured."""
