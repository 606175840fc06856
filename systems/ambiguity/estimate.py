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

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.ambiguity.coarse import plan
from quietfix.systems.ambiguity.comparison import GUARD, Health, Jobs, Work, in_parts
from quietfix.systems.ambiguity.differences import Differences, Window
from quietfix.systems.ambiguity.limits import check_duration
from quietfix.systems.ambiguity.prefilter import Everything, Prefilter
from quietfix.systems.iq.block import IqBlock

__all__ = ["CrossAmbiguity"]

Array = NDArray[np.float64]


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
        jobs = Jobs(delay * rate, (frequency - tuned) / rate, half_delay * rate, half_frequency / rate)
        result = Differences.empty(trials)
        first = (main.size - size) // 2
        result.time[:] = main.start_time + (first + 0.5 * (size - 1)) / rate
        moments = self.prefilter.moments(rate)
        # where the auxiliary block begins, in samples after the first one that is compared
        lead = (auxiliary.start_time - main.start_time) * rate - first
        carrier = main.centre_frequency / rate if self.follow_rate else 0.0
        healthy = [Health(block, self.clipped_share) for block in (main, auxiliary)]
        work = Work(
            prefilter=self.prefilter,
            least_overlap=self.overlap,
            least_confidence=self.confidence,
            main=main,
            auxiliary=auxiliary,
            size=size,
            first=first,
            rate=rate,
            moments=moments,
            carrier=carrier,
            tuned=tuned / rate,
        )
        for chosen, lags, half in jobs.groups(moments.noise_bandwidth / rate, size):
            grid = plan(size, lags, half, GUARD)
            for part in in_parts(chosen, size + 2 * lags):
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
            from quietfix.systems.iq.resample import resampled

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
