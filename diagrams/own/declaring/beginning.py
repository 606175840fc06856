"""How the estimators of a system of one's own begin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Part
from quietfix.diagrams.own.declaring.resolving import two_differences
from quietfix.diagrams.own.declaring.sensing import Measured
from quietfix.diagrams.own.declaring.target import spread_of
from quietfix.diagrams.own.fields.schema import Given, OwnScenario, Prior
from quietfix.diagrams.own.fields.starts import KnownHeight, Snapshot
from quietfix.diagrams.own.kinds.phase import Phase
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.diagrams.paths.functions import Path, path_of
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.atmosphere.delayed import Delayed, in_vacuum
from quietfix.systems.clocks import Clock
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.fixes.known_height import Method, has_closed_form
from quietfix.systems.fixes.snapshot import starts_around, starts_around_level, under_ground, under_ground_level
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.sensors.prior import PriorEstimate
from quietfix.systems.starts.known_height_start import KnownHeightStart
from quietfix.systems.starts.snapshot_start import SnapshotStart
from quietfix.systems.starts.start import GivenStart, PortStart, Start

__all__ = ["Begin", "Surroundings", "begin"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surroundings:
    """What a start is made from.

    Attributes
    ----------
    scenario : OwnScenario
    kinds : sequence of Measured
        All that is measured.
    clock : Clock
        When measurements come.
    states : int
        Number of components of the state.
    target, carriers : callable
        States (6,) and (6 p,) at a time [s], as they are; None: nobody knows where the target is.
    setting : Setting
        Length of a run, its date, and where files are.
    scaled : bool
        Whether R comes with the measurement.
    """

    scenario: OwnScenario
    kinds: Sequence[Measured]
    clock: Clock
    states: int
    target: Path | None
    carriers: Callable[[float], Array]
    setting: Setting
    scaled: bool = False

    def first(self, where: str, names: Sequence[str]) -> list[Measured]:
        """Return kinds of these names, all if none is named; all of them must see the target at the first instant."""
        known = {one.name: one for one in self.kinds}
        chosen = [known[choose(where, name, known)] for name in names or known]
        if self.states != 6:
            raise UserError(f"{where}: a fix knows nothing of the oscillator, or of along_track; !Prior or !Given")
        simulated = self.scenario.measurements is None
        time = min(one.timed.offset_s for one in self.kinds) if simulated else 0.0
        target, carriers = self._anywhere(time)[None], self.carriers(time).reshape(1, -1, 6)
        for one in chosen:
            if simulated and one.timed.offset_s > time:
                raise UserError(
                    f"{where}: {one.name} is not allowed; it measures from {one.timed.offset_s:g} s on, the first "
                    f"measurement is at {time:g} s"
                )
            used = one.real.platforms_used(carriers.shape[-2]).any(axis=0)
            if simulated and one.mask is not None and not one.mask.visible(target, carriers)[..., used].all():
                raise UserError(
                    f"{where}: {one.name} is not allowed; at {time:g} s one of its platforms does not see the target"
                )
            if one.believed.jacobian(target, carriers)[..., 3:].any():
                raise UserError(
                    f"{where}: {one.name} is not allowed; a fix is of rows that depend on the position alone"
                )
        return chosen

    def _anywhere(self, time: float) -> Array:
        """Return the target's state, or one that is as good to see what measurements depend on."""
        if self.target is not None:
            return self.target(time)
        state = self.carriers(time).reshape(-1, 6).mean(axis=0)
        return state + np.array([1e3, 2e3, 3e3, 4.0, 5.0, 6.0])


Begin = Callable[[str, EstimatorOptions, Sequence[str]], Start]
"""``(name, options, rows) -> Start`` of an estimator that gets these rows."""


def begin(around: Surroundings) -> tuple[Begin, list[Part]]:
    """Return what makes an estimator's start, and the parts that it needs."""
    field, scenario = around.scenario.start, around.scenario
    if isinstance(field, Snapshot):
        return _snapshot(field, around), []
    if isinstance(field, KnownHeight):
        return _known_height(field, around)
    oscillator = field.sigma_offset_hz, field.sigma_drift_hzps
    spread = spread_of(scenario, field.sigma_position_m, field.sigma_velocity_mps, oscillator)
    if isinstance(field, Given):
        mean, constants = np.zeros(around.states), gravity_constants(scenario.constants)
        mean[:6] = path_of(field.at, scenario.axes, around.setting, constants, "start.at")(0.0)
        return lambda name, options, rows: GivenStart(mean, spread), []
    assert isinstance(field, Prior)
    return lambda name, options, rows: PortStart(spread), [_prior(spread)]


