"""One chunk of a study that has been run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

__all__ = ["Part", "added"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """A chunk of a study that has been run; it does not depend on which others have been.

    Attributes
    ----------
    number : int
        Which chunk of the study it is, from 0.
    begin : int
        How many trials of the study come before it.
    dataset : xarray.Dataset
        Its trials.
    sums : ndarray, optional
        Its part of the sums over all trials, see `quietfix.diagrams.statistics.bounds.StudyBounds.take`.
    told : tuple of str
        Warnings of a process that cannot print them itself.
    tally : mapping of str to ndarray
        Its part of the sums of errors, NEES and NIS, see `quietfix.diagrams.statistics.tally.Tally`; empty: not known.
    also : mapping of str to ndarray
        Little that is kept beside the sums: what a chunk has cost, or all that is made of it.
    """

    number: int
    begin: int
    dataset: xr.Dataset
    sums: Array | None = None
    told: tuple[str, ...] = ()
    tally: Mapping[str, Array] = field(default_factory=dict)
    also: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def end(self) -> int:
        """How many trials of the study there are up to its last one."""
        return self.begin + int(self.dataset.sizes["trial"])


def added(sums: Iterable[Array | None]) -> Array | None:
    """Return the sums of a study: those of its chunks, added in the order that is given.

    Floating point sums depend on their order: with that of the chunks the result is the same to the last bit, whoever
    has run them, and whenever.
    """
    total: Array | None = None
    for one in sums:
        if one is not None:
            total = one if total is None else total + one
    return total
