"""Sums over trials that do not depend, to the last bit, on how the trials are cut into chunks."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled

__all__ = ["add_finite"]


@compiled("void(float64[:,::1],int64,float64[::1],float64[::1])")
def add_finite(values: Any, trials: int, sums: Any, counts: Any) -> None:
    """Add to `sums` and `counts` (k,) what is finite of values (k, trials or 1), one trial after the other."""
    alike = values.shape[1] == 1
    for i in range(values.shape[0]):
        total, count = sums[i], counts[i]
        for t in range(trials):
            value = values[i, 0 if alike else t]
            if value - value == 0.0:
                total += value
                count += 1.0
        sums[i], counts[i] = total, count
