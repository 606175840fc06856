"""Crossing locators: first and current line, sliding pair, least squares of all lines, instrumental variable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.documented import choice, count, number, text
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.bearings.lines import BearingLocator, Lately, Sighting
from quietfix.systems.estimators.memory import Memory
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.fixes.crossing import Lines, crossing, crossing_covariance, instrumental_variable
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Crossing", "CrossingLocator", "Method"]

Array = NDArray[np.float64]
Method = Literal["first", "pair", "lines", "iv"]

_GOOD_INSTRUMENT = 0.1  # standard deviation over range, below which the last estimate serves as the instrument


class CrossingLocator(BearingLocator):
    r"""Locate a target at rest in the plane where lines of bearing cross.

    A line of bearing from :math:`p_i` is :math:`n_i^T (x - p_i) = 0` with
    :math:`n_i = (-\sin\theta_i, \cos\theta_i)`; `quietfix.systems.fixes.crossing` solves that of two lines, or of all
    in the least-squares sense.

    Parameters
    ----------
    name, model, motion, start, wiring
        See `BearingLocator`.
    method : {'first', 'pair', 'lines', 'iv'}
        ``first``: the first line and the current one, which reproduces the paper's figures best. ``pair``: the current
        line and the one `baseline` ago. ``lines``: unweighted least squares of all. ``iv``: weighted instrumental
        variable of all.
    baseline : float
        For ``pair``: at least so long between the two lines [s].
    window : int
        For ``pair`` and ``iv``: lines that are kept; older ones are forgotten.
    sigma_position : float
        Error of the platform's position per axis that is believed in [m].
    """

    note = (
        "Where lines of bearing cross at a small angle the error of their crossing has no variance: read the medians, "
        "here and in summary.json, not the RMSE."
    )

    def __init__(
        self,
        name: str,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        method: Method = "first",
        baseline: float = 200.0,
        window: int = 1024,
        sigma_position: float = 0.0,
    ) -> None:
        if method not in get_args(Method):
            raise ValueError(f"{name}: method {method} is not allowed; one of {', '.join(get_args(Method))}")
        self.method = method
        self.baseline = baseline
        self.sigma_position = sigma_position
        self._lately = Lately(window, 1, 2, timed=method == "pair", weighed=method == "pair" or wiring.noise_port)
        super().__init__(name, model, motion, start, wiring)

    def kept_sizes(self) -> Mapping[str, int]:
        """See `BearingLocator.kept_sizes`."""
        if self.method == "first":
            return {"line": 4}  # x, y, azimuth, variance
        sums = {"origin": 2, "sums": 22}
        return sums if self.method == "lines" else {**self._lately.sizes(), **(sums if self.method == "iv" else {})}

    def locate(self, kept: Memory, sighting: Sighting, mean: Array, covariance: Array) -> tuple[Memory, Array, Array]:
        """See `BearingLocator.locate`."""
        # in the plane: an elevation, and the platform's height, say nothing here
        sighting = replace(
            sighting, angles=sighting.angles[:, :1], variance=sighting.variance[:, :1], place=sighting.place[:, :2]
        )
        azimuth, variance = sighting.angles[:, 0], sighting.variance[:, 0]
        there = sighting.there
        place = sighting.place
        if self.method == "first":
            line = kept["line"]
            before = np.all(np.isfinite(line), axis=-1)
            position, spread = self._cross(line, place, azimuth, variance)
            new = np.column_stack([place, azimuth, variance])
            kept = {"line": np.where((~before & there)[:, None], new, line)}
        elif self.method == "pair":
            position, spread = self._cross(self._earlier(kept, sighting.time), place, azimuth, variance)
            kept, _ = self._lately.push(kept, sighting)
        else:
            sums, origin = self._sums(kept, sighting)
            position, spread = sums.fix(self.sigma_position)
            position = position + origin
            kept = {**kept, "origin": origin, "sums": sums.flatten()}
            if self.method == "iv":
                pushed, _ = self._lately.push(kept, sighting)
                kept = {**kept, **pushed}
                position, spread = self._instrumental(kept, position, sighting, mean, covariance)
        return kept, *self.whole(position, spread, mean, covariance)

    def _cross(self, line: Array, place: Array, azimuth: Array, variance: Array) -> tuple[Array, Array]:
        position = crossing(line[:, :2], line[:, 2], place, azimuth)
        return position, crossing_covariance(position, line[:, :2], place, line[:, 3], variance, self.sigma_position)

    def _instrumental(
        self, kept: Memory, lines: Array, sighting: Sighting, mean: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """Return the instrumental-variable fix; good instruments of the last epoch need to be renewed only once."""
        rings = self._lately.unpack(kept)
        azimuth, place = rings["angles"][..., 0], rings["places"]
        variance = rings["variances"][..., 0] if "variances" in rings else np.array(self.sensor.sigma**2)
        distance = np.linalg.norm(mean[:, :2] - sighting.place[:, :2], axis=-1)
        vague = ~(np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1]) < _GOOD_INSTRUMENT * distance)
        start = np.where(vague[:, None], lines, mean[:, :2])
        position, spread = np.full_like(lines, np.nan), np.full((*lines.shape, 2), np.nan)
        for rows, iterations in ((vague, 3), (~vague, 1)):
            if rows.any():
                some = slice(None) if rows.all() else rows
                weight = variance if variance.ndim == 0 else variance[some]
                position[some], spread[some] = instrumental_variable(
                    azimuth[some], weight, place[some], start[some], iterations, self.sigma_position
                )
        return position, spread

    def _earlier(self, kept: Memory, now: float) -> Array:
        """Return the latest line that is at least a baseline old, shape (trials, 4); NaN where there is none."""
        rings = self._lately.unpack(kept)
        times = rings["times"]
        trials, filled = times.shape
        if filled == 0:
            return np.full((trials, 4), np.nan)
        old = np.where(times <= now - self.baseline + 1e-9 * self.baseline, times, -np.inf)
        pick = old.argmax(axis=-1)
        rows = np.arange(trials)
        line = np.concatenate(
            [rings["places"][rows, pick], rings["angles"][rows, pick], rings["variances"][rows, pick]], axis=-1
        )
        return np.where(np.isfinite(old[rows, pick])[:, None], line, np.nan)

    def _sums(self, kept: Memory, sighting: Sighting) -> tuple[Lines, Array]:
        """Return the sums with the line of now, counted from each trial's first place."""
        origin = np.where(
            (np.any(np.isnan(kept["origin"]), axis=-1) & sighting.there)[:, None], sighting.place[:, :2], kept["origin"]
        )
        sums = Lines.unflatten(np.nan_to_num(kept["sums"]))
        offset = sighting.place[:, :2] - origin
        return sums.add(offset, sighting.angles[:, 0], sighting.variance[:, 0]), origin


@dataclass(frozen=True)
class Crossing(EstimatorOptions):
    """Crossing of lines of bearing, raw or filtered."""

    bearings: str = text("raw, or the name of one of the scenario's azimuth filters", "raw")
    method: str = choice(
        "first: first and current line; pair: current line and the one baseline_s ago; lines: least squares of all; "
        "iv: weighted instrumental variable of all",
        "first",
        get_args(Method),
    )
    baseline_s: float = number("for pair: time between the two lines [s]", 200.0, above=0)
    window: int = count("for pair and iv: so many lines are kept", 1024, at_least=2)
    sigma_position_m: float = number("believed error of the observer's position per axis [m]", 0.0, at_least=0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return CrossingLocator(
            name,
            model,
            motion,
            start,
            wiring,
            self.method,  # type: ignore[arg-type]
            self.baseline_s,
            self.window,
            self.sigma_position_m,
        )
