"""The first measurements of a run, known when it begins: what a method needs that looks ahead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock, first_ticks
from quietfix.systems.sensors.platform_error import PlatformError
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Preview"]

Array = NDArray[np.float64]


class Preview(EnsembleBlock):
    """Output ``preview``: what a sensor will read at its first ticks, with the very noise that it will have.

    Not causal, hence a block of its own that is seen in the diagram. Per tick the row of the sensor and the state of
    platform 0 as the estimators will know it.

    Parameters
    ----------
    sensor : Sensor
        Whose readings.
    target, platform : callable
        ``f(time) -> (1 or trials, 6)``: true states as functions of time [s].
    clock : Clock
        Of the sensor.
    epochs : int
        How many ticks.
    error : PlatformError, optional
        What the estimators' knowledge of the platform suffers from.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        sensor: Sensor,
        target: Callable[[float], Array],
        platform: Callable[[float], Array],
        clock: Clock,
        epochs: int,
        error: PlatformError | None = None,
        name: str = "preview",
    ) -> None:
        super().__init__(name)
        self._times = first_ticks(clock, epochs)
        if len(self._times) < epochs:
            raise ValueError(f"{name}: {epochs} epochs are asked for, the sensor has {len(self._times)}")
        self._sensor, self._target, self._platform, self._error = sensor, target, platform, error
        draw = self.declare_draw()
        self._ahead = self.declare_cached("ahead", Preview._calc, {draw})
        self.declare_output(
            "preview",
            sensor.trials,
            epochs * (sensor.model.size + 6),
            lambda context: self.cached(context, self._ahead),
            {self.cached_ticket(self._ahead)},
        )

    def _calc(self, context: Context) -> Array:
        draw, trials = self.draw(context), self._sensor.trials
        epochs = []
        for tick, time in enumerate(self._times):
            platform = self._platform(float(time))[:, None]
            reading = self._sensor.reading(draw, tick, self._target(float(time)), platform)
            known = platform if self._error is None else platform + self._error.error(draw)
            epochs.append(np.concatenate([reading, np.broadcast_to(known[:, 0], (trials, 6))], axis=-1))
        return np.stack(epochs, axis=1)
