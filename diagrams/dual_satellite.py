"""Two satellites track an airborne emitter by direction of arrival, TDOA and FDOA of the cross-ambiguity function.

The main satellite measures the direction of arrival; the auxiliary one relays its signal, and the cross-ambiguity
function of both gives the differences of delay and Doppler. This is the system of the patent whose particle filter is
`pf_sir` here; its own simulations are not in the text that is public.
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import NDArray

from diagrams import formation
from diagrams.assembly.bus import Bus
from diagrams.assembly.map import BoundMap
from diagrams.assembly.model import Assumed, Model, Part
from diagrams.assembly.system import System, packaged
from diagrams.dual_signal import Drawn, Signal, SignalChain, predicted_sigmas, waveform_of
from diagrams.errors import UserError
from diagrams.formation import (
    Constants,
    GreatCircle,
    Kepler,
    Offset,
    PositionVelocity,
    RandomAcceleration,
    ReferenceOrbit,
    StraightLine,
)
from diagrams.maps.ground import Prior, ground_grid, ground_map
from diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from diagrams.parts.movers import Emitter, Platforms, true_motion
from diagrams.parts.sensing import TargetSensor
from diagrams.sensor_errors import SensorErrors
from systems.ambiguity.limits import check_duration
from systems.ambiguity.variance import effective_snr, stein
from systems.clocks import Periodic
from systems.documented import choice, documented, number
from systems.estimators.direction_start import DirectionStart
from systems.estimators.options import EstimatorOptions
from systems.estimators.prior_position_start import PriorPositionStart
from systems.frames import inertial_to_earth_fixed
from systems.geodetic import geodetic_state
from systems.measurement.altitude import Altitude
from systems.measurement.base import MeasurementModel
from systems.measurement.body_frame import body_frame
from systems.measurement.direction import BodyDirection, Direction, DirectionCosines
from systems.measurement.fdoa import Fdoa
from systems.measurement.position import Position
from systems.measurement.stack import Stack
from systems.measurement.tdoa import Tdoa
from systems.measurement.visibility import ElevationMask
from systems.motion.constant_velocity import ConstantVelocity
from systems.plants.orbit import DenseOrbit
from systems.registry import estimator_options

__all__ = ["SYSTEM", "Scenario", "Truth", "bound_map", "delay_doppler_sigmas", "models", "target_state"]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_KM = 1e3
_SATELLITES = 2
_KINDS = ("direction", "tdoa", "fdoa")


@dataclass
class Truth:
    """What is the case."""

    latitude_deg: float = number("geodetic latitude of the target at t = 0 [deg]", 4.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude of the target at t = 0 [deg]", 5.0, at_least=-360, at_most=360)
    height_km: float = number("height of the target above the ellipsoid [km]", 10.0, above=-1, at_most=500)
    speed_mps: float = number("speed of the target [m/s]", 300.0, at_least=0, at_most=8000)
    course_deg: float = number("course of the target, clockwise from north [deg]", 60.0)
    motion: StraightLine | GreatCircle | RandomAcceleration = documented(
        "how the target moves: !StraightLine, !GreatCircle or !RandomAcceleration", factory=StraightLine
    )
    carrier_ghz: float = number("carrier frequency of the emitter [GHz]", 3.0, above=0)
    direction: str = choice(
        "angles: azimuth and depression at the main satellite; cosines: direction cosines, for above 85 deg depression",
        "angles",
        ("angles", "cosines"),
    )
    sigma_direction_deg: float = number("standard deviation of each angle of the direction [deg]", 0.5, above=0)
    differences: str = choice(
        "errors of TDOA and FDOA. stated: the two standard deviations below; stein: those that signal-to-noise ratio, "
        "bandwidth and integration time leave",
        "stated",
        ("stated", "stein"),
    )
    sigma_tdoa_ns: float = number("stated standard deviation of the TDOA [ns]", 20.0, above=0)
    sigma_fdoa_hz: float = number("stated standard deviation of the FDOA [Hz]", 1.0, above=0)
    snr_main_db: float = number("stein: signal-to-noise ratio in the noise bandwidth, main satellite [dB]", -13.0)
    snr_auxiliary_db: float = number("stein: the same at the auxiliary satellite [dB]", -13.0)
    noise_bandwidth_mhz: float = number("stein: noise bandwidth of both receivers [MHz]", 2.5, above=0)
    rms_bandwidth_mhz: float = number(
        "stein: rms width of the signal's spectrum about its centre [MHz]", 0.587, above=0
    )
    integration_ms: float = number("stein: integration time [ms]", 16.384, above=0)
    light_time: bool = documented("TDOA and FDOA of one wave front, instead of geometry of one instant", False)
    sigma_prior_position_km: float = number("error of the prior position per axis [km]", 5.0, above=0)
    sigma_assumed_height_km: float = number("error of the height that is assumed without a prior [km]", 3.0, above=0)
    minimum_elevation_deg: float = number(
        "a satellite lower than this over the target's horizon hears nothing [deg]", 0.0, at_least=-90, at_most=89
    )
    errors: SensorErrors = documented("errors of the sensors that the estimators do not know of", factory=SensorErrors)


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    acceleration_mps2: float = number("process noise: acceleration in a step [m/s^2]", 0.1, at_least=0)
    sigma_velocity_mps: float = number("velocity at the start is 0 with this standard deviation [m/s]", 200.0, above=0)
    start: str = choice(
        "prior: from a prior position; measurement: from the first direction, TDOA and FDOA and an assumed height",
        "prior",
        ("prior", "measurement"),
    )
    sigma_prior_position_km: float | None = number("error of the prior position per axis [km]", None, above=0)
    sigma_assumed_height_km: float | None = number("error of the assumed height [km]", None, above=0)
    sigma_direction_deg: float | None = number("standard deviation of each angle of the direction [deg]", None, above=0)
    sigma_tdoa_ns: float | None = number("standard deviation of the TDOA [ns]", None, above=0)
    sigma_fdoa_hz: float | None = number("standard deviation of the FDOA [Hz]", None, above=0)
    light_time: bool | None = documented("TDOA and FDOA of one wave front", None)


@dataclass
class Scenario:
    """Scenario of `dual_satellite`."""

    duration_s: float = number("length of the pass [s]", 150.0, above=0)
    period_s: float = number("time between measurements [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 20e3, above=0)
    constants: Constants = documented("physical constants", factory=Constants)
    reference_orbit: ReferenceOrbit = documented("orbit that the offsets refer to", factory=ReferenceOrbit)
    satellites: list[Offset | Kepler | PositionVelocity] = documented(
        "the two satellites, !Offset, !Kepler or !PositionVelocity; the first is the main one and finds directions",
        factory=list,
    )
    truth: Truth = documented("what is the case", factory=Truth)
    sensing: Drawn | Signal = documented(
        "!Drawn: TDOA and FDOA are drawn with the errors that truth states; !Signal: they come from I/Q samples",
        factory=Drawn,
    )
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)


# -------------------------------------------------------------------------------------------------- models


def target_state(scenario: Scenario) -> Array:
    """Return the target's Earth-fixed state at t = 0, shape (6,)."""
    truth = scenario.truth
    place = math.radians(truth.latitude_deg), math.radians(truth.longitude_deg), truth.height_km * _KM
    return geodetic_state(*place, math.radians(truth.course_deg), truth.speed_mps)


