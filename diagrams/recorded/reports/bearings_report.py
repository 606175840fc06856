"""What a run of bearings tells: the fixes, and which of their ellipses can be believed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.readers.bearings_file import Bearings
from quietfix.diagrams.writers.fixes import PlaneTrack, write_plane
from quietfix.systems.angles.bearing import to_compass
from quietfix.systems.fixes.bearing_belief import BearingCost, believable, small_sample_coverage
from quietfix.systems.fixes.von_mises import DirectionFix, weighted_fix

__all__ = ["MOST", "BearingsReport", "Fix", "blocks_of", "shown_as", "sigma_of"]

Array = NDArray[np.float64]

MOST = 1024
"""Bearings that the blocks take: so many iv remembers, and each is a step of a simulation."""

_TOLD = 5  # bearings that are set aside and named
_HELD = 0.95  # of 99.9 %; below, small numbers are told


def sigma_of(robust: DirectionFix) -> float:
    """Return the sigma of a bearing by the robust fix [rad], at most 60 degrees."""
    return math.radians(min(_degrees(robust.concentration), 60.0))


def shown_as(estimator: str) -> str:
    """Return what an estimator is called beside the fixes ``ml`` and ``robust``, whose names it may have."""
    return f"{estimator}_estimator" if estimator in ("ml", "robust") else estimator


def blocks_of(result: xr.Dataset) -> dict[str, tuple[Array, Array]]:
    """Return position (2,) [m] and covariance (2, 2) [m^2] after the last bearing, by estimator."""
    last = result.isel(trial=0, time=-1)
    return {
        shown_as(str(name)): (
            last["estimate"].sel(estimator=name, state=["x", "y"]).values,
            last["covariance"].sel(estimator=name, state=["x", "y"]).isel(state_=slice(2)).values,
        )
        for name in result["estimator"].values
    }


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
        Whether its own ellipse can be believed, see `quietfix.systems.fixes.bearing_belief`.
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
class BearingsReport:
    """What came out.

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
        """See `Report.table`."""
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
        """See `Report.notes`."""
        fixes, count = self.fixes.values(), len(self.bearings.azimuth)
        *most, last = self.blocks
        blocks = " and ".join(filter(None, [", ".join(most), last]))
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
            lines.append(f"the file has no sigma: {blocks} took {math.degrees(self.sigma):.2f} deg")
        held = small_sample_coverage(count)
        if held < _HELD and any(fix.there for fix in fixes):
            who = "all methods" if np.isnan(self.bearings.sigma).all() else "ml and robust"
            told = "nothing of their sigma" if count <= 2 else "little of their sigma"
            lines.append(
                f"{count} bearings tell {told}, which {who} take from the residuals: a 99.9 % ellipse then holds the "
                f"target in {100 * held:.0f} % of the cases"
            )
        if count > MOST:
            lines.append(
                f"{blocks} took {MOST} of the {count} bearings, drawn at random from equal stretches of the file; "
                "ml and robust took all"
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
        """See `Report.summary`."""
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
            "bearings_in_blocks": min(count, MOST),
            "fixes": fixes,
            "robust_weights": [float(w) for w in self.robust.weights],
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`: the lines of bearing and the fixes; and the files of places."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.bearings_figures import draw_lines

        fixes = {name: (fix.position, fix.believable) for name, fix in self.fixes.items() if fix.there}
        figure = draw_lines(self.bearings.place, self.bearings.azimuth, self.robust.weights, fixes)
        return [save(figure, folder / "bearings.png"), *write_plane(self._tracks(), folder)]

    def _tracks(self) -> list[PlaneTrack]:
        """Return the fixes as they are written, at the time of the last bearing."""
        found, time = [], self.bearings.time[-1:]
        for name, fix in self.fixes.items():
            if fix.there:
                state = fix.position[None]
                degrees = None if self.bearings.origin is None else self.bearings.degrees(state)
                found.append(PlaneTrack(name, "target", time, state, fix.covariance[None], degrees))
        return found


def _degrees(kappa: float) -> float:
    return math.degrees(1 / math.sqrt(kappa)) if kappa > 0 else math.inf


def _spread(covariance: Array) -> tuple[float, float, float]:
    with np.errstate(invalid="ignore"):
        sx, sy = np.sqrt(np.diag(covariance))
        return float(sx), float(sy), float(covariance[0, 1] / (sx * sy))
