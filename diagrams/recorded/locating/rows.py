"""What was measured between receivers, as rows of a table of measurements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.stamps import write_stamps

__all__ = ["Rows", "write_rows"]

Array = NDArray[np.float64]


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