def delay_doppler_sigmas(truth: Truth) -> tuple[float, float]:
    """Return the standard deviations of TDOA [s] and FDOA [Hz] of the truth: stated, or by Stein's formulae."""
    if truth.differences == "stated":
        return truth.sigma_tdoa_ns * 1e-9, truth.sigma_fdoa_hz
    time = truth.integration_ms * 1e-3
    gamma = effective_snr(10 ** (truth.snr_main_db / 10), 10 ** (truth.snr_auxiliary_db / 10))
    beta = 2 * math.pi * truth.rms_bandwidth_mhz * 1e6
    sigmas = stein(truth.noise_bandwidth_mhz * 1e6 * time, gamma, beta, time)
    return float(sigmas.delay), float(sigmas.frequency)


def models(scenario: Scenario, believed: bool) -> dict[str, MeasurementModel]:
    """Return the measurement models, of the truth or as the estimators believe them, by kind.

    Keys ``direction``, ``tdoa``, ``fdoa``.
    """
    truth, belief = scenario.truth, scenario.belief
    signal = scenario.sensing
    sigma_tdoa, sigma_fdoa = predicted_sigmas(signal) if isinstance(signal, Signal) else delay_doppler_sigmas(truth)

    def chosen(field: str) -> Any:
        value = getattr(belief, field) if believed else None
        return getattr(truth, field) if value is None else value

    if believed and belief.sigma_tdoa_ns is not None:
        sigma_tdoa = belief.sigma_tdoa_ns * 1e-9
    if believed and belief.sigma_fdoa_hz is not None:
        sigma_fdoa = belief.sigma_fdoa_hz
    rate = scenario.constants.earth_rate_radps
    common = {
        "receivers": (1,),
        "light_time": chosen("light_time"),
        "earth_rate": rate,
        "constants": formation.gravity_constants(scenario.constants),
    }
    sigma = math.radians(chosen("sigma_direction_deg"))
    direction = Direction if truth.direction == "angles" else DirectionCosines
    return {
        "direction": direction(sigma, earth_rate=rate),
        "tdoa": Tdoa(sigma_tdoa, **common),
        "fdoa": Fdoa(sigma_fdoa, truth.carrier_ghz * 1e9, **common),
    }


