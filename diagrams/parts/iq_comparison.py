"""Pairs of I/Q recordings: what they have in common, and what a comparison of two gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.systems.ambiguity.differences import Flag
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.signal_chain.cross_ambiguity import QUALITY

__all__ = ["PAIR_SIGNALS", "PairResult", "Piece", "pair_result", "pieces"]

Array = NDArray[np.float64]

PAIR_SIGNALS = ("measurement", "noise_covariance", "quality")
"""Signals of every pair of receivers i (main) and j (auxiliary), ``SIGNAL_ji``."""


class Piece(NamedTuple):
    """A time that all recordings have in common without a gap: from, to [s], and the part of each recording."""

    begin: float
    end: float
    parts: tuple[IqBlock, ...]

    @property
    def duration(self) -> float:
        """How long it is [s]."""
        return self.end - self.begin


def pieces(recordings: Sequence[Sequence[IqBlock]]) -> list[Piece]:
    """Return what recordings have in common, in the order of time.

    Parameters
    ----------
    recordings : sequence of sequence of IqBlock
        The parts of each recording, which do not overlap.
    """
    found = [Piece(-np.inf, np.inf, ())]
    for parts in recordings:
        found = [
            Piece(begin, end, (*piece.parts, part))
            for piece in found
            for part in parts
            if (begin := max(piece.begin, float(part.start_time[0])))
            < (end := min(piece.end, float(part.start_time[0]) + part.size / part.sample_rate))
        ]
    return sorted(found, key=lambda piece: piece.begin)


@dataclass(frozen=True, eq=False)
class PairResult:
    """TDOA and FDOA of a pair against time; NaN where flagged.

    Attributes
    ----------
    main, auxiliary : str
        Names of the receivers; the differences are auxiliary minus main.
    tdoa, fdoa, sigma_tdoa, sigma_fdoa : ndarray, shape (samples,)
        [s], [Hz], and the standard deviations that the samples let expect.
    peak, coherence : ndarray, shape (samples,)
        See `quietfix.systems.ambiguity.differences.Differences`.
    flag : ndarray of int, shape (samples,)
        Sum of `Flag`.
    """

    main: str
    auxiliary: str
    tdoa: Array
    fdoa: Array
    sigma_tdoa: Array
    sigma_fdoa: Array
    peak: Array
    coherence: Array
    flag: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """Where there is a measurement, shape (samples,)."""
        return np.isfinite(self.tdoa)

    @property
    def scatter(self) -> float:
        """Standard deviation of the TDOAs [s]; NaN: there is none."""
        return float(np.std(self.tdoa[self.good])) if self.good.any() else np.nan

    @property
    def typical_sigma(self) -> float:
        """Median of `sigma_tdoa` [s]; NaN: there is none."""
        return float(np.median(self.sigma_tdoa[self.good])) if self.good.any() else np.nan

    def reasons(self) -> str:
        """Return what was flagged and how often, in words; empty if nothing was."""
        found = [(flag, int(np.count_nonzero(self.flag & flag))) for flag in Flag if flag]
        return ", ".join(f"{str(flag.name).lower().replace('_', ' ')} {count}" for flag, count in found if count)


def pair_result(names: Sequence[str], pair: tuple[int, int], result: xr.Dataset) -> PairResult:
    """Return what was found of one pair in a study's result."""
    i, j = pair
    logs = (result[f"{port}_{j}{i}"].isel(trial=0) for port in PAIR_SIGNALS)
    measured, noise, quality = (log.transpose("time", ...).values for log in logs)
    column = {name: quality[:, k] for k, name in enumerate(QUALITY)}
    return PairResult(
        names[i],
        names[j],
        measured[:, 0],
        measured[:, 1],
        np.sqrt(noise[:, 0]),
        np.sqrt(noise[:, 3]),
        column["peak_to_noise"],
        column["coherence"],
        column["flag"].astype(np.int64),
    )
