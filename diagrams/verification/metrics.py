"""The metrics that a requirement may be about, one class and YAML tag each.

Everything is SI, courses in degrees, as in `quietfix.diagrams.statistics.state_errors`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Union

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.statistics.intervals import MeanRatio, Proportion, Quantile, SettlingTime, SignedMean, Statistic
from quietfix.diagrams.statistics.state_errors import QUANTITIES
from quietfix.diagrams.verification.metric import ErrorMetric, Metric, TimedMetric, mean_over_epochs, mean_squares
from quietfix.diagrams.verification.study_view import StudyFacts, StudyView
from quietfix.systems.documented import choice, documented, number, text

__all__ = ["METRICS", "MetricChoice", "RmseRatio"]

Array = NDArray[np.float64]
_MOMENTS = ("rms", "mean", "std", "max")


@dataclass
class Rmse(ErrorMetric):
    """Root mean square error over the trials (and epochs)."""

    clip: float | None = number("larger errors count as this, in the unit of the error", None, above=0)

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the mean square of each trial."""
        return mean_squares(view, self, estimator, run, self.clip)

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return the root of a mean."""
        return MeanRatio(root=True)

    def title(self) -> str:
        """Return what it is."""
        clipped = "" if self.clip is None else f", clipped at {self.clip:g}"
        return f"RMSE of {self.of} {self.when()}{clipped}"


@dataclass
class Percentile(ErrorMetric):
    """A percentile over the trials of the size of the error, or of its moment in time."""

    percent: float = number("which percentile", 90.0, above=0, at_most=99.99)
    over_time: str = choice("what an interval makes of a trial: rms, |mean|, std or max", "rms", _MOMENTS)

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the size of each trial's error."""
        error = view.error(estimator, self.of, self.epochs(run))
        with np.errstate(invalid="ignore"):
            lost = np.isinf(error).any(axis=-1)
            error = np.where(np.isinf(error), np.nan, error)
            if self.over_time == "max":
                size = np.where(np.isnan(error).all(-1), np.nan, np.max(np.nan_to_num(np.abs(error)), axis=-1))
            elif self.over_time == "rms":
                size = np.sqrt(mean_over_epochs(error**2))
            else:
                centre = mean_over_epochs(error)
                spread = np.sqrt(mean_over_epochs((error - centre[:, None]) ** 2))
                size = np.abs(centre) if self.over_time == "mean" else spread
        return np.where(lost, np.inf, size)[:, None]

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a quantile."""
        return Quantile(self.percent / 100)

    def title(self) -> str:
        """Return what it is."""
        moment = "" if self.time_s is not None else f" the {self.over_time} of"
        return f"{self._which()} over trials of{moment} {self.of} error {self.when()}"

    def _which(self) -> str:
        return f"{self.percent:g} % point"


@dataclass
class Median(Percentile):
    """The median over the trials of the size of the error, or of its moment in time."""

    percent: float = number("50; another one is a Percentile", 50.0, at_least=50, at_most=50)

    def _which(self) -> str:
        return "median"


@dataclass
class Mean(ErrorMetric):
    """The mean signed error, over the trials (and epochs): the bias of the estimate."""

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Check that the error has a sign."""
        super().check(run, estimator, where)
        if self.of in ("position", "velocity"):
            raise UserError(f"{where}.of: {self.of} is not allowed; an error with a sign, such as height or x")

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the mean of each trial."""
        return mean_over_epochs(view.error(estimator, self.of, self.epochs(run)))[:, None]

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a mean."""
        return SignedMean()

    def title(self) -> str:
        """Return what it is."""
        return f"mean {self.of} error {self.when()}"


@dataclass
class Share(ErrorMetric):
    """The share of the trials whose error (its rms over an interval) is at most so large."""

    within: float = number("how large, in the unit of the error", 0.0, at_least=0)

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return 1 or 0 for each trial."""
        square = mean_squares(view, self, estimator, run)
        return np.where(np.isnan(square), np.nan, square <= self.within**2)

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a proportion."""
        return Proportion()

    def unit(self, run: StudyFacts) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"share of trials with {self.of} error <= {self.within:g} {self.when()}"


@dataclass
class DivergenceRate(Metric):
    """The share of the trials that have diverged: last position error not finite, or beyond the limit."""

    limit_m: float | None = number("position error [m]; by default the scenario's divergence_m", None, above=0)

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return 1 or 0 for each trial; its last epoch is the last with a known truth."""
        error = view.error(estimator, "position", np.arange(run.epochs.size))
        known = ~np.isnan(error)
        last = error.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
        limit = run.divergence if self.limit_m is None else self.limit_m
        with np.errstate(invalid="ignore"):
            return (error[np.arange(len(error)), last] > limit)[:, None].astype(float)

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a proportion."""
        return Proportion()

    def title(self) -> str:
        """Return what it is."""
        return "divergence rate" if self.limit_m is None else f"divergence rate beyond {self.limit_m:g} m"


