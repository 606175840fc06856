"""Predicted innovations and surprise, called from Python."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call
from quietfix.systems.kernels.updating import fit, plain, raised

__all__ = ["follow", "screened"]

Array = NDArray[np.float64]

_SCREEN = Parts((0, 1, 2, 3, 9, 10), 8, each=1.0, unit=4096)


def screened(
    mean: Array, covariance: Array, measurement: Array, platforms: Array, program: Program
) -> tuple[Array, Array]:
    """Return the innovations (trials, m), NaN in missing rows, and H P H' (trials, m, m), 0 there.

    Raises
    ------
    ValueError
        Where platforms are too few, or a user's kernel raised.
    """
    (trials, n), m, full = mean.shape, measurement.shape[-1], program.rows
    fit(program, n, platforms)
    given = [plain(array) for array in (mean, covariance, measurement, platforms)]
    out = np.empty((trials, m)), np.empty((trials, m, m))
    equations = program.parts, program.chosen, program.parameters, program.moduli
    space = np.empty(2 * m + full + n * (full + m))
    code = call(ready("recovery.screening:screen"), (*given, *equations, space, *out), trials, _SCREEN)
    if code:
        trial, part = code >> 12, (code >> 4) & 255
        raised(program, part, given[0][trial], given[3][trial if platforms.shape[0] > 1 else 0])
    return out


@cache
def _follow() -> Any:
    return ready("recovery.surprise:follow")


def follow(nis: Array, rows: Array, rule: tuple[float, float, float, float], total: Array) -> None:
    """Add, in place, to `total` (trials,) what an epoch says; see `quietfix.systems.kernels.recovery.surprise`."""
    _follow()(nis, rows, *rule, total)
