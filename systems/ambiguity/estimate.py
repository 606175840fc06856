r"""TDOA and FDOA of a block of samples from two receivers.

With x from the main receiver and y from the auxiliary one,

.. math:: A(\tau, f) = \sum_t \bar x(t)\, y(t + \tau)\, e^{-2\pi j f t}

peaks at tau = arrival time at the auxiliary receiver minus that at the main one, and f = frequency received by the
auxiliary receiver minus that received by the main one, both at the middle of the main receiver's block: tagged at its
beginning they would be wrong by half a block's drift, tens of nanoseconds here.

The steps: the auxiliary block is cut at the predicted delay and freed of the predicted frequency; both pass the
prefilter; a coarse search over the window (`coarse`); the block is cut anew at the peak and refined (`fine`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from systems.ambiguity.coarse import Grid, ambiguity_grid, plan
from systems.ambiguity.fine import Peak, parabola, refine
from systems.ambiguity.limits import check_duration
from systems.ambiguity.phasor import phasor
from systems.ambiguity.prefilter import Everything, Moments, Prefilter
from systems.ambiguity.threshold import cells, confidence, right_cell_probability
from systems.iq.block import IqBlock

__all__ = ["CrossAmbiguity", "Differences", "Flag", "Window"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex64]

_GUARD = 4.0  # cells beyond the window in which a peak of twice the power gives away that the window is too small
_MUCH = 2.0  # a repetition of a periodic signal beside the window is as high as the peak, and must not be that
_SIDELOBE = 2.0  # curvature of a side lobe of sinc is three times that of the main one
_SAMPLES_AT_ONCE = 1 << 17  # per channel: what a cache holds
_NOISE_SHIFTS = (-11, -5, 7, 13)  # bins; any few that are not the signal's own frequency difference
_LEAST = 1e-3
_TIME_SPREAD = math.pi / math.sqrt(3.0)


class Flag(enum.IntFlag):
    """Why an estimate is not to be believed."""

    GOOD = 0
    NO_SIGNAL = 1
    """Samples are all zero or not finite."""
    CLIPPED = 2
    """Too many samples at the largest value: the receiver was saturated."""
    NO_OVERLAP = 4
    """The auxiliary block does not hold what the main receiver's block is to be compared with."""
    BELOW_THRESHOLD = 8
    """Noise alone may well have made that peak."""
    EDGE = 16
    """The function rises beyond the edge of the window, or what was found is a side lobe: the window is too small."""
    LEFT_CELL = 32
    """The refinement did not stay near the coarse peak; the parabola's result stands."""


@dataclass(frozen=True)
class Window:
    """Where the peak is sought, per trial or the same for all.

    Parameters
    ----------
    delay, frequency : array_like, shape () or (trials,)
        Its centre [s], [Hz].
    half_delay, half_frequency : array_like, shape () or (trials,)
        Its half-widths [s], [Hz], >= 0.

    Raises
    ------
    ValueError
        If a centre is infinite or a half-width is negative or not finite. A centre that is NaN is allowed: there the
        result is NaN.
    """

    delay: ArrayLike
    frequency: ArrayLike
    half_delay: ArrayLike
    half_frequency: ArrayLike

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name, unit in (("half_delay", "s"), ("half_frequency", "Hz")):
            value = np.asarray(getattr(self, name), dtype=float)
            if not np.all(np.isfinite(value) & (value >= 0)):
                raise ValueError(f"window {name}: {value} is not allowed; finite and >= 0 {unit}")
        for name in ("delay", "frequency"):
            if np.any(np.isinf(np.asarray(getattr(self, name), dtype=float))):
                raise ValueError(f"window {name}: it must not be infinite")

    @property
    def trials(self) -> int:
        """Number of windows."""
        sizes = [np.size(getattr(self, name)) for name in ("delay", "frequency", "half_delay", "half_frequency")]
        return max(sizes)

    def over(self, trials: int) -> tuple[Array, Array, Array, Array]:
        """Return the four, each of shape (trials,)."""
        values = (self.delay, self.frequency, self.half_delay, self.half_frequency)
        a, b, c, d = (np.broadcast_to(np.asarray(value, dtype=float), (trials,)) for value in values)
        return a, b, c, d


