"""A rocket as truth: the equations of motion solved once, from event to event, and read as a function of time."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context
from scipy.integrate import OdeSolution

from quietfix.systems.plants.solving import solve
from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.rocket import RocketModel

__all__ = ["Rocket", "fly"]

Array = NDArray[np.float64]

_RTOL = 1e-10
_ATOL = np.array([1e-6] * 3 + [1e-9] * 3)  # m, m/s


def fly(model: RocketModel, end: float, method: str = "DOP853", rtol: float = _RTOL) -> list[tuple[float, OdeSolution]]:
    """Return (begin of segment, dense solution) from ignition of the first stage to `end`, split at every event.

    Inside a segment nothing jumps, so that a jump is exact whatever the samples are.

    Raises
    ------
    ValueError
        If the rocket falls back to the ground.
    """
    start = model.stages[0].ignition
    inside = [t for t in model.events().tolist() if start < t < end]
    knots = [start, *inside, end]
    state = np.zeros(6)
    found = []
    for begin, stop in pairwise(knots):
        middle = 0.5 * (begin + stop)
        solution = solve(
            "rocket",
            partial(model.derivative, program_time=middle),
            begin,
            stop,
            state,
            method=method,
            rtol=rtol,
            atol=_ATOL,
        )
        state = solution.y[:, -1]
        if float(model.site.height(state[:3])) < -1.0:
            raise ValueError(f"rocket: it falls back to the ground before {stop:g} s")
        found.append((begin, solution.sol))
    return found


class Rocket(EnsembleBlock):
    r"""Truth shared by all trials, as a dense function of the time since lift-off.

    Ports, all outputs: ``state`` (1, 6) launch-frame position [m] and velocity [m/s]; ``acceleration`` (1, 3)
    relative to the launch frame [m/s^2]; ``stage`` (1, 1) the lowest stage attached, 0 for the first. At an event
    they show what holds after it.

    .. math:: \dot v = \frac{(F - pA_e)\,u}{m} - \frac{\rho v c_d A}{2m} V - \frac{\mu d}{|d|^3}
              - 2\,\omega\times v - \omega\times(\omega\times d)

    with all that is in it as of `quietfix.systems.trajectories.rocket.RocketModel`.

    Parameters
    ----------
    model : RocketModel
        The rocket.
    end : float
        How long it is flown [s]; later states are NaN.
    name : str
        Name of the block.
    segments : list of (float, OdeSolution), optional
        What `fly` returns for just these, where it is known; see `again`.
    """

    def __init__(
        self,
        model: RocketModel,
        end: float,
        name: str = "rocket",
        segments: list[tuple[float, OdeSolution]] | None = None,
    ) -> None:
        super().__init__(name)
        self.model = model
        self.end = float(end)
        self._segments = fly(model, self.end) if segments is None else segments
        self._begins = np.array([begin for begin, _ in self._segments])
        ticket = {self.time_ticket()}
        self.declare_output("state", 1, 6, lambda c: self._state(c.get_time())[0][None], ticket)
        self.declare_output("acceleration", 1, 3, lambda c: self.at(c.get_time())[1][None], ticket)
        self.declare_output("stage", 1, 1, self._stage, ticket, [("stage", "1")])

    def again(self) -> Rocket:
        """Return such a block for another diagram; nothing is flown again."""
        return Rocket(self.model, self.end, self.get_name(), self._segments)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return state (6,) and acceleration (3,) at `time` [s]; at rest before lift-off, NaN after the end."""
        state, program_time = self._state(time)
        if program_time is None:
            return state, state[:3].copy()
        return state, self.model.acceleration(time, state, program_time)

    def _state(self, time: float) -> tuple[Array, float | None]:
        """Return the state and an instant inside its smooth segment; none before lift-off and after the end."""
        if time > self.end:
            return np.full(6, np.nan), None
        if time < self._begins[0]:
            return np.zeros(6), None
        i = int(np.searchsorted(self._begins, time, side="right")) - 1
        begin, solution = self._segments[i]
        stop = self._begins[i + 1] if i + 1 < self._begins.size else self.end
        return np.asarray(solution(time)), 0.5 * (begin + stop)

    def _stage(self, context: Context) -> Array:
        return np.array([[float(self.model.stage(context.get_time()))]])
