"""What was measured between receivers, as rows of a table of measurements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.readers.stamps import write_stamps
from quietfix.systems.fixes.standing import averaged

__all__ = ["Rows", "at_once", "write_rows"]

Array = NDArray[np.float64]

_FEWEST, _SURE = 3, 0.999


@dataclass(frozen=True, eq=False)
class Rows:
    """A quantity at times.

    Attributes
    ----------
    kind, receiver, reference, unit : str
        As the table names it.
    value, sigma : ndarray, shape (times,)
        NaN: it is missing.
    """

    kind: str
    receiver: str
    reference: str
    unit: str
    value: Array
    sigma: Array

    @property
    def there(self) -> NDArray[np.bool_]:
        """Where there is a value, shape (times,)."""
        found: NDArray[np.bool_] = np.isfinite(self.value) & np.isfinite(self.sigma) & (self.sigma > 0)
        return found


def at_once(rows: Rows, at: int) -> tuple[Rows, float]:
    """Return the weighted mean of what does not change, as a row at one time, and how much larger its scatter is.

    An estimator that takes the times one after the other, each about another estimate, would believe to learn of
    directions of which the rows tell nothing, such as the height of what is heard by three receivers on the ground.

    Parameters
    ----------
    rows : Rows
    at : int
        Which of the times.

    Returns
    -------
    Rows
    float
        By how much sigma was enlarged, for the values scatter so; 1 where that is chance (in 999 of 1000).
    """
    there = rows.there
    mean, sigma = averaged(rows.value[there, None], rows.sigma[there, None])
    dof = int(there.sum()) - 1
    scatter = float(np.square((rows.value[there] - mean[0, 0]) / rows.sigma[there]).sum())
    larger = math.sqrt(scatter / dof) if dof >= _FEWEST and scatter > chi2.ppf(_SURE, dof) else 1.0
    value, spread = np.full(there.size, np.nan), np.full(there.size, np.nan)
    value[at], spread[at] = mean[0, 0], larger * sigma[0, 0]
    return replace(rows, value=value, sigma=spread), larger


def write_rows(
    path: Path, began: tuple[int, float] | None, times: Array, rows: Sequence[Rows], target: str = "emitter"
) -> int:
    """Write a table that ``quietfix run FILE.yaml --measurements`` reads; return how many rows it has.

    Parameters
    ----------
    path : Path
    began : (int, float), optional
        Time 0 in seconds of TAI since 1970; None: nobody knows, and the table has ``time_s``.
    times : ndarray, shape (times,)
        [s]
    rows : sequence of Rows
    target : str
        Name of what was heard.
    """
    shown = [repr(float(t)) for t in times] if began is None else write_stamps(began, times)
    count = 0
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{'time_s' if began is None else 'time'},target,kind,receiver,reference,value,unit,sigma\n")
        for line in _lines(shown, rows, target):
            file.write(line)
            count += 1
    return count


def _lines(times: Sequence[str], rows: Sequence[Rows], target: str) -> Iterator[str]:
    middles = [f",{target},{one.kind},{one.receiver},{one.reference}," for one in rows]
    there: Iterable[NDArray[np.bool_]] = np.array([one.there for one in rows]).reshape(len(rows), len(times)).T
    for k, (time, found) in enumerate(zip(times, there, strict=True)):
        for i in np.flatnonzero(found).tolist():
            one = rows[i]
            yield f"{time}{middles[i]}{float(one.value[k])!r},{one.unit},{float(one.sigma[k])!r}\n"
