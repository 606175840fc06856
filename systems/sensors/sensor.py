"""The generic sensor: any measurement model, sampled by a clock, with noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.counting import tally
from quietfix.systems.geometry.visibility import Mask
from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.noise import normal
from quietfix.systems.signals import Draw, EnsembleBlock, components_of

__all__ = ["Sensor"]

Array = NDArray[np.float64]


class Sensor(EnsembleBlock):
    r"""Read a target from known platforms.

    Inputs ``target`` and ``platforms``, output ``measurement``; NaN between the ticks of its clock and in rows
    whose platforms are below the horizon. The noise is a function of (seed, block name, trial, tick).

    .. math:: z_k = h(x(t_k), s(t_k)) + L w_k, \qquad L L^T = R, \quad w_k \sim N(0, I)

    Parameters
    ----------
    model : MeasurementModel
        What the sensor reads (the truth's instance, which an estimator's may differ from).
    clock : Clock
        When it samples.
    trials : int
        Trials of the measurement.
    platforms : int
        Number of platforms, six numbers each on the port.
    target_trials, target_size : int
        Shape of the target's state; one trial of truth serves all trials of noise.
    platform_trials : int
        Trials of the platforms' states.
    mask : Mask, optional
        Who sees whom, such as an `ElevationMask`. Without it every platform sees the target, even through the Earth.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        model: MeasurementModel,
        clock: Clock,
        trials: int,
        platforms: int,
        target_trials: int = 1,
        target_size: int = 6,
        platform_trials: int = 1,
        mask: Mask | None = None,
        name: str = "sensor",
    ) -> None:
        super().__init__(name)
        for what, count in (("target", target_trials), ("platforms", platform_trials)):
            if count not in (1, trials):
                raise ValueError(f"{name}: {what} has {count} trials; 1 or {trials} are allowed")
        self.model = model
        self.clock = clock
        self.trials = trials
        self._platforms = platforms
        self._mask = mask
        self._needs = model.platforms_used(platforms)
        self._root = semidefinite_root(model.noise_covariance())
        self.declare_input("target", target_trials, target_size)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        draw = self.declare_draw()
        self.declare_output(
            "measurement",
            trials,
            model.size,
            self._measure,
            {self.time_ticket(), self.input_ticket("target"), self.input_ticket("platforms"), draw},
            components_of(model),
        )

    def _measure(self, context: Context) -> Array:
        tally("reading", self)
        tick = self.clock.index(context.get_time())
        if tick is None:
            return np.full((self.trials, self.model.size), np.nan)
        target = self.read(context, "target")
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        return self.reading(self.draw(context), tick, target, platforms)

    def reading(self, draw: Draw, tick: int, target: Array, platforms: Array) -> Array:
        """Return what the sensor reads at one tick.

        Parameters
        ----------
        draw : Draw
            Random numbers of the run.
        tick : int
            Index of the tick.
        target : ndarray, shape (1 or trials, n)
            True state of the target.
        platforms : ndarray, shape (1 or trials, p, 6)
            True states of the platforms.

        Returns
        -------
        ndarray, shape (trials, m)
        """
        exact = self.model.predict(target, platforms)
        seen = self.visible_rows(target, platforms)
        if seen is not None:
            exact = np.where(seen, exact, np.nan)
        white = normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, tick, self.model.size)
        return self.model.represent(exact + np.einsum("ij,...j->...i", self._root, white))

    def visible_rows(self, target: Array, platforms: Array) -> NDArray[np.bool_] | None:
        """Return which rows have all their platforms in sight of the target, shape (..., m); None: all.

        Parameters
        ----------
        target : ndarray, shape (..., n)
            Place in the first three components.
        platforms : ndarray, shape (..., p, 6)
        """
        if self._mask is None:
            return None
        hidden = ~self._mask.visible(target, platforms)
        if not hidden.any():
            return None
        seen: NDArray[np.bool_] = ~np.any(self._needs & hidden[..., None, :], axis=-1)
        return seen
