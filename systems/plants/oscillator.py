"""A beacon's oscillator error as a range-rate bias: constant, linear, or the paper's power of time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.noise import normal
from quietfix.systems.signals import EnsembleBlock

__all__ = ["BiasLaw", "OscillatorBias"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BiasLaw:
    r"""The bias :math:`\delta(t) = (b + \varepsilon)\,t^{k} + r t` [m/s], t since lift-off.

    Constant: k = 0, r = 0. Linear: k = 0. Shang, Xing and Gan, Control Theory & Applications 29 (2012) 59, eq. (19)
    (numbered (18) in print): b = 88 m/s, k = 0.05, r = 0.01 m/s^2, epsilon standard normal.

    Parameters
    ----------
    level, exponent, rate : float
        b [m/s], k, r [m/s^2].
    spread : float
        Standard deviation of epsilon [m/s], >= 0.
    per : {'sample', 'run'}
        Whether epsilon is drawn anew at every sample (the paper's printed statistics need this) or once per trial.
    """

    level: float
    exponent: float = 0.0
    rate: float = 0.0
    spread: float = 0.0
    per: Literal["sample", "run"] = "sample"

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not all(math.isfinite(v) for v in (self.level, self.exponent, self.rate)) or self.exponent < 0:
            raise ValueError("bias: level, exponent and rate must be finite numbers, the exponent >= 0")
        if not (math.isfinite(self.spread) and self.spread >= 0):
            raise ValueError(f"bias spread: {self.spread} is not allowed; it must be >= 0 m/s")
        if self.per not in ("sample", "run"):
            raise ValueError(f"bias per: {self.per} is not allowed; sample or run")

    def value(self, time: float, epsilon: Array) -> Array:
        """Return the bias [m/s] for draws of epsilon [m/s]."""
        return (self.level + epsilon) * float(time) ** self.exponent + self.rate * time


class OscillatorBias(EnsembleBlock):
    r"""Port ``state`` (trials, 1): the bias [m/s]; between ticks epsilon is that of the last tick.

    .. math:: \delta(t) = (b + \varepsilon)\,t^k + r t

    Parameters
    ----------
    law : BiasLaw
        How it runs.
    clock : Clock
        When epsilon is drawn.
    trials : int
        Number of trials; without spread all trials share one.
    name : str
        Name of the block.
    """

    def __init__(self, law: BiasLaw, clock: Clock, trials: int, name: str = "oscillator") -> None:
        super().__init__(name)
        self.law, self.clock = law, clock
        self.trials = trials if law.spread > 0 else 1
        draw = self.declare_draw()
        self.declare_output("state", self.trials, 1, self._state, {self.time_ticket(), draw})

    def _state(self, context: Context) -> Array:
        time = context.get_time()
        epsilon = np.zeros((1, 1))
        if self.law.spread > 0:
            draw = self.draw(context)
            tick = 0
            if self.law.per == "sample":
                exact = self.clock.index(time)
                tick = max(len(self.clock.ticks(time)) - 1, 0) if exact is None else exact
            white = normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, tick, 1)
            epsilon = self.law.spread * white
        return self.law.value(time, epsilon)
