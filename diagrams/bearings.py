"""Replay of bearings from a CSV file: ``quietfix replay bearings FILE``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from diagrams.bearings_file import Bearings, read_bearings
from diagrams.replay import Dataset
from diagrams.tables import Column, Table
from systems.estimators.base import Estimator
from systems.estimators.bearing_start import BearingStart
from systems.estimators.crossing import Crossing
from systems.estimators.ekf import Ekf
from systems.estimators.mgekf import Mgekf
from systems.estimators.options import EstimatorOptions
from systems.estimators.wiring import Wiring
from systems.fixes.bearing_belief import BearingCost, believable, small_sample_coverage
from systems.fixes.von_mises import DirectionFix, robust_fix, sample, von_mises_fix, weighted_fix
from systems.measurement.bearing import Bearing, to_compass
from systems.motion.stationary import Stationary
from systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = ["DATASET", "BearingsReplay", "Fix", "locate"]

Array = NDArray[np.float64]

_MOST = 1024  # bearings that the blocks take: so many iv remembers, and each is a step of a simulation
_TOLD = 5  # bearings that are set aside and named
_HELD = 0.95  # of 99.9 %; below, small numbers are told

_BLOCKS: dict[str, EstimatorOptions] = {
    "lines": Crossing(method="lines"),
    "iv": Crossing(method="iv"),
    "ekf": Ekf(),
    "mgekf": Mgekf(),
}


def locate(bearings: Bearings, sigma: float) -> dict[str, tuple[Array, Array]]:
    """Run the estimator blocks over recorded bearings of a fixed target; over a sample of 1024 where there are more.

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
    bearings = bearings.take(sample(len(bearings.azimuth), _MOST))
    k = len(bearings.azimuth)
    spread = bearings.spread(sigma)
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


@dataclass(frozen=True)
class Fix:
    """What a method found, and what the bearings say of it.

    Attributes
    ----------
    position : ndarray, shape (2,)
        [m]; NaN where the geometry has no solution: `there` is False.
    covariance : ndarray, shape (2, 2)
        [m^2]
    believable : bool
        Whether its own ellipse can be believed, see `systems.fixes.bearing_belief`.
    """

    position: Array
    covariance: Array
    believable: bool

    @property
    def there(self) -> bool:
        """Whether there is a fix."""
        return bool(np.isfinite(self.position).all())


