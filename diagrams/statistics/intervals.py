r"""Confidence intervals over Monte Carlo trials; the trial is the unit, whatever happens in time within one.

The errors of passive location lie nearly along one line, so that a trial of N states counts as one degree of freedom,
not as N; nothing here assumes how errors are distributed. Every function works over leading axes: samples are
(..., trials, columns), limits (...).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binom

__all__ = ["FEWEST", "MeanRatio", "Proportion", "Quantile", "SettlingTime", "SignedMean", "Statistic"]

Array = NDArray[np.float64]

FEWEST = 50
"""Trials from which the bootstrap of a mean square is trusted: below, the skewness of a square is not yet known."""

_HUGE = 1e150  # stands for infinity while order statistics are interpolated
_SEED = 20_090_401  # of the resampling; a verdict is a function of the trials alone
_BLOCK = 1e6  # numbers of a block of resampling weights: 8 MB


class Statistic(Protocol):
    """What is estimated from the trials."""

    def estimate(self, samples: Array) -> Array:
        """Return the estimate (...) from samples (..., trials, columns)."""

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return lower and upper confidence limits (...), each missed with probability `tail` at most."""

    @property
    def floor(self) -> int:
        """From how many trials on the limits are right."""

    def fewest(self, tail: float, upper: bool) -> int:
        """Return from how many trials on the upper (or lower) limit can say anything."""


def _resamples(count: int, draws: int) -> Iterator[Array]:
    """Yield blocks (some draws, count): how often each trial is in each bootstrap sample."""
    rng = np.random.default_rng(_SEED)
    height = max(1, int(_BLOCK / count))
    for start in range(0, draws, height):
        rows = min(height, draws - start)
        picks = rng.integers(0, count, (rows, count)) + count * np.arange(rows)[:, None]
        yield np.bincount(picks.ravel(), minlength=rows * count).reshape(rows, count).astype(float)


def _draws(tail: float) -> int:
    """Return how many bootstrap samples leave about 40 beyond a limit, which knows the tail to 16 %."""
    return int(np.clip(40 / tail, 2000, 40_000))


def _log_ratio(a: Array, b: Array | None) -> tuple[Array, Array]:
    """Return log of mean(a)/mean(b) over the last axis, and its standard error (delta method)."""
    mean = a.mean(axis=-1)
    influence = a / mean[..., None]
    value = np.log(mean)
    if b is not None:
        below = b.mean(axis=-1)
        influence, value = influence - b / below[..., None], value - np.log(below)
    else:
        influence = influence - 1.0
    return value, np.sqrt((influence**2).mean(axis=-1) / (a.shape[-1] - 1))


def _studentised(a: Array, b: Array | None, tail: float) -> tuple[Array, Array]:
    """Return both limits of log(mean(a)/mean(b)) by the studentised bootstrap.

    All resampled means of all leading axes come from products with one matrix of counts.
    """
    count = a.shape[-1]
    centre, spread = _log_ratio(a, b)
    flat = a.reshape(-1, count).T
    low = None if b is None else np.broadcast_to(b, a.shape).reshape(-1, count).T
    flat_square = flat**2
    product, low_square = (flat, flat) if low is None else (flat * low, low**2)
    parts = []
    for weights in _resamples(count, _draws(tail)):
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = weights @ flat / count
            square = weights @ flat_square / count / mean**2
            if low is None:
                value, variance = np.log(mean), square - 1.0
            else:
                below = weights @ low / count
                cross = weights @ product / count / (mean * below)
                value = np.log(mean / below)
                variance = square - 2 * cross + weights @ low_square / count / below**2
            deviation = value.reshape(-1, *a.shape[:-1]) - centre
            error = np.sqrt(np.maximum(variance, 0.0) / (count - 1)).reshape(deviation.shape)
            parts.append(np.where(error > 0, deviation / error, np.copysign(np.inf, deviation)))
    return _limits(centre, spread, np.concatenate(parts), tail)


def _limits(centre: Array, spread: Array, pivot: Array, tail: float) -> tuple[Array, Array]:
    """Return both limits from bootstrap values (draws, ...) of the studentised statistic.

    Order statistics, not interpolated: a resample without any spread counts as infinitely far.
    """
    k, last = int(tail * pivot.shape[0]), pivot.shape[0] - 1
    pivot.partition([k, last - k], axis=0)
    with np.errstate(invalid="ignore"):
        lower = np.where(spread > 0, centre - spread * pivot[last - k], centre)
        upper = np.where(spread > 0, centre - spread * pivot[k], centre)
    return lower, upper


