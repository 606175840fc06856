"""Comparing the blocks of some trials: coarse peak, refinement, variances, flags."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from quietfix.systems.ambiguity.coarse import CoarseGrid, ambiguity_grid
from quietfix.systems.ambiguity.differences import Differences, Flag
from quietfix.systems.ambiguity.fine import Peak, parabola, refine
from quietfix.systems.ambiguity.phasor import phasor
from quietfix.systems.ambiguity.prefilter import Moments, Prefilter
from quietfix.systems.ambiguity.threshold import cells, confidence, right_cell_probability
from quietfix.systems.iq.block import IqBlock

__all__ = ["GUARD", "Health", "Jobs", "Work", "in_parts"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex64]

GUARD = 4.0  # cells beyond the window in which a peak of twice the power gives away that the window is too small
_MUCH = 2.0  # a repetition of a periodic signal beside the window is as high as the peak, and must not be that
_SIDELOBE = 2.0  # curvature of a side lobe of sinc is three times that of the main one
_SAMPLES_AT_ONCE = 1 << 17  # per channel: what a cache holds
_NOISE_SHIFTS = (-11, -5, 7, 13)  # bins; any few that are not the signal's own frequency difference
_LEAST = 1e-3
_TIME_SPREAD = math.pi / math.sqrt(3.0)


@dataclass(frozen=True)
class Jobs:
    """Windows in samples and cycles per sample, shape (trials,) each."""

    delay: Array
    frequency: Array
    half_delay: Array
    half_frequency: Array

    def groups(self, bandwidth: float, size: int) -> Iterator[tuple[NDArray[np.intp], int, float]]:
        """Yield trials whose windows are of one size, with their delays and half-width.

        The size of a trial's window alone says which transforms it sees, so its result does not depend on the others.
        """
        lags = np.ceil(self.half_delay) + math.ceil(GUARD / min(bandwidth, 1.0))
        known = np.isfinite(self.delay + self.frequency)
        pairs, which = np.unique(np.stack([lags, self.half_frequency], axis=-1), axis=0, return_inverse=True)
        for i, (lag, half) in enumerate(pairs):
            chosen = np.flatnonzero((which.reshape(-1) == i) & known)
            if chosen.size:
                yield chosen, int(lag), float(half)


def in_parts(chosen: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    """Yield as many trials at once as a cache holds."""
    step = max(1, _SAMPLES_AT_ONCE // size)
    for begin in range(0, chosen.size, step):
        yield chosen[begin : begin + step]


class Health:
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
        """Return of some trials whether there is a signal, its scale, and whether it is clipped."""
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
class Work:
    """How the trials of one grid are compared; sizes in samples, frequencies in cycles per sample.

    Attributes
    ----------
    prefilter : Prefilter
        What both channels pass.
    least_overlap, least_confidence : float
        What is flagged where there is less.
    main, auxiliary : IqBlock
        What the receivers heard.
    size, first : int
        How many samples are compared, and the first of them in the main block.
    rate : float
        Sample rate [Hz].
    moments : Moments
        Of the prefilter.
    carrier : float
        By which the delay drifts with the frequency; 0 where it does not.
    tuned : float
        Centre frequency of the auxiliary receiver minus that of the main one.
    """

    prefilter: Prefilter
    least_overlap: float
    least_confidence: float
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
        jobs: Jobs,
        grid: CoarseGrid,
        lead: Array,
        healthy: list[Health],
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
        flag |= np.where(overlap < self.least_overlap * size, Flag.NO_OVERLAP, 0)
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
        table = self.prefilter.table(points, self.rate)
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
        jobs: Jobs,
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
        result.flag[part] = flag | np.where(sure < self.least_confidence, Flag.BELOW_THRESHOLD, 0)

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
    power: NDArray[np.float32], inside: NDArray[np.bool_], near: NDArray[np.bool_], grid: CoarseGrid
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
