"""A fixed target located by bearings from a CSV file of one's own: ``quietfix replay bearings FILE``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.recorded import RecordedStream
from quietfix.diagrams.readers.bearings_file import Bearings, read_bearings
from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.recorded.reports.bearings_report import MOST, BearingsReport, blocks_of, sigma_of
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.documented import documented, text
from quietfix.systems.fixes.von_mises import robust_fix, sample, von_mises_fix
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.options.bearings.crossing import Crossing
from quietfix.systems.options.choice import EstimatorChoice
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.mgekf import Mgekf
from quietfix.systems.sensors.recorded import Recording
from quietfix.systems.starts.bearing_start import BearingStart

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_bearings"]

SOURCE = Source(
    folder="",
    origin="a CSV file of your own; columns time_s, x_m, y_m (or latitude_deg, longitude_deg), bearing_deg, sigma_deg",
    truth=False,
)


@dataclass
class Settings:
    """Which file, and who locates the target."""

    data: str = text("the bearings, a CSV file", "")
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators and their options",
        factory=lambda: {
            "lines": Crossing(method="lines"),
            "iv": Crossing(method="iv"),
            "ekf": Ekf(),
            "mgekf": Mgekf(),
        },
    )


def declare(settings: Settings) -> Model:
    """Return recorded bearings and what the estimators are given; see `quietfix.diagrams.assembly`."""
    if not settings.data:
        raise UserError(f"FILE: it is missing; bearings takes {SOURCE.origin}")
    return declare_bearings(read_bearings(Path(settings.data)))


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
    title="recording: a fixed target located by bearings from a CSV file of your own",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
)
