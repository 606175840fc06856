"""Targets located by bearings from a CSV file of one's own: ``quietfix replay bearings FILE``.

One target at rest, or, by the column ``target``, several at once; with ``motion=constant_velocity`` they move straight
on, seen by several stations or by an observer that manoeuvres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.recorded import RecordedStream
from quietfix.diagrams.readers.bearings_file import Bearings, Target, read_targets
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.recorded.reports.bearings_report import MOST, BearingsReport, blocks_of, sigma_of
from quietfix.diagrams.recorded.reports.targets_report import believed_sigma, targets_report
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.documented import choice, documented, number, text
from quietfix.systems.fixes.von_mises import robust_fix, sample, von_mises_fix
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.options.bearings.crossing import Crossing
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.mgekf import Mgekf
from quietfix.systems.sensors.recorded import Recording
from quietfix.systems.starts.bearing_start import BearingStart

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_bearings", "declare_targets"]

_AFTER = 1e-6  # s

SOURCE = Source(
    folder="",
    origin="a CSV file of your own; columns time_s, x_m, y_m (or latitude_deg, longitude_deg), bearing_deg, sigma_deg "
    "and, of several targets, target",
    truth=False,
)


@dataclass
class Settings:
    """Which file, and who locates the target."""

    data: str = text("the bearings, a CSV file", "")
    motion: str = choice("how targets move", "fixed", ("fixed", "constant_velocity"))
    correction_deg: float = number(
        "what is added to all bearings: the declination of magnetic ones; where places are x_m and y_m, less the "
        "convergence of true ones [deg]",
        0.0,
    )
    sigma_velocity_mps: float = number("of targets that move, per axis at the start [m/s]", 20.0, above=0)
    acceleration_density_m2ps3: float = number("of targets that move, as filters believe it", 1e-4, at_least=0)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options",
        factory=lambda: {
            "lines": Crossing(method="lines"),
            "iv": Crossing(method="iv"),
            "ekf": Ekf(),
            "mgekf": Mgekf(),
        },
    )

    def completed(self) -> Settings:
        """Return the settings without methods that know only targets at rest, where they move."""
        if self.motion == "fixed":
            return self
        able = {name: one for name, one in self.estimators.items() if not isinstance(one, Crossing)}
        return replace(self, estimators=able)


def declare(settings: Settings) -> Model:
    """Return recorded bearings and what the estimators are given; see `quietfix.diagrams.assembly`."""
    if not settings.data:
        raise UserError(f"FILE: it is missing; bearings takes {SOURCE.origin}")
    targets = read_targets(Path(settings.data))
    if settings.correction_deg:
        turn = math.radians(settings.correction_deg)
        targets = [
            one._replace(bearings=replace(one.bearings, azimuth=wrap(one.bearings.azimuth - turn))) for one in targets
        ]
    if settings.motion == "fixed" and len(targets) == 1:
        return declare_bearings(targets[0].bearings)
    return declare_targets(targets, settings)


def declare_targets(targets: Sequence[Target], settings: Settings) -> Model:
    """Return the bearings of several targets, or of such as move: each is a track of a study."""
    moving = settings.motion == "constant_velocity"
    usable = [one for one in targets if not one.wrong]
    if not usable:
        raise UserError(f"bearings: {targets[0].name or 'the target'}: {targets[0].wrong}")
    sigma = believed_sigma([one.bearings for one in usable], moving)
    recordings = [_recording(one.bearings, sigma.value, moving) for one in usable]
    size = 4 if moving else 2
    played = RecordedStream(recordings, [np.full((one.times.size, size), np.nan) for one in recordings])
    model = Bearing(sigma.value)
    motion = WhiteNoiseAcceleration(settings.acceleration_density_m2ps3, 2) if moving else Stationary(2)
    reach = max(float(np.linalg.norm(np.ptp(one.bearings.place, axis=0))) for one in usable)

    def assume(bus: Bus, name: str, options: Any) -> Assumed:
        start = BearingStart(model, model.names, motion.size, reach, reach, settings.sigma_velocity_mps)
        return Assumed(model, motion, start, model.names, {"noise_covariance": "noise_covariance"})

    several = len(usable) > 1
    return Model(
        clock=played.clock,
        duration=played.duration,
        divergence=0.0,
        parts=[played],
        assume=assume,
        frame="local",
        truth_states=motion.names,
        platforms=["observer"],
        recorded=Recorded(
            tracks=[one.name or "target" for one in usable],
            clocks=played.clocks if several else (),
            times=played.times if several else (),
            report=partial(targets_report, targets=targets, sigma=sigma, moving=moving),
            keeps=["covariance"],
            truth=False,
        ),
    )


def _recording(bearings: Bearings, sigma: float, moving: bool) -> Recording:
    """Return the bearings of a target, of a sample of 1024 where there are more."""
    taken = bearings.take(sample(len(bearings.azimuth), MOST))
    k = len(taken.azimuth)
    stamps = taken.time - taken.time[0]
    if moving:  # those of one instant one after the other; a millionth of a second moves nothing
        for i in np.flatnonzero(np.diff(stamps) < _AFTER) + 1:
            stamps[i:] = np.maximum(stamps[i:], stamps[i - 1] + _AFTER)
    elif not np.all(np.diff(stamps) > 0):  # of a fixed target only the order matters
        stamps = np.arange(float(k))
    platforms = np.zeros((k, 1, 6))
    platforms[:, 0, :2] = taken.place
    return Recording(stamps, taken.azimuth[:, None], platforms, np.square(taken.spread(sigma))[:, None, None])


def declare_bearings(bearings: Bearings, sigma: float | None = None) -> Model:
    """Return the same of bearings that were read already; of a sample of 1024 where there are more.

    Parameters
    ----------
    bearings : Bearings
    sigma : float, optional
        Standard deviation of the bearings where the file has none [rad]; by default that of the robust fix.
    """
    likely = von_mises_fix(bearings.place, bearings.azimuth)
    robust = robust_fix(bearings.place, bearings.azimuth)
    believed = sigma_of(robust) if sigma is None else sigma
    taken = bearings.take(sample(len(bearings.azimuth), MOST))
    k = len(taken.azimuth)
    spread = taken.spread(believed)
    # Several stations may take a bearing at the same time; of a fixed target only the order matters.
    stamps = taken.time - taken.time[0] if np.all(np.diff(taken.time) > 0) else np.arange(float(k))
    platforms = np.zeros((k, 1, 6))
    platforms[:, 0, :2] = taken.place
    recording = Recording(stamps, taken.azimuth[:, None], platforms, np.square(spread)[:, None, None])
    played = RecordedStream([recording], [np.full((k, 2), np.nan)])
    model, motion = Bearing(float(np.median(spread))), Stationary(2)
    reach = float(np.linalg.norm(np.ptp(taken.place, axis=0)))

    def assume(bus: Bus, name: str, options: Any) -> Assumed:
        start = BearingStart(model, model.names, motion.size, reach, reach)
        return Assumed(model, motion, start, model.names, {"noise_covariance": "noise_covariance"})

    def report(result: xr.Dataset) -> BearingsReport:
        return BearingsReport(bearings, likely, robust, blocks_of(result), believed)

    return Model(
        clock=played.clock,
        duration=played.duration,
        divergence=0.0,
        parts=[played],
        assume=assume,
        frame="local",
        truth_states=motion.names,
        platforms=["observer"],
        recorded=Recorded(report=report, keeps=["covariance"]),
    )


SYSTEM = System(
    name="bearings",
    title="recording: targets located by bearings from a CSV file of your own",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
)
