"""Compiled equations with biases: each kernel that has some is called by one that knows them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.biases.bias import Turn
from quietfix.systems.geometry.body_frame import NadirAxes
from quietfix.systems.kernels.equations import Equations, Kernel
from quietfix.systems.kernels.loading import address

__all__ = ["biased_equations"]

Array = NDArray[np.float64]
Turned = tuple[Turn, list[int], list[int]]


def biased_equations(inner: Equations, states: int, shares: Array, turned: Sequence[Turned]) -> Equations | None:
    """Return equations with biases behind the state.

    Parameters
    ----------
    inner : Equations
        Without them.
    states : int
        How many components the state of those has.
    shares : ndarray, shape (m, k)
        What is added to each row for one of each bias.
    turned : sequence of (Turn, rows, places)
        Platforms with turned axes: which rows, and which biases the rotation about x, y and z is; -1: none.

    Returns
    -------
    Equations or None
        None where a kernel makes rows of which some are turned and others not, or in axes that have no kernel.
    """
    kernels: list[Kernel] = []
    parameters = []
    last = 0
    for kernel, size, given in zip(inner.kernels, inner.sizes, inner.parameters, strict=True):
        first, last = last, last + size
        # of each row of the model that this kernel makes: where it stands there
        own = {i: row - first for i, row in enumerate(inner.chosen) if first <= row < last}
        for turn, rows, places in turned:
            among = own.keys() & set(rows)
            if not among:
                continue
            kind = _kind(turn)
            if kind is None or among != own.keys():
                return None
            found = [states + k if k >= 0 else -1 for k in places]
            kernel, given = "biases:turned", (address(kernel), states, turn.platform, turn.axes, *kind, *found, *given)
        added = [(own[i], states + k, shares[i, k]) for i in own for k in np.flatnonzero(shares[i]).tolist()]
        # a user's kernel is not to see the biases: it may loop over all of the state
        if added or callable(kernel):
            numbers = [number for one in added for number in one]
            kernel, given = "biases:added", (address(kernel), states, len(added), *numbers, *given)
        kernels.append(kernel)
        parameters.append(tuple(map(float, given)))
    needed = max([inner.platforms, *(turn.platform + 1 for turn, _, _ in turned)])
    return Equations(
        tuple(kernels),
        inner.sizes,
        tuple(parameters),
        inner.chosen,
        inner.moduli,
        states + shares.shape[1],
        needed,
        6 if turned else inner.coordinates,
    )


def _kind(turn: Turn) -> tuple[float, float] | None:
    """Return what the kernel calls a platform's axes, and the Earth's rate; None where it does not know them."""
    if turn.body is None:
        return 0.0, 0.0
    return (1.0, turn.body.earth_rate) if isinstance(turn.body, NadirAxes) else None