@dataclass(frozen=True)
class Differences:
    """What was found, over trials; NaN where there is nothing to be found.

    Attributes
    ----------
    delay, frequency : ndarray, shape (trials,)
        TDOA [s] and FDOA [Hz]; flagged ones are kept, see `flag`.
    time : ndarray, shape (trials,)
        What they hold for: the middle of the main receiver's block [s].
    variance : ndarray, shape (trials, 2)
        Predicted variances [s^2], [Hz^2], by the exact expression with the noise that the samples show.
    stein : ndarray, shape (trials, 2)
        The same by Stein's formulae.
    peak : ndarray, shape (trials,)
        Peak power over the mean noise power.
    confidence : ndarray, shape (trials,)
        Chance that noise alone stays below it, everywhere in the window.
    right_cell : ndarray, shape (trials,)
        Chance that a signal as strong as this one wins over the noise.
    coherence : ndarray, shape (trials,)
        Of the two channels behind the prefilter, 0 to 1.
    flag : ndarray of int, shape (trials,)
        Sum of `Flag`.
    """

    delay: Array
    frequency: Array
    time: Array
    variance: Array
    stein: Array
    peak: Array
    confidence: Array
    right_cell: Array
    coherence: Array
    flag: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """Where there is no flag, shape (trials,)."""
        return self.flag == Flag.GOOD

    @staticmethod
    def empty(trials: int) -> Differences:
        """Return NaN everywhere."""
        one = (np.full(trials, np.nan) for _ in range(7))
        delay, frequency, time, peak, sure, right, coherence = one
        two = np.full((trials, 2), np.nan), np.full((trials, 2), np.nan)
        return Differences(delay, frequency, time, *two, peak, sure, right, coherence, np.zeros(trials, dtype=np.int64))


