"""A three-stage rocket seen as range rates whose beacon drifts: one bias shared by all stations.

Shang, Xing and Gan, *Real-time processing of tracking data of maneuvering target in beacon-mode*, Control Theory &
Applications 29 (2012) 59. Everything is in the launch frame: Earth-fixed axes at the launch site of a spherical Earth,
X down-range, Y up. State of truth and estimates: position, velocity, acceleration, bias (the paper interleaves the
axes).
"""

from __future__ import annotations

from functools import partial

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System, packaged
from quietfix.diagrams.library.fields.beacon_rocket import Scenario
from quietfix.diagrams.library.models.beacon_rocket import (
    acceleration_limits,
    believed_sigma,
    bound_map,
    motion_within,
    start_covariance,
    truth_motion,
    warn_unobservable,
)
from quietfix.diagrams.library.parts.beacon_rocket import BeaconFlight, OffsetStart
from quietfix.diagrams.parts.biases import Biasable, believed_biases, row_units
from quietfix.diagrams.parts.impairment import Impaired, KnownPlatforms
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.launch import (
    station_names,
    station_positions,
    vehicle_block,
)
from quietfix.diagrams.parts.sensor_errors import NO_CLOCKS, refuse
from quietfix.diagrams.quantities.frame import LAUNCH
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.known_flight import KnownFlight
from quietfix.systems.starts.start import PortStart

__all__ = ["SYSTEM"]


def declare(scenario: Scenario) -> Model:
    """Return rocket, oscillator, stations, prior and what the estimators are given; see `assembly`."""
    if scenario.stop_s < scenario.start_s + scenario.period_s:
        raise UserError(f"stop_s: {scenario.stop_s:g} is not allowed; it must be after start_s {scenario.start_s:g}")
    clock, positions = Periodic(scenario.period_s, scenario.start_s), station_positions(scenario)
    vehicle, errors = vehicle_block(scenario), scenario.sensor.errors
    warn_unobservable(positions, vehicle, scenario)
    refuse(errors, "sensor.errors", {**NO_CLOCKS, "attitude": "range rates know no directions"})
    limits, stations = acceleration_limits(scenario, vehicle), range(len(positions))
    real, sigma = RangeRate(scenario.sensor.sigma_mps, stations), believed_sigma(scenario)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        if options.measurements not in ([], ["range_rate"]):
            raise UserError(f"estimators.{name}.measurements: {options.measurements} is not allowed; range_rate")
        biased = getattr(options, "estimates_bias", True)
        motion = motion_within(scenario, limits, biased)
        model = RangeRate(sigma, stations, 9 if biased else None)
        start = PortStart(start_covariance(scenario.belief, biased))
        return Assumed(model, motion, start, real.names, {"initial_estimate": f"initial_estimate_{motion.size}"})

    return Model(
        clock=clock,
        duration=scenario.stop_s,
        divergence=scenario.divergence_m,
        parts=[
            BeaconFlight(scenario, clock, vehicle, positions, real),
            Impaired(real, clock, errors),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
            OffsetStart(scenario),
        ],
        assume=assume,
        truth_motion=truth_motion(scenario),
        truth_states=KnownFlight([0.0]).names,
        signals={"mode": "mode", "stage": "stage"},
        platforms=station_names(scenario),
        frame=LAUNCH,
        map=partial(bound_map, scenario),
        late=late_of(
            {"sensor.latency_s": (real.names, scenario.sensor.latency_s)}, scenario.belief.late, real.names, apart=True
        ),
        biases=believed_biases(
            scenario.belief.biases,
            Biasable(row_units(real), {"range_rate": real.names}, platforms=station_names(scenario)),
        ),
    )


SYSTEM = System(
    name="beacon_rocket",
    title="three-stage rocket, range rates at many stations, the beacon's drift as one shared bias",
    scenario=Scenario,
    declare=declare,
    **packaged("beacon_rocket"),
)
