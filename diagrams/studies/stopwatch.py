"""What an estimator costs: the time spent in its own mathematics while a diagram runs."""

from __future__ import annotations

import time
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.kernels.progress import loading_seconds

__all__ = ["Stopwatch"]


class Stopwatch:
    """Time spent in an estimator's own `first`, `predict`, `update`, `step_at_once` and `moments`.

    Ports, caches, sensors and scores are not in it, nor blocks before the estimator, nor the compiling of what is used
    for the first time. It is the processor time of this thread, so that other programs on the machine do not count.

    Parameters
    ----------
    estimator : Estimator
        Watched from now on; its numbers stay what they are.

    Attributes
    ----------
    seconds : float
        Time so far [s].
    steps : int
        Updates so far.
    """

    watched = ("first", "predict", "update", "step_at_once", "moments")

    def __init__(self, estimator: Estimator) -> None:
        self.seconds, self.steps = 0.0, 0
        self._depth = 0
        self._trials = estimator.wiring.trials
        self._estimator = weakref.ref(estimator)
        for name in self.watched:
            setattr(estimator, name, self._timed(name, getattr(type(estimator), name)))

    def _timed(self, name: str, method: Any) -> Any:
        own = self._estimator

        def call(*arguments: Any) -> Any:
            if self._depth:  # one of the watched calls another
                return method(own(), *arguments)
            self._depth += 1
            began = time.thread_time() - loading_seconds()
            result: Any = None
            try:
                result = method(own(), *arguments)
                return result
            finally:
                self.seconds += time.thread_time() - loading_seconds() - began
                self.steps += name == "update" or (name == "step_at_once" and result is True)
                self._depth -= 1

        return call

    @property
    def spent(self) -> NDArray[np.float64]:
        """Time so far [s], and steps of a trial so far."""
        return np.array([self.seconds, float(self.steps * self._trials)])

    @property
    def microseconds(self) -> float:
        """Mean time of one step of one trial [us]; NaN before the first step."""
        return 1e6 * self.seconds / (self.steps * self._trials) if self.steps else float("nan")