def _prior(spread: Array) -> Part:
    def part(bus: Bus) -> None:
        prior = PriorEstimate(spread, bus.trials, bus.shape("target")[0])
        bus.add(prior, gives={"initial_estimate": "initial_estimate"})

    return part


def _snapshot(field: Snapshot, around: Surroundings) -> Begin:
    if around.scenario.axes.up is None:
        raise UserError(f"start: !Snapshot is not allowed in frame {around.scenario.frame}; local or earth_fixed")
    chosen = around.first("start.sensors", field.sensors)
    for one in chosen:
        if isinstance(one.field, Phase) and one.field.resolved_by:
            raise UserError(
                f"start.sensors: {one.name} is not allowed; its phases are resolved by a prediction, which the first "
                "measurement has not; name others"
            )
    level = around.scenario.axes.flat
    places, buried = (starts_around_level, under_ground_level) if level else (starts_around, under_ground)

    def make(name: str, options: EstimatorOptions, rows: Sequence[str]) -> Start:
        for one in chosen:
            if one.resolved and options.resolves_phases:
                raise UserError(f"estimators.{name}: it takes wrapped phases; start.sensors: {one.name} is not allowed")
        model = Stack([one.cleared for one in chosen])
        spread, height = field.sigma_velocity_mps, field.height_m
        return SnapshotStart(model, rows, spread, height, around.scaled, places, buried=buried)

    size = sum(one.believed.size for one in chosen)
    if size < 3:
        rows = [row for one in chosen for row in one.believed.names]
        raise UserError(f"start.sensors: {rows} are not enough; a position takes three rows")
    return make


def _known_height(field: KnownHeight, around: Surroundings) -> tuple[Begin, list[Part]]:
    if not around.scenario.axes.geodetic:
        raise UserError(f"start: !KnownHeight is for frame earth_fixed only, this is {around.scenario.frame}")
    able = two_differences(around.kinds)
    if not able:
        raise UserError("start: !KnownHeight needs a !Tdoa of two rows; there is none")
    if not field.sensor and len(able) > 1:
        raise UserError(f"start.sensor: none is given; one of {', '.join(able)}")
    name = choose("start.sensor", field.sensor or next(iter(able)), able)
    believed = able[name].believed
    tdoa, air = in_vacuum(believed), believed if isinstance(believed, Delayed) else None
    assert isinstance(tdoa, Tdoa)
    if not tdoa.light_time:  # with light time the start itself allows for the velocity
        around.first("start.sensor", [name])
    if around.states != 6:
        raise UserError("start: a fix knows nothing of the oscillator, or of along_track; !Prior or !Given")
    platforms = around.carriers(able[name].timed.offset_s).reshape(1, -1, 6)
    order = [tdoa.reference, *tdoa.receivers]
    _check_above(around, order)
    if field.method == "closed_form" and not np.all(has_closed_form(platforms[:, order])):
        raise UserError(
            "start.method: closed_form is not allowed for these platforms (collinear, or in one plane with the Earth's "
            "centre); newton or auto"
        )

    def make(name: str, options: EstimatorOptions, rows: Sequence[str]) -> Start:
        sigma, method = field.believed_sigma_height_m or field.sigma_height_m, cast(Method, field.method)
        return KnownHeightStart(tdoa, rows, sigma, field.sigma_velocity_mps, field.sigma_platform_m, method, air)

    height = Altitude(field.sigma_height_m, "assumed_height")
    return make, [TargetSensor("assumed_height", height, around.clock)]


def _check_above(around: Surroundings, receivers: Sequence[int]) -> None:
    """Refuse receivers that are never all above the target's horizon: the fix takes no other solution."""
    if around.target is None:
        return
    ticks = around.clock.ticks(around.setting.duration)
    times = [float(t) for t in ticks[:: max(1, len(ticks) // 60)]]
    target = np.array([around.target(t) for t in times])
    carriers = np.array([around.carriers(t).reshape(-1, 6) for t in times])
    above = ElevationMask(0.0, "target").visible(target, carriers)[:, receivers]
    if not above.all(axis=1).any():
        worst = list(around.scenario.platforms)[receivers[int(np.argmin(above.sum(axis=0)))]]
        never = f"{worst} never is" if not above.any(axis=0).all() else "they never are all at once"
        raise UserError(
            f"start: !KnownHeight is for receivers above the target's horizon, such as satellites; {never}; !Snapshot "
            "or !Prior"
        )
