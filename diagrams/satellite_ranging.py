"""One satellite finds the orbit of another by listening: angles, rates, radial velocity and radial acceleration.

Wu Shunhua, Xin Qin and Wan Jianwei, *A passive ranging method of single satellite to satellite based on kinematics*,
Progress in Natural Science (in Chinese), received 2008. The frame is inertial throughout.
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Union

import numpy as np
from numpy.typing import NDArray

from diagrams.assembly.bus import Bus
from diagrams.assembly.map import BoundMap
from diagrams.assembly.model import Assumed, Model
from diagrams.assembly.system import System, packaged
from diagrams.errors import UserError
from diagrams.maps.orbits import orbit_map
from diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from diagrams.parts.movers import Platforms
from diagrams.parts.sensing import TargetSensor
from diagrams.sensor_errors import NO_CLOCKS, SensorErrors, refuse
from systems.clocks import Periodic
from systems.documented import choice, documented, number
from systems.estimators.base import Estimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.range_decomposed import PREVIEW
from systems.estimators.start import PortStart
from systems.fixes.orbit_plane import plane_normal
from systems.measurement.ranged_position import RangedPosition
from systems.measurement.relative_kinematics import ROWS, RelativeKinematics, rows_of
from systems.measurement.visibility import EarthOccultation
from systems.motion.gravity import GravityConstants
from systems.motion.kepler import KeplerElements, mean_motion, state_of
from systems.motion.orbital import OrbitalMotion
from systems.plants.orbit import DenseOrbit
from systems.plants.recorded import RecordedTruth
from systems.plants.sp3 import read_sp3
from systems.registry import estimator_options
from systems.sensors.platform_error import PlatformError
from systems.sensors.preview import Preview
from systems.sensors.prior import PriorEstimate
from systems.sensors.ranging import Ranging

__all__ = ["SYSTEM", "Scenario", "believed_sensor", "bound_map", "initial_states", "prior_covariance", "true_sensor"]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_KM = 1e3
_KINDS = ("angles", "rates", *ROWS)
_POSITION = "position"
_MAPPED = {"angles": ("angles",), "angles + rates": ("angles", "rates"), "all six rows": ()}
_COPLANAR = 1.0  # degrees between the two orbit planes


@dataclass
class Constants:
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
    """What is the case."""

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


@dataclass
class Scenario:
    """Scenario of `satellite_ranging`."""

    duration_s: float = number("length of the arc [s]", 5000.0, above=0)
    period_s: float = number("time between measurements [s]", 10.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 100e3, above=0)
    constants: Constants = documented("physical constants", factory=Constants)
    observer: Kepler = documented("orbit of the satellite that listens", factory=Kepler)
    target: Kepler | Sp3 = documented("orbit of the other one: !Kepler or !Sp3", factory=Kepler)
    truth: Truth = documented("what is the case", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)


# -------------------------------------------------------------------------------------------------- models


def gravity(scenario: Scenario) -> GravityConstants:
    """Return the physical constants."""
    c = scenario.constants
    return GravityConstants(mu=c.mu_m3ps2, radius=c.earth_radius_m, j2=c.j2, earth_rate=c.earth_rate_radps)


def _sigmas(scenario: Scenario, believed: bool) -> dict[str, float]:
    truth, belief = scenario.truth, scenario.belief

    def chosen(field: str) -> float:
        value = getattr(belief, field) if believed else None
        return float(getattr(truth, field) if value is None else value)

    angle, rate = 1e-3 * chosen("sigma_angle_mrad"), 1e-3 * chosen("sigma_angle_rate_mradps")
    return {
        "azimuth": angle,
        "elevation": angle,
        "azimuth_rate": rate,
        "elevation_rate": rate,
        "radial_velocity": chosen("sigma_radial_velocity_mps"),
        "radial_acceleration": chosen("sigma_radial_acceleration_mps2"),
    }


def true_sensor(scenario: Scenario) -> RelativeKinematics:
    """Return the sensor as it is, with all six rows."""
    return RelativeKinematics(_sigmas(scenario, False), gravity(scenario), scenario.truth.j2)


def _believed_j2(scenario: Scenario) -> bool:
    return scenario.truth.j2 if scenario.belief.j2 is None else scenario.belief.j2


def believed_sensor(scenario: Scenario, kinds: Sequence[str] = ()) -> RelativeKinematics:
    """Return the sensor as the estimators believe it to be.

    Parameters
    ----------
    scenario : Scenario
    kinds : sequence of str
        ``angles``, ``rates`` or single rows; empty: all six rows.

    Raises
    ------
    UserError
        For an unknown kind.
    """
    for kind in kinds:
        if kind not in _KINDS:
            raise UserError(f"measurements: {kind} is not allowed; any of {', '.join(_KINDS)}, or position alone")
    rows = rows_of(kinds) if kinds else list(ROWS)
    sigmas = _sigmas(scenario, True)
    return RelativeKinematics({row: sigmas[row] for row in rows}, gravity(scenario), _believed_j2(scenario))


def believed_motion(scenario: Scenario) -> OrbitalMotion:
    """Return how the estimators believe that the target moves."""
    belief = scenario.belief
    return OrbitalMotion(
        gravity(scenario),
        _believed_j2(scenario),
        "second_order" if belief.propagation == "second_order" else "runge_kutta",
        density=belief.acceleration_density_m2ps3,
    )


def prior_covariance(scenario: Scenario) -> Array:
    """Return the covariance of the initial estimate, shape (6, 6)."""
    belief = scenario.belief
    return np.diag([(belief.sigma_position_km * _KM) ** 2] * 3 + [belief.sigma_velocity_mps**2] * 3)


# ------------------------------------------------------------------------------------------------ geometry


def kepler_state(orbit: Kepler, constants: GravityConstants, who: str) -> Array:
    """Return the inertial state at t = 0, shape (6,).

    Raises
    ------
    UserError
        For a hyperbola, or an orbit that enters the Earth.
    """
    if orbit.eccentricity >= 1:
        raise UserError(
            f"{who}.eccentricity: {orbit.eccentricity:g} is not allowed; 0 <= eccentricity < 1 (a hyperbola has no "
            "perigee passage to count from)"
        )
    axis = orbit.semi_major_axis_km * _KM
    perigee = axis * (1 - orbit.eccentricity)
    if perigee <= constants.radius:
        raise UserError(
            f"{who}.semi_major_axis_km, {who}.eccentricity: ({orbit.semi_major_axis_km:g}, {orbit.eccentricity:g}) is "
            f"not allowed; the perigee is {perigee / _KM:.0f} km from the centre of the Earth, inside it"
        )
    elements = KeplerElements(
        axis,
        orbit.eccentricity,
        math.radians(orbit.inclination_deg),
        math.radians(orbit.raan_deg),
        math.radians(orbit.argument_of_perigee_deg),
        float(-mean_motion(axis, constants.mu) * orbit.perigee_passage_s),
    )
    return state_of(elements, constants.mu)


def initial_states(scenario: Scenario, record: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """Return the inertial states of observer and target at t = 0, each (6,).

    A recorded target's are those of its `record`, which is read here if it is not given; see `recorded_orbit`.
    """
    constants = gravity(scenario)
    observer = kepler_state(scenario.observer, constants, "observer")
    if isinstance(scenario.target, Sp3):
        return observer, (record or recorded_orbit(scenario))[1][0]
    return observer, kepler_state(scenario.target, constants, "target")


def recorded_orbit(scenario: Scenario) -> tuple[Array, Array]:
    """Return times and inertial states of the recorded target.

    Raises
    ------
    UserError
        If the data are not there, cannot be read, or end before the run does.
    """
    target = scenario.target
    assert isinstance(target, Sp3)
    folder = os.environ.get("QUIETFIX_DATA")
    if not folder or not (Path(folder) / "sp3").is_dir():
        raise UserError(
            f"target.file: {target.file} is looked for in the folder sp3 of the recorded data, which the environment "
            f"variable QUIETFIX_DATA names ({folder or 'not set'}); "
            "source: ftp://doris.ign.fr/pub/doris/products/orbits/grg/ja2/"
        )
    path = Path(folder) / "sp3" / target.file
    try:
        record = read_sp3(path, target.satellite or None)
        times, states = record.inertial(target.start_s, scenario.constants.earth_rate_radps)
    except OSError as error:
        raise UserError(f"target.file: {path} cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise UserError(f"target: {error}") from error
    if times[-1] < scenario.duration_s:
        raise UserError(
            f"target.start_s: {target.start_s:g} is not allowed; {times[-1]:g} s of the record are left, duration_s is "
            f"{scenario.duration_s:g}"
        )
    needed = times < scenario.duration_s
    needed[np.count_nonzero(needed)] = True
    absent = np.flatnonzero(needed & ~np.isfinite(states).all(axis=-1))
    if absent.size:
        raise UserError(
            f"target.start_s: {target.start_s:g} is not allowed with duration_s {scenario.duration_s:g}; the record "
            f"has no position, or no velocity to be trusted, {times[absent[0]]:g} s after the start"
        )
    return times, states


def _check_planes(observer: Array, target: Array) -> None:
    cosine = abs(float(plane_normal(observer) @ plane_normal(target)))
    angle = math.degrees(math.acos(min(1.0, cosine)))
    if angle < _COPLANAR:
        raise UserError(
            f"observer, target: their orbit planes are {angle:.2g} deg apart; coplanar orbits are not observable by "
            f"this method (every root of the ranging equation lies in the plane), at least {_COPLANAR:g} deg are needed"
        )


# ------------------------------------------------------------------------------------------------ declared


@dataclass(frozen=True)
class _Target:
    """The satellite that is heard: publishes ``target`` and ``truth``."""

    solved: Callable[[], DenseOrbit | RecordedTruth]

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        block = self.solved().again()
        port = "inertial" if isinstance(block, DenseOrbit) else "state"
        bus.add(block, gives={"target": port, "truth": port})


def _orbit(scenario: Scenario, state: Array, name: str) -> DenseOrbit:
    constants = gravity(scenario)
    return DenseOrbit(state[None], scenario.duration_s, constants=constants, j2=scenario.truth.j2, name=name)


def _preview(scenario: Scenario, clock: Periodic, bus: Bus, block: Estimator) -> str:
    """Add what the sensor will read, for an estimator that looks ahead; return its signal."""
    name, epochs = block.get_name(), block.GetInputPort("preview").size() // (bus.trials * PREVIEW)
    if scenario.truth.errors != SensorErrors():
        raise UserError(
            f"estimators.{name}: {name} is not allowed with truth.errors; it is given what the sensor will read"
        )
    span = clock.period * (epochs - 1)
    if scenario.duration_s < span:
        raise UserError(
            f"duration_s: {scenario.duration_s:g} is not allowed; {name} looks ahead, at least {span:g} s are needed"
        )
    sensor, observer, target = (bus[signal].get_system() for signal in ("measured", "platforms", "target"))
    known = bus["known"].get_system()
    error = known if isinstance(known, PlatformError) else None
    bus.add(Preview(sensor, target.at, observer.at, clock, epochs, error, f"preview_{name}"))
    return f"preview_{name}.preview"


def declare(scenario: Scenario) -> Model:
    """Return both satellites, sensor, prior and what the estimators are given; see `diagrams.assembly`."""
    truth, clock, constants = scenario.truth, Periodic(scenario.period_s), gravity(scenario)
    record = recorded_orbit(scenario) if isinstance(scenario.target, Sp3) else None
    listener, emitter = initial_states(scenario, record)
    _check_planes(listener, emitter)

    @cache
    def observer() -> DenseOrbit:
        return _orbit(scenario, listener, "observer")

    @cache
    def target() -> DenseOrbit | RecordedTruth:
        return RecordedTruth(*record, name="target") if record else _orbit(scenario, emitter, "target")

    known = "truth.sigma_observer_m and truth.sigma_observer_mps say how well the observer is known"
    refuse(truth.errors, "truth.errors", {**NO_CLOCKS, "platform": known})
    real, full, covariance = true_sensor(scenario), believed_sensor(scenario), prior_covariance(scenario)
    mask = _mask(scenario)

    def ranging(bus: Bus, name: str = "ranging", feedback: dict[str, str] | None = None) -> None:
        block = Ranging(full, bus.trials, 1, bus.shape("known")[0], feedback is not None, name=name)
        bus.add(block, takes={"platforms": "known"}, feedback=feedback)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        motion, start, kinds = believed_motion(scenario), PortStart(covariance), list(options.measurements)
        ahead = {"preview": partial(_preview, scenario, clock)}
        if kinds != [_POSITION]:
            return Assumed(believed_sensor(scenario, kinds), motion, start, list(ROWS), on_demand=ahead)
        model, own = RangedPosition(full), f"ranging_{name}"
        ranging(bus, own, {"prediction": f"{name}.prediction"})
        takes = {port: f"{own}.{port}" for port in ("measurement", "noise_covariance")}
        return Assumed(model, motion, start, model.names, takes, on_demand=ahead)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(lambda: observer().again(), "inertial"),
            _Target(target),
            TargetSensor("sensor", real, clock, mask, gives=["measured"]),
            Impaired(real, clock, truth.errors, mounts=[Mount(rows_of(["angles", "rates"]))]),
            KnownPlatforms(truth.sigma_observer_m, truth.sigma_observer_mps, name="observer_error"),
            lambda bus: bus.add(PriorEstimate(covariance, bus.trials), {"initial_estimate": "initial_estimate"}),
            ranging,
        ],
        assume=assume,
        truth_motion=OrbitalMotion(constants, real.j2),
        signals={port: f"ranging.{port}" for port in ("ranges", "range_sigmas")},
        platforms=("observer",),
        frame="inertial",
        # a tenth of the initial error, as in (61): of its expectation, so that all estimators are held to the same
        convergence=0.1 * math.sqrt(np.trace(covariance[:3, :3])),
        # a recorded target has no elements to map over
        map=partial(bound_map, scenario, scenario.target) if isinstance(scenario.target, Kepler) else None,
    )


def _mask(scenario: Scenario) -> EarthOccultation | None:
    truth, radius = scenario.truth, gravity(scenario).radius
    return EarthOccultation(radius + truth.grazing_height_km * _KM) if truth.occultation else None


def bound_map(scenario: Scenario, target: Kepler, points: tuple[int, int] | None = None) -> BoundMap:
    """Return the map of the bound over inclination and phase of the orbit of `target`; see `orbit_map`."""
    constants, belief = gravity(scenario), scenario.belief
    rate = math.degrees(mean_motion(target.semi_major_axis_km * _KM, constants.mu))
    density = belief.acceleration_density_m2ps3

    def state(inclination: float, anomaly: float) -> Array:
        moved = dataclasses.replace(target, inclination_deg=inclination, perigee_passage_s=-anomaly / rate)
        return kepler_state(moved, constants, "target")

    return orbit_map(
        Periodic(scenario.period_s).ticks(scenario.duration_s),
        kepler_state(scenario.observer, constants, "observer"),
        state,
        OrbitalMotion(constants, true_sensor(scenario).j2),
        _mask(scenario),
        {name: believed_sensor(scenario, kinds) for name, kinds in _MAPPED.items()},
        believed_motion(scenario),
        prior_covariance(scenario),
        {
            "noise": "none" if density == 0 else f"{density:g} m^2/s^3",
            "prior": f"{belief.sigma_position_km:g} km, {belief.sigma_velocity_mps:g} m/s per axis",
            "target": f"semi-major axis {target.semi_major_axis_km:g} km, eccentricity {target.eccentricity:g}, "
            f"node {target.raan_deg:g} deg",
        },
        (target.inclination_deg, (-target.perigee_passage_s * rate + 180.0) % 360.0 - 180.0),
        points,
    )


SYSTEM = System(
    name="satellite_ranging",
    title="satellite to satellite: passive ranging from angles, rates, radial velocity and radial acceleration",
    scenario=Scenario,
    declare=declare,
    **packaged("satellite_ranging"),
)
