"""What `three_satellite` makes of its scenario: satellites, target, sensors, and the map of its bound."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.library.fields.three_satellite import PLATFORMS, Scenario
from quietfix.diagrams.maps.ground import GroundPrior, ground_grid, ground_map
from quietfix.diagrams.parts import formation
from quietfix.diagrams.parts.ground import beside_track
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.angles.phase import Axis, InterferometerPhase
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.phase_resolver import PhaseResolver
from quietfix.systems.fixes.known_height import has_closed_form
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.plants.orbit import DenseOrbit

__all__ = [
    "baseline_chain",
    "believed_stack",
    "bound_map",
    "check_visible",
    "measurement_sets",
    "models",
    "satellite_orbit",
    "satellite_states",
    "sensor_stack",
    "target_state",
]

Array = NDArray[np.float64]
_KINDS = ("tdoa", "fdoa", "phase_a", "phase_b")
_PHASE_AXES: dict[str, Sequence[Axis]] = {"phase_a": ("a",), "phase_b": ("b",), "phase": ("a", "b")}


def satellite_states(scenario: Scenario) -> Array:
    """Return the three satellites' inertial states at t = 0, shape (3, 6); see `formation.satellite_states`."""
    return formation.satellite_states(scenario, 3)


def satellite_orbit(scenario: Scenario) -> DenseOrbit:
    """Return the block of the satellites."""
    return formation.satellite_orbit(scenario, 3)


def target_state(
    scenario: Scenario, orbit: DenseOrbit, along_km: ArrayLike | None = None, cross_km: ArrayLike | None = None
) -> Array:
    """Return the target's Earth-fixed state at t = 0, shape (..., 6).

    Parameters
    ----------
    scenario : Scenario
        Height, speed and course, and the place if it is not given.
    orbit : DenseOrbit
        The satellites.
    along_km, cross_km : array_like, shape (...), optional
        Place [km], as `quietfix.diagrams.parts.ground.beside_track` counts it.
    """
    truth = scenario.truth
    along = truth.along_km if along_km is None else along_km
    cross = truth.cross_km if cross_km is None else cross_km
    return beside_track(scenario, orbit, along, cross)


def models(scenario: Scenario, believed: bool) -> dict[str, Any]:
    """Return the measurement models, of the truth or as the estimators believe them, by kind.

    Keys ``tdoa``, ``fdoa``, ``phase_a``, ``phase_b``, and ``phase``: both axes together.
    """
    truth, belief = scenario.truth, scenario.belief

    def chosen(field: str) -> Any:
        value = getattr(belief, field) if believed else None
        return getattr(truth, field) if value is None else value

    common = {
        "correlated": chosen("correlated"),
        "light_time": chosen("light_time"),
        "earth_rate": scenario.constants.earth_rate_radps,
        "constants": formation.gravity_constants(scenario.constants),
    }
    carrier = truth.carrier_ghz * 1e9
    wrapped = truth.phase == "wrapped" and not believed
    phases = {
        name: InterferometerPhase(
            math.radians(chosen("sigma_phase_deg")),
            truth.baseline_m,
            SPEED_OF_LIGHT / carrier,
            axes,
            wrapped=wrapped,
            earth_rate=scenario.constants.earth_rate_radps,
        )
        for name, axes in _PHASE_AXES.items()
    }
    return {
        "tdoa": Tdoa(chosen("sigma_tdoa_ns") * 1e-9, **common),
        "fdoa": Fdoa(chosen("sigma_fdoa_hz"), carrier, paper_sign=truth.paper_sign, **common),
        **phases,
    }


def baseline_chain(scenario: Scenario) -> list[InterferometerPhase]:
    """Return the phases of the shorter baselines that resolve the first."""
    truth = scenario.truth
    wavelength = SPEED_OF_LIGHT / (truth.carrier_ghz * 1e9)
    return [
        InterferometerPhase(
            math.radians(truth.sigma_phase_deg),
            baseline,
            wavelength,
            wrapped=True,
            earth_rate=scenario.constants.earth_rate_radps,
        )
        for baseline in truth.chain_m
    ]