@dataclass(frozen=True)
class CrossAmbiguity:
    """How two blocks are compared.

    Parameters
    ----------
    samples : int, optional
        Samples that are integrated, from the middle of the main receiver's block; default: all of it.
    prefilter : Prefilter
        What both channels pass.
    confidence : float
        Least confidence of a peak that is not flagged.
    clipped_share : float
        A receiver with a larger share of its I and Q at their largest value is flagged as saturated; 1: never (for
        signals with rectangular pulses, or quantised to one bit).
    overlap : float
        Least share of the main receiver's block that has its counterpart in the auxiliary one.
    follow_rate : bool
        Let the delay drift within the block by -f / carrier per second, as a frequency difference f that is all Doppler
        says it does, and hold the integration time against the limits of `limits`. Not for receivers whose oscillators
        differ, nor where the carrier is not known.
    frequency_rate : float
        Largest rate of the frequency difference to be expected [Hz/s]: limits the integration time.
    resample : bool
        Whether the sample rates may differ; the auxiliary block is then resampled to that of the main one.

    Raises
    ------
    ValueError
        For a number out of its range.
    """

    samples: int | None = None
    prefilter: Prefilter = field(default_factory=Everything)
    confidence: float = 0.99
    clipped_share: float = 0.02
    overlap: float = 0.9
    follow_rate: bool = True
    frequency_rate: float = 0.0
    resample: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.samples is not None and self.samples < 64:
            raise ValueError(f"samples: {self.samples} is not allowed; at least 64 are integrated")
        for name in ("confidence", "clipped_share", "overlap"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name}: {getattr(self, name)} is not allowed; 0 to 1")

    def __call__(self, main: IqBlock, auxiliary: IqBlock, window: Window) -> Differences:
        """Return TDOA and FDOA.

        Parameters
        ----------
        main, auxiliary : IqBlock
            What the receivers heard; one trial of one of them serves all trials of the other, and of the window. The
            auxiliary block should be longer than the main one by the largest delay on both sides, so that all of the
            latter has its counterpart.
        window : Window
            Where the peak is sought.

        Raises
        ------
        ValueError
            If the sample rates differ undeclared, a block is shorter than what is integrated, or the motion that the
            window's centre tells of forbids so long an integration.
        """
        main, auxiliary, size = self._checked(main, auxiliary)
        trials = max(main.trials, auxiliary.trials, window.trials)
        rate = main.sample_rate
        tuned = auxiliary.centre_frequency - main.centre_frequency
        delay, frequency, half_delay, half_frequency = window.over(trials)
        self._check_duration(main, size, frequency)
        jobs = _Jobs(delay * rate, (frequency - tuned) / rate, half_delay * rate, half_frequency / rate)
        result = Differences.empty(trials)
        first = (main.size - size) // 2
        result.time[:] = main.start_time + (first + 0.5 * (size - 1)) / rate
        moments = self.prefilter.moments(rate)
        # where the auxiliary block begins, in samples after the first one that is compared
        lead = (auxiliary.start_time - main.start_time) * rate - first
        carrier = main.centre_frequency / rate if self.follow_rate else 0.0
        healthy = [_Health(block, self.clipped_share) for block in (main, auxiliary)]
        for chosen, lags, half in jobs.groups(moments.noise_bandwidth / rate, size):
            grid = plan(size, lags, half, _GUARD)
            work = _Work(self, main, auxiliary, size, first, rate, moments, carrier, tuned / rate)
            for part in _parts(chosen, size + 2 * lags):
                starts = np.broadcast_to(lead, (trials,))[part]
                work.run(part, jobs, grid, starts, healthy, result)
        return result

    def _check_duration(self, main: IqBlock, size: int, frequency: Array) -> None:
        known = frequency[np.isfinite(frequency)]
        if not (self.follow_rate and main.centre_frequency > 0 and known.size):
            return
        edges = self.prefilter.edges
        bandwidth = min(main.sample_rate, edges[1] - edges[0]) if edges else main.sample_rate
        check_duration(size / main.sample_rate, known / main.centre_frequency, self.frequency_rate, bandwidth)

    def _checked(self, main: IqBlock, auxiliary: IqBlock) -> tuple[IqBlock, IqBlock, int]:
        if auxiliary.sample_rate != main.sample_rate:
            if not self.resample:
                raise ValueError(
                    f"auxiliary sample_rate: {auxiliary.sample_rate} Hz is not allowed; {main.sample_rate} Hz as the "
                    "main receiver's, or declare that it is to be resampled"
                )
            from systems.iq.resample import resampled

            auxiliary = resampled(auxiliary, main.sample_rate)
        if main.trials != auxiliary.trials and 1 not in (main.trials, auxiliary.trials):
            raise ValueError(
                f"auxiliary: {auxiliary.trials} trials are not allowed; 1 or {main.trials} as the main receiver's"
            )
        size = self.samples or main.size
        for name, block in (("main", main), ("auxiliary", auxiliary)):
            if block.size < size:
                raise ValueError(f"{name}: {block.size} samples are not allowed; at least the {size} to be integrated")
        if size < 64:
            raise ValueError(f"main: {size} samples are not allowed; at least 64")
        return main, auxiliary, size


