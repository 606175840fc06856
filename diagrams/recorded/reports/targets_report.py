"""What a run of bearings of several targets tells, or of targets that move: one table, and files of places."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.readers.bearings_file import Bearings, Target
from quietfix.diagrams.recorded.reports.bearings_report import BearingsReport, shown_as
from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.writers.fixes import PlaneTrack, write_plane
from quietfix.systems.fixes.moving_bearings import moving_fix, robust_moving_fix
from quietfix.systems.fixes.von_mises import DirectionFix, robust_fix, von_mises_fix, weighted_fix

__all__ = ["Located", "Sigma", "TargetsReport", "believed_sigma", "targets_report"]

Array = NDArray[np.float64]

_SHOWN = ("ml", "robust")  # fixes in the table
_PRINTED = 60  # targets in the table; all are in the files
_NAMED = 5
_ASSUMED = math.radians(3.0)  # of bearings of which nothing tells how good they are
_UNCOVERED = 1.5  # times as large as claimed
_SURE = 0.999
_TRACK = 2000  # places of a target that moves


class Sigma(NamedTuple):
    """How good bearings are.

    Attributes
    ----------
    value : float
        What is believed where the file does not say [rad].
    told : bool
        Whether residuals tell it; else it is assumed.
    claimed : bool
        Whether the file says it.
    larger : float or None
        How many times as large as the file's residuals are; None: they do not tell.
    """

    value: float
    told: bool
    claimed: bool
    larger: float | None


class Located(NamedTuple):
    """What a method found of a target: state (2 or 4,), its covariance, whether there is one and it can be believed."""

    state: Array
    covariance: Array
    there: bool
    believable: bool


def believed_sigma(bearings: Sequence[Bearings], moving: bool) -> Sigma:
    r"""Return how good bearings are, from the residuals of the fixes of all targets together.

    Of k bearings and n unknowns :math:`\sum r^2/\sigma^2` is chi-square with k - n degrees of freedom; half of the
    targets lie below its median whatever happened to the others (see `locards_sigma`, which does the same).
    """
    states = 4 if moving else 2
    claimed = bool(np.isfinite(bearings[0].sigma).all())
    ratios, total, freedom = [], 0.0, 0
    for one in bearings:
        dof = one.azimuth.size - states
        if dof <= 0:
            continue
        sigma = one.sigma if claimed else np.ones(one.azimuth.size)
        cost = float(np.sum(np.square(_likely(one, sigma, moving).residuals / sigma)))
        ratios.append(cost / float(chi2.median(dof)))
        total, freedom = total + cost, freedom + dof
    usual = float(np.median(np.concatenate([one.sigma for one in bearings]))) if claimed else _ASSUMED
    if not ratios:
        return Sigma(usual, False, claimed, None)
    larger = math.sqrt(float(np.median(ratios)))
    if claimed:
        uncovered = larger > _UNCOVERED and total > chi2.ppf(_SURE, freedom)
        return Sigma(usual, True, True, larger if uncovered else None)
    return Sigma(min(max(larger, 1e-9), math.radians(60.0)), True, False, None)


def _likely(one: Bearings, sigma: Array, moving: bool) -> DirectionFix:
    """Return the most likely fix for known standard deviations (k,)."""
    if moving:
        return moving_fix(one.time, one.place, one.azimuth, sigma)
    found = von_mises_fix(one.place, one.azimuth)
    if np.ptp(sigma) > 0:
        found = found._replace(position=weighted_fix(one.place, one.azimuth, sigma**-2.0, [found.position]))
    return _spread(one, found, sigma**-2.0)


def _spread(one: Bearings, found: DirectionFix, kappa: Array) -> DirectionFix:
    """Return a fix of a target at rest with the covariance of bearings of known concentrations."""
    offset = found.position - one.place
    square = np.maximum(np.einsum("ki,ki->k", offset, offset), 1e-12)
    g = np.stack([-offset[:, 1], offset[:, 0]], axis=-1) / square[:, None]
    information = np.einsum("k,ki,kj->ij", found.weights * kappa, g, g)
    try:
        covariance = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        covariance = np.full((2, 2), np.nan)
    off = np.arctan2(
        np.sin(one.azimuth - np.arctan2(offset[:, 1], offset[:, 0])),
        np.cos(one.azimuth - np.arctan2(offset[:, 1], offset[:, 0])),
    )
    return found._replace(covariance=covariance, concentration=float(np.median(kappa)), residuals=off)


def targets_report(result: xr.Dataset, targets: Sequence[Target], sigma: Sigma, moving: bool) -> TargetsReport:
    """Return what is told of a study's result, which has the targets that may be located in their order."""
    usable = [one for one in targets if not one.wrong]
    chosen = [usable[int(number)] for number in result["trial"].values]
    located = {
        one.name: _located(one.bearings, _blocks(result, k, moving), sigma, moving) for k, one in enumerate(chosen)
    }
    return TargetsReport(list(targets), located, sigma, moving)


