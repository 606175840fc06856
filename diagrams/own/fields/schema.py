"""What the file of a system of one's own says: its scenario."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.classes import extra, motions, plants
from quietfix.diagrams.own.fields.along_track import AlongTrack
from quietfix.diagrams.own.fields.atmosphere import Atmosphere
from quietfix.diagrams.own.fields.measurements import Measurements
from quietfix.diagrams.own.fields.sensors import Sensor
from quietfix.diagrams.own.fields.starts import KnownHeight, Snapshot
from quietfix.diagrams.own.fields.view import Map
from quietfix.diagrams.parts.biases import BIASES, BelievedBias
from quietfix.diagrams.parts.formation import EarthConstants, ReferenceOrbit
from quietfix.diagrams.parts.latency import LateBelief
from quietfix.diagrams.paths.movers import Fixed, Mover, RandomMotion
from quietfix.diagrams.quantities.frame import Frame, as_frame
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.motions import ConstantVelocity, CoordinatedTurn, WhiteNoiseAcceleration

__all__ = [
    "Belief",
    "Given",
    "Orbital",
    "Oscillator",
    "OwnScenario",
    "PlatformErrors",
    "Prior",
]


@dataclass
class Orbital:
    """Falls around the Earth, driven by white acceleration noise; of inertial states."""

    density_m2ps3: float = number("power spectral density of the acceleration per axis [m^2/s^3]", 0.0, at_least=0)


@dataclass
class Oscillator:
    """The emitter's oscillator; its error is the state ``bias``, as a range rate [m/s], its drift ``bias_rate``."""

    carrier_mhz: float = number("nominal carrier frequency [MHz]", 400.0, above=0)
    offset_hz: float = number("mean error at t = 0: too high is positive [Hz]", 0.0)
    sigma_offset_hz: float = number("standard deviation of that error from trial to trial [Hz]", 0.0, at_least=0)
    walk_hz2ps: float = number("variance that it gains per second by a random walk [Hz^2/s]", 0.0, at_least=0)
    drift_hzps: float | None = number(
        "mean rate of its growth [Hz/s]; a number, 0 too, makes the rate a state of its own; null: it has none", None
    )
    sigma_drift_hzps: float = number("standard deviation of that rate from trial to trial [Hz/s]", 0.0, at_least=0)
    drift_walk_hz2ps3: float = number("variance that the rate gains per second [Hz^2/s^3]", 0.0, at_least=0)
    pause_s: float | None = number(
        "after so long without a measurement it is believed to be unknown again, as at the start [s]; null: never",
        None,
        above=0,
    )


@dataclass
class Belief:
    """What the estimators believe."""

    motion: WhiteNoiseAcceleration | ConstantVelocity | CoordinatedTurn | Orbital | motions.Custom = documented(
        "how the target moves", factory=WhiteNoiseAcceleration
    )
    sensors: dict[str, Sensor] = documented(
        "sensors, or kinds of a !Joint, that are believed to be otherwise than they are, by name and in full",
        factory=dict,
    )
    walk_hz2ps: float | None = number(
        "variance that the oscillator gains per second [Hz^2/s]; null: as it does", None, at_least=0
    )
    atmosphere: Atmosphere | None = documented("what is in the way of signals; null: what is, {}: nothing", None)
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of measurements that come late", factory=LateBelief)


@dataclass
class Prior:
    """An estimate before the first measurement, off by what it says of itself; drawn about the truth in every trial."""

    sigma_position_m: float = number("standard deviation of the position per axis [m]", 1000.0, above=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 50.0, above=0)
    sigma_offset_hz: float = number("standard deviation of the oscillator's error [Hz]", 1000.0, above=0)
    sigma_drift_hzps: float = number("standard deviation of its rate, where it drifts [Hz/s]", 1.0, above=0)


@dataclass
class Given:
    """The same estimate in every trial."""

    at: Mover = documented("where it says that the target is at t = 0", factory=Fixed)
    sigma_position_m: float = number("standard deviation of the position per axis [m]", 1000.0, above=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 50.0, above=0)
    sigma_offset_hz: float = number("standard deviation of the oscillator's error, taken as 0 [Hz]", 1000.0, above=0)
    sigma_drift_hzps: float = number("the same of its rate, where it drifts [Hz/s]", 1.0, above=0)


@dataclass
class PlatformErrors:
    """How well the estimators know the platforms."""

    sigma_position_m: float = number("error per axis, constant, drawn per trial [m]", 0.0, at_least=0)
    sigma_velocity_mps: float = number("the same of the velocity [m/s]", 0.0, at_least=0)


@dataclass
class OwnScenario:
    """A system of a user's own."""

    frame: str = choice(
        "axes of all states. local: east, north, up on a flat Earth; earth_fixed; inertial",
        "local",
        ("local", "earth_fixed", "inertial"),
    )
    start_utc: str | None = documented("date and time of t = 0, ISO 8601, UTC or with its offset; !Tle needs it", None)
    duration_s: float = number("length of a run [s]", 100.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 50e3, above=0)
    constants: EarthConstants = documented("physical constants", factory=EarthConstants)
    reference_orbit: ReferenceOrbit = documented("what !Offset is counted from", factory=ReferenceOrbit)
    platforms: dict[str, Mover] = documented("what carries the sensors, by name", factory=dict)
    along_track: dict[str, AlongTrack] = documented(
        "satellites among them that are ahead of their elements, by name", factory=dict
    )
    platform_errors: PlatformErrors = documented("how well the platforms are known", factory=PlatformErrors)
    target: Mover | RandomMotion | plants.Custom | None = documented(
        "what is looked for; null: nobody knows where it is, with measurements", None
    )
    sensors: dict[str, Sensor] = documented("what is measured, by name", factory=dict)
    measurements: Measurements | None = documented("what was measured, in a file; null: it is simulated", None)
    oscillator: Oscillator | None = documented(
        "of the emitter, for !Frequency and !RangeRate; null: it has no error", None
    )
    atmosphere: Atmosphere = documented("what is in the way of signals", factory=Atmosphere)
    parts: list[extra.Custom] = documented("parts of one's own, in that order", factory=list)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    start: Prior | Given | Snapshot | KnownHeight = documented("how the estimators begin", factory=Prior)
    map: Map | None = documented("what quietfix gdop draws; null: what is around the target and the platforms", None)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)

    @property
    def axes(self) -> Frame:
        """The frame."""
        return as_frame(self.frame)

    @property
    def period_s(self) -> float:
        """Time between the measurements of the fastest sensor [s]."""
        return min((sensor.every_s for sensor in self.sensors.values()), default=1.0)
