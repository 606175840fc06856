"""Which platforms and target see each other: over the horizon, past the Earth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.geodetic import up

__all__ = ["EarthOccultation", "ElevationMask", "Mask", "SphericalMask"]

Array = NDArray[np.float64]


class Mask(Protocol):
    """Says who sees whom."""

    def visible(self, target: Array, platforms: Array) -> NDArray[np.bool_]:
        """Return whether each of platforms (..., p, 6) sees the target (..., n), shape (..., p)."""


@dataclass(frozen=True)
class ElevationMask:
    """A platform is visible if it stands high enough above the local horizon.

    Parameters
    ----------
    minimum : float
        Smallest elevation [rad], between -pi/2 and pi/2.
    at : {'target', 'platform'}
        Whose horizon: 'target' for satellites that look down, 'platform' for stations that look up.
    """

    minimum: float = 0.0
    at: Literal["target", "platform"] = "target"

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not -math.pi / 2 <= self.minimum <= math.pi / 2:
            raise ValueError(f"elevation mask: {self.minimum} is not allowed; from -pi/2 to pi/2 rad")

    def vertical(self, position: Array) -> Array:
        """Return the upward unit vector at Earth-fixed positions (..., 3)."""
        return up(position)

    def elevation(self, target: Array, platforms: Array) -> Array:
        """Return the elevation [rad], shape (..., p)."""
        offset = platforms[..., :3] - target[..., None, :3]
        if self.at == "target":
            normal = self.vertical(target[..., :3])[..., None, :]
        else:
            normal, offset = self.vertical(platforms[..., :3]), -offset
        height = np.einsum("...i,...i->...", normal, offset)
        distance = np.sqrt(np.einsum("...i,...i->...", offset, offset))
        # straight overhead, rounding can make the sine more than 1
        return np.arcsin(np.clip(height / distance, -1.0, 1.0))

    def visible(self, target: Array, platforms: Array) -> NDArray[np.bool_]:
        """Return whether each platform is visible, shape (..., p)."""
        return self.elevation(target, platforms) >= self.minimum


@dataclass(frozen=True)
class SphericalMask(ElevationMask):
    """The same over a spherical Earth, in any axes.

    Parameters
    ----------
    centre : tuple of float
        Centre of the Earth in the axes of target and platforms [m].
    """

    centre: tuple[float, ...] = (0.0, 0.0, 0.0)

    def vertical(self, position: Array) -> Array:
        """See `ElevationMask.vertical`."""
        out = position - np.array(self.centre)
        return out / np.linalg.norm(out, axis=-1, keepdims=True)


@dataclass(frozen=True)
class EarthOccultation:
    """A platform sees the target unless a sphere about the centre of the Earth is between them.

    Parameters
    ----------
    radius : float
        Of the sphere [m], > 0: the Earth's, or more where the atmosphere counts.
    """

    radius: float

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"occultation radius: {self.radius} is not allowed; it must be > 0 m")

    def visible(self, target: Array, platforms: Array) -> NDArray[np.bool_]:
        """Return whether each platform sees the target, shape (..., p)."""
        place = platforms[..., :3]
        offset = target[..., None, :3] - place
        length = (offset * offset).sum(axis=-1)
        # share of the way at which the line of sight is nearest to the centre
        share = np.clip(-(place * offset).sum(axis=-1) / length, 0.0, 1.0)
        nearest = place + share[..., None] * offset
        return (nearest * nearest).sum(axis=-1) >= self.radius**2
