r"""A measurement model whose platforms are ahead of where they are said to be.

Elements of a satellite grow old mostly along its track: drag that was not foreseen makes it early or late. With
:math:`\tau` the time that it is ahead, it is at

.. math:: r + v\tau + \tfrac12 a\tau^2, \qquad v + a\tau,

a the acceleration of gravity in the axes of the platforms: good to :math:`\dot a\tau^3/6` and :math:`\dot a\tau^2/2`,
in a low orbit 1.5 mm and 4 mm/s for 1 s, 0.2 m and 0.1 m/s for 5 s. A row that depends on the difference of target and
platform alone changes by

.. math:: \frac{\partial z}{\partial\tau} = -\frac{\partial z}{\partial p}(v + a\tau) - \frac{\partial z}{\partial v}a .
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration

__all__ = ["Ahead"]

Array = NDArray[np.float64]


class Ahead(MeasurementModel):
    """A model of ranges and Doppler shifts, with the times that satellites are ahead as states.

    Parameters
    ----------
    model : MeasurementModel
        Each row that needs one of `ahead` needs it alone, and depends on target minus platform alone; its names, units,
        noise and residuals are those of this one.
    ahead : mapping of int to int
        By the number of the platform: which component of the state is the time that it is ahead [s].
    platforms : int
        How many there are.
    constants : GravityConstants
        Of the Earth.
    turning : bool
        Whether the axes turn with the Earth.

    Raises
    ------
    ValueError
        If a row needs such a platform and another one.
    """

    def __init__(
        self,
        model: MeasurementModel,
        ahead: Mapping[int, int],
        platforms: int,
        constants: GravityConstants,
        turning: bool,
    ) -> None:
        used = model.platforms_used(platforms)
        for number in ahead:
            several = used[:, number] & (used.sum(axis=1) > 1)
            if several.any():
                raise ValueError(
                    f"{model.names[int(np.argmax(several))]}: a row of several platforms is not allowed with one that "
                    "is ahead of its elements; rows of one"
                )
        self.model, self.ahead = model, dict(ahead)
        self.names, self.units = tuple(model.names), tuple(model.units)
        self._rows = {number: np.flatnonzero(used[:, number]) for number in ahead}
        self._constants, self._rate = constants, constants.earth_rate if turning else 0.0

    def _acceleration(self, state: Array) -> Array:
        """Return the acceleration (..., 3) of what falls, for states (..., 6)."""
        found = acceleration(state[..., :3], self._constants)
        w = self._rate
        found[..., 0] += 2 * w * state[..., 4] + w**2 * state[..., 0]
        found[..., 1] += -2 * w * state[..., 3] + w**2 * state[..., 1]
        return found

    def _moved(self, target: Array, platforms: Array) -> tuple[Array, dict[int, Array]]:
        """Return where the platforms are (..., p, 6), and of those ahead the derivative of that (..., 6)."""
        leading = np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2])
        moved = np.array(np.broadcast_to(platforms, (*leading, *platforms.shape[-2:])))
        rates = {}
        for number, component in self.ahead.items():
            state, time = platforms[..., number, :], target[..., component, None]
            pull = self._acceleration(state)
            rates[number] = np.concatenate(
                [state[..., 3:] + pull * time, np.broadcast_to(pull, (*leading, 3))], axis=-1
            )
            moved[..., number, :3] += time * (state[..., 3:] + 0.5 * time * pull)
            moved[..., number, 3:] += time * pull
        return moved, rates

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self.model.predict(target, self._moved(target, platforms)[0])

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        moved, rates = self._moved(target, platforms)
        value, jacobian = self.model.linearize(target, moved)
        jacobian = jacobian.copy()
        for number, component in self.ahead.items():
            rows = self._rows[number]
            jacobian[..., rows, component] = -np.einsum("...mk,...k->...m", jacobian[..., rows, :6], rates[number])
        return value, jacobian

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.model.noise_covariance()

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.noise_covariance_at`."""
        return self.model.noise_covariance_at(target, self._moved(target, platforms)[0])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self.model.residual(measured, predicted)

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self.model.represent(value)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        return self.model.platforms_used(platforms)
