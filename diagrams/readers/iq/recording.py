"""What a recording of samples holds, whatever the file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_SAMPLES", "IqRecording", "Segment"]

MOST_SAMPLES = 1 << 25
"""Of all channels of a recording together; with what is made of them they take less than 1 GB."""


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples without a gap.

    Attributes
    ----------
    samples : ndarray of complex64, shape (n,)
    frequency : float
        To which the receiver was tuned [Hz]; 0 where the file does not say.
    begin : float
        Since the first sample of the recording [s].
    dated : bool
        Whether a date says so, instead of the samples since then.
    """

    samples: NDArray[np.complex64]
    frequency: float
    begin: float
    dated: bool = False


@dataclass(frozen=True, eq=False)
class IqRecording:
    """What a file holds.

    Attributes
    ----------
    name : str
        Name of the recording without its ending.
    sample_rate : float
        [Hz]
    segments : tuple of Segment
        One or more; captures that follow each other without a gap at one frequency are one segment.
    start : (int, float) or None
        UTC of the first sample: whole seconds since 1970, and the rest [s]; None where the file does not say.
    unclaimed : int
        Samples before the first capture, which says nothing of them: they are left out.
    others : tuple of tuple of Segment
        The same segments of further channels, which were sampled together with the first.
    places : ndarray, shape (k, 4), or None
        Where the receiver was: seconds since the first sample, latitude, longitude [deg], height above the ellipsoid
        [m]; None where the file does not say.
    notes : tuple of str
        What is doubtful.
    """

    name: str
    sample_rate: float
    segments: tuple[Segment, ...]
    start: tuple[int, float] | None
    unclaimed: int = 0
    others: tuple[tuple[Segment, ...], ...] = ()
    places: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[tuple[Segment, ...], ...]:
        """Segments of all channels, the first one first."""
        return (self.segments, *self.others)
