"""A cumulative sum of how surprising the innovations of many trials are."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined

__all__ = ["follow", "followed"]


@inlined
def followed(nis: float, rows: float, gain: float, each: float, most: float, full: float, total: float) -> float:
    """Return a trial's sum after this epoch; see `follow`."""
    if rows > 0.0:
        step = gain * nis - each * rows
        if not step < most:  # nor where it is not a number
            step = most
        return max(0.0, min(full, total + step))
    return total


@compiled("void(float64[::1],float64[::1],float64,float64,float64,float64,float64[::1])")
def follow(nis: Any, rows: Any, gain: float, each: float, most: float, full: float, total: Any) -> None:
    """Add to `total` what this epoch says: gain NIS - each rows, at most `most`; the sum stays between 0 and `full`.

    A trial without a row stays as it is; a NIS that is not a number says as much as one can.
    """
    for t in range(total.shape[0]):
        total[t] = followed(nis[t], rows[t], gain, each, most, full, total[t])
