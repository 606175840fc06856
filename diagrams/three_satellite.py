"""Three satellites track an airborne emitter of unknown height by TDOA, FDOA and two-axis phase.

Xu, Su and Wang, *A moving target tracking method based on fusion of TDOA/FDOA/DOA*, Telecommunication Engineering
64 (2024) 261, doi 10.20079/j.issn.1001-893x.220609005.
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Union, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from diagrams import formation
from diagrams.assembly.bus import Bus
from diagrams.assembly.map import BoundMap
from diagrams.assembly.model import Assumed, Model
from diagrams.assembly.system import System, packaged
from diagrams.errors import UserError, choose
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
from diagrams.ground import beside_track, track_axes
from diagrams.maps.ground import Prior, ground_grid, ground_map
from diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from diagrams.parts.movers import Emitter, Platforms, true_motion
from diagrams.parts.resolving import PhaseResolution
from diagrams.parts.sensing import TargetSensor
from diagrams.sensor_errors import SensorErrors
from systems.clocks import Periodic
from systems.constants import SPEED_OF_LIGHT
from systems.documented import choice, documented, number
from systems.estimators.known_height_start import KnownHeightStart
from systems.estimators.options import EstimatorOptions
from systems.estimators.phase_resolver import PhaseResolver
from systems.fixes.known_height import Method, has_closed_form
from systems.frames import inertial_to_earth_fixed
from systems.measurement.altitude import Altitude
from systems.measurement.base import MeasurementModel
from systems.measurement.body_frame import body_frame
from systems.measurement.fdoa import Fdoa
from systems.measurement.phase import Axis, InterferometerPhase
from systems.measurement.stack import Stack
from systems.measurement.tdoa import Tdoa
from systems.measurement.visibility import ElevationMask
from systems.motion.constant_velocity import ConstantVelocity
from systems.plants.orbit import DenseOrbit
from systems.registry import estimator_options

__all__ = [
    "SYSTEM",
    "Scenario",
    "bound_map",
    "measurement_sets",
    "models",
    "satellite_orbit",
    "satellite_states",
    "target_state",
    "track_axes",
]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_KM = 1e3
_KINDS = ("tdoa", "fdoa", "phase_a", "phase_b")
_PHASE_AXES: dict[str, Sequence[Axis]] = {"phase_a": ("a",), "phase_b": ("b",), "phase": ("a", "b")}


@dataclass
class Truth:
    """What is the case."""

    along_km: float = number("place of the target at t = 0, from satellite 0's sub-point at mid pass: along [km]", 0.0)
    cross_km: float = number("the same, to the right of the ground track [km]", 300.0)
    height_km: float = number("height of the target above the ellipsoid [km]", 10.0, above=-1, at_most=500)
    speed_mps: float = number("speed of the target [m/s]", 300.0, at_least=0, at_most=8000)
    course_deg: float = number("course of the target, clockwise from north [deg]", 60.0)
    motion: StraightLine | GreatCircle | RandomAcceleration = documented(
        "how the target moves: !StraightLine, !GreatCircle or !RandomAcceleration", factory=StraightLine
    )
    carrier_ghz: float = number("carrier frequency of the emitter [GHz]", 3.0, above=0)
    baseline_m: float = number("baseline of the interferometer on satellite 0 [m]", 3.0, above=0)
    chain_m: list[float] = documented(
        "shorter baselines that resolve the phase one after the other [m]; empty: the TDOA fix resolves it",
        factory=list,
    )
    phase: str = choice(
        "wrapped: the phases come in [-pi, pi); unambiguous: an ideal sensor",
        "wrapped",
        ("wrapped", "unambiguous"),
    )
    sigma_tdoa_ns: float = number("standard deviation of a TDOA [ns]", 20.0, above=0)
    sigma_fdoa_hz: float = number("standard deviation of an FDOA [Hz]", 1.0, above=0)
    sigma_phase_deg: float = number("standard deviation of a phase [deg]", 15.0, above=0)
    correlated: bool = documented("errors of differences correlated through satellite 0", False)
    light_time: bool = documented("TDOA and FDOA of one wave front, instead of geometry of one instant", False)
    paper_sign: bool = documented("FDOA as range-rate difference over wavelength, as the paper prints it", False)
    sigma_assumed_height_km: float = number("error of the height assumed at the start [km]", 3.0, above=0)
    minimum_elevation_deg: float = number(
        "a satellite lower than this over the target's horizon hears nothing [deg]",
        0.0,
        at_least=-90,
        at_most=89,
    )
    errors: SensorErrors = documented("errors of the sensors that the estimators do not know of", factory=SensorErrors)


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    acceleration_mps2: float = number("process noise: acceleration in a step [m/s^2]", 0.1, at_least=0)
    sigma_velocity_mps: float = number("velocity at the start is 0 with this standard deviation [m/s]", 400.0, above=0)
    sigma_satellite_m: float = number("error of a satellite's position per axis, in P1 only [m]", 0.0, at_least=0)
    start: str = choice("how the first fix is solved", "auto", ("auto", "closed_form", "newton"))
    sigma_assumed_height_km: float | None = number("error of the assumed height [km]", None, above=0)
    sigma_tdoa_ns: float | None = number("standard deviation of a TDOA [ns]", None, above=0)
    sigma_fdoa_hz: float | None = number("standard deviation of an FDOA [Hz]", None, above=0)
    sigma_phase_deg: float | None = number("standard deviation of a phase [deg]", None, above=0)
    correlated: bool | None = documented("errors of differences correlated through satellite 0", None)
    light_time: bool | None = documented("TDOA and FDOA of one wave front", None)


@dataclass
class Scenario:
    """Scenario of `three_satellite`."""

    duration_s: float = number("length of the pass [s]", 150.0, above=0)
    period_s: float = number("time between measurements [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 50e3, above=0)
    constants: Constants = documented("physical constants", factory=Constants)
    reference_orbit: ReferenceOrbit = documented("orbit that the offsets refer to", factory=ReferenceOrbit)
    satellites: list[Offset | Kepler | PositionVelocity] = documented(
        "the three satellites, !Offset, !Kepler or !PositionVelocity; the first is the reference and carries the "
        "interferometer",
        factory=list,
    )
    truth: Truth = documented("what is the case", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators side by side; the first one's prediction resolves the phases", factory=dict
    )


# ------------------------------------------------------------------------------------------------ geometry


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
        Place [km], as `diagrams.ground.beside_track` counts it.
    """
    truth = scenario.truth
    along = truth.along_km if along_km is None else along_km
    cross = truth.cross_km if cross_km is None else cross_km
    return beside_track(scenario, orbit, along, cross)


