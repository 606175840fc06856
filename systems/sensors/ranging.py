"""Ranges and positions from one instant of angles, rates and radial acceleration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.fixes.ranged_position import RangedPosition
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Ranging"]

Array = NDArray[np.float64]


class Ranging(EnsembleBlock):
    r"""Solve the ranging equation for every trial.

    Inputs ``measurement`` (the six rows in the order of `ROWS`), ``platforms`` and, with `feedback`, ``prediction``.
    Outputs: ``ranges`` (3) all positive roots [m], NaN where there is none; ``range_sigmas`` (3) their standard
    deviations [m]; ``positions`` (9) of the roots that can be a satellite; ``naive_range`` (1), of a target without
    acceleration. With `feedback` also ``measurement`` (3), the position nearest to the predicted one, and
    ``noise_covariance`` (9), evaluated at the prediction: a position measurement for any estimator that takes its R
    from a port.

    .. math:: f(r) = w_2 r + e\cdot a(r_O + r e) - e\cdot a(r_O) - \ddot r = 0, \qquad
              w_2 = (\dot\beta\cos\epsilon)^2 + \dot\epsilon^2

    Parameters
    ----------
    model : RelativeKinematics
        The sensor as it is believed to be, all six rows.
    trials, platforms, platform_trials : int
        Trials, number of platforms on the port, their trials.
    feedback : bool
        Whether an estimator's prediction chooses the root.
    minimum_height : float
        Roots lower than this [m], or unbound, are impossible.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        model: RelativeKinematics,
        trials: int,
        platforms: int = 1,
        platform_trials: int = 1,
        feedback: bool = False,
        minimum_height: float = 100e3,
        name: str = "ranging",
    ) -> None:
        super().__init__(name)
        self.position = RangedPosition(model)
        self._model, self._trials, self._platforms = model, trials, platforms
        self._minimum_height = minimum_height
        self.declare_input("measurement", trials, len(ROWS))
        self.declare_input("platforms", platform_trials, 6 * platforms)
        given = {self.input_ticket("measurement"), self.input_ticket("platforms")}
        self._solved = self.declare_cached("solved", Ranging._solve, given)
        ticket = {self.cached_ticket(self._solved)}
        roots = [(f"root_{i}", "m") for i in range(3)]  # those of one cubic, sorted: there is nothing else to call them
        for port, size in (("ranges", 3), ("range_sigmas", 3), ("positions", 9), ("naive_range", 1)):
            named = roots if port.startswith("range") else None
            self.declare_output(port, trials, size, self._reader(port), ticket, named)
        if feedback:
            self.declare_input("prediction", trials, 6)
            ahead = {self.input_ticket("prediction")}
            self.declare_output("measurement", trials, 3, self._choose, ticket | ahead)
            self.declare_output("noise_covariance", trials, 9, self._noise, {self.input_ticket("platforms")} | ahead)

    def _reader(self, port: str) -> Callable[[Context], Array]:
        return lambda context: self.cached(context, self._solved)[port]

    def _carriers(self, context: Context) -> Array:
        return self.read(context, "platforms").reshape(-1, self._platforms, 6)

    def _solve(self, context: Context) -> dict[str, Array]:
        equation, sigmas = self.position.equation, self._model.sigmas
        measured = self.read(context, "measurement")
        observer = np.broadcast_to(self._carriers(context)[:, self._model.observer], (self._trials, 6))
        ranges = equation.ranges(measured, observer)
        partials = equation.range_partials(ranges, measured[:, None], observer[:, None])
        states = equation.states(ranges, measured[:, None], observer[:, None])
        good = equation.possible(states, self._minimum_height)
        positions = np.where(good[..., None], states[..., :3], np.nan)
        spread = np.sqrt(((partials * sigmas) ** 2).sum(axis=-1))
        return {
            "ranges": ranges,
            "range_sigmas": spread,
            "positions": positions.reshape(self._trials, 9),
            "naive_range": equation.naive_range(measured, observer)[:, None],
        }

    def _choose(self, context: Context) -> Array:
        positions = self.cached(context, self._solved)["positions"].reshape(self._trials, 3, 3)
        prediction = self.read(context, "prediction")[:, None, :3]
        off = np.linalg.norm(positions - prediction, axis=-1)
        nearest = np.argmin(np.where(np.isnan(off), np.inf, off), axis=-1)
        return positions[np.arange(self._trials), nearest]

    def _noise(self, context: Context) -> Array:
        return self.position.noise_covariance_at(self.read(context, "prediction"), self._carriers(context))