@dataclass(frozen=True)
class _Jobs:
    """Windows in samples and cycles per sample, shape (trials,) each."""

    delay: Array
    frequency: Array
    half_delay: Array
    half_frequency: Array

    def groups(self, bandwidth: float, size: int) -> Iterator[tuple[NDArray[np.intp], int, float]]:
        """Yield trials whose windows are of one size, with their delays and half-width.

        The size of a trial's window alone says which transforms it sees, so its result does not depend on the others.
        """
        lags = np.ceil(self.half_delay) + math.ceil(_GUARD / min(bandwidth, 1.0))
        known = np.isfinite(self.delay + self.frequency)
        pairs, which = np.unique(np.stack([lags, self.half_frequency], axis=-1), axis=0, return_inverse=True)
        for i, (lag, half) in enumerate(pairs):
            chosen = np.flatnonzero((which.reshape(-1) == i) & known)
            if chosen.size:
                yield chosen, int(lag), float(half)


def _parts(chosen: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    step = max(1, _SAMPLES_AT_ONCE // size)
    for begin in range(0, chosen.size, step):
        yield chosen[begin : begin + step]


class _Health:
    """Scale of the samples and what is wrong with them, per trial."""

    def __init__(self, block: IqBlock, clipped_share: float) -> None:
        parts = np.ascontiguousarray(block.samples).view(block.samples.real.dtype)
        with np.errstate(invalid="ignore", over="ignore"):
            largest = np.maximum(parts.max(axis=-1), -parts.min(axis=-1)).astype(float)
        self.ok = np.isfinite(largest) & (largest > 0)
        self.scale = np.where(self.ok, largest, 1.0)
        at_limit = np.count_nonzero(np.abs(parts) >= largest[:, None], axis=-1)
        self.clipped = self.ok & (at_limit > clipped_share * parts.shape[-1])

    def at(self, part: NDArray[np.intp]) -> tuple[NDArray[np.bool_], Array, NDArray[np.bool_]]:
        own = part if self.ok.size > 1 else np.zeros_like(part)
        return self.ok[own], self.scale[own], self.clipped[own]


def _cut(block: IqBlock, part: NDArray[np.intp], begin: NDArray[np.int64], size: int, scale: Array) -> Complex:
    """Return `size` samples from `begin` on, of unit scale, zeros where there are none; shape (trials, size)."""
    out = np.zeros((part.size, size), dtype=np.complex64)
    for row, (trial, start) in enumerate(zip(part, begin, strict=True)):  # copies: every trial has a place of its own
        low, high = max(0, -start), min(size, block.size - start)
        if low < high:
            source = block.samples[trial if block.trials > 1 else 0, start + low : start + high]
            np.multiply(source, 1 / scale[row], out=out[row, low:high], casting="same_kind")
    return out


@dataclass(frozen=True)
class _Work:
    settings: CrossAmbiguity
    main: IqBlock
    auxiliary: IqBlock
    size: int
    first: int
    rate: float
    moments: Moments
    carrier: float
    tuned: float

    def run(
        self,
        part: NDArray[np.intp],
        jobs: _Jobs,
        grid: Grid,
        lead: Array,
        healthy: list[_Health],
        result: Differences,
    ) -> None:
        """Fill in the trials `part` of `result`."""
        size, lags = self.size, grid.lags
        (ok1, scale1, clipped1), (ok2, scale2, clipped2) = (health.at(part) for health in healthy)
        flag = np.where(ok1 & ok2, 0, Flag.NO_SIGNAL) | np.where(clipped1 | clipped2, Flag.CLIPPED, 0)
        # the first sample of the auxiliary block that is compared, and what is left of the delay when it is
        begin = np.rint(jobs.delay[part] - lead).astype(np.int64)
        base = begin + lead
        overlap = np.minimum(begin + size, self.auxiliary.size) - np.maximum(begin, 0)
        flag |= np.where(overlap < self.settings.overlap * size, Flag.NO_OVERLAP, 0)
        able = (flag & (Flag.NO_SIGNAL | Flag.NO_OVERLAP)) == 0
        result.flag[part] = flag
        part, begin, base, flag = part[able], begin[able], base[able], flag[able]
        if part.size == 0:
            return
        centre = jobs.frequency[part]
        x = _cut(self.main, part, np.full(part.size, self.first), size, scale1[able])
        y = _cut(self.auxiliary, part, begin - lags, size + 2 * lags, scale2[able])
        y *= phasor(-centre, -0.5 * (size - 1) - lags, size + 2 * lags)
        x, y, noise = self._filtered(x, y)
        power = ambiguity_grid(x, y, grid)

        wide = np.abs(np.arange(-lags, lags + 1) - (jobs.delay[part] - base)[:, None])
        bins = np.abs(np.arange(-grid.bins, grid.bins + 1)) * grid.step
        inside = (wide <= np.maximum(jobs.half_delay[part], 0.5)[:, None])[:, :, None] & (
            bins <= np.maximum(jobs.half_frequency[part], 0.5 * grid.step)[:, None]
        )[:, None, :]
        cell = np.array([1 / (self.moments.noise_bandwidth / self.rate), 1 / size])
        reach = np.maximum(jobs.half_delay[part], 0.5) + cell[0], jobs.half_frequency[part] + cell[1]
        near = (wide <= reach[0][:, None])[:, :, None] & (bins <= reach[1][:, None])[:, None, :]
        at, beyond = _coarse_peak(power, inside, near, grid)
        begin_delay, begin_frequency = at[:, 0], at[:, 1] * grid.step
        # cut anew at the peak, so that less than a sample is left
        lag = np.rint(begin_delay).astype(np.int64)
        y = np.take_along_axis(y, (lags + lag)[:, None] + np.arange(size), axis=1) if lags else y
        # one sample earlier or later in y is also another phase of the mixer: that does not matter for the modulus
        curvature = np.array([2 * self._lever(), 2 * np.square(_TIME_SPREAD * size)])
        drift = np.zeros(part.size)
        if self.carrier > 0:
            drift = -(centre + begin_frequency + self.tuned) / self.carrier
        fine = refine(x, y, begin_delay - lag, begin_frequency, cell, curvature, drift)

        flag |= np.where(fine.lost, Flag.LEFT_CELL, 0)
        crooked = fine.curvature[:, 1] > _SIDELOBE * curvature[1]
        flag |= np.where(beyond | crooked, Flag.EDGE, 0)
        self._report(part, jobs, fine, base + lag, centre, noise, x, y, flag, result)

    def _lever(self) -> float:
        """Return the mean square angular frequency [rad^2/sample^2]; of the prefilter where the signal's is unknown."""
        known = self.moments.bandwidth_squared
        if known is not None:
            return known / self.rate**2
        w = 2 * np.pi * self.moments.frequency / self.rate
        weight = self.moments.weight / self.moments.weight.sum()
        return float((weight * np.square(w - (weight * w).sum())).sum())

    def _filtered(self, x: Complex, y: Complex) -> tuple[Complex, Complex, Array]:
        """Return both behind the prefilter, and the mean power of |A| where there is no signal."""
        size, longer = x.shape[-1], y.shape[-1]
        points = fft.next_fast_len(longer, real=True)  # factors of 2, 3 and 5 only: half the time
        table = self.settings.prefilter.table(points, self.rate)
        x, y = fft.fft(x, points, axis=-1), fft.fft(y, points, axis=-1)
        x *= table
        y *= table
        px, py = (np.square(z.real) + np.square(z.imag) for z in (x, y))
        # by Parseval the sum over all delays, of which `longer` are as good as full; shifted, so that the signal
        # itself does not count
        noise = np.mean([(px * np.roll(py, k, axis=-1)).sum(axis=-1, dtype=float) for k in _NOISE_SHIFTS], axis=0)
        x, y = fft.ifft(x, axis=-1, overwrite_x=True), fft.ifft(y, axis=-1, overwrite_x=True)
        return x[:, :size], y[:, :longer], noise / (points * longer)

    def _report(
        self,
        part: NDArray[np.intp],
        jobs: _Jobs,
        fine: Peak,
        base: Array,
        centre: Array,
        noise: Array,
        x: Complex,
        y: Complex,
        flag: NDArray[np.int64],
        result: Differences,
    ) -> None:
        rate, duration = self.rate, self.size / self.rate
        result.delay[part] = (base + fine.delay) / rate
        frequency = centre + fine.frequency + self.tuned
        if self.carrier > 0:
            # A drift that is followed turns the phase by that of the oscillator's frequency; the signal, which both
            # receivers hear with a Doppler shift in common, is beside it.
            beside = fine.centre / (2 * np.pi * self.moments.pull)
            frequency = frequency * (1 + beside / self.carrier)
        result.frequency[part] = frequency * rate
        power = np.square(np.abs(fine.amplitude))
        peak = power / np.maximum(noise, np.finfo(float).tiny)
        rho = np.maximum(peak - 1, 0.0)
        half_delay, half_frequency = jobs.half_delay[part] / rate, jobs.half_frequency[part] * rate
        count = cells(half_delay, half_frequency, self.moments.noise_bandwidth, duration)
        result.peak[part] = peak
        sure = confidence(peak, 2 * half_delay / self.moments.noise_cell, 2 * half_frequency * duration)
        result.confidence[part] = sure
        result.right_cell[part] = right_cell_probability(rho, count)
        both = _energy(x) * _energy(y)
        result.coherence[part] = np.sqrt(np.minimum(power / np.maximum(both, np.finfo(float).tiny), 1.0))
        result.flag[part] = flag | np.where(sure < self.settings.confidence, Flag.BELOW_THRESHOLD, 0)

        # a peak of nothing but noise has no variance; it gets a large one
        signal = np.maximum(power - 2 * fine.quadrature, _LEAST * power)
        known = self.moments.bandwidth_squared
        lever = np.maximum(fine.lever, np.finfo(float).tiny) if known is None else known / rate**2
        result.variance[part, 0] = fine.spread / (signal * np.square(lever) * rate**2)
        result.variance[part, 1] = fine.quadrature / (signal * np.square(_TIME_SPREAD * duration))
        twice = 2 * np.maximum(rho, _LEAST)
        result.stein[part, 0] = 1 / (twice * lever * rate**2)
        result.stein[part, 1] = 1 / (twice * np.square(_TIME_SPREAD * duration))


def _energy(z: Complex) -> Array:
    return (np.square(z.real).sum(axis=-1, dtype=float) + np.square(z.imag).sum(axis=-1, dtype=float)).astype(float)


def _coarse_peak(
    power: NDArray[np.float32], inside: NDArray[np.bool_], near: NDArray[np.bool_], grid: Grid
) -> tuple[Array, NDArray[np.bool_]]:
    """Return where the power is highest inside, (trials, 2) [samples, bins].

    And whether it is higher within a cell outside, or much higher anywhere.
    """
    trials, rows, columns = power.shape
    allowed = np.where(inside, power, -1.0).reshape(trials, -1)
    best = np.argmax(allowed, axis=-1)
    trial = np.arange(trials)
    peak = allowed[trial, best]
    beside = np.where(near, power, -1.0).reshape(trials, -1).max(axis=-1)
    beyond = (beside > peak) | (power.reshape(trials, -1).max(axis=-1) > _MUCH * peak)
    row, column = np.divmod(best, columns)
    # on the border of what is computed there is no parabola; it is beyond the window by some cells, or flagged
    middle = np.clip(row, 1, rows - 2), np.clip(column, 1, columns - 2)
    around = np.arange(-1, 2)
    nine = power[
        trial[:, None, None], (middle[0][:, None] + around)[:, :, None], (middle[1][:, None] + around)[:, None, :]
    ]
    offset = parabola(nine)
    place = np.stack([middle[0] - grid.lags, middle[1] - grid.bins], axis=-1) + offset
    return place, beyond
