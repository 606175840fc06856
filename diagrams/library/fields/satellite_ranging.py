"""The scenario of `satellite_ranging`: orbits, the truth, and what the estimators believe."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts.biases import BIASES, BelievedBias
from quietfix.diagrams.parts.latency import LateBelief, LatencyOptions
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.options.choice import EstimatorChoice

__all__ = ["Kepler", "PaperConstants", "Scenario", "Sp3"]


@dataclass
class PaperConstants:
    """Physical constants; the paper's J2 and radius, and the mu of its tools."""

    mu_m3ps2: float = number("gravitational parameter of the Earth [m^3/s^2]", 3.986004415e14, above=0)
    earth_radius_m: float = number("equatorial radius of the Earth [m]", 6378136.0, at_least=1e5, at_most=1e8)
    j2: float = number("second zonal harmonic", 1.0826261e-3, at_least=0, at_most=0.1)
    earth_rate_radps: float = number("rotation rate of the Earth, for recorded orbits [rad/s]", 7.292115e-5)


@dataclass
class Kepler:
    """An orbit by its elements, as the paper gives them."""

    semi_major_axis_km: float = number("semi-major axis [km]", 7500.0, above=0)
    eccentricity: float = number("eccentricity, 0 <= e < 1", 0.0, at_least=0)
    inclination_deg: float = number("inclination [deg]", 45.0, at_least=0, at_most=180)
    raan_deg: float = number("right ascension of the ascending node [deg]", 60.0)
    argument_of_perigee_deg: float = number("argument of perigee [deg]", 108.0)
    perigee_passage_s: float = number("time of perigee passage [s]; the mean anomaly is n (t - it)", 500.0)


@dataclass
class Sp3:
    """A recorded precise orbit; inertial axes that coincide with the Earth-fixed ones at the start."""

    file: str = documented("file in the folder sp3 of the recorded data", "grgja203.b08243.e08247.D_S.sp3")
    satellite: str = documented("its identification in the file; empty: the only one", "")
    start_s: float = number("seconds after the file's first epoch at which the run begins [s]", 0.0, at_least=0)


@dataclass
class Truth:
    """The truth."""

    j2: bool = documented(
        "whether J2 acts on both satellites; for a recorded target: in the acceleration that is measured",
        False,
    )
    sigma_angle_mrad: float = number("standard deviation of azimuth and elevation [mrad]", 1.0, above=0)
    sigma_angle_rate_mradps: float = number("standard deviation of their rates [mrad/s]", 0.01, above=0)
    sigma_radial_velocity_mps: float = number("standard deviation of the radial velocity [m/s]", 10.0, above=0)
    sigma_radial_acceleration_mps2: float = number(
        "standard deviation of the radial acceleration [m/s^2]", 0.05, above=0
    )
    occultation: bool = documented("whether the Earth blocks the line of sight; the paper ignores it", False)
    grazing_height_km: float = number("height below which a line of sight is blocked [km]", 0.0, at_least=0)
    sigma_observer_m: float = number("error of the observer's known position, constant, per axis [m]", 0.0, at_least=0)
    sigma_observer_mps: float = number(
        "error of the observer's known velocity, constant, per axis [m/s]", 0.0, at_least=0
    )
    latency_s: LatencyOptions = documented("how late what is measured at an instant comes", factory=LatencyOptions)
    errors: SensorErrors = documented(
        "errors of the sensor that the estimators do not know of; attitude: turns of the inertial axes",
        factory=SensorErrors,
    )


@dataclass
class Belief:
    """What the estimators believe; null: as it is."""

    j2: bool | None = documented("whether J2 acts on both satellites", None)
    sigma_angle_mrad: float | None = number("standard deviation of azimuth and elevation [mrad]", None, above=0)
    sigma_angle_rate_mradps: float | None = number("standard deviation of their rates [mrad/s]", None, above=0)
    sigma_radial_velocity_mps: float | None = number("standard deviation of the radial velocity [m/s]", None, above=0)
    sigma_radial_acceleration_mps2: float | None = number(
        "standard deviation of the radial acceleration [m/s^2]", None, above=0
    )
    propagation: str = choice(
        "runge_kutta: fourth order with variational equations; second_order: the paper's (42), (43) corrected",
        "runge_kutta",
        ("runge_kutta", "second_order"),
    )
    acceleration_density_m2ps3: float = number(
        "process noise: density of white acceleration [m^2/s^3]", 0.0, at_least=0
    )
    sigma_position_km: float = number("error of the initial estimate's position per axis [km]", 500.0, above=0)
    sigma_velocity_mps: float = number("error of the initial estimate's velocity per axis [m/s]", 500.0, above=0)
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of measurements that come late", factory=LateBelief)


@dataclass
class Scenario:
    """Scenario of `satellite_ranging`."""

    duration_s: float = number("length of the arc [s]", 5000.0, above=0)
    period_s: float = number("time between measurements [s]", 10.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 100e3, above=0)
    constants: PaperConstants = documented("physical constants", factory=PaperConstants)
    observer: Kepler = documented("orbit of the satellite that listens", factory=Kepler)
    target: Kepler | Sp3 = documented("orbit of the other one: !Kepler or !Sp3", factory=Kepler)
    truth: Truth = documented("the truth", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)
