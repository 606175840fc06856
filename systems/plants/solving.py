"""A solution of differential equations that ends; SciPy steps on for ever where its steps grow too small."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from quietfix.systems.counting import tally

__all__ = ["solve"]

Array = NDArray[np.float64]

_MOST_CALLS = 400_000  # of the derivative, some ten seconds; a low orbit takes about 1000 a revolution


def solve(
    what: str, derivative: Callable[[float, Array], Array], begin: float, end: float, start: Array, **options: Any
) -> Any:
    """Return what ``scipy.integrate.solve_ivp`` does, with a dense output.

    Parameters
    ----------
    what : str
        What moves, for messages.
    derivative : callable
        ``derivative(t, x)``.
    begin, end : float
        [s]
    start : ndarray, shape (n,)
    **options
        Further options of ``solve_ivp``.

    Raises
    ------
    ValueError
        If there is no solution up to `end`, or it takes more than 400,000 calls of the derivative.
    """
    tally("solved")
    calls = 0

    def counted(t: float, x: ArrayLike) -> Array:
        nonlocal calls
        calls += 1
        if calls > _MOST_CALLS:
            raise ValueError(
                f"{what}: it moves too fast to be followed to {end:g} s, {_MOST_CALLS} steps reach {t:g} s; constants, "
                "the start or the end of the run are not allowed"
            )
        return derivative(t, np.asarray(x))

    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        solved = solve_ivp(counted, (begin, end), start, dense_output=True, **options)
    if not solved.success:
        raise ValueError(f"{what}: no solution up to {end:g} s: beyond {solved.t[-1]:g} s: {solved.message}")
    return solved
