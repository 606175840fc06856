"""Angles, angle rates, radial velocity and radial acceleration of one satellite seen from another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["ROWS", "RelativeKinematics", "SightAxes", "sight_axes"]

Array = NDArray[np.float64]

ROWS = {
    "azimuth": "rad",
    "elevation": "rad",
    "azimuth_rate": "rad/s",
    "elevation_rate": "rad/s",
    "radial_velocity": "m/s",
    "radial_acceleration": "m/s^2",
}
"""Every row that can be measured, and its unit."""


@dataclass(frozen=True)
class SightAxes:
    r"""The spherical unit vectors of a direction, in inertial axes.

    Attributes
    ----------
    radial, azimuthal, elevational : ndarray, shape (..., 3)
        :math:`e_r = (\cos\beta\cos\epsilon, \sin\beta\cos\epsilon, \sin\epsilon)` (the paper's (3) prints
        :math:`\sin\beta` as its third component), :math:`e_\beta`, :math:`e_\epsilon`.
    cosine, sine : ndarray, shape (...)
        Of the elevation.
    """

    radial: Array
    azimuthal: Array
    elevational: Array
    cosine: Array
    sine: Array


def sight_axes(azimuth: Array, elevation: Array) -> SightAxes:
    """Return the unit vectors for azimuth and elevation [rad], shape (...)."""
    cb, sb, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return SightAxes(
        np.stack([cb * ce, sb * ce, se], axis=-1),
        np.stack([-sb, cb, np.zeros_like(sb)], axis=-1),
        np.stack([-cb * se, -sb * se, ce], axis=-1),
        ce,
        se,
    )


class RelativeKinematics(CompiledModel):
    r"""What a satellite measures of another one, in inertial axes.

    With :math:`\rho` the vector from observer to target, w its velocity and a its acceleration:

    .. math:: \beta = \mathrm{atan2}(y, x), \quad \epsilon = \mathrm{atan2}(z, q), \quad q^2 = x^2 + y^2, \\
              \dot\beta = e_\beta\cdot w/q, \quad \dot\epsilon = e_\epsilon\cdot w/r, \\
              \dot r = e_r\cdot w, \quad \ddot r = e_r\cdot a + (w^2 - \dot r^2)/r

    Both accelerations follow from the positions through the dynamics (two-body or J2), so that the radial
    acceleration is a function of the two states; its derivative has the target's gravity gradient in it.
    Section 2 of Wu, Xin and Wan, *Progress in Natural Science* (in Chinese, 2008).

    Parameters
    ----------
    sigmas : mapping of str to float
        Standard deviation of each row that is measured; keys from `ROWS`. The rows come in the order of `ROWS`.
    constants : GravityConstants, optional
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts on both satellites.
    observer : int
        Which platform carries the sensor.
    """

    def __init__(
        self,
        sigmas: Mapping[str, float],
        constants: GravityConstants | None = None,
        j2: bool = False,
        observer: int = 0,
    ) -> None:
        unknown = [row for row in sigmas if row not in ROWS]
        if unknown or not sigmas:
            raise ValueError(f"rows: {unknown or 'none'} is not allowed; any of {', '.join(ROWS)}")
        self.names = tuple(row for row in ROWS if row in sigmas)
        self.units = tuple(ROWS[row] for row in self.names)
        self.constants = constants or GravityConstants()
        self.j2 = bool(j2)
        self.observer = observer
        self._sigmas = np.array([positive(sigmas[row], f"sigma_{row}", ROWS[row]) for row in self.names])
        self._rows = [list(ROWS).index(row) for row in self.names]
        self._angles = np.array([row in ("azimuth", "elevation") for row in self.names])

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        earth = self.constants
        flat = 1.5 * earth.j2 * earth.radius**2 if self.j2 else 0.0
        return of_kernel(
            "kinematics:relative_kinematics",
            [self.observer, earth.mu, flat, *self._rows],
            self.size,
            modulus=[2 * np.pi if angle else 0.0 for angle in self._angles],
            states=6,
            platforms=[self.observer],
        )

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.diag(self._sigmas**2)

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`; angles are wrapped."""
        difference = np.asarray(measured - predicted)
        if self._angles.any():
            difference[..., self._angles] = wrap(difference[..., self._angles])
        return difference

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`: an azimuth in [-pi, pi)."""
        if self._rows[0] != 0:  # by number, as the rows may be renamed
            return value
        shown = np.array(value)
        shown[..., 0] = wrap(shown[..., 0])
        return shown

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Only the satellite that carries the sensor."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.observer] = True
        return used


def rows_of(kinds: Sequence[str]) -> list[str]:
    """Return the rows of kinds such as ``angles`` and ``rates``; a row's own name is a kind as well."""
    groups = {
        "angles": ("azimuth", "elevation"),
        "rates": ("azimuth_rate", "elevation_rate"),
    }
    wanted = {row for kind in kinds for row in groups.get(kind, (kind,))}
    return [row for row in ROWS if row in wanted]