def _blocks(result: xr.Dataset, k: int, moving: bool) -> dict[str, tuple[Array, Array]]:
    """Return state and covariance of a target after its last bearing, by estimator."""
    states = ["x", "y", "vx", "vy"] if moving else ["x", "y"]
    axis, one = along(result), result.isel(trial=k)
    last = {axis: int(np.flatnonzero(np.isfinite(one["time"].values))[-1])}
    at = one.isel(last)
    return {
        shown_as(str(name)): (
            at["estimate"].sel(estimator=name, state=states).values,
            at["covariance"].sel(estimator=name, state=states).isel(state_=slice(len(states))).values,
        )
        for name in result["estimator"].values
    }


def _located(
    one: Bearings, blocks: Mapping[str, tuple[Array, Array]], sigma: Sigma, moving: bool
) -> tuple[dict[str, Located], Array]:
    """Return what each method found, and the weights that the robust one gives to the bearings."""
    spread = one.spread(sigma.value)
    likely = _likely(one, spread, moving)
    if not moving:
        robust = _spread(one, robust_fix(one.place, one.azimuth), spread**-2.0)
        fixes = BearingsReport(replace(one, sigma=spread), likely, robust, dict(blocks), sigma.value).fixes
        return {n: Located(f.position, f.covariance, f.there, f.believable) for n, f in fixes.items()}, robust.weights
    robust = robust_moving_fix(one.time, one.place, one.azimuth, spread)
    found = {"ml": _moving(one, likely, spread), "robust": _moving(one, robust, spread)}
    for name, (state, covariance) in blocks.items():
        there = found["ml"].there and bool(np.isfinite(state).all())
        found[name] = Located(state, covariance, there, there and _agrees(found["ml"].state, state, covariance))
    return found, robust.weights


def _moving(one: Bearings, fix: DirectionFix, sigma: Array) -> Located:
    """Return a track; it is none if its range is less certain than it is long, or it is behind the observers."""
    offset = fix.position[:2] + (one.time - one.time[-1])[:, None] * fix.position[2:] - one.place
    nearest = float(np.linalg.norm(offset, axis=-1).min())
    ahead = float(np.sum(np.cos(fix.residuals) / sigma**2)) > 0
    certain = np.isfinite(fix.covariance).all() and np.linalg.eigvalsh(fix.covariance[:2, :2])[-1] < nearest**2
    there = bool(np.isfinite(fix.position).all() and ahead and certain)
    freedom = max(int(np.count_nonzero(fix.weights > 0)) - 4, 1)
    cost = float(np.sum(fix.weights * np.square(fix.residuals / sigma)))
    return Located(
        fix.position, fix.covariance, there, there and cost <= _UNCOVERED**2 * float(chi2.ppf(_SURE, freedom))
    )


def _agrees(likely: Array, state: Array, covariance: Array) -> bool:
    """Return whether the 99.9 % ellipse of a place holds the most likely one."""
    off = likely[:2] - state[:2]
    try:
        return bool(off @ np.linalg.solve(covariance[:2, :2], off) < chi2.ppf(_SURE, 2))
    except np.linalg.LinAlgError:
        return False


