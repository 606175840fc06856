"""What `beacon_rocket` makes of its scenario: sensor, motions, prior, what hides the rocket, map of the bound."""

from __future__ import annotations

import math
import warnings
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.library.fields.beacon_rocket import Belief, ConstantBias, LinearBias, RandomWalkBias, Scenario
from quietfix.diagrams.maps.flight import flight_map
from quietfix.diagrams.parts.launch import (
    launch_site,
    station_names,
    station_positions,
    vehicle_block,
)
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Periodic
from quietfix.systems.geometry.lines_of_sight import line_of_sight
from quietfix.systems.geometry.visibility import SphericalMask
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.current_statistical import CurrentStatistical, MeanAcceleration
from quietfix.systems.motion.known_flight import KnownFlight

__all__ = [
    "acceleration_limits",
    "believed_motion",
    "believed_sensor",
    "believed_sigma",
    "bound_map",
    "motion_within",
    "sensor_mask",
    "start_covariance",
    "truth_motion",
    "warn_unobservable",
]

Array = NDArray[np.float64]

_FLOWN = 400  # points of the flight on a map
_UNKNOWNS = ("x", "y", "z", "vx", "vy", "vz", "bias")  # of one sample


def acceleration_limits(scenario: Scenario, plant: Any) -> tuple[Array, Array]:
    """Return the largest and smallest acceleration per axis that the estimators believe in."""
    belief = scenario.belief
    for name in ("a_max_mps2", "a_min_mps2"):
        value = getattr(belief, name)
        if value is not None and len(value) != 3:
            raise UserError(f"belief.{name}: {value} is not allowed; a list of three numbers, along x, y and z")
    times = np.arange(scenario.start_s, scenario.stop_s, scenario.period_s)
    flown = np.array([plant.at(float(t))[1] for t in times])
    largest = np.maximum(flown.max(axis=0), 0.0) * belief.limit_margin
    smallest = np.minimum(flown.min(axis=0), 0.0) * belief.limit_margin
    return (
        largest if belief.a_max_mps2 is None else np.array(belief.a_max_mps2),
        smallest if belief.a_min_mps2 is None else np.array(belief.a_min_mps2),
    )


def warn_unobservable(positions: Array, plant: Any, scenario: Scenario) -> None:
    """Say what too few stations leave open in one sample."""
    if len(positions) >= len(_UNKNOWNS):
        return
    state = plant.at(0.5 * (scenario.start_s + scenario.stop_s))[0]
    still = np.concatenate([positions, np.zeros_like(positions)], axis=-1)
    sight = line_of_sight(state, still)
    # Lengths are scaled by the mean range over the speed, so that all columns are per m/s.
    scale = sight.distance.mean() / np.linalg.norm(state[3:])
    rows = np.concatenate([sight.range_rate_gradient * scale, sight.direction, np.ones((len(positions), 1))], axis=-1)
    free = np.linalg.svd(rows)[2][len(positions) :]
    share = np.einsum("ki,ki->i", free, free)
    named = [_UNKNOWNS[i] for i in np.argsort(-share) if share[i] > 0.5] or [_UNKNOWNS[int(np.argmax(share))]]
    warnings.warn(
        f"stations: {len(positions)} for the {len(_UNKNOWNS)} unknowns of a sample ({', '.join(_UNKNOWNS)}); "
        f"{len(free)} combinations are unobservable but through the motion, mostly {', '.join(named)}",
        stacklevel=2,
    )


def motion_within(scenario: Scenario, limits: tuple[Array, Array], biased: bool = True) -> CurrentStatistical:
    """Return the motion that the estimators believe in, for limits of the acceleration, with the bias or without."""
    belief = scenario.belief
    density = belief.bias_variance_per_step_m2ps2 / scenario.period_s
    return CurrentStatistical(
        belief.alpha_hz,
        *limits,
        belief.sigma_floor_mps2,
        [density] if biased else [],
        cast(MeanAcceleration, belief.mean_acceleration),
    )


def believed_motion(scenario: Scenario, vehicle: Any) -> CurrentStatistical:
    """Return how the estimators believe that the vehicle moves, a block of `vehicle_block`."""
    return motion_within(scenario, acceleration_limits(scenario, vehicle))


def believed_sigma(scenario: Scenario) -> float:
    """Return the standard deviation of a range rate that the estimators believe in [m/s]."""
    return scenario.sensor.sigma_mps if scenario.belief.sigma_mps is None else scenario.belief.sigma_mps


def believed_sensor(scenario: Scenario) -> RangeRate:
    """Return the sensor as the estimators believe it to be, with the bias as the tenth state."""
    return RangeRate(believed_sigma(scenario), range(len(scenario.stations)), 9)


def sensor_mask(scenario: Scenario) -> SphericalMask | None:
    """Return what hides the rocket from a station; None: nothing, not even the Earth."""
    minimum = scenario.sensor.minimum_elevation_deg
    if minimum is None:
        return None
    return SphericalMask(math.radians(minimum), "platform", tuple(launch_site(scenario).centre))


def truth_motion(scenario: Scenario) -> KnownFlight | None:
    """Return the motion that the bounds may believe in: the flown acceleration known, the bias's law too.

    None where the bias is none of a state's: redrawn at every sample, growing with a power of time, or jumping to the
    transponder's range rate and back.
    """
    if any(w.end_s > scenario.start_s and w.begin_s < scenario.stop_s for w in scenario.mode.transponder):
        return None
    if isinstance(scenario.bias, RandomWalkBias):
        return KnownFlight([scenario.bias.density_m2ps3])
    return KnownFlight([0.0]) if isinstance(scenario.bias, ConstantBias | LinearBias) else None


def start_covariance(belief: Belief, biased: bool) -> Array:
    """Return the covariance of the start, shape (10, 10), or (9, 9) without the bias."""
    sigmas = [belief.sigma_position_m] * 3 + [belief.sigma_velocity_mps] * 3 + [belief.sigma_acceleration_mps2] * 3
    return np.diag(np.square([*sigmas, belief.sigma_bias_mps] if biased else sigmas))


def bound_map(scenario: Scenario, points: tuple[int, int] | None = None) -> BoundMap:
    """Return the map of the bound in the plane of the flight; see `flight_map`."""
    vehicle, belief = vehicle_block(scenario), scenario.belief
    flown_at = np.linspace(scenario.start_s, scenario.stop_s, _FLOWN)
    return flight_map(
        np.array([np.concatenate(vehicle.at(float(t))) for t in flown_at]),
        launch_site(scenario),
        station_positions(scenario),
        station_names(scenario),
        Periodic(scenario.period_s),
        believed_sensor(scenario),
        believed_motion(scenario, vehicle),
        sensor_mask(scenario),
        belief.sigma_acceleration_mps2,
        belief.sigma_bias_mps,
        f"current statistical model, {belief.alpha_hz:g} 1/s",
        points,
    )