@dataclass
class ConvergenceTime(Metric):
    """When the RMSE of the position falls below a threshold for good."""

    threshold_m: float | None = number(
        "position RMSE [m]; by default the scenario's convergence_m, else half of the RMSE at the first epoch",
        None,
        above=0,
    )

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the squared error at every epoch."""
        return view.error(estimator, "position", np.arange(run.epochs.size)) ** 2

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a convergence time."""
        threshold = run.threshold if self.threshold_m is None else self.threshold_m
        return SettlingTime(tuple(map(float, run.epochs)), threshold)

    def unit(self, run: StudyFacts) -> str:
        """Return seconds."""
        return "s"

    def title(self) -> str:
        """Return what it is."""
        return "convergence time" + ("" if self.threshold_m is None else f" to {self.threshold_m:g} m")


@dataclass
class Nees(TimedMetric):
    """The mean NEES over the trials (and epochs): equivalence of the filter's covariance to a stated band."""

    per_state: bool = documented("divided by the number of states, so that 1 is consistent", False)

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the mean NEES of each trial."""
        epochs = self.epochs(run)
        mean = mean_over_epochs(view.number("nees", estimator, epochs))[:, None]
        mean[view.lost(estimator, epochs)] = np.inf  # left out, the trials that survive would speak for all
        return mean / (len(run.states[estimator]) or np.nan) if self.per_state else mean

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a mean."""
        return MeanRatio()

    def title(self) -> str:
        """Return what it is."""
        return f"mean NEES{' per state' if self.per_state else ''} {self.when()}"


@dataclass
class Nis(TimedMetric):
    """The NIS per measured row, 1 for a consistent filter: sum of the NIS over sum of the rows used."""

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the sums of NIS and rows of each trial."""
        epochs = self.epochs(run)
        nis, rows = view.number("nis", estimator, epochs), view.number("nis_dof", estimator, epochs)
        known = ~np.isnan(nis) & (rows > 0)
        sums = np.stack([np.where(known, x, 0.0).sum(axis=-1) for x in (nis, rows)], axis=-1)
        sums = np.where(known.any(axis=-1, keepdims=True), sums, np.nan)
        lost = view.lost(estimator, epochs)
        sums[lost] = np.inf, 1.0  # left out, the trials that survive would speak for all
        return sums

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return a ratio of means."""
        return MeanRatio()

    def title(self) -> str:
        """Return what it is."""
        return f"NIS per row {self.when()}"


@dataclass
class Efficiency(ErrorMetric):
    """RMSE over the posterior Cramer-Rao bound, over the same trials and epochs.

    The bound is taken as known. Where the truth differs between trials it is itself a mean over them, which moves with
    the RMSE: the interval is then wider than need be.
    """

    bound: str = choice(
        "bound: that of the filter's motion model; bound_truth: of the true one", "bound", ("bound", "bound_truth")
    )

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Check that there can be such a bound."""
        super().check(run, estimator, where)
        choose(f"{where}.of", self.of, [name for name in QUANTITIES if name in run.quantities[estimator]])

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the mean square of each trial."""
        return mean_squares(view, self, estimator, run)

    def bound_square(self, dataset: xr.Dataset, estimator: str, run: StudyFacts) -> float | None:
        """Return the mean over the epochs of the squared bound; NaN where the system has none."""
        name = f"{self.bound}_{self.of}"
        if name not in dataset:
            return float("nan")
        return float(np.mean(dataset[name].sel(estimator=estimator).values[self.epochs(run)] ** 2))

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return the root of a ratio of means."""
        return MeanRatio(root=True)

    def unit(self, run: StudyFacts) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"RMSE/{self.bound} of {self.of} {self.when()}"


@dataclass
class RmseRatio(ErrorMetric):
    """RMSE over that of another estimator in the same trials, on the same measurements."""

    to: str = text("the other estimator")

    def check(self, run: StudyFacts, estimator: str, where: str) -> None:
        """Check both estimators."""
        super().check(run, estimator, where)
        choose(f"{where}.to", self.to, run.states)
        choose(f"{where}.of", self.of, run.quantities[self.to])

    def reduce(self, view: StudyView, estimator: str, run: StudyFacts) -> Array:
        """Return the mean squares of each trial."""
        return np.concatenate([mean_squares(view, self, name, run) for name in (estimator, self.to)], axis=-1)

    def statistic(self, run: StudyFacts) -> Statistic:
        """Return the root of a ratio of means."""
        return MeanRatio(root=True)

    def unit(self, run: StudyFacts) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"RMSE of {self.of} {self.when()} over that of {self.to}"


METRICS = (Rmse, Median, Percentile, Mean, Share, DivergenceRate, ConvergenceTime, Nees, Nis, Efficiency, RmseRatio)
"""What a requirement may be about; the class name is the YAML tag."""

MetricChoice = Union[METRICS]  # type: ignore[valid-type]  # noqa: UP007 - the members come from the tuple
