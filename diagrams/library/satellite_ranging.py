"""One satellite finds the orbit of another by listening: angles, rates, radial velocity and radial acceleration.

Wu Shunhua, Xin Qin and Wan Jianwei, *A passive ranging method of single satellite to satellite based on kinematics*,
Progress in Natural Science (in Chinese), received 2008. The frame is inertial throughout.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System, packaged
from quietfix.diagrams.library.fields.satellite_ranging import Kepler, Scenario, Sp3
from quietfix.diagrams.library.models.satellite_ranging import (
    believed_motion,
    believed_sensor,
    bound_map,
    check_planes,
    gravity,
    initial_states,
    prior_covariance,
    recorded_orbit,
    sensor_mask,
    true_sensor,
)
from quietfix.diagrams.library.parts.satellite_ranging import OrbitingTarget, add_preview, orbit_block
from quietfix.diagrams.parts.biases import Biasable, believed_biases, row_units
from quietfix.diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.movers import Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.diagrams.parts.sensor_errors import NO_CLOCKS, refuse
from quietfix.diagrams.quantities.frame import INERTIAL
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.relative_kinematics import ROWS, rows_of
from quietfix.systems.biases.bias import Bias
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.fixes.ranged_position import RangedPosition
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.plants.recorded import RecordedTruth
from quietfix.systems.sensors.prior import PriorEstimate
from quietfix.systems.sensors.ranging import Ranging
from quietfix.systems.starts.start import PortStart

__all__ = ["SYSTEM"]

_POSITION = "position"


def declare(scenario: Scenario) -> Model:
    """Return both satellites, sensor, prior and what the estimators are given; see `quietfix.diagrams.assembly`."""
    truth, clock, constants = scenario.truth, Periodic(scenario.period_s), gravity(scenario)
    record = recorded_orbit(scenario) if isinstance(scenario.target, Sp3) else None
    listener, emitter = initial_states(scenario, record)
    check_planes(listener, emitter)

    @cache
    def observer() -> DenseOrbit:
        return orbit_block(scenario, listener, "observer")

    @cache
    def target() -> DenseOrbit | RecordedTruth:
        return RecordedTruth(*record, name="target") if record else orbit_block(scenario, emitter, "target")

    known = "truth.sigma_observer_m and truth.sigma_observer_mps say how well the observer is known"
    refuse(truth.errors, "truth.errors", {**NO_CLOCKS, "platform": known})
    real, full, covariance = true_sensor(scenario), believed_sensor(scenario), prior_covariance(scenario)
    mask, mounts = sensor_mask(scenario), [Mount(rows_of(["angles", "rates"]))]

    def ranging(bus: Bus, name: str = "ranging", feedback: dict[str, str] | None = None) -> None:
        block = Ranging(full, bus.trials, 1, bus.shape("known")[0], feedback is not None, name=name)
        bus.add(block, takes={"platforms": "known"}, feedback=feedback)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        motion, start, kinds = believed_motion(scenario), PortStart(covariance), list(options.measurements)
        ahead = {"preview": partial(add_preview, scenario, clock)}
        if kinds != [_POSITION]:
            return Assumed(believed_sensor(scenario, kinds), motion, start, list(ROWS), on_demand=ahead)
        _check_ranged(scenario, name)
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
            OrbitingTarget(target),
            TargetSensor("sensor", real, clock, mask, gives=["measured"]),
            Impaired(real, clock, truth.errors, mounts),
            KnownPlatforms(truth.sigma_observer_m, truth.sigma_observer_mps, name="observer_error"),
            lambda bus: bus.add(PriorEstimate(covariance, bus.trials), {"initial_estimate": "initial_estimate"}),
            ranging,
        ],
        assume=assume,
        truth_motion=OrbitalMotion(constants, real.j2),
        signals={port: f"ranging.{port}" for port in ("ranges", "range_sigmas")},
        platforms=("observer",),
        frame=INERTIAL,
        late=late_of({"truth.latency_s": (real.names, truth.latency_s)}, scenario.belief.late, real.names),
        biases=_biases(scenario, real, mounts),
        # a tenth of the initial error, as in (61): of its expectation, so that all estimators are held to the same
        convergence=0.1 * math.sqrt(np.trace(covariance[:3, :3])),
        # a recorded target has no elements to map over
        map=partial(bound_map, scenario, scenario.target) if isinstance(scenario.target, Kepler) else None,
    )


def _check_ranged(scenario: Scenario, name: str) -> None:
    if scenario.belief.biases:
        raise UserError(
            f"estimators.{name}.measurements: [{_POSITION}] is not allowed with belief.biases; a position that is made "
            "of rows has none of their biases; angles, rates, ..."
        )


def _biases(scenario: Scenario, real: MeasurementModel, mounts: Sequence[Mount]) -> tuple[Bias, ...]:
    """Return the biases of the scenario's belief."""
    groups = {kind: rows_of([kind]) for kind in ("angles", "rates")}
    own = Biasable(row_units(real), groups, mounts=mounts, platforms=("observer",), errors=scenario.truth.errors)
    return believed_biases(scenario.belief.biases, own)


SYSTEM = System(
    name="satellite_ranging",
    title="satellite to satellite: passive ranging from angles, rates, radial velocity and radial acceleration",
    scenario=Scenario,
    declare=declare,
    **packaged("satellite_ranging"),
)
