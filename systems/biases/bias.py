"""What a bias is: a number that is wrong in the same way at all times, or nearly so."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Bias", "Turn"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Turn:
    """A rotation of the axes in which a platform measures directions, about one of them.

    Attributes
    ----------
    platform : int
        Which platform.
    about : int
        0, 1 or 2: about the axis x (roll), y (pitch) or z (yaw) of the platform.
    axes : int
        Space dimensions of the target's state; in the plane only about z.
    body : callable, optional
        From the platform's state (..., 6) to its believed axes as rows (..., 3, 3); by default those of the states.
    """

    platform: int
    about: int
    axes: int = 3
    body: Callable[[Array], Array] | None = None

    def __post_init__(self) -> None:
        """Check the axis."""
        if self.about not in (0, 1, 2) or (self.axes == 2 and self.about != 2):
            raise ValueError(f"turn: about axis {self.about} is not allowed; 0, 1 or 2, in the plane 2 alone")


@dataclass(frozen=True)
class Bias:
    r"""One number that rows of a measurement have in common, beside their noise.

    :math:`b_0 \sim N(0, \sigma^2)`, and from then on :math:`db = w\,dW`, a random walk.

    Attributes
    ----------
    name : str
        What the state is called.
    unit : str
        SI.
    sigma : float
        Standard deviation at the start, > 0.
    walk : float
        Standard deviation that it gains in a second [unit/sqrt(s)], >= 0.
    rows : mapping of str to float
        Rows that it enters; of one that is added, with which factor.
    considered : bool
        Its uncertainty counts, but it is not estimated.
    turn : Turn, optional
        Where it is an angle, of which axes; it is then not added to the rows.
    true : float
        What it is worth in the truth, as far as that is known: where bounds take their derivatives.
    """

    name: str
    unit: str
    sigma: float
    walk: float = 0.0
    rows: Mapping[str, float] = field(default_factory=dict)
    considered: bool = False
    turn: Turn | None = None
    true: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (math.isfinite(self.sigma) and self.sigma > 0):
            raise ValueError(f"{self.name}: sigma {self.sigma} is not allowed; a finite number > 0 {self.unit}")
        if not (math.isfinite(self.walk) and self.walk >= 0):
            raise ValueError(f"{self.name}: walk {self.walk} is not allowed; a finite number >= 0 {self.unit}/sqrt(s)")
        if not self.rows:
            raise ValueError(f"{self.name}: no row has this bias")