@dataclass
class TargetsReport:
    """What came out.

    Attributes
    ----------
    targets : list of Target
        All of the file.
    located : dict of str to (dict, ndarray)
        Of those that may be located, what each method found, and the weights of the bearings.
    sigma : Sigma
    moving : bool
    """

    targets: list[Target]
    located: dict[str, tuple[dict[str, Located], Array]]
    sigma: Sigma
    moving: bool

    @property
    def _geodetic(self) -> bool:
        return self.targets[0].bearings.origin is not None

    def table(self) -> Table:
        """See `Report.table`."""
        place = ("latitude, deg", "longitude, deg") if self._geodetic else ("x, m", "y, m")
        rates = ("vx, m/s", "vy, m/s") if self.moving else ()
        heads = (Column("target"), Column("fix"), "bearings", *place, *rates, "sigma x, m", "sigma y, m", "correlation")
        count = len(self.targets)
        table = Table(
            f"{count} target{'s' * (count != 1)}{' that move straight on, at the last bearing' * self.moving}",
            heads,
            keys=2,
        )
        for one in self.targets[:_PRINTED]:
            name, bearings = one.name or "target", str(one.bearings.azimuth.size)
            fixes = self.located.get(one.name, ({}, None))[0]
            for method in _SHOWN:
                fix = fixes.get(method)
                if fix is None or not fix.there:
                    table.add(name, method, bearings, "no fix", *["-"] * (4 + 2 * self.moving))
                    continue
                shown = self._place(one.bearings, fix.state)
                sx, sy = np.sqrt(np.diag(fix.covariance)[:2])
                table.add(
                    name,
                    method + " *" * (not fix.believable),
                    bearings,
                    *(f"{v:.6f}" if self._geodetic else f"{v:.1f}" for v in shown),
                    *(f"{v:.2f}" for v in fix.state[2:]),
                    f"{sx:.1f}",
                    f"{sy:.1f}",
                    f"{fix.covariance[0, 1] / (sx * sy):.2f}",
                )
        return table

    def _place(self, bearings: Bearings, state: Array) -> tuple[float, float]:
        if not self._geodetic:
            return float(state[0]), float(state[1])
        latitude, longitude = bearings.degrees(state[:2])
        return float(latitude), float(longitude)

    @cached_property
    def _without(self) -> dict[str, str]:
        """Why targets have no fix."""
        found = {one.name: one.wrong for one in self.targets if one.wrong}
        vague = (
            "their bearings leave the range open: it is less certain than it is long; a single observer has to "
            "manoeuvre, or several have to take bearings"
            if self.moving
            else "the lines diverge, are parallel as far as their sigma tells, or cross behind the observers or beyond "
            "the horizon"
        )
        return found | {name: vague for name, (fixes, _) in self.located.items() if not fixes["ml"].there}

    def notes(self) -> list[str]:
        """See `Report.notes`."""
        lines = []
        if len(self.targets) > _PRINTED:
            lines.append(f"{len(self.targets) - _PRINTED} more targets are in summary.json and estimates.csv")
        for reason in dict.fromkeys(self._without.values()):
            who = [name or "the target" for name, why in self._without.items() if why == reason]
            lines.append(f"no fix of {_listed(who)}: {reason}")
        shown = [fixes[method] for fixes, _ in self.located.values() for method in _SHOWN if method in fixes]
        if any(fix.there and not fix.believable for fix in shown):
            lines.append("* do not believe its sigmas: the bearings do not bear them out")
        others = dict.fromkeys(name for fixes, _ in self.located.values() for name in fixes if name not in _SHOWN)
        lines.append(f"with --out, summary.json and estimates.csv also have the fixes of {', '.join(others)}")
        lines += self._unprinted()
        north = "true north" if self._geodetic else "the y axis (grid north)"
        lines += [f"bearings are taken as clockwise from {north}; --set correction_deg=... turns them", self._sigma()]
        return [line for line in lines if line] + self._aside()

    def _sigma(self) -> str:
        degrees = math.degrees(self.sigma.value)
        if self.sigma.larger is not None:
            return (
                f"the claimed sigmas cannot cover the residuals, which are {self.sigma.larger:.2g} times as large: all "
                "sigmas above are too small"
            )
        if self.sigma.claimed:
            return "" if self.sigma.told else "the sigmas are the file's; too few bearings to tell whether they hold"
        if self.sigma.told:
            return f"the file has no sigma: {degrees:.2f} deg, from the residuals of all targets together"
        return f"the file has no sigma, and too few bearings tell one: {degrees:g} deg is assumed"

    def _unprinted(self) -> list[str]:
        """Return a line on fixes that are in the files alone and that the bearings do not bear out."""
        count = Counter(
            method
            for fixes, _ in self.located.values()
            for method, fix in fixes.items()
            if method not in _SHOWN and fix.there and not fix.believable
        )
        told = ", ".join(f"{method} of {number} targets" for method, number in count.items())
        return (
            [f"the files have also {told}, whose sigmas the bearings do not bear out: leave them out"] if told else []
        )

    def _aside(self) -> list[str]:
        """Return a line on bearings that the robust fixes set aside."""
        found = []
        for one in self.targets:
            fixes, weights = self.located.get(one.name, ({}, np.ones(0)))
            if fixes and fixes["robust"].there:
                found += [f"{one.name or 'bearing'}/{i + 1}" for i in np.flatnonzero(weights < 0.5)]
        if not found:
            return []
        return [f"the robust fixes give little weight to bearing {_listed(found)} (target/number in order of time)"]

    def summary(self) -> Mapping[str, Any]:
        """See `Report.summary`."""
        found: dict[str, Any] = {}
        for one in self.targets:
            entry: dict[str, Any] = {"bearings": int(one.bearings.azimuth.size), "fixes": {}}
            if one.name in self._without:
                entry["no_fix"] = self._without[one.name]
            for method, fix in self.located.get(one.name, ({}, None))[0].items():
                numbers = dict(zip(("x_m", "y_m", "vx_mps", "vy_mps"), fix.state.tolist(), strict=False))
                with np.errstate(invalid="ignore"):
                    sigmas = np.sqrt(np.diag(fix.covariance)).tolist()
                numbers |= dict(zip(("sigma_x_m", "sigma_y_m", "sigma_vx_mps", "sigma_vy_mps"), sigmas, strict=False))
                numbers["correlation"] = (
                    float(fix.covariance[0, 1]) / (sigmas[0] * sigmas[1]) if fix.there else math.nan
                )
                if self._geodetic:
                    numbers["latitude_deg"], numbers["longitude_deg"] = self._place(one.bearings, fix.state)
                clean = {key: value if fix.there and math.isfinite(value) else None for key, value in numbers.items()}
                entry["fixes"][method] = clean | {"fix": fix.there, "believable": fix.believable}
            found[one.name or "target"] = entry
        return {
            "motion": "constant_velocity" if self.moving else "fixed",
            "sigma_deg": math.degrees(self.sigma.value),
            "residuals_over_believed": self.sigma.larger,
            "targets": found,
        }

    def tracks(self) -> list[PlaneTrack]:
        """Return what is written: the fix of a target at rest, and where one that moves was at each bearing."""
        found = []
        for one in self.targets:
            bearings = one.bearings
            for method, fix in self.located.get(one.name, ({}, None))[0].items():
                if not fix.there:
                    continue
                time = np.unique(bearings.time)[-_TRACK:] if self.moving and method in _SHOWN else bearings.time[-1:]
                state, covariance = _carried(fix, time - bearings.time[-1])
                degrees = bearings.degrees(state[:, :2]) if self._geodetic else None
                found.append(PlaneTrack(method, one.name or "target", time, state, covariance, degrees))
        return found

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`: observers and fixes; and the files of places."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.bearings_figures import draw_fixes

        tracks = self.tracks()
        origin = self.targets[0].bearings.origin
        alike = [one.bearings for one in self.targets if one.bearings.origin == origin]
        shown = {one.name or "target" for one in self.targets if one.bearings.origin == origin}
        likely = {
            track.target: (track.state[:, :2], track.covariance[-1, :2, :2])
            for track in tracks
            if track.estimator == "ml" and track.target in shown
        }
        place = np.unique(np.concatenate([one.place for one in alike]), axis=0)
        figure = draw_fixes(place, likely, "maximum likelihood")
        return [save(figure, folder / "targets.png"), *write_plane(tracks, folder)]


def _carried(fix: Located, elapsed: Array) -> tuple[Array, Array]:
    """Return states (k, n) and covariances at other times."""
    n = fix.state.size
    phi = np.broadcast_to(np.eye(n), (elapsed.size, n, n)).copy()
    if n == 4:
        phi[:, 0, 2] = phi[:, 1, 3] = elapsed
    return phi @ fix.state, phi @ fix.covariance @ np.swapaxes(phi, -1, -2)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" * (len(names) > _NAMED)
    return ", ".join(name[:60] for name in names[:_NAMED]) + more
