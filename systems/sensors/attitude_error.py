"""A sensor that does not point where its platform believes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.geometry.misalignment import rotation_matrix, seen_from_turned_axes
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.noise import normal
from quietfix.systems.signals import Draw, EnsembleBlock

__all__ = ["AttitudeError"]

Array = NDArray[np.float64]


class AttitudeError(EnsembleBlock):
    r"""Turn the directions that a sensor reads, as if its axes were turned; put it behind the sensor.

    Inputs ``measurement``, ``target`` and ``platforms`` (the true ones), output ``measurement``.

    .. math:: z' = z + h(C x) - h(x), \qquad C = \exp[\theta\times],\quad \theta \sim N(\theta_0, \sigma^2 I)

    with C x the target as it is seen from axes that are turned by C.

    Parameters
    ----------
    model : MeasurementModel
        The sensor's.
    rows : sequence of str
        The rows that are directions; the others pass.
    trials, platforms : int
        Trials of the measurement, and number of platforms.
    bias : array_like, shape (3,)
        Rotation vector of the sensor's axes [rad], the same in every trial.
    sigma : float
        Standard deviation of a further rotation per axis [rad], constant through a run, drawn per trial; >= 0.
    platform : int
        The platform that carries the sensor.
    body : callable, optional
        From the platform's state (..., 6) to the believed axes as rows (..., 3, 3); by default the axes of the states.
    target_trials, target_size, platform_trials : int
        Shapes of the inputs.
    axes : int
        Space dimensions of the target's state; with 2 only a rotation about z is allowed.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        model: MeasurementModel,
        rows: Sequence[str],
        trials: int,
        platforms: int,
        bias: ArrayLike = (0.0, 0.0, 0.0),
        sigma: float = 0.0,
        platform: int = 0,
        body: Callable[[Array], Array] | None = None,
        target_trials: int = 1,
        target_size: int = 6,
        platform_trials: int = 1,
        axes: int = 3,
        name: str = "attitude_error",
    ) -> None:
        super().__init__(name)
        unknown = [row for row in rows if row not in model.names]
        if unknown or not rows:
            raise ValueError(f"{name}: rows {unknown or 'none'} are not allowed; any of {', '.join(model.names)}")
        self._bias = np.array(bias, dtype=float)
        if self._bias.shape != (3,) or not np.all(np.isfinite(self._bias)):
            raise ValueError(f"{name}: bias {bias!r} is not allowed; three finite numbers [rad]")
        if not (math.isfinite(sigma) and sigma >= 0):
            raise ValueError(f"{name}: sigma {sigma} is not allowed; it must be >= 0 rad")
        if axes == 2 and np.any(self._bias[:2]):
            raise ValueError(f"{name}: bias {bias!r} is not allowed; in the plane only about z")
        self.model = model
        self.trials = trials
        self._rows = [list(model.names).index(row) for row in rows]
        self._platforms, self._platform, self._body, self._axes = platforms, platform, body, axes
        self._sigma = np.array([0.0, 0.0, sigma] if axes == 2 else [sigma] * 3)
        self.declare_input("measurement", trials, model.size)
        self.declare_input("target", target_trials, target_size)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        inputs = {self.input_ticket(port) for port in ("measurement", "target", "platforms")}
        self.declare_output("measurement", trials, model.size, self._calc, {*inputs, self.declare_draw()})

    def turn(self, draw: Draw) -> Array:
        """Return the rotation of a run, shape (1 or trials, 3, 3)."""
        vector = self._bias[None]
        if self._sigma.any():
            vector = vector + self._sigma * normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, 0, 3)
        return rotation_matrix(vector)

    def _calc(self, context: Context) -> Array:
        measured = self.read(context, "measurement").copy()
        target = self.read(context, "target")
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        platform = platforms[:, self._platform]
        body = None if self._body is None else self._body(platform)
        seen = seen_from_turned_axes(target, platform, self.turn(self.draw(context)), body, self._axes)
        moved = self.model.predict(seen, platforms) - self.model.predict(target, platforms)
        measured[:, self._rows] += moved[:, self._rows]
        return self.model.represent(measured)
