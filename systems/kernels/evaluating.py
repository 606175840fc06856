"""Values and derivatives of compiled equations over leading axes, as a measurement model gives them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call
from quietfix.systems.kernels.updating import fit, raised

__all__ = ["linearized", "values"]

Array = NDArray[np.float64]

_OVER_AXES = Parts((0, 1, 4, 5), -1, each=0.5, unit=256, good=-1)


def values(program: Program, target: Array, platforms: Array) -> Array:
    """Return the rows (..., m) for targets (..., n), seen from platforms (..., p, 6)."""
    return _evaluated(program, target, platforms, derivatives=False)[0]


def linearized(program: Program, target: Array, platforms: Array) -> tuple[Array, Array]:
    """Return the rows (..., m) and their derivatives (..., m, n).

    Leading axes of targets and platforms broadcast; rows that need no platform know nothing of theirs.

    Raises
    ------
    ValueError
        Where platforms or states are too few, or a user's kernel raised.
    """
    return _evaluated(program, target, platforms, derivatives=True)


def _evaluated(program: Program, target: Array, platforms: Array, derivatives: bool) -> tuple[Array, Array]:
    n = target.shape[-1]
    fit(program, n, platforms)
    if not program.equations.platforms:
        platforms = np.zeros((0, 6))
    lead = np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2])
    states, seen = _two_axes(target, lead, 1), _two_axes(platforms, lead, 2)
    a, b = states.shape[:2]
    value, jacobian = np.empty((a, b, program.rows)), np.empty((a, b, program.rows if derivatives else 0, n))
    arguments = states, seen, program.parts, program.parameters, value, jacobian
    code = call(ready("leading:over_axes"), arguments, a, _OVER_AXES, b)
    if code >= 0:
        i, j = divmod(code >> 8, b)
        raised(program, code & 255, states[i, j], seen[min(i, len(seen) - 1), min(j, seen.shape[1] - 1)])
    if not program.straight:
        value, jacobian = value[..., program.chosen], jacobian[:, :, program.chosen] if derivatives else jacobian
    return value.reshape(*lead, value.shape[-1]), jacobian.reshape(*lead, *jacobian.shape[-2:])


def _two_axes(array: Array, lead: tuple[int, ...], own: int) -> Array:
    """Return an array with two leading axes, each as long as that of all of `lead` in two, or 1 long."""
    cut = array.ndim - own
    front, rest = array.shape[:cut], array.shape[cut:]
    front = (1,) * (len(lead) - len(front)) + front
    if front != lead and (own == 1 or len(lead) > 2):  # what is repeated by its index is platforms, in two axes
        array, front = np.broadcast_to(array, (*lead, *rest)), lead
    if len(lead) > 2:
        array = array.reshape(math.prod(lead[:-1]), lead[-1], *rest)
    elif len(lead) < 2 or array.ndim < own + 2:
        array = array.reshape(*front, *(1,) * (2 - len(lead)), *rest)
    return array if array.flags.writeable and array.dtype.char == "d" else np.array(array, dtype=np.float64)