_NOWHERE = Fix(np.full(2, np.nan), np.full((2, 2), np.nan), False)


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

    @cached_property
    def fixes(self) -> dict[str, Fix]:
        """What every method found."""
        place, azimuth, one = self.bearings.place, self.bearings.azimuth, self.robust.concentration
        cost = BearingCost(place, azimuth, 1 / np.square(self.bearings.spread(self.sigma)))
        near = [self.likely.position, self.robust.position, *(position for position, _ in self.blocks.values())]
        best = weighted_fix(place, azimuth, cost.kappa, near)
        alike = BearingCost(place, azimuth, np.full(len(azimuth), self.likely.concentration))
        some = BearingCost(place, azimuth, one * self.robust.weights)
        judged = {
            "ml": (self.likely.position, self.likely.covariance, alike, self.likely.position),
            "robust": (self.robust.position, self.robust.covariance, some, self.robust.position),
        }
        judged |= {name: (*block, cost, best) for name, block in self.blocks.items()}
        if not cost.tells_range(best):
            return dict.fromkeys(judged, _NOWHERE)
        return {
            name: Fix(x, p, believable(x, p, belief, middle)) if belief.is_fix(x) else _NOWHERE
            for name, (x, p, belief, middle) in judged.items()
        }

    def table(self) -> Table:
        """See `Replay.table`."""
        geodetic = self.bearings.origin is not None
        place = ("latitude, deg", "longitude, deg") if geodetic else ("x, m", "y, m")
        heads = (Column("fix"), *place, "sigma x, m", "sigma y, m", "correlation")
        table = Table(f"{len(self.bearings.azimuth)} bearings", heads)
        for name, fix in self.fixes.items():
            if not fix.there:
                table.add(name, "no fix", *["-"] * 4)
                continue
            sx, sy, correlation = _spread(fix.covariance)
            coordinates = self.bearings.degrees(fix.position) if geodetic else fix.position
            shown = (f"{v:.6f}" if geodetic else f"{v:.1f}" for v in coordinates)
            mark = "" if fix.believable else " *"
            table.add(name + mark, *shown, f"{sx:.1f}", f"{sy:.1f}", f"{correlation:.2f}")
        return table

    def notes(self) -> list[str]:
        """See `Replay.notes`."""
        fixes, count = self.fixes.values(), len(self.bearings.azimuth)
        lines = []
        if any(fix.there and not fix.believable for fix in fixes):
            lines.append(
                "* do not believe its sigmas: its 99.9 % ellipse leaves out places where the bearings put the target "
                "(at 68 %), or they scatter far more than the sigma it took"
            )
        if not all(fix.there for fix in fixes):
            lines.append(
                "no fix: the lines diverge, are parallel as far as their sigma tells, or cross behind the observers or "
                "beyond the horizon; no place explains them better than one infinitely far away"
            )
        lines.append(
            f"sigma of a bearing: {_degrees(self.likely.concentration):.2f} deg from all, "
            f"{_degrees(self.robust.concentration):.2f} deg by the robust fix"
        )
        if np.isnan(self.bearings.sigma).all():
            lines.append(f"the file has no sigma: lines, iv, ekf and mgekf took {math.degrees(self.sigma):.2f} deg")
        held = small_sample_coverage(count)
        if held < _HELD and any(fix.there for fix in fixes):
            who = "all methods" if np.isnan(self.bearings.sigma).all() else "ml and robust"
            told = "nothing of their sigma" if count <= 2 else "little of their sigma"
            lines.append(
                f"{count} bearings tell {told}, which {who} take from the residuals: a 99.9 % ellipse then holds the "
                f"target in {100 * held:.0f} % of the cases"
            )
        if count > _MOST:
            lines.append(
                f"lines, iv, ekf and mgekf took {_MOST} of the {count} bearings, drawn at random from equal stretches "
                "of the file; ml and robust took all"
            )
        return lines + self._aside()

    def _aside(self) -> list[str]:
        """Return lines on the bearings that the robust fix sets aside, the worst ones first."""
        weights = self.robust.weights
        aside = np.flatnonzero(weights < 0.5)
        if aside.size == 0 or not self.fixes["robust"].there:
            return []
        worst = aside[np.argsort(-np.abs(self.robust.residuals[aside]), kind="stable")][:_TOLD]
        lines = [
            f"bearing {i + 1} ({to_compass(self.bearings.azimuth[i]):g} deg) is "
            f"{abs(math.degrees(self.robust.residuals[i])):.0f} deg off the robust fix, which gives it weight "
            f"{weights[i]:.2f}"
            for i in np.sort(worst)
        ]
        if aside.size > _TOLD:
            lines.append(f"these are the {_TOLD} worst of {aside.size} bearings of weight < 0.5")
        return lines

    def summary(self) -> Mapping[str, Any]:
        """See `Replay.summary`."""
        fixes: dict[str, dict[str, Any]] = {}
        for name, fix in self.fixes.items():
            sx, sy, correlation = _spread(fix.covariance)
            numbers = {"x_m": fix.position[0], "y_m": fix.position[1], "sigma_x_m": sx, "sigma_y_m": sy}
            numbers["correlation"] = correlation
            if self.bearings.origin is not None:
                numbers["latitude_deg"], numbers["longitude_deg"] = self.bearings.degrees(fix.position)
            fixes[name] = {key: float(v) if np.isfinite(v) else None for key, v in numbers.items()}
            fixes[name] |= {"fix": fix.there, "believable": fix.there and fix.believable}
        count = len(self.bearings.azimuth)
        return {
            "bearings": count,
            "bearings_in_blocks": min(count, _MOST),
            "fixes": fixes,
            "robust_weights": [float(w) for w in self.robust.weights],
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Replay.draw`: the lines of bearing and the fixes."""
        from diagrams.figures.bearings import draw_lines
        from diagrams.figures.style import save

        return [save(draw_lines(self), folder / "bearings.png")]


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
