"""Phase differences of a two-axis interferometer, and the angles that they mean."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.geometry.body_frame import body_frame
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["InterferometerPhase", "phase_angle"]

Array = NDArray[np.float64]

Axis = Literal["a", "b"]


def phase_angle(phase: Array, baseline: float, wavelength: float) -> Array:
    r"""Return the angle between the baseline and the line of sight that an unambiguous phase means.

    .. math:: \beta = \arccos\frac{\varphi}{2\pi n}, \qquad n = d/\lambda

    Eq. (4) of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. The error of the angle is
    :math:`\sigma_\varphi/(2\pi n\sin\beta)`: it depends on the direction, and near end-fire it is neither small nor
    Gaussian; that is why the phase, not the angle, is the measurement.

    Parameters
    ----------
    phase : array_like
        Unambiguous phase difference [rad].
    baseline, wavelength : float
        d and lambda [m].

    Returns
    -------
    ndarray
        Angle [rad] in [0, pi]; NaN where the phase is impossible, ``|phase| > 2 pi n``.
    """
    n = positive(baseline, "baseline", "m") / positive(wavelength, "wavelength", "m")
    cosine = np.asarray(phase, dtype=float) / (2 * np.pi * n)
    return np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))


class InterferometerPhase(CompiledModel):
    r"""Phase differences of orthogonal baselines on one satellite that points to nadir.

    .. math:: \varphi_a = 2\pi n\, x_b/r, \qquad \varphi_b = 2\pi n\, y_b/r, \qquad n = d/\lambda

    Eq. (5)-(7) of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005: a along track (x along the inertial
    velocity), b across (y = z x x, z to nadir); :math:`(x_b, y_b, z_b)` is the target in the body frame.

    Parameters
    ----------
    sigma : float
        Standard deviation of a phase [rad].
    baseline, wavelength : float
        d and lambda [m].
    axes : sequence of 'a', 'b'
        Which baselines there are.
    platform : int
        The satellite that carries them.
    wrapped : bool
        True: the sensor reports the phase in [-pi, pi), and residuals are wrapped. False: unambiguous.
    earth_rate : float
        Earth rotation [rad/s], to turn Earth-fixed into inertial velocity.
    """

    def __init__(
        self,
        sigma: float,
        baseline: float,
        wavelength: float,
        axes: Sequence[Axis] = ("a", "b"),
        platform: int = 0,
        wrapped: bool = False,
        earth_rate: float = EARTH_RATE,
    ) -> None:
        self.sigma = positive(sigma, "sigma_phase", "rad")
        self.wavelength = positive(wavelength, "wavelength", "m")
        self.baseline = positive(baseline, "baseline", "m")
        self.platform = platform
        self.wrapped = wrapped
        self.earth_rate = earth_rate
        if not axes or any(axis not in ("a", "b") for axis in axes):
            raise ValueError(f"phase axes: {list(axes)} is not allowed; 'a', 'b' or both")
        self._rows = ["ab".index(axis) for axis in axes]
        self.names = tuple(f"phase_{axis}" for axis in axes)
        self.units = ("rad",) * len(self.names)

    def only(self, names: Sequence[str]) -> InterferometerPhase:
        """Return the same interferometer with the baselines of rows `names` alone."""
        found, rows = copy(self), [i for i, row in enumerate(self.names) if row in names]
        found._rows = [self._rows[i] for i in rows]
        found.names, found.units = tuple(self.names[i] for i in rows), ("rad",) * len(rows)
        return found

    def unambiguous(self) -> InterferometerPhase:
        """Return the same interferometer with phases that are not wrapped."""
        found = copy(self)
        found.wrapped = False
        return found

    @property
    def cycles(self) -> float:
        """Baseline over wavelength."""
        return self.baseline / self.wavelength

    def body_axes(self, platforms: Array) -> Array:
        """Return 2 pi n times the baseline directions in Earth-fixed axes, shape (..., m, 3)."""
        frame = body_frame(platforms, self.platform, self.earth_rate)
        return (2 * np.pi * self.cycles) * frame[..., self._rows, :]

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        parameters = [2 * np.pi * self.cycles, self.earth_rate, self.platform, *self._rows]
        modulus = 2 * np.pi if self.wrapped else 0.0
        return of_kernel(
            "sight:interferometer_phase", parameters, self.size, modulus=modulus, states=3, platforms=[self.platform]
        )

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`; wrapped for a wrapped sensor."""
        difference = measured - predicted
        return wrap(difference) if self.wrapped else difference

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return wrap(value) if self.wrapped else value

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Only the satellite with the interferometer."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.platform] = True
        return used
