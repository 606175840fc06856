"""Three satellites track an airborne emitter of unknown height by TDOA, FDOA and two-axis phase.

Xu, Su and Wang, *A moving target tracking method based on fusion of TDOA/FDOA/DOA*, Telecommunication Engineering
64 (2024) 261, doi 10.20079/j.issn.1001-893x.220609005.
"""

from __future__ import annotations

import math
from functools import partial
from typing import cast

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System, packaged
from quietfix.diagrams.library.fields.three_satellite import PLATFORMS, Scenario
from quietfix.diagrams.library.models.three_satellite import (
    baseline_chain,
    believed_stack,
    bound_map,
    check_visible,
    models,
    satellite_orbit,
    sensor_stack,
    target_state,
)
from quietfix.diagrams.parts.biases import Biasable, believed_biases, groups_of, row_units
from quietfix.diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.movers import Emitter, Platforms, true_motion
from quietfix.diagrams.parts.resolving import PhaseResolution
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.fixes.known_height import Method
from quietfix.systems.geometry.body_frame import NadirAxes
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.starts.known_height_start import KnownHeightStart

__all__ = ["SYSTEM"]

_KM = 1e3


def declare(scenario: Scenario) -> Model:
    """Return truth, sensor, start, resolver and what the estimators are given; see `quietfix.diagrams.assembly`."""
    truth, belief, errors = scenario.truth, scenario.belief, scenario.truth.errors
    clock, rate = Periodic(scenario.period_s), scenario.constants.earth_rate_radps
    orbit = satellite_orbit(scenario)
    start_state = target_state(scenario, orbit)
    check_visible(scenario, orbit, start_state)
    real, believed = (models(scenario, believed) for believed in (False, True))
    stack = sensor_stack(scenario, real)
    resolver = PhaseResolution(stack.names, real["phase"], real["tdoa"], baseline_chain(scenario))
    sigma_height = truth.sigma_assumed_height_km * _KM
    phases = [row for row in stack.names if row.startswith("phase")]
    mounts, clocks = [Mount(phases, 0, NadirAxes(rate))], {"tdoa_10": (1, 0), "tdoa_20": (2, 0)}
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
        clearings = () if raw else (resolver.cycles,)
        model = believed_stack(scenario, name, options)
        return Assumed(model, motion, start, rows, takes, clearings=clearings)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(orbit.again),
            Emitter(truth.motion, start_state, clock),
            TargetSensor("sensor", stack, clock, mask, gives=["measured"]),
            TargetSensor("assumed_height", Altitude(sigma_height, "assumed_height"), clock),
            Impaired(stack, clock, errors, mounts, clocks),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
        ],
        assume=assume,
        truth_motion=true_motion(truth.motion),
        truth_states=ConstantVelocity(0.0).names,
        platforms=PLATFORMS,
        signals={"integers": "phase_resolver.integers"},
        rows=stack.names,
        late=late_of({"truth.latency_s": (stack.names, truth.latency_s)}, belief.late, stack.names),
        map=partial(bound_map, scenario),
        biases=believed_biases(
            belief.biases, Biasable(row_units(stack), groups_of(real), clocks, mounts, PLATFORMS, errors=errors)
        ),
    )


SYSTEM = System(
    name="three_satellite",
    title="airborne emitter of unknown height, three satellites: TDOA, FDOA, two-axis phase",
    scenario=Scenario,
    declare=declare,
    **packaged("three_satellite"),
)
