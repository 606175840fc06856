"""Percentiles over the trials, also of more than fit into memory: they are sorted epoch by epoch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from tempfile import SpooledTemporaryFile
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

__all__ = ["Columns", "median", "percentile", "percentiles_of"]

Array = NDArray[np.float64]

_HUGE = 1e150  # stands for infinity while percentiles are interpolated; its square is still finite
_IN_MEMORY = 1 << 27  # bytes; columns that need more wait in a file
_AT_ONCE = 1 << 23  # bytes of columns that are handed out together


def median(error: xr.DataArray) -> xr.DataArray:
    """Return the median over the trials of the size of the error; lost trials count as infinite."""
    return percentile(error, 50.0)


def percentile(error: xr.DataArray, percent: float) -> xr.DataArray:
    """Return a percentile over the trials of the size of the error.

    Parameters
    ----------
    error : xarray.DataArray
        With the dimension ``trial``; one of `errors`.
    percent : float
        0 to 100.

    Returns
    -------
    xarray.DataArray
        Interpolated between order statistics; infinite where a lost trial takes part, NaN where no truth is known.
    """
    if not 0 <= percent <= 100:
        raise ValueError(f"percent: {percent} is not allowed; 0 to 100")
    values = percentiles_of(error.transpose("trial", ...).values, (percent,))[0]
    return error.isel(trial=0, drop=True).copy(data=values)


def percentiles_of(numbers: Array, percents: Sequence[float]) -> Array:
    """Return percentiles of the sizes of numbers (trials, ...), as `percentile`: (percents, ...)."""
    size = np.minimum(np.abs(numbers), _HUGE)  # between two infinities interpolation would give NaN
    values = np.full((len(percents), *size.shape[1:]), np.nan)
    known = np.isfinite(size).any(axis=0)
    if known.any():
        values[:, known] = np.nanpercentile(size[:, known], percents, axis=0)
    return np.where(values > 1e-3 * _HUGE, np.inf, values)


class Columns:
    """Numbers (trial, column) that come trial by trial and are wanted column by column, as a quantile wants them.

    Parameters
    ----------
    trials, columns : int
        How many there are.
    """

    def __init__(self, trials: int, columns: int) -> None:
        self.trials, self.columns = trials, columns
        self._spool: Any = SpooledTemporaryFile(_IN_MEMORY)  # noqa: SIM115

    def put(self, begin: int, numbers: Array) -> None:
        """Take the numbers (some trials, columns) of the trials from `begin` on."""
        for column, values in enumerate(np.ascontiguousarray(numbers.T)):
            self._spool.seek(8 * (column * self.trials + begin))
            self._spool.write(values.tobytes())

    def take(self) -> Iterator[tuple[slice, Array]]:
        """Yield some columns after the other: which they are, and their numbers (trials, some)."""
        step = max(1, _AT_ONCE // (8 * max(1, self.trials)))
        for first in range(0, self.columns, step):
            some = slice(first, min(first + step, self.columns))
            self._spool.seek(8 * first * self.trials)
            read = np.frombuffer(self._spool.read(8 * (some.stop - first) * self.trials))
            yield some, read.reshape(some.stop - first, self.trials).T

    def close(self) -> None:
        """Forget all."""
        self._spool.close()
