"""A user's own motion model, behind the boundary where what it returns is checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.checked import Checked, disagreement, state_steps
from quietfix.systems.checked import made as made_checked
from quietfix.systems.kernels.progress import say_slower
from quietfix.systems.motion.base import MotionModel

__all__ = ["CustomMotion", "made"]

Array = NDArray[np.float64]

_CLOSE = 1e-3  # of a gradient; what is nearer costs no estimator anything
_NO_GRADIENT = 1e-9  # per unit of the state


def made(path: str, options: Mapping[str, Any]) -> tuple[MotionModel, bool]:
    """Return a user's motion and whether it has a transition of its own; see `quietfix.systems.checked.made`."""
    motion, lacking = made_checked(path, options, MotionModel, ["transition"])
    assert isinstance(motion, MotionModel)
    return motion, not lacking


class CustomMotion(MotionModel):
    r"""A motion that somebody else wrote; what it returns is checked for its shape.

    Where it has no transition, central differences

    .. math:: \partial f/\partial x_i \approx [f(x + s_i e_i) - f(x - s_i e_i)]/(2 s_i)

    stand in for it, with the steps of `quietfix.systems.checked.state_steps`: of a motion that is smooth over a
    kilometre they are off by some 1e-8.

    Parameters
    ----------
    motion : MotionModel
        What they wrote; without an input.
    has_transition : bool
        False: central differences.
    name : str
        What messages call it.
    path : str
        ``package.module:Class``, for messages.
    refused : type of Exception
        What is raised where it returns something of a wrong shape, or fails.
    """

    def __init__(
        self,
        motion: MotionModel,
        has_transition: bool = True,
        name: str = "motion",
        path: str = "",
        refused: type[Exception] = ValueError,
    ) -> None:
        self.motion, self.has_transition = motion, has_transition
        self._checked = Checked(motion, name, path, refused)
        self.names, self.units = self._checked.names("states")
        self.linear = bool(motion.linear)
        self.nominal = dict(motion.nominal)
        if motion.input_size:
            raise self._checked.wrong("input_size", f"{motion.input_size} is not allowed; 0")

    def check(self, state: Array, dt: float) -> None:
        """Ask everything once, at a state (..., n) and a step [s]: shapes, finite numbers, a covariance.

        Raises
        ------
        Exception
            Of the kind `refused`, naming class and method.
        """
        for what, value in (("propagate", self.propagate(state, dt)), ("transition", self.transition(state, dt))):
            if not np.isfinite(value).all():
                begin = state.reshape(-1, self.size)[0].tolist()
                raise self._checked.wrong(what, f"a number that is not finite, after {dt:g} s from {begin}")
        if not self.has_transition:
            say_slower(self._checked.path, "no transition: its derivatives are central differences")
        self._checked.same_again("propagate", self.propagate(state, dt), self.propagate(state, dt))
        n = self.size
        self._checked.covariance("process_noise", (state, dt), [(*state.shape[:-1], n, n), (n, n)], least=False)

    def doubt(self, state: Array, dt: float) -> str:
        """Return in words that the class's own transition is not the derivative of its `propagate`; else nothing."""
        if not self.has_transition:
            return ""
        own = np.broadcast_to(self.transition(state, dt), (*state.shape, state.shape[-1]))
        values, step = self.propagate(state, dt), state_steps(state)
        off = disagreement(own, self._differences(state, dt), values, step, np.full(self.size, _NO_GRADIENT))
        if off <= _CLOSE:
            return ""
        return (
            f"{self._checked.name}: {self._checked.path}.transition is {off:.2g} of the gradient off that of propagate."
        )

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return self._checked.shaped("propagate", (state, dt), [state.shape])

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        n = state.shape[-1]
        if self.has_transition:
            return self._checked.shaped("transition", (state, dt), [(*state.shape, n), (n, n)])
        return self._differences(state, dt)

    def _differences(self, state: Array, dt: float) -> Array:
        n = state.shape[-1]
        step, columns = state_steps(state), []
        for i in range(n):
            up, down = state.copy(), state.copy()
            up[..., i] += step[..., i]
            down[..., i] -= step[..., i]
            change = self.propagate(up, dt) - self.propagate(down, dt)
            # not 2 * step: what the rounded states differ by
            columns.append(change / (up[..., i] - down[..., i])[..., None])
        return np.stack(columns, axis=-1)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        n = self.size
        return self._checked.shaped("process_noise", (state, dt), [(*state.shape[:-1], n, n), (n, n)])