@dataclass(frozen=True)
class MeanRatio:
    r"""A mean, or a ratio of two means over the same trials; with `root` the square root of it (RMSE, ratio of RMSEs).

    Studentised bootstrap over trials of :math:`\log(\bar a/\bar b)`, standard error by the delta method (Efron and
    Tibshirani, *An Introduction to the Bootstrap*, 1993, section 12.5; Hall, *The Bootstrap and Edgeworth Expansion*,
    1992, section 3.3): second-order correct for one-sided limits where the plain percentile bootstrap of a mean square
    misses up to three times too often, because a sample whose largest squares are missing has a small mean and a small
    spread. What no resampling can know is the tail beyond the largest value seen; therefore the upper limit is that
    of the trials and one more, as bad as the worst (the lower limit of a ratio: as bad for the denominator). Squares
    of Gaussian and of mildly heavy-tailed errors (Laplace, Student's t with 8 degrees of freedom) are then covered
    from 50 trials on.

    Columns of the samples: a, and b if there is a denominator; both >= 0.

    Parameters
    ----------
    root : bool
        Whether the square root is wanted.
    """

    root: bool = False

    def estimate(self, samples: Array) -> Array:
        """Return mean(a)/mean(b) or its root; infinite where a is somewhere infinite, NaN where both are."""
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = samples.mean(axis=-2)
            value = mean[..., 0] / mean[..., 1] if samples.shape[-1] == 2 else mean[..., 0]
            return np.sqrt(value) if self.root else value

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return the limits; one lost trial in a makes both infinite, since the mean over all trials then is."""
        finite = np.asarray(np.isfinite(samples).all(axis=(-1, -2)) & (samples.max(axis=-2) > 0).all(axis=-1))
        usable = np.where(finite[..., None, None], samples, 1.0)
        a, b = usable[..., 0], usable[..., 1] if samples.shape[-1] == 2 else None
        lower, _ = _studentised(*_with_worst(a, b, below=True), tail)
        _, upper = _studentised(*_with_worst(a, b, below=False), tail)
        power = 0.5 if self.root else 1.0
        value = self.estimate(samples)
        lower = np.where(finite, np.exp(power * lower), np.where(np.isnan(value), 0.0, value))
        upper = np.where(finite, np.exp(power * upper), np.where(np.isnan(value), np.inf, value))
        return lower, upper

    @property
    def floor(self) -> int:
        """From how many trials on the bootstrap is trusted."""
        return FEWEST

    def fewest(self, tail: float, upper: bool) -> int:
        """Return the floor."""
        return FEWEST


def _with_worst(a: Array, b: Array | None, below: bool) -> tuple[Array, Array | None]:
    """Return the trials and one more, as bad as the worst: of a for the upper limit, of b for the lower one."""
    if below and b is None:
        return a, None
    judged = b if below and b is not None else a
    worst = np.argmax(judged, axis=-1)[..., None]
    more = [None if x is None else np.concatenate([x, np.take_along_axis(x, worst, -1)], axis=-1) for x in (a, b)]
    assert more[0] is not None
    return more[0], more[1]


@dataclass(frozen=True)
class SignedMean:
    """The mean of a signed number, such as an error along one axis; studentised bootstrap, without the logarithm."""

    def estimate(self, samples: Array) -> Array:
        """Return the mean."""
        return samples[..., 0].mean(axis=-1)

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return the limits; without end where a trial is lost."""
        finite = np.asarray(np.isfinite(samples[..., 0]).all(axis=-1))
        a = np.where(finite[..., None], samples[..., 0], 0.0)
        count = a.shape[-1]
        centre, spread = a.mean(axis=-1), a.std(axis=-1) / math.sqrt(count - 1)
        flat = (a - centre[..., None]).reshape(-1, count).T
        square, parts = flat**2, []
        for weights in _resamples(count, _draws(tail)):
            mean = weights @ flat / count
            error = np.sqrt(np.maximum(weights @ square / count - mean**2, 0.0) / (count - 1))
            with np.errstate(invalid="ignore", divide="ignore"):
                parts.append(np.where(error > 0, mean / error, np.copysign(np.inf, mean)))
        lower, upper = _limits(centre, spread, np.concatenate(parts).reshape(-1, *a.shape[:-1]), tail)
        return np.where(finite, lower, -np.inf), np.where(finite, upper, np.inf)

    @property
    def floor(self) -> int:
        """From how many trials on the bootstrap is trusted."""
        return FEWEST

    def fewest(self, tail: float, upper: bool) -> int:
        """Return the floor."""
        return FEWEST


