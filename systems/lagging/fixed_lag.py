"""A fixed-lag smoother behind an estimator: what it knows now of a state some time ago."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.clocks import at_ticks, same_instant
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.signals import EnsembleBlock, components_of
from quietfix.systems.smoothing.smoother import Smoother

__all__ = ["FixedLag"]

Array = NDArray[np.float64]


class FixedLag(EnsembleBlock):
    r"""Put it behind a Kalman-type estimator: its state `lag_s` ago, with all that has been measured since.

    Inputs ``estimate`` and ``covariance``, of the estimator. Outputs ``estimate`` and ``covariance`` of the oldest tick
    that is no longer ago than `lag_s`, and ``time`` (trials, 1), that tick [s]; NaN before the run is so old. The
    numbers are those that `Smoother` with this lag has of that tick when the run is over.

    .. math:: x^s = x + G\,(x^s_+ - x^-_+), \qquad P^s = P + G\,(P^s_+ - P^-_+)\,G^T, \qquad G = P A^T (P^-_+)^{-1}

    Rauch, Tung and Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA J. 3 (1965) 1445-1450.

    Parameters
    ----------
    filter_ : KalmanEstimator
        The estimator; of it only motion, algorithm and clock are used.
    lag_s : float
        [s], >= 0.
    end : float
        End of the run [s]: so long a buffer is enough.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For a lag that is none, and an estimator that knows more than a mean and a covariance, or not all of it on its
        ports.
    """

    def __init__(self, filter_: KalmanEstimator, lag_s: float, end: float, name: str = "fixed_lag") -> None:
        super().__init__(name)
        motion = filter_.motion
        goes_on = not filter_.may_begin_again and "releases" not in filter_.tallies()
        if not (filter_.plain and goes_on) or filter_.HasOutputPort("whole"):
            raise ValueError(
                f"{name}: {filter_.get_name()} is not allowed; a filter of one mean and covariance, without a gate or "
                "restart"
            )
        self._smoother = Smoother(filter_.algorithm, motion)
        Smoother(filter_.algorithm, motion, lag_s)  # checks the lag
        self.lag, self._clock, n = float(lag_s), filter_.wiring.clock, motion.size
        ticks, trials = self._clock.ticks(end), filter_.wiring.trials
        oldest = np.searchsorted(ticks, ticks - self.lag - 1e-9)
        self._count = int((np.arange(len(ticks)) - oldest).max(initial=0)) + 1
        self.declare_input("estimate", trials, n)
        self.declare_input("covariance", trials, n * n)
        self._shape = self._count, trials, n + n * n
        self._state = self.DeclareDiscreteState(np.full(self._count * (1 + trials * (n + n * n)), np.nan))
        read = {self.input_ticket("estimate"), self.input_ticket("covariance")}
        found = self.declare_cached("found", FixedLag._calc, {*read, self.xd_ticket(), self.time_ticket()})
        after = {self.cached_ticket(found)}
        for i, (port, size) in enumerate({"estimate": n, "covariance": n * n, "time": 1}.items()):
            names = components_of(motion) if port == "estimate" else None
            self.declare_output(port, trials, size, partial(self._part, found, i), after, names)
        at_ticks(
            self._clock,
            lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._store),
            lambda: self.DeclarePerStepDiscreteUpdateEvent(self._store_at_tick),
        )

    def _part(self, found: object, which: int, context: Context) -> Array:
        part: Array = self.cached(context, found)[which]
        return part

    def _held(self, context: Context) -> tuple[Array, Array]:
        """Return times (count,) and beliefs (count, trials, n + n n) of the last ticks, the earliest first."""
        held = context.get_discrete_state(self._state).CopyToVector()
        return held[: self._count], held[self._count :].reshape(self._shape)

    def _with_now(self, context: Context) -> tuple[Array, Array]:
        """Return the same with what is known now."""
        times, beliefs = self._held(context)
        now = np.concatenate([self.read(context, "estimate"), self.read(context, "covariance")], axis=-1)
        if np.isfinite(times[-1]) and same_instant(float(times[-1]), context.get_time()):
            times, beliefs = np.append(np.nan, times[:-1]), np.concatenate([beliefs[:1], beliefs[:-1]])
        return np.append(times[1:], context.get_time()), np.concatenate([beliefs[1:], now[None]])

    def _calc(self, context: Context) -> tuple[Array, Array, Array]:
        times, beliefs = self._with_now(context)
        _, trials, width = self._shape
        n = int((np.sqrt(1 + 4 * width) - 1) / 2)
        since = times[-1] - self.lag
        kept = np.flatnonzero(times >= since - 1e-9)
        reached = since >= -1e-9 and self._clock.ticks(times[-1])[0] <= since + 1e-9
        if not reached:
            nothing = np.full((trials, width), np.nan)
            return nothing[:, :n], nothing[:, n:], np.full((trials, 1), np.nan)
        covariances = beliefs[kept, :, n:].reshape(len(kept), trials, n, n)
        mean, of = self._smoother.smooth(times[kept], beliefs[kept, :, :n], covariances)
        return mean[0], of[0].reshape(trials, -1), np.full((trials, 1), times[kept[0]])

    def _store(self, context: Context, discrete: DiscreteValues) -> None:
        times, beliefs = self._with_now(context)
        discrete.get_mutable_vector(self._state).SetFromVector(np.concatenate([times, beliefs.ravel()]))

    def _store_at_tick(self, context: Context, discrete: DiscreteValues) -> None:
        if self._clock.index(context.get_time()) is not None:
            self._store(context, discrete)
