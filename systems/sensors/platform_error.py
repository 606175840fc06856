"""What is known of the platforms when their navigation is not perfect."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.noise import normal
from quietfix.systems.signals import Draw, EnsembleBlock

__all__ = ["PlatformError"]

Array = NDArray[np.float64]


class PlatformError(EnsembleBlock):
    r"""Add to the platforms' states an error that is constant through a run, N(0, sigma^2) per axis and trial.

    Input and output ``platforms``; estimators read the output, sensors the true states.

    .. math:: s' = s + e, \qquad e \sim N(0,\ \mathrm{diag}(\sigma_p^2 I, \sigma_v^2 I))

    Parameters
    ----------
    trials, platforms : int
        Trials of the output, and number of platforms.
    sigma_position : float
        Per axis [m], >= 0.
    sigma_velocity : float
        Per axis [m/s], >= 0.
    platform_trials : int
        Trials of the input.
    name : str
        Name of the block; part of the key of its random numbers.
    """

    def __init__(
        self,
        trials: int,
        platforms: int,
        sigma_position: float,
        sigma_velocity: float = 0.0,
        platform_trials: int = 1,
        name: str = "platform_error",
    ) -> None:
        super().__init__(name)
        for what, value, unit in (("position", sigma_position, "m"), ("velocity", sigma_velocity, "m/s")):
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"sigma of the platform's {what}: {value} is not allowed; it must be >= 0 {unit}")
        self._trials, self._platforms = trials, platforms
        self._sigmas = np.array([sigma_position] * 3 + [sigma_velocity] * 3)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        draw = self.declare_draw()
        self.declare_output("platforms", trials, 6 * platforms, self._calc, {self.input_ticket("platforms"), draw})

    def error(self, draw: Draw) -> Array:
        """Return the error of a run, shape (trials, platforms, 6)."""
        white = normal(draw.seed, self.noise_name(), draw.first_trial, self._trials, 0, 6 * self._platforms)
        return white.reshape(-1, self._platforms, 6) * self._sigmas

    def _calc(self, context: Context) -> Array:
        states = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        return states + self.error(self.draw(context))