def _believed_stack(scenario: Scenario, name: str, options: EstimatorOptions) -> MeasurementModel:
    available = models(scenario, believed=True)
    kinds = list(options.measurements) or list(_KINDS)
    unknown = [kind for kind in kinds if kind not in available]
    if unknown:
        raise UserError(f"estimators.{name}.measurements: {unknown} is not allowed; any of {', '.join(_KINDS)}")
    return Stack([available[kind] for kind in kinds])


# ------------------------------------------------------------------------------------------------ declared


def declare(scenario: Scenario) -> Model:
    """Return truth, sensors, starts and what the estimators are given; see `diagrams.assembly`."""
    truth, errors, clock = scenario.truth, scenario.truth.errors, Periodic(scenario.period_s)
    orbit, start_state = formation.satellite_orbit(scenario, _SATELLITES), target_state(scenario)
    _check_visible(scenario, orbit, start_state)
    real = models(scenario, believed=False)
    stack = Stack([real[kind] for kind in _KINDS])
    mask = ElevationMask(math.radians(truth.minimum_elevation_deg), "target")
    sensors: list[Part]
    chain = None
    if isinstance(scenario.sensing, Signal):
        chain = _signal_chain(scenario, scenario.sensing, orbit, clock, mask)
        sensors = [TargetSensor("direction_finding", real["direction"], clock, mask), chain]
    else:
        sensors = [TargetSensor("sensor", stack, clock, mask, gives=["measured"])]
    start = _start(scenario, stack.names, noisy=chain is not None)
    known = {
        "prior_position": Position(truth.sigma_prior_position_km * _KM, "prior_position"),
        "assumed_height": Altitude(truth.sigma_assumed_height_km * _KM, "assumed_height"),
    }
    noise = dict.fromkeys(("noise_covariance", "start_noise_covariance") if chain else (), "noise_covariance")
    rate = scenario.constants.earth_rate_radps

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        motion = ConstantVelocity(scenario.belief.acceleration_mps2)
        return Assumed(_believed_stack(scenario, name, options), motion, start, stack.names, noise)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(orbit.again),
            Emitter(truth.motion, start_state, clock),
            *sensors,
            Impaired(
                stack,
                clock,
                errors,
                mounts=[Mount(stack.models[0].names, 0, lambda carrier: body_frame(carrier[..., None, :], 0, rate))],
                clocks={"tdoa_10": (1, 0)},
            ),
            *(TargetSensor(port, known[port], clock, mask) for port in known if port in start.inputs),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
        ],
        assume=assume,
        truth_motion=true_motion(truth.motion),
        truth_states=ConstantVelocity(0.0).names,
        platforms=("main", "auxiliary"),
        signals={port: port for port in ("quality", "differences_covariance")},
        note=chain.note if chain else "",
        widest=chain.widest if chain else None,
        map=partial(bound_map, scenario),
    )