# -------------------------------------------------------------------------------------------------- models


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


def _chain(scenario: Scenario) -> list[InterferometerPhase]:
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


def _believed_stack(scenario: Scenario, name: str, options: EstimatorOptions) -> MeasurementModel:
    available = models(scenario, believed=True)
    kinds = list(options.measurements) or ["tdoa", "fdoa", "phase"]
    unknown = [kind for kind in kinds if kind not in available]
    if unknown:
        raise UserError(f"estimators.{name}.measurements: {unknown} is not allowed; any of {', '.join(_KINDS)}")
    return Stack([available[kind] for kind in kinds])


# ------------------------------------------------------------------------------------------------ declared


def declare(scenario: Scenario) -> Model:
    """Return truth, sensor, start, resolver and what the estimators are given; see `diagrams.assembly`."""
    truth, belief, errors = scenario.truth, scenario.belief, scenario.truth.errors
    clock, rate = Periodic(scenario.period_s), scenario.constants.earth_rate_radps
    orbit = satellite_orbit(scenario)
    start_state = target_state(scenario, orbit)
    _check_visible(scenario, orbit, start_state)
    real, believed = (models(scenario, believed) for believed in (False, True))
    stack = _sensor_stack(scenario, real)
    resolver = PhaseResolution(stack.names, real["phase"], real["tdoa"], _chain(scenario))
    sigma_height = truth.sigma_assumed_height_km * _KM
    phases = [row for row in stack.names if row.startswith("phase")]
    mask = ElevationMask(math.radians(truth.minimum_elevation_deg), "target")

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        raw = truth.phase == "unambiguous" or options.resolves_phases
        rows = list(stack.names) if raw else resolver.on(bus)
        start = KnownHeightStart(
            believed["tdoa"],
            rows,
            belief.sigma_assumed_height_km * _KM if belief.sigma_assumed_height_km else sigma_height,
            belief.sigma_velocity_mps,
            belief.sigma_satellite_m,
            cast(Method, belief.start),
        )
        motion = ConstantVelocity(belief.acceleration_mps2)
        takes = {"measurement": "raw"} if raw else {}
        return Assumed(_believed_stack(scenario, name, options), motion, start, rows, takes)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(orbit.again),
            Emitter(truth.motion, start_state, clock),
            TargetSensor("sensor", stack, clock, mask, gives=["measured"]),
            TargetSensor("assumed_height", Altitude(sigma_height, "assumed_height"), clock),
            Impaired(
                stack,
                clock,
                errors,
                mounts=[Mount(phases, 0, lambda carrier: body_frame(carrier[..., None, :], 0, rate))],
                clocks={"tdoa_10": (1, 0), "tdoa_20": (2, 0)},
            ),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
        ],
        assume=assume,
        truth_motion=true_motion(truth.motion),
        truth_states=ConstantVelocity(0.0).names,
        platforms=("satellite_0", "satellite_1", "satellite_2"),
        signals={"integers": "phase_resolver.integers"},
        rows=stack.names,
        map=partial(bound_map, scenario),
    )


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
    prior: Prior | None = None,
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
        See `diagrams.maps.ground.ground_grid`.
    prior : Prior, optional
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
    return ground_map(scenario, grid, stacks, scenario.belief.acceleration_mps2, prior or Prior())


def _sensor_stack(scenario: Scenario, real: Mapping[str, Any]) -> Stack:
    """Return what the satellites measure, with the phases of the shorter baselines."""
    chain = _chain(scenario)
    if chain and scenario.truth.phase == "unambiguous":
        raise UserError("truth.chain_m: a chain of baselines is for truth.phase wrapped only")
    phase = real["phase"]
    for i, link in enumerate(chain):
        link.names = PhaseResolver.link_names(phase, i)
    return Stack([real["tdoa"], real["fdoa"], phase, *chain])


def _check_visible(scenario: Scenario, orbit: DenseOrbit, target: Array) -> None:
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


SYSTEM = System(
    name="three_satellite",
    title="airborne emitter of unknown height, three satellites: TDOA, FDOA, two-axis phase",
    scenario=Scenario,
    declare=declare,
    **packaged("three_satellite"),
)
