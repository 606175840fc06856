"""Replay of bearings from a CSV file: ``quietfix replay bearings FILE``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from diagrams.bearings_file import Bearings, read_bearings
from diagrams.figures.style import grid, new_figure, save
from diagrams.replay import Dataset
from diagrams.tables import Column, Table
from systems.estimators.base import Estimator, Wiring
from systems.estimators.bearing_start import BearingStart
from systems.estimators.crossing import Crossing
from systems.estimators.ekf import Ekf
from systems.estimators.mgekf import Mgekf
from systems.estimators.options import EstimatorOptions
from systems.fixes.von_mises import DirectionFix, robust_fix, von_mises_fix
from systems.measurement.bearing import Bearing, to_compass
from systems.motion.stationary import Stationary
from systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = ["DATASET", "BearingsReplay", "locate"]

Array = NDArray[np.float64]

_BLOCKS: dict[str, EstimatorOptions] = {
    "lines": Crossing(method="lines"),
    "iv": Crossing(method="iv"),
    "ekf": Ekf(),
    "mgekf": Mgekf(),
}


def locate(bearings: Bearings, sigma: float) -> dict[str, tuple[Array, Array]]:
    """Run the estimator blocks over recorded bearings of a fixed target.

    Parameters
    ----------
    bearings : Bearings
    sigma : float
        Standard deviation of the bearings where the file has none [rad].

    Returns
    -------
    dict of str to (ndarray (2,), ndarray (2, 2))
        Position [m] and covariance [m^2] after the last bearing, by estimator.
    """
    k = len(bearings.azimuth)
    spread = np.where(np.isfinite(bearings.sigma), bearings.sigma, sigma)
    # Several stations may take a bearing at the same time; of a fixed target only the order matters.
    stamps = bearings.time - bearings.time[0] if np.all(np.diff(bearings.time) > 0) else np.arange(float(k))
    platforms = np.zeros((k, 1, 6))
    platforms[:, 0, :2] = bearings.place
    recording = Recording(stamps, bearings.azimuth[:, None], platforms, np.square(spread)[:, None, None])
    model, motion = Bearing(float(np.median(spread))), Stationary(2)
    reach = float(np.linalg.norm(np.ptp(bearings.place, axis=0)))
    start = BearingStart(model, model.names, motion.size, reach, reach)
    wiring = Wiring(1, model.names, recording.clock, platforms=1, noise_port=True)

    builder = DiagramBuilder()
    source = builder.AddSystem(RecordedMeasurements([recording]))
    blocks: dict[str, Estimator] = {}
    for name, options in _BLOCKS.items():
        block = builder.AddSystem(options.make(name, model, motion, start, wiring))
        for port in ("measurement", "platforms", "noise_covariance"):
            builder.Connect(source.GetOutputPort(port), block.GetInputPort(port))
        blocks[name] = block
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(float(stamps[-1]))
    root = simulator.get_context()
    found = {}
    for name, block in blocks.items():
        context = block.GetMyContextFromRoot(root)
        position = block.GetOutputPort("estimate").Eval(context)
        found[name] = position, block.GetOutputPort("covariance").Eval(context).reshape(2, 2)
    return found


@dataclass
class BearingsReplay:
    """What came out of a replay of bearings.

    Attributes
    ----------
    bearings : Bearings
    likely, robust : DirectionFix
        Maximum likelihood with one unknown concentration, and the fix that wild bearings do not move.
    blocks : dict of str to (position, covariance)
        The estimator blocks.
    sigma : float
        What they believed where the file has no sigma [rad].
    """

    bearings: Bearings
    likely: DirectionFix
    robust: DirectionFix
    blocks: dict[str, tuple[Array, Array]]
    sigma: float

    def fixes(self) -> dict[str, tuple[Array, Array]]:
        """Return position [m] and covariance of every method."""
        return {
            "ml": (self.likely.position, self.likely.covariance),
            "robust": (self.robust.position, self.robust.covariance),
            **self.blocks,
        }

    def table(self) -> Table:
        """See `Replay.table`."""
        geodetic = self.bearings.origin is not None
        place = ("latitude, deg", "longitude, deg") if geodetic else ("x, m", "y, m")
        heads = (Column("fix"), *place, "sigma x, m", "sigma y, m", "correlation")
        table = Table(f"{len(self.bearings.azimuth)} bearings", heads)
        for name, (position, covariance) in self.fixes().items():
            sx, sy, correlation = _spread(covariance)
            coordinates = self.bearings.degrees(position) if geodetic else position
            shown = (f"{v:.6f}" if geodetic else f"{v:.1f}" for v in coordinates)
            table.add(name, *shown, f"{sx:.1f}", f"{sy:.1f}", f"{correlation:.2f}")
        return table

    def notes(self) -> list[str]:
        """See `Replay.notes`."""
        aside = np.flatnonzero(self.robust.weights < 0.5)
        lines = [
            f"sigma of a bearing: {_degrees(self.likely.concentration):.2f} deg from all, "
            f"{_degrees(self.robust.concentration):.2f} deg by the robust fix"
        ]
        for i in aside:
            lines.append(
                f"bearing {i + 1} ({to_compass(self.bearings.azimuth[i]):g} deg) is "
                f"{abs(math.degrees(self.robust.residuals[i])):.0f} deg off the robust fix, which gives it weight "
                f"{self.robust.weights[i]:.2f}"
            )
        if np.isnan(self.bearings.sigma).all():
            lines.append(f"the file has no sigma: lines, iv, ekf and mgekf took {math.degrees(self.sigma):.2f} deg")
        return lines

    def summary(self) -> Mapping[str, Any]:
        """See `Replay.summary`."""
        fixes = {}
        for name, (position, covariance) in self.fixes().items():
            sx, sy, correlation = _spread(covariance)
            numbers = {"x_m": position[0], "y_m": position[1], "sigma_x_m": sx, "sigma_y_m": sy}
            numbers["correlation"] = correlation
            if self.bearings.origin is not None:
                numbers["latitude_deg"], numbers["longitude_deg"] = self.bearings.degrees(position)
            fixes[name] = {key: float(v) if np.isfinite(v) else None for key, v in numbers.items()}
        return {
            "bearings": len(self.bearings.azimuth),
            "fixes": fixes,
            "robust_weights": [float(w) for w in self.robust.weights],
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Replay.draw`: the lines of bearing and the fixes."""
        figure, axes = new_figure()
        place, azimuth = self.bearings.place / 1e3, self.bearings.azimuth
        fixes = np.array([position for position, _ in self.fixes().values()]) / 1e3
        reach = 1.3 * np.linalg.norm(place - self.robust.position / 1e3, axis=-1).max()
        for (x, y), angle, weight in zip(place, azimuth, self.robust.weights, strict=True):
            axes.plot(
                [x, x + reach * np.cos(angle)],
                [y, y + reach * np.sin(angle)],
                color="0.6",
                linestyle="-" if weight > 0.5 else ":",
                linewidth=0.8,
            )
        axes.plot(*place.T, "k^", label="observers")
        for name, fix in zip(self.fixes(), fixes, strict=True):
            if np.isfinite(fix).all() and np.linalg.norm(fix - self.robust.position / 1e3) < 3 * reach:
                axes.plot(*fix, "o", fillstyle="none", label=name)
        axes.set(xlabel="east [km]", ylabel="north [km]", aspect="equal")
        grid(axes)
        axes.legend()
        return [save(figure, folder / "bearings.png")]


def _degrees(kappa: float) -> float:
    return math.degrees(1 / math.sqrt(kappa)) if kappa > 0 else math.inf


def _spread(covariance: Array) -> tuple[float, float, float]:
    with np.errstate(invalid="ignore"):
        sx, sy = np.sqrt(np.diag(covariance))
        return float(sx), float(sy), float(covariance[0, 1] / (sx * sy))


def _run(file: Path, progress: bool) -> BearingsReplay:
    bearings = read_bearings(file)
    likely = von_mises_fix(bearings.place, bearings.azimuth)
    robust = robust_fix(bearings.place, bearings.azimuth)
    sigma = math.radians(min(_degrees(robust.concentration), 60.0))
    return BearingsReplay(bearings, likely, robust, locate(bearings, sigma), sigma)


DATASET = Dataset(
    name="bearings",
    folder="",
    source="a CSV file of your own; columns time_s, x_m, y_m (or latitude_deg, longitude_deg), bearing_deg, sigma_deg",
    run=_run,
    takes_file=True,
)
