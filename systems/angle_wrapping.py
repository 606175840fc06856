"""Angles and phases, wrapped into one turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["wrap"]

Array = NDArray[np.float64]


def wrap(angle: Array) -> Array:
    """Wrap angles [rad] into [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
