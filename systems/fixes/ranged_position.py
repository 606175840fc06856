"""A position from one instant of ranging as a measurement: its covariance depends on where the target is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.fixes.ranging import RangingEquation
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["RangedPosition", "ranging_equation"]

Array = NDArray[np.float64]

_NOMINAL = 130e3  # m; the median range error of the paper's arc


def ranging_equation(sensor: MeasurementModel) -> RangingEquation:
    """Return the ranging equation with the constants of a sensor, which must have all six rows.

    Raises
    ------
    ValueError
        If a row is missing: angles, rates and radial acceleration give the range, the radial velocity the orbit.
    """
    if not isinstance(sensor, RelativeKinematics) or len(sensor.names) < len(ROWS):
        raise ValueError(
            f"ranging needs all rows of one sensor: {', '.join(ROWS)}; there are {', '.join(sensor.names)}"
        )
    return RangingEquation(sensor.constants, sensor.j2)


class RangedPosition(MeasurementModel):
    r"""Inertial position, eq. (44) and (45) of Wu, Xin and Wan.

    .. math:: h(x) = p, \qquad R = G\,\mathrm{diag}(\sigma_1^2, ..., \sigma_6^2)\,G^T

    with G the derivative of the ranged position by the six rows.

    Parameters
    ----------
    sensor : RelativeKinematics
        All six rows; from their errors follows the covariance.
    """

    names = ("position_x", "position_y", "position_z")
    units = ("m", "m", "m")

    def __init__(self, sensor: RelativeKinematics) -> None:
        self.sensor = sensor
        self.equation = ranging_equation(sensor)

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        leading = np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2])
        return np.broadcast_to(target[..., :3], (*leading, 3))

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        leading = np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2])
        jacobian = np.zeros((*leading, 3, target.shape[-1]))
        jacobian[..., :3] = np.eye(3)
        return jacobian

    def noise_covariance(self) -> Array:
        """Return a nominal covariance; the one that counts comes with the measurement, or from the method below."""
        return _NOMINAL**2 * np.eye(3)

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the position for a target at `target`, shape (..., 3, 3)."""
        observer = platforms[..., self.sensor.observer, :]
        return self.covariance_of(target, observer, self.sensor.predict(target, platforms))

    def covariance_of(self, target: Array, observer: Array, rows: Array) -> Array:
        """Return the covariance of the position (..., 3, 3) where a target would be measured by these six `rows`."""
        distance = np.linalg.norm(target[..., :3] - observer[..., :3], axis=-1)
        return self.equation.position_covariance(distance, rows, observer, self.sensor.sigmas)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """No platform is needed: the position is already inertial."""
        return np.zeros((3, platforms), dtype=bool)
