"""What `dual_satellite` makes of its scenario: target, sensors, starts, signal chain, and the map of its bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.library.fields.dual_satellite import PLATFORMS, Scenario, Truth
from quietfix.diagrams.maps.ground import GroundPrior, ground_grid, ground_map
from quietfix.diagrams.parts import formation
from quietfix.diagrams.parts.dual_signal import Signal, SignalChain, predicted_sigmas, waveform_of
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.ambiguity.limits import check_duration
from quietfix.systems.ambiguity.variance import effective_snr, stein
from quietfix.systems.angles.direction import BodyDirection, Direction, DirectionCosines
from quietfix.systems.clocks import Periodic
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.starts.direction_start import DirectionStart
from quietfix.systems.starts.prior_position_start import PriorPositionStart

__all__ = [
    "believed_stack",
    "bound_map",
    "check_visible",
    "delay_doppler_sigmas",
    "models",
    "signal_chain",
    "start_of",
    "target_state",
]

Array = NDArray[np.float64]

_KM = 1e3
_KINDS = ("direction", "tdoa", "fdoa")


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


def believed_stack(scenario: Scenario, name: str, options: EstimatorOptions) -> MeasurementModel:
    """Return the sensor that an estimator believes in, of the kinds that its options name."""
    available = models(scenario, believed=True)
    kinds = list(options.measurements) or list(_KINDS)
    unknown = [kind for kind in kinds if kind not in available]
    if unknown:
        raise UserError(f"estimators.{name}.measurements: {unknown} is not allowed; any of {', '.join(_KINDS)}")
    return Stack([available[kind] for kind in kinds])


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
    return ground_map(scenario, grid, sets, scenario.belief.acceleration_mps2, GroundPrior(), PLATFORMS)


def signal_chain(
    scenario: Scenario, signal: Signal, orbit: DenseOrbit, clock: Periodic, mask: ElevationMask
) -> SignalChain:
    """Return all that the cross-ambiguity function needs."""
    believed = models(scenario, believed=True)
    direction, tdoa, fdoa = (believed[kind] for kind in _KINDS)
    assert isinstance(direction, BodyDirection) and isinstance(tdoa, Tdoa) and isinstance(fdoa, Fdoa)
    _check_duration(scenario, signal, fdoa, orbit)
    return SignalChain(signal, direction, tdoa, fdoa, orbit, scenario.duration_s, clock, mask)


def start_of(scenario: Scenario, rows: Sequence[str], noisy: bool) -> PriorPositionStart | DirectionStart:
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


def check_visible(scenario: Scenario, orbit: DenseOrbit, target: Array) -> None:
    """Refuse what cannot be measured at all."""
    mask = ElevationMask(math.radians(scenario.truth.minimum_elevation_deg), "target")
    if not formation.seen_at_all(scenario, orbit, target, mask):
        raise UserError(
            f"truth.latitude_deg, truth.longitude_deg: ({scenario.truth.latitude_deg:g}, "
            f"{scenario.truth.longitude_deg:g}) is not allowed; the target is below "
            f"{scenario.truth.minimum_elevation_deg:g} deg elevation of both satellites for the whole pass"
        )
