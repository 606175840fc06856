"""What a requirement is about: the metric, what it takes from each trial, and how that is estimated.

A metric over an interval of time makes one number of each trial first (its mean square, say): trials are independent,
epochs are not. Everything is SI, courses in degrees, as in `diagrams.metrics`.
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Union

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from diagrams.assembly.build import Assembly
from diagrams.errors import UserError, choose
from diagrams.metrics import NEEDED, QUANTITIES, axis_errors, errors
from diagrams.states import shared
from diagrams.verification.statistics import MeanRatio, Proportion, Quantile, SettlingTime, SignedMean, Statistic
from systems.documented import choice, documented, number, text

__all__ = ["METRICS", "Metric", "MetricChoice", "RmseRatio", "Run", "View"]

Array = NDArray[np.float64]

_UNITS = {"position": "m", "height": "m", "velocity": "m/s", "speed": "m/s", "course": "deg"}
_MOMENTS = ("rms", "mean", "std", "max")


class Run:
    """What is known of a study before it has run.

    Parameters
    ----------
    wired : Assembly
        The diagram of the study.
    """

    def __init__(self, wired: Assembly) -> None:
        self.epochs: Array = np.asarray(wired.clock.ticks(wired.duration), dtype=float)
        self.divergence = wired.model.divergence
        self.threshold = wired.model.convergence
        self.estimators = list(wired.estimators)
        # as a study has it: the states that estimator and truth both have
        models = {name: estimator.motion for name, estimator in wired.estimators.items()}
        self.units = {state: u for m in models.values() for state, u in zip(m.names, m.units, strict=True)}
        judged = shared(wired.estimated_names, wired.truth_names)
        self.states = {name: list(shared(motion.names, judged)) for name, motion in models.items()}
        self.quantities = {name: _quantities(states, judged, wired.model.frame) for name, states in self.states.items()}

    def unit(self, of: str) -> str:
        """Return the unit of a quantity or component."""
        return _UNITS.get(of) or self.units.get(of, "")


def _quantities(states: Sequence[str], judged: Sequence[str], frame: str) -> list[str]:
    """Return what `diagrams.metrics.errors` and `axis_errors` find of those components, where the study judges more."""
    row = np.zeros((1, 1, 1, len(judged)))
    row[..., :1] = 7e6  # somewhere on the Earth
    still = xr.Dataset(
        {"estimate": (("estimator", "trial", "time", "state"), row), "truth": (("time", "state"), row[0, 0])},
        {"state": list(judged)},
        {"frame": frame},
    )
    found = [str(of) for of in errors(still) if set(shared(NEEDED[str(of)], judged)) <= set(states)]
    return list(dict.fromkeys([*found, *states]))


class View:
    """A chunk of a study with its errors, computed once for all requirements.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `diagrams.study.Study.chunks`.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset = dataset

    @cached_property
    def _errors(self) -> xr.Dataset:
        return errors(self.dataset)

    @cached_property
    def _axes(self) -> xr.DataArray:
        return axis_errors(self.dataset)

    def error(self, estimator: str, of: str, epochs: NDArray[np.int_]) -> Array:
        """Return the error (trials, epochs); infinite in a lost trial, NaN where no truth is known."""
        if of in self._errors:
            found = self._errors[of].sel(estimator=estimator)
        else:
            found = self._axes.sel(estimator=estimator, state=of)
        return found.transpose("trial", "time").values[:, epochs]

    def number(self, name: str, estimator: str, epochs: NDArray[np.int_]) -> Array:
        """Return ``nees``, ``nis`` or ``nis_dof`` (trials, epochs)."""
        return self.dataset[name].sel(estimator=estimator).transpose("trial", "time").values[:, epochs]

    def lost(self, estimator: str, epochs: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return in which trials the estimate is not finite at the last of the epochs; it may begin late."""
        return np.isinf(self.error(estimator, "position", epochs[-1:])[:, 0])


def _mean(values: Array) -> Array:
    """Return the mean over the epochs, of those that have a number; NaN where none has."""
    known = ~np.isnan(values)
    count = known.sum(axis=-1)
    total = np.where(known, values, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


# ------------------------------------------------------------------------------------------------ what all share


@dataclass
class Metric:
    """What all metrics have."""

    def check(self, run: Run, estimator: str, where: str) -> None:
        """Raise a `UserError` that begins with `where` if the system or the run lacks what is asked for."""

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return samples (trials, columns); NaN in a trial that has none."""
        raise NotImplementedError

    def statistic(self, run: Run) -> Statistic:
        """Return what is estimated from the samples."""
        raise NotImplementedError

    def bound_square(self, dataset: xr.Dataset, estimator: str, run: Run) -> float | None:
        """Return the squared bound that the samples are divided by, if there is one."""
        return None

    def unit(self, run: Run) -> str:
        """Return the unit, empty for a number."""
        return ""

    def title(self) -> str:
        """Return what it is, for tables."""
        raise NotImplementedError


@dataclass
class _Timed(Metric):
    time_s: float | None = number("at this time [s]; the nearest epoch", None, at_least=0)
    interval_s: list[float] = documented("or over this time: begin, end, and more such pairs [s]", factory=list)

    def check(self, run: Run, estimator: str, where: str) -> None:
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

    def epochs(self, run: Run) -> NDArray[np.int_]:
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
class _Error(_Timed):
    of: str = text(
        "position, height, velocity, speed, course, bias, or a component of the state such as vx", "position"
    )

    def check(self, run: Run, estimator: str, where: str) -> None:
        """Check quantity and times."""
        choose(f"{where}.of", self.of, run.quantities[estimator])
        super().check(run, estimator, where)

    def unit(self, run: Run) -> str:
        """Return the unit of the quantity."""
        return run.unit(self.of)


def _squares(view: View, metric: _Error, estimator: str, run: Run, clip: float | None = None) -> Array:
    error = np.abs(view.error(estimator, metric.of, metric.epochs(run)))
    return _mean((error if clip is None else np.minimum(error, clip)) ** 2)[:, None]


# ------------------------------------------------------------------------------------------------------ metrics


@dataclass
class Rmse(_Error):
    """Root mean square error over the trials (and epochs)."""

    clip: float | None = number("larger errors count as this, in the unit of the error", None, above=0)

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the mean square of each trial."""
        return _squares(view, self, estimator, run, self.clip)

    def statistic(self, run: Run) -> Statistic:
        """Return the root of a mean."""
        return MeanRatio(root=True)

    def title(self) -> str:
        """Return what it is."""
        clipped = "" if self.clip is None else f", clipped at {self.clip:g}"
        return f"RMSE of {self.of} {self.when()}{clipped}"


@dataclass
class Percentile(_Error):
    """A percentile over the trials of the size of the error, or of its moment in time."""

    percent: float = number("which percentile", 90.0, above=0, at_most=99.99)
    over_time: str = choice("what an interval makes of a trial: rms, |mean|, std or max", "rms", _MOMENTS)

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the size of each trial's error."""
        error = view.error(estimator, self.of, self.epochs(run))
        with np.errstate(invalid="ignore"):
            lost = np.isinf(error).any(axis=-1)
            error = np.where(np.isinf(error), np.nan, error)
            if self.over_time == "max":
                size = np.where(np.isnan(error).all(-1), np.nan, np.max(np.nan_to_num(np.abs(error)), axis=-1))
            elif self.over_time == "rms":
                size = np.sqrt(_mean(error**2))
            else:
                centre = _mean(error)
                spread = np.sqrt(_mean((error - centre[:, None]) ** 2))
                size = np.abs(centre) if self.over_time == "mean" else spread
        return np.where(lost, np.inf, size)[:, None]

    def statistic(self, run: Run) -> Statistic:
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
class Mean(_Error):
    """The mean signed error, over the trials (and epochs): the bias of the estimate."""

    def check(self, run: Run, estimator: str, where: str) -> None:
        """Check that the error has a sign."""
        super().check(run, estimator, where)
        if self.of in ("position", "velocity"):
            raise UserError(f"{where}.of: {self.of} is not allowed; an error with a sign, such as height or x")

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the mean of each trial."""
        return _mean(view.error(estimator, self.of, self.epochs(run)))[:, None]

    def statistic(self, run: Run) -> Statistic:
        """Return a mean."""
        return SignedMean()

    def title(self) -> str:
        """Return what it is."""
        return f"mean {self.of} error {self.when()}"


@dataclass
class Share(_Error):
    """The share of the trials whose error (its rms over an interval) is at most so large."""

    within: float = number("how large, in the unit of the error", 0.0, at_least=0)

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return 1 or 0 for each trial."""
        square = _squares(view, self, estimator, run)
        return np.where(np.isnan(square), np.nan, square <= self.within**2)

    def statistic(self, run: Run) -> Statistic:
        """Return a proportion."""
        return Proportion()

    def unit(self, run: Run) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"share of trials with {self.of} error <= {self.within:g} {self.when()}"


@dataclass
class DivergenceRate(Metric):
    """The share of the trials that have diverged: last position error not finite, or beyond the limit."""

    limit_m: float | None = number("position error [m]; by default the scenario's divergence_m", None, above=0)

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return 1 or 0 for each trial; its last epoch is the last with a known truth."""
        error = view.error(estimator, "position", np.arange(run.epochs.size))
        known = ~np.isnan(error)
        last = error.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
        limit = run.divergence if self.limit_m is None else self.limit_m
        with np.errstate(invalid="ignore"):
            return (error[np.arange(len(error)), last] > limit)[:, None].astype(float)

    def statistic(self, run: Run) -> Statistic:
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

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the squared error at every epoch."""
        return view.error(estimator, "position", np.arange(run.epochs.size)) ** 2

    def statistic(self, run: Run) -> Statistic:
        """Return a convergence time."""
        threshold = run.threshold if self.threshold_m is None else self.threshold_m
        return SettlingTime(tuple(map(float, run.epochs)), threshold)

    def unit(self, run: Run) -> str:
        """Return seconds."""
        return "s"

    def title(self) -> str:
        """Return what it is."""
        return "convergence time" + ("" if self.threshold_m is None else f" to {self.threshold_m:g} m")


@dataclass
class Nees(_Timed):
    """The mean NEES over the trials (and epochs): equivalence of the filter's covariance to a stated band."""

    per_state: bool = documented("divided by the number of states, so that 1 is consistent", False)

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the mean NEES of each trial."""
        epochs = self.epochs(run)
        mean = _mean(view.number("nees", estimator, epochs))[:, None]
        mean[view.lost(estimator, epochs)] = np.inf  # left out, the trials that survive would speak for all
        return mean / (len(run.states[estimator]) or np.nan) if self.per_state else mean

    def statistic(self, run: Run) -> Statistic:
        """Return a mean."""
        return MeanRatio()

    def title(self) -> str:
        """Return what it is."""
        return f"mean NEES{' per state' if self.per_state else ''} {self.when()}"


@dataclass
class Nis(_Timed):
    """The NIS per measured row, 1 for a consistent filter: sum of the NIS over sum of the rows used."""

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the sums of NIS and rows of each trial."""
        epochs = self.epochs(run)
        nis, rows = view.number("nis", estimator, epochs), view.number("nis_dof", estimator, epochs)
        known = ~np.isnan(nis) & (rows > 0)
        sums = np.stack([np.where(known, x, 0.0).sum(axis=-1) for x in (nis, rows)], axis=-1)
        sums = np.where(known.any(axis=-1, keepdims=True), sums, np.nan)
        lost = view.lost(estimator, epochs)
        sums[lost] = np.inf, 1.0  # left out, the trials that survive would speak for all
        return sums

    def statistic(self, run: Run) -> Statistic:
        """Return a ratio of means."""
        return MeanRatio()

    def title(self) -> str:
        """Return what it is."""
        return f"NIS per row {self.when()}"


@dataclass
class Efficiency(_Error):
    """RMSE over the posterior Cramer-Rao bound, over the same trials and epochs.

    The bound is taken as known. Where the truth differs between trials it is itself a mean over them, which moves with
    the RMSE: the interval is then wider than need be.
    """

    bound: str = choice(
        "bound: that of the filter's motion model; bound_truth: of the true one", "bound", ("bound", "bound_truth")
    )

    def check(self, run: Run, estimator: str, where: str) -> None:
        """Check that there can be such a bound."""
        super().check(run, estimator, where)
        choose(f"{where}.of", self.of, [name for name in QUANTITIES if name in run.quantities[estimator]])

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the mean square of each trial."""
        return _squares(view, self, estimator, run)

    def bound_square(self, dataset: xr.Dataset, estimator: str, run: Run) -> float | None:
        """Return the mean over the epochs of the squared bound; NaN where the system has none."""
        name = f"{self.bound}_{self.of}"
        if name not in dataset:
            return float("nan")
        return float(np.mean(dataset[name].sel(estimator=estimator).values[self.epochs(run)] ** 2))

    def statistic(self, run: Run) -> Statistic:
        """Return the root of a ratio of means."""
        return MeanRatio(root=True)

    def unit(self, run: Run) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"RMSE/{self.bound} of {self.of} {self.when()}"


@dataclass
class RmseRatio(_Error):
    """RMSE over that of another estimator in the same trials, on the same measurements."""

    to: str = text("the other estimator")

    def check(self, run: Run, estimator: str, where: str) -> None:
        """Check both estimators."""
        super().check(run, estimator, where)
        choose(f"{where}.to", self.to, run.states)
        choose(f"{where}.of", self.of, run.quantities[self.to])

    def reduce(self, view: View, estimator: str, run: Run) -> Array:
        """Return the mean squares of each trial."""
        return np.concatenate([_squares(view, self, name, run) for name in (estimator, self.to)], axis=-1)

    def statistic(self, run: Run) -> Statistic:
        """Return the root of a ratio of means."""
        return MeanRatio(root=True)

    def unit(self, run: Run) -> str:
        """Return none."""
        return ""

    def title(self) -> str:
        """Return what it is."""
        return f"RMSE of {self.of} {self.when()} over that of {self.to}"


METRICS = (Rmse, Median, Percentile, Mean, Share, DivergenceRate, ConvergenceTime, Nees, Nis, Efficiency, RmseRatio)
"""What a requirement may be about; the class name is the YAML tag."""

MetricChoice = Union[METRICS]  # type: ignore[valid-type]  # noqa: UP007 - the members come from the tuple
