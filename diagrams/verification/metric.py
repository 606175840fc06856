"""What a metric is: what it takes from each trial, and how that is estimated.

A metric over an interval of time makes one number of each trial first (its mean square, say): trials are independent,
epochs are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.statistics.intervals import Statistic
from quietfix.diagrams.verification.study_view import StudyFacts, StudyView
from quietfix.systems.documented import documented, number, text

__all__ = ["ErrorMetric", "Metric", "TimedMetric", "mean_over_epochs", "mean_squares"]

Array = NDArray[np.float64]


def mean_over_epochs(values: Array) -> Array:
    """Return the mean over the epochs, of those that have a number; NaN where none has."""
    known = ~np.isnan(values)
    count = known.sum(axis=-1)
    total = np.where(known, values, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@dataclass
class Metric:
    """What all metrics have."""

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Raise a `UserError` that begins with `where` if the system or the run lacks what is asked for."""

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return samples (trials, columns); NaN in a trial that has none."""
        raise NotImplementedError

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return what is estimated from the samples."""
        raise NotImplementedError

    def bound_square(self, dataset: xr.Dataset, estimator: str, run: StudyFacts) -> float | None:
        """Return the squared bound that the samples are divided by, if there is one."""
        return None

    def unit(self, run: StudyFacts) -> str:
        """Return the unit, empty for a number."""
        return ""

    def title(self) -> str:
        """Return what it is, for tables."""
        raise NotImplementedError


@dataclass
class TimedMetric(Metric):
    """A metric at a time, or over intervals of time."""

    time_s: float | None = number("at this time [s]; the nearest epoch", None, at_least=0)
    interval_s: list[float] = documented("or over this time: begin, end, and more such pairs [s]", factory=list)

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Check the times."""
        first, last = float(run.epochs[0]), float(run.epochs[-1])
        span = f"the run has epochs from {first:g} to {last:g} s"
        if (self.time_s is None) == (not self.interval_s):
            raise UserError(f"{where}: time_s or interval_s is needed, and not both; {span}")
        if self.time_s is not None and not first <= self.time_s <= last:
            raise UserError(f"{where}.time_s: {self.time_s:g} is not allowed; {span}")
        pairs = self.interval_s
        if pairs and (len(pairs) % 2 or not np.all(np.diff(pairs) > 0)):
            raise UserError(f"{where}.interval_s: {pairs} is not allowed; pairs of begin and end, rising")
        if pairs and not (first <= pairs[0] and pairs[-1] <= last):
            raise UserError(f"{where}.interval_s: {pairs} is not allowed; {span}")
        if not self.epochs(run).size:
            raise UserError(f"{where}.interval_s: {pairs} is not allowed; there is no epoch in it, and {span}")

    def epochs(self, run: StudyFacts) -> NDArray[np.int_]:
        """Return the indices of the epochs meant."""
        if self.time_s is not None:
            return np.array([int(np.argmin(np.abs(run.epochs - self.time_s)))])
        inside = np.zeros(run.epochs.size, dtype=bool)
        for begin, end in zip(self.interval_s[::2], self.interval_s[1::2], strict=True):
            inside |= (run.epochs >= begin - 1e-9) & (run.epochs <= end + 1e-9)
        return np.flatnonzero(inside)

    def when(self) -> str:
        """Return the time, in words."""
        if self.time_s is not None:
            return f"at {self.time_s:g} s"
        pairs = zip(self.interval_s[::2], self.interval_s[1::2], strict=True)
        return "over " + ", ".join(f"{begin:g}-{end:g}" for begin, end in pairs) + " s"


@dataclass
class ErrorMetric(TimedMetric):
    """A metric of an error: of a quantity, or of a component of the state."""

    of: str = text(
        "position, height, velocity, speed, course, bias, or a component of the state such as vx", "position"
    )

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Check quantity and times."""
        choose(f"{where}.of", self.of, run.quantities[estimator])
        super().check(run, estimator, where)

    def unit(self, run: StudyFacts) -> str:
        """Return the unit of the quantity."""
        return run.unit(self.of)


def mean_squares(
    view: StudyView, metric: ErrorMetric, estimator: str, run: StudyFacts, clip: float | None = None
) -> Array:
    """Return the mean square over the epochs of each trial, shape (trials, 1); errors beyond `clip` count as that."""
    error = np.abs(view.error(estimator, metric.of, metric.epochs(run)))
    return mean_over_epochs((error if clip is None else np.minimum(error, clip)) ** 2)[:, None]
