"""Two satellites track an airborne emitter by direction of arrival, TDOA and FDOA of the cross-ambiguity function.

The main satellite measures the direction of arrival; the auxiliary one relays its signal, and the cross-ambiguity
function of both gives the differences of delay and Doppler. This is the system of the patent whose particle filter is
`pf_sir` here; its own simulations are not in the text that is public.
"""

from __future__ import annotations

import math
from functools import partial

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model, Part
from quietfix.diagrams.assembly.system import System, packaged
from quietfix.diagrams.library.fields.dual_satellite import PLATFORMS, Scenario
from quietfix.diagrams.library.models.dual_satellite import (
    believed_stack,
    bound_map,
    check_visible,
    models,
    signal_chain,
    start_of,
    target_state,
)
from quietfix.diagrams.parts import formation
from quietfix.diagrams.parts.biases import Biasable, believed_biases, groups_of, row_units
from quietfix.diagrams.parts.dual_signal import Signal
from quietfix.diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.movers import Emitter, Platforms, true_motion
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.geometry.body_frame import NadirAxes
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.position import Position
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import ConstantVelocity

__all__ = ["SYSTEM"]

_KM = 1e3
_SATELLITES = 2
_KINDS = ("direction", "tdoa", "fdoa")


def declare(scenario: Scenario) -> Model:
    """Return truth, sensors, starts and what the estimators are given; see `quietfix.diagrams.assembly`."""
    truth, errors, clock = scenario.truth, scenario.truth.errors, Periodic(scenario.period_s)
    orbit, start_state = formation.satellite_orbit(scenario, _SATELLITES), target_state(scenario)
    check_visible(scenario, orbit, start_state)
    real = models(scenario, believed=False)
    stack = Stack([real[kind] for kind in _KINDS])
    mask = ElevationMask(math.radians(truth.minimum_elevation_deg), "target")
    sensors: list[Part]
    chain = None
    if isinstance(scenario.sensing, Signal):
        chain = signal_chain(scenario, scenario.sensing, orbit, clock, mask)
        sensors = [TargetSensor("direction_finding", real["direction"], clock, mask), chain]
    else:
        sensors = [TargetSensor("sensor", stack, clock, mask, gives=["measured"])]
    start = start_of(scenario, stack.names, noisy=chain is not None)
    known = {
        "prior_position": Position(truth.sigma_prior_position_km * _KM, "prior_position"),
        "assumed_height": Altitude(truth.sigma_assumed_height_km * _KM, "assumed_height"),
    }
    noise = dict.fromkeys(("noise_covariance", "start_noise_covariance") if chain else (), "noise_covariance")
    mounts = [Mount(stack.models[0].names, 0, NadirAxes(scenario.constants.earth_rate_radps))]
    clocks = {"tdoa_10": (1, 0)}

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        motion = ConstantVelocity(scenario.belief.acceleration_mps2)
        return Assumed(believed_stack(scenario, name, options), motion, start, stack.names, noise)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(orbit.again),
            Emitter(truth.motion, start_state, clock),
            *sensors,
            Impaired(stack, clock, errors, mounts, clocks),
            *(TargetSensor(port, known[port], clock, mask) for port in known if port in start.inputs),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
        ],
        assume=assume,
        truth_motion=true_motion(truth.motion),
        truth_states=ConstantVelocity(0.0).names,
        platforms=PLATFORMS,
        signals={port: port for port in ("quality", "differences_covariance")},
        note=chain.note if chain else "",
        widest=chain.widest if chain else None,
        map=partial(bound_map, scenario),
        late=late_of({"truth.latency_s": (stack.names, truth.latency_s)}, scenario.belief.late, stack.names),
        biases=believed_biases(
            scenario.belief.biases,
            Biasable(row_units(stack), groups_of(real), clocks, mounts, PLATFORMS, errors=errors),
        ),
    )


SYSTEM = System(
    name="dual_satellite",
    title="airborne emitter, two satellites: direction of arrival, TDOA, FDOA; particle filters",
    scenario=Scenario,
    declare=declare,
    **packaged("dual_satellite"),
)