def bound_map(scenario: Scenario) -> BoundMap:
    """Return the map over the ground: of the direction alone, of the differences alone, and of both.

    The prior is that of `three_satellite`'s map, so that the two can be compared.
    """
    available = models(scenario, believed=True)
    sets = {
        "direction": Stack([available["direction"]]),
        "TDOA + FDOA": Stack([available["tdoa"], available["fdoa"]]),
        "direction + TDOA + FDOA": Stack([available[kind] for kind in ("direction", "tdoa", "fdoa")]),
    }
    grid = ground_grid(scenario, count=2)
    return ground_map(scenario, grid, sets, scenario.belief.acceleration_mps2, Prior())


def _signal_chain(
    scenario: Scenario, signal: Signal, orbit: DenseOrbit, clock: Periodic, mask: ElevationMask
) -> SignalChain:
    """Return all that the cross-ambiguity function needs."""
    believed = models(scenario, believed=True)
    direction, tdoa, fdoa = (believed[kind] for kind in _KINDS)
    assert isinstance(direction, BodyDirection) and isinstance(tdoa, Tdoa) and isinstance(fdoa, Fdoa)
    _check_duration(scenario, signal, fdoa, orbit)
    return SignalChain(signal, direction, tdoa, fdoa, orbit, scenario.duration_s, clock, mask)


def _start(scenario: Scenario, rows: Sequence[str], noisy: bool) -> PriorPositionStart | DirectionStart:
    """Return how the estimators begin, and begin again; `noisy`: R comes with the measurement."""
    truth, belief = scenario.truth, scenario.belief
    believed = models(scenario, believed=True)
    direction, tdoa, fdoa = (believed[kind] for kind in _KINDS)
    assert isinstance(direction, BodyDirection) and isinstance(tdoa, Tdoa) and isinstance(fdoa, Fdoa)
    height = (belief.sigma_assumed_height_km or truth.sigma_assumed_height_km) * _KM
    velocity = belief.sigma_velocity_mps
    once = DirectionStart(direction, tdoa, fdoa, rows, height, velocity, noisy)
    if belief.start == "measurement":
        return once
    position = (belief.sigma_prior_position_km or truth.sigma_prior_position_km) * _KM
    return PriorPositionStart(position, velocity, again=once)


def _check_duration(scenario: Scenario, signal: Signal, fdoa: Fdoa, orbit: DenseOrbit) -> None:
    """Refuse an integration that the motion smears; the block itself checks what its windows tell of."""
    step, ends = 0.5, np.linspace(0.0, scenario.duration_s, 7)[:, None]
    times = np.clip(ends + np.array([-step, step]), 0.0, scenario.duration_s)
    platforms = inertial_to_earth_fixed(orbit.at(times), times[..., None], scenario.constants.earth_rate_radps)
    start = target_state(scenario)
    moving = start + times[..., None] * np.concatenate([start[3:], np.zeros(3)])
    frequency = fdoa.predict(moving, platforms)[..., 0]
    rate = np.diff(frequency, axis=-1)[:, 0] / np.diff(times, axis=-1)[:, 0]
    band = min(waveform_of(signal).bandwidth, signal.sample_rate_mhz * 1e6)
    try:
        check_duration(signal.samples / signal.sample_rate_mhz / 1e6, frequency / fdoa.carrier, rate, band)
    except ValueError as error:
        raise UserError(f"sensing.samples: {signal.samples} is not allowed; {error}") from error


def _check_visible(scenario: Scenario, orbit: DenseOrbit, target: Array) -> None:
    """Refuse what cannot be measured at all."""
    mask = ElevationMask(math.radians(scenario.truth.minimum_elevation_deg), "target")
    if not formation.seen_at_all(scenario, orbit, target, mask):
        raise UserError(
            f"truth.latitude_deg, truth.longitude_deg: ({scenario.truth.latitude_deg:g}, "
            f"{scenario.truth.longitude_deg:g}) is not allowed; the target is below "
            f"{scenario.truth.minimum_elevation_deg:g} deg elevation of both satellites for the whole pass"
        )


SYSTEM = System(
    name="dual_satellite",
    title="airborne emitter, two satellites: direction of arrival, TDOA, FDOA; particle filters",
    scenario=Scenario,
    declare=declare,
    **packaged("dual_satellite"),
)