@dataclass(frozen=True)
class Quantile:
    """A quantile over the trials; limits are order statistics and exact for every distribution.

    David and Nagaraja, *Order Statistics*, 2003, section 7.1: the number of trials below the quantile is binomial.

    Parameters
    ----------
    share : float
        Between 0 and 1; 0.5 is the median.
    """

    share: float

    def estimate(self, samples: Array) -> Array:
        """Return the quantile, interpolated; infinite where a lost trial takes part."""
        value = np.quantile(np.minimum(samples[..., 0], _HUGE), self.share, axis=-1)
        return np.where(value > 1e-3 * _HUGE, np.inf, value)

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return the limits; without end where there are too few trials for one."""
        count = samples.shape[-2]
        ordered = np.sort(samples[..., 0], axis=-1)
        # upper: the r-th smallest with P(Bin >= r) <= tail; lower: the s-th with P(Bin <= s - 1) <= tail
        r = int(binom.isf(tail, count, self.share)) + 1
        s = int(binom.ppf(tail, count, self.share))
        s = s + 1 if binom.cdf(s, count, self.share) <= tail else s
        without = np.full(samples.shape[:-2], np.inf)
        lower = ordered[..., s - 1] if s >= 1 else -without
        upper = ordered[..., r - 1] if r <= count else without
        return lower, upper

    @property
    def floor(self) -> int:
        """1: the limits are right for any number of trials."""
        return 1

    def fewest(self, tail: float, upper: bool) -> int:
        """Return from how many trials on the limit is finite."""
        return math.ceil(math.log(tail) / math.log(self.share if upper else 1 - self.share))


@dataclass(frozen=True)
class Proportion:
    """The share of trials of which something is true; exact limits of Clopper and Pearson, Biometrika 26 (1934) 404."""

    def estimate(self, samples: Array) -> Array:
        """Return the share."""
        return samples[..., 0].mean(axis=-1)

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return the limits, 0 to 1."""
        count = samples.shape[-2]
        true = np.count_nonzero(samples[..., 0], axis=-1)
        with np.errstate(invalid="ignore"):
            lower, upper = beta.ppf(tail, true, count - true + 1), beta.isf(tail, true + 1, count - true)
        return np.where(true == 0, 0.0, lower), np.where(true == count, 1.0, upper)

    @property
    def floor(self) -> int:
        """1: the limits are right for any number of trials."""
        return 1

    def fewest(self, tail: float, upper: bool) -> int:
        """Return 1."""
        return 1


@dataclass(frozen=True)
class SettlingTime:
    r"""The first epoch from which the RMSE over the trials stays at or below a threshold, to the end.

    The limits need no correction for the many epochs. Upper: the first epoch from which the pointwise *upper* limit
    of the RMSE stays below the threshold. It is too early only if that limit misses at the last epoch at which the RMSE
    is above the threshold, one epoch. Lower: the first epoch at which the pointwise *lower* limit of the RMSE is not
    above the threshold. It is too late only if that limit misses at the convergence time itself, again one epoch.

    Columns of the samples: squared errors at the epochs.

    Parameters
    ----------
    times : tuple of float
        Epochs [s].
    threshold : float or None
        In the unit of the error; None: `fraction` of the RMSE at the first epoch, in the same trials.
    fraction : float
        See `threshold`.
    """

    times: tuple[float, ...]
    threshold: float | None
    fraction: float = 0.5

    def _parts(self, samples: Array) -> tuple[Array, float]:
        """Return (..., epochs, trials, 1 or 2) for a `MeanRatio`, and the threshold for its root."""
        squares = np.swapaxes(samples, -1, -2)[..., None]
        if self.threshold is not None:
            return squares, self.threshold
        return np.concatenate([squares, np.broadcast_to(squares[..., :1, :, :], squares.shape)], -1), self.fraction

    def estimate(self, samples: Array) -> Array:
        """Return the convergence time [s]; infinite where the RMSE does not stay below."""
        parts, threshold = self._parts(samples)
        return self._from_which(MeanRatio(root=True).estimate(parts) <= threshold)

    def interval(self, samples: Array, tail: float) -> tuple[Array, Array]:
        """Return the limits [s]; the upper one is infinite where it is not certain that the RMSE stays below."""
        parts, threshold = self._parts(samples)
        lower, upper = MeanRatio(root=True).interval(parts, tail)
        reached = lower <= threshold
        first = np.where(reached.any(axis=-1), np.argmax(reached, axis=-1), len(self.times) - 1)
        earliest = np.where(reached.any(axis=-1), np.asarray(self.times)[first], np.inf)
        return earliest, self._from_which(upper <= threshold)

    def _from_which(self, good: NDArray[np.bool_]) -> Array:
        """Return the first time from which all is good, infinite if the last is not."""
        bad_after = np.argmax(~good[..., ::-1], axis=-1)
        length = len(self.times)
        last_bad = np.where(good.all(axis=-1), -1, length - 1 - bad_after)
        times = np.append(self.times, np.inf)
        return times[np.minimum(last_bad + 1, length)]

    @property
    def floor(self) -> int:
        """From how many trials on the bootstrap is trusted."""
        return FEWEST

    def fewest(self, tail: float, upper: bool) -> int:
        """Return the floor."""
        return FEWEST