def believed_stack(scenario: Scenario, name: str, options: EstimatorOptions) -> MeasurementModel:
    """Return the sensor that an estimator believes in, of the kinds that its options name."""
    available = models(scenario, believed=True)
    kinds = list(options.measurements) or ["tdoa", "fdoa", "phase"]
    unknown = [kind for kind in kinds if kind not in available]
    if unknown:
        raise UserError(f"estimators.{name}.measurements: {unknown} is not allowed; any of {', '.join(_KINDS)}")
    return Stack([available[kind] for kind in kinds])


def measurement_sets(scenario: Scenario) -> dict[str, list[str]]:
    """Return the sets of measurement kinds that the scenario's estimators use, each once, in their order."""
    sets: dict[str, list[str]] = {}
    for options in scenario.estimators.values():
        kinds = list(getattr(options, "measurements", [])) or ["tdoa", "fdoa", "phase"]
        sets.setdefault(" + ".join(kinds), kinds)
    return sets


def bound_map(
    scenario: Scenario,
    sets: Mapping[str, Sequence[str]] | None = None,
    spacing_km: float = 100.0,
    extent_km: float = 1500.0,
    prior: GroundPrior | None = None,
) -> BoundMap:
    """Return the map of the bound after the pass, for targets on a grid over the ground.

    The height is that above the ellipsoid where the target is at the last epoch.

    Parameters
    ----------
    scenario : Scenario
        Satellites, the target's height, speed and course, noise, and the filter's process noise.
    sets : mapping of str to sequence of str, optional
        Kinds of measurement by name of the set (``tdoa``, ``fdoa``, ``phase_a``, ``phase_b``; ``phase`` is both); by
        default those of the scenario's estimators.
    spacing_km, extent_km : float
        See `quietfix.diagrams.maps.ground.ground_grid`.
    prior : GroundPrior, optional
        What is known before the first measurement.

    Raises
    ------
    UserError
        For a kind that is not known, or a grid without points.
    """
    available = models(scenario, believed=True)
    chosen = measurement_sets(scenario) if sets is None else sets
    stacks = {
        name: Stack([available[choose("gdop: measurement", kind, available)] for kind in kinds])
        for name, kinds in chosen.items()
    }
    grid = ground_grid(scenario, spacing_km, extent_km)
    return ground_map(scenario, grid, stacks, scenario.belief.acceleration_mps2, prior or GroundPrior(), PLATFORMS)


def sensor_stack(scenario: Scenario, real: Mapping[str, Any]) -> Stack:
    """Return what the satellites measure, with the phases of the shorter baselines."""
    chain = baseline_chain(scenario)
    if chain and scenario.truth.phase == "unambiguous":
        raise UserError("truth.chain_m: a chain of baselines is for truth.phase wrapped only")
    phase = real["phase"]
    for i, link in enumerate(chain):
        link.names = PhaseResolver.link_names(phase, i)
    return Stack([real["tdoa"], real["fdoa"], phase, *chain])


def check_visible(scenario: Scenario, orbit: DenseOrbit, target: Array) -> None:
    """Refuse what cannot be measured or started at all."""
    mask = ElevationMask(math.radians(scenario.truth.minimum_elevation_deg), "target")
    if not formation.seen_at_all(scenario, orbit, target, mask):
        raise UserError(
            f"truth.along_km, truth.cross_km: ({scenario.truth.along_km:g}, {scenario.truth.cross_km:g}) is not "
            f"allowed; the target is below {scenario.truth.minimum_elevation_deg:g} deg elevation of all satellites "
            "for the whole pass"
        )
    platforms = inertial_to_earth_fixed(orbit.at(0.0), 0.0, scenario.constants.earth_rate_radps)
    if scenario.belief.start == "closed_form" and not np.all(has_closed_form(platforms[None])):
        raise UserError(
            "belief.start: closed_form is not allowed for this formation (collinear, or in one plane with the "
            "Earth's centre); newton or auto"
        )
