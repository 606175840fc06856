"""What `satellite_ranging` makes of its scenario: sensor, motion, prior, orbits at the start, map of the bound."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.library.fields.satellite_ranging import Kepler, Scenario, Sp3
from quietfix.diagrams.maps.orbits import orbit_map
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics, rows_of
from quietfix.systems.clocks import Periodic
from quietfix.systems.fixes.orbit_plane import plane_normal
from quietfix.systems.geometry.visibility import EarthOccultation
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.plants.sp3 import read_sp3
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.kepler import KeplerElements, mean_motion, state_of

__all__ = [
    "believed_motion",
    "believed_sensor",
    "bound_map",
    "check_planes",
    "gravity",
    "initial_states",
    "prior_covariance",
    "recorded_orbit",
    "sensor_mask",
    "true_sensor",
]

Array = NDArray[np.float64]

_KM = 1e3
_KINDS = ("angles", "rates", *ROWS)
_MAPPED = {"angles": ("angles",), "angles + rates": ("angles", "rates"), "all six rows": ()}
_COPLANAR = 1.0  # degrees between the two orbit planes


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


def check_planes(observer: Array, target: Array) -> None:
    """Refuse orbits in one plane; states (6,)."""
    cosine = abs(float(plane_normal(observer) @ plane_normal(target)))
    angle = math.degrees(math.acos(min(1.0, cosine)))
    if angle < _COPLANAR:
        raise UserError(
            f"observer, target: their orbit planes are {angle:.2g} deg apart; coplanar orbits are not observable by "
            f"this method (every root of the ranging equation lies in the plane), at least {_COPLANAR:g} deg are needed"
        )


def sensor_mask(scenario: Scenario) -> EarthOccultation | None:
    """Return what hides the target; None: nothing, not even the Earth."""
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
        sensor_mask(scenario),
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
