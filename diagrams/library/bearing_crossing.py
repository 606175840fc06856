"""One aircraft locates a target by bearings alone.

Huang, *Bearing cross location algorithm based on piecewise linear Kalman filter*, Modern Defence Technology 45 (2017)
no. 1, 113-118, doi 10.3969/j.issn.1009-086x.2017.01.020.

A local frame: x east, y north, z up. Azimuths are counter-clockwise from x in radians inside; courses and bearings
clockwise from north in degrees where people read and write.
"""

from __future__ import annotations

from functools import partial
from typing import cast

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.system import System, packaged
from quietfix.diagrams.library.fields.bearing_crossing import Scenario
from quietfix.diagrams.library.models.bearing_crossing import (
    axes_of,
    bearing_start,
    believed_sensor,
    bound_map,
    check_errors,
    check_geometry,
    check_rows,
    observer_path,
    sensor_model,
    target_motion,
    target_state,
)
from quietfix.diagrams.parts.biases import Biasable, believed_biases, row_units
from quietfix.diagrams.parts.impairment import Impaired, Mount, NavigationError
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.movers import ModelTarget, Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.diagrams.quantities.frame import LOCAL
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.clocks import Clock, Periodic
from quietfix.systems.estimators.azimuth_filter import AzimuthFilter
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.plants.path import Path

__all__ = ["SYSTEM"]

_KM = 1e3


def declare(scenario: Scenario) -> Model:
    """Return observer, target, sensor, azimuth filters and what the estimators are given; see `assembly`."""
    path, motion, axes = observer_path(scenario), target_motion(scenario), axes_of(scenario)
    check_geometry(scenario, path, motion)
    truth, clock = scenario.truth, Periodic(scenario.period_s)
    check_errors(scenario)
    spread = truth.target_spread_km * _KM
    place = np.diag([spread**2] * axes + [0.0] * (motion.size - axes))
    real, model = (sensor_model(scenario, believed) for believed in (False, True))
    start = bearing_start(scenario, model, motion)

    mounts = [Mount(real.names)]

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        check_rows(name, options, model)
        source = getattr(options, "bearings", "raw")
        if source == "raw":
            return Assumed(model, motion, start, model.names)
        filtered = _azimuth_filter(scenario, bus, name, source, clock)
        takes = {"measurement": f"{source}.bearing", "noise_covariance": f"{source}.bearing_covariance"}
        return Assumed(model, motion, start, filtered.motion.names, takes)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(lambda: Path(path)),
            ModelTarget(motion, clock, target_state(scenario), place, shared=spread == 0),
            TargetSensor("sensor", real, clock, gives=["measured"]),
            Impaired(real, clock, truth.errors, mounts=mounts, axes=axes),
            NavigationError(truth.sigma_navigation_m, truth.navigation_time_s, clock, axes),
        ],
        assume=assume,
        truth_motion=motion,
        signals={name: f"{name}.estimate" for name in scenario.azimuth_filters},
        platforms=("observer",),
        frame=LOCAL,
        rows=model.names,
        map=partial(bound_map, scenario),
        biases=believed_biases(
            scenario.belief.biases,
            Biasable(row_units(model), {}, {}, mounts, ("observer",), axes, truth.errors),
        ),
        late=late_of({"truth.latency_s": (real.names, truth.latency_s)}, scenario.belief.late, real.names),
    )


def _azimuth_filter(scenario: Scenario, bus: Bus, estimator: str, name: str, clock: Clock) -> AzimuthFilter:
    """Return the azimuth filter of that name; one block serves all locators that use it."""
    signal = f"{name}.bearing"
    if signal in bus:
        return cast(AzimuthFilter, bus[signal].get_system())
    choose(f"estimators.{estimator}.bearings", name, ["raw", *scenario.azimuth_filters])
    if name in scenario.estimators:
        raise UserError(f"azimuth_filters.{name}: there is an estimator of that name; another is needed")
    if axes_of(scenario) == 3:
        raise UserError(f"estimators.{estimator}.bearings: {name} is not allowed where elevation is measured; raw")
    model = believed_sensor(scenario)
    wiring = Wiring(bus.trials, model.names, clock, 1, bus.shape("known")[0])
    block = scenario.azimuth_filters[name].make(name, model.sigma, wiring)
    return bus.add(block, takes={"platforms": "known"})


SYSTEM = System(
    name="bearing_crossing",
    title="one aircraft, bearings only: azimuth filtered in pieces, crossing of lines, direct filters",
    scenario=Scenario,
    declare=declare,
    **packaged("bearing_crossing"),
)
