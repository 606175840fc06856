"""A measurement model with what the atmosphere adds to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.atmosphere.columns import Medium
from quietfix.systems.atmosphere.sights import End, Sights, sights
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Delayed", "Excess", "excess", "in_vacuum"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Excess:
    """What media add to paths from a target to platforms; gradients are with respect to the target's position.

    Attributes
    ----------
    path, rate : ndarray, shape (..., p)
        [m], [m/s].
    gradient, rate_gradient : ndarray, shape (..., p, 3)
        [1], [1/s]; `gradient` is the derivative of `rate` with respect to the target's velocity, too.
    """

    path: Array
    rate: Array
    gradient: Array
    rate_gradient: Array


def excess(media: Sequence[Medium], target: Array, platforms: Array, phase: bool = False) -> Excess:
    r"""Return what media add.

    From the lower end to the upper one it is the column of the medium from the lower one on, less that from the upper
    one on: :math:`L = F(h_1, \mu_1) - F(h_2, \mu_2)`.

    Parameters
    ----------
    media : sequence of Medium
    target : ndarray, shape (..., n)
        Earth-fixed position [m] and velocity [m/s] first.
    platforms : ndarray, shape (..., p, 6)
    phase : bool
        Whether it is the path of a carrier's phase, that of Doppler shifts, or that of a group.

    Returns
    -------
    Excess
    """
    lines = sights(target, platforms)
    total: Excess | None = None
    for medium in media:
        one = _of(medium, lines, medium.phase_sign if phase else 1.0)
        total = one if total is None else Excess(*(a + b for a, b in zip(_parts(total), _parts(one), strict=True)))
    assert total is not None
    return total


def _parts(one: Excess) -> tuple[Array, Array, Array, Array]:
    return one.path, one.rate, one.gradient, one.rate_gradient


def _of(medium: Medium, lines: Sights, sign: float) -> Excess:
    upward = np.where(lines.target.height <= lines.platform.height, 1.0, -1.0)
    reached = np.maximum(lines.target.height, lines.platform.height) >= medium.bottom
    near = _parts(_end(medium, lines.target, upward))
    far = _parts(_end(medium, lines.platform, upward))
    scale = np.where(reached, sign, 0.0)
    both = [a - b for a, b in zip(near, far, strict=True)]
    return Excess(scale * both[0], scale * both[1], scale[..., None] * both[2], scale[..., None] * both[3])


def _end(medium: Medium, end: End, upward: Array) -> Excess:
    """Return the column beyond one end, positive for rays from the target upward."""
    f = medium.column(end.height + np.zeros_like(upward), upward * end.sine)
    by_h, by_u, by_hh, by_uu = upward * f.by_h, f.by_u, upward * f.by_hh, upward * f.by_uu
    by_h_rate = by_hh * end.height_rate + f.by_hu * end.sine_rate
    by_u_rate = f.by_hu * end.height_rate + by_uu * end.sine_rate
    return Excess(
        upward * f.value,
        by_h * end.height_rate + by_u * end.sine_rate,
        by_h[..., None] * end.height_gradient + by_u[..., None] * end.sine_gradient,
        by_h_rate[..., None] * end.height_gradient
        + by_h[..., None] * end.height_gradient_rate
        + by_u_rate[..., None] * end.sine_gradient
        + by_u[..., None] * end.sine_gradient_rate,
    )


class Delayed(MeasurementModel):
    r"""A model of ranges, delays or Doppler shifts, with what media add to its rows.

    Each row gets a multiple of the excess path to its receiver, less that to the reference if there is one; a row of
    Doppler shifts of the rate of the phase's. Geometry of one instant: over the light time a delay changes by less than
    1e-5 of itself.

    .. math:: h_i(x) = h_i^{\mathrm{vacuum}}(x) + k\,(L_i - L_0) \quad\text{or, of Doppler shifts,}\quad
              h_i^{\mathrm{vacuum}}(x) + k\,(\dot L_i - \dot L_0)

    with L the excess path that `excess` adds up, k the scale, 0 the reference.

    Parameters
    ----------
    model : MeasurementModel
        As in vacuum; its names, units, noise and residuals are those of this one.
    media : sequence of Medium
        At least one.
    receivers : sequence of int
        Platform of each row.
    reference : int, optional
        The one that all are compared with.
    scale : float
        Of a row, per metre, or per m/s of a Doppler shift.
    doppler : bool
        Whether the rows are Doppler shifts.
    """

    def __init__(
        self,
        model: MeasurementModel,
        media: Sequence[Medium],
        receivers: Sequence[int],
        reference: int | None = None,
        scale: float = 1.0,
        doppler: bool = False,
    ) -> None:
        if len(receivers) != model.size:
            raise ValueError(f"receivers: {list(receivers)} is not allowed; one for each of the {model.size} rows")
        if not media:
            raise ValueError("media: none is given; at least one is needed")
        self.model = model
        self.media = list(media)
        self.receivers = list(receivers)
        self.reference = reference
        self.scale = scale
        self.doppler = doppler
        self.names, self.units = model.names, model.units
        self._platforms = [*self.receivers] if reference is None else [*self.receivers, reference]

    def _difference(self, values: Array, axis: int) -> Array:
        """Return rows of values at receivers and reference along an axis, counted from the last."""
        moved = np.moveaxis(values, axis, -1)
        if self.reference is not None:
            moved = moved[..., :-1] - moved[..., -1:]
        return np.moveaxis(self.scale * moved, -1, axis)

    def excess(self, target: Array, platforms: Array) -> Array:
        """Return what the media add, shape (..., m)."""
        found = excess(self.media, target, platforms[..., self._platforms, :], self.doppler)
        return self._difference(found.rate if self.doppler else found.path, -1)

    def _excess_jacobian(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        found = excess(self.media, target, platforms[..., self._platforms, :], self.doppler)
        slope = self._difference(found.rate_gradient if self.doppler else found.gradient, -2)
        rows = np.zeros((*slope.shape[:-1], target.shape[-1]))
        rows[..., :3] = slope
        if self.doppler:
            rows[..., 3:6] = self._difference(found.gradient, -2)
        return self._difference(found.rate if self.doppler else found.path, -1), rows

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self.model.predict(target, platforms) + self.excess(target, platforms)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        value, jacobian = self.model.linearize(target, platforms)
        more, rows = self._excess_jacobian(target, platforms)
        return value + more, jacobian + rows

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.modified_gain`; what the media add is linearised."""
        more, rows = self._excess_jacobian(target, platforms)
        return self.model.modified_gain(measured - more, target, platforms) + rows

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.model.noise_covariance()

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.noise_covariance_at`."""
        return self.model.noise_covariance_at(target, platforms)

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self.model.residual(measured, predicted)

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self.model.represent(value)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        return self.model.platforms_used(platforms)


def in_vacuum(model: MeasurementModel) -> MeasurementModel:
    """Return a model without what the atmosphere adds."""
    return model.model if isinstance(model, Delayed) else model
