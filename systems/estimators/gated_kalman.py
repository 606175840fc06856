"""Gaussian filters behind a gate that remembers what it has refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.recovery.gate import Gate, likeliest_scale, normalised
from quietfix.systems.filters.recovery.screening import Screened, screen
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.signals import components_of
from quietfix.systems.starts.start import Start

__all__ = ["GatedKalman"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_DOUBT = 2  # refusals, one after the other, of what a start has never passed: two gross errors are rarer than one
_SHARP = 4.0  # variance from the belief over that of the noise
_SETTLED = 1.0 - 1e-9  # of `passed`, which is a sum of equal shares
_LASTING = ("rejected", "releases", "starts")


class GatedKalman(KalmanEstimator):
    r"""Any `GaussianFilter` behind a `Gate`.

    What the gate refuses is NaN for the filter, and in ``innovation``. It opens

    - for a row (an epoch) refused `release_after` times one after the other: the prediction's covariance is scaled to
      what the refused rows say of it (`quietfix.systems.filters.recovery.gate`), and the measurement of now is used;
    - by another beginning, where a row has been refused since the start without having passed once, 2 times the first
      time, 4, 8, ... times then, as long as that is not more than `release_after`: with a gross error in a share p of
      the rows the start took one with probability p, both epochs after it with :math:`p^2`. Only where the start
      begins from a measurement.

    Before the first pass, all rows together are tested where the start took a measurement (its gross error shows in
    no row by itself); a belief that was given has taken none, and there each row is tested by itself, with
    ``per: epoch`` until the belief is sharp or `release_after` epochs in a row were likely as a whole.

    Missing rows are neither refused nor passed. ``nis`` and ``nis_dof`` are over the rows used; whether the filter is
    ``lost`` is judged by all that were there, for what passes a gate is never surprising.

    Further outputs: ``rejected`` (trials, m), how often each row has been refused, ``releases`` (trials, 1), how often
    the gate has opened.

    Parameters
    ----------
    name, algorithm, model, motion, start, wiring
        See `KalmanEstimator`.
    gate : Gate
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        gate: Gate,
    ) -> None:
        self.gate = gate
        super().__init__(name, algorithm, model, motion, start, wiring)
        self.count_restarts()
        counted = [(row.name, "1") for row in components_of(model)]
        self.tell("rejected", model.size, lambda memory: memory["rejected"], counted)
        self.tell("releases", 1, lambda memory: memory["releases"], [("releases", "1")])

    def tallies(self) -> Sequence[str]:
        """See `Watching.tallies`."""
        return ("rejected", "releases", "restarts")

    @property
    def may_begin_again(self) -> bool:
        """See `Watching.may_begin_again`."""
        return self.restarts_when_lost or self.beginning

    @property
    def plain(self) -> bool:
        """See `KalmanEstimator.plain`: what it counts does not change what its filter predicts."""
        return type(self).predict is GatedKalman.predict and type(self).moments is KalmanEstimator.moments

    # ---- memory

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`.

        Beside the belief: refusals of each test one after the other; whether it has passed since the start; refusals
        of each row, openings and beginnings so far; NIS and number of all rows of the last epoch; whether to begin
        again.
        """
        tests = self.gate.width(self.model.size)
        counts = {"refusals": tests, "passed": tests, "rejected": self.model.size, "releases": 1, "starts": 1}
        return {**super().memory_sizes(), **counts, "seen": 2, "doubt": 1}

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        memory = super().begin(mean, covariance, epoch)
        sizes = self.memory_sizes()
        return {**memory, **{group: np.zeros((mean.shape[0], sizes[group])) for group in sizes if group not in memory}}

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        return {**memory, **super().predict(memory, dt, epoch)}

    # ---- the gate

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        mean, covariance = self.moments(memory)
        seen = screen(mean, covariance, observation, self.model)
        nis, rows = normalised(seen)
        refused, there = self.gate.refused(seen, nis, rows)
        passed = memory["passed"]
        fresh = np.flatnonzero((there & (memory["passed"] < _SETTLED)).any(axis=-1))
        if fresh.size and self.beginning and self.gate.per == "row":
            refused[fresh] |= self._at_odds(seen, refused, fresh)
        if fresh.size and not self.beginning and self.gate.per == "epoch":
            likely = ~refused
            refused[fresh] &= self._beyond_doubt(seen, rows, fresh)
            passed = self._settling(memory["passed"], there, likely)
        belief = {group: memory[group] for group in super().memory_sizes()}
        refusals, releases, doubt = memory["refusals"], memory["releases"], np.zeros((mean.shape[0], 1))
        if refused.any():
            refusals = np.where(refused, refusals + 1, refusals)
            doubt = self._doubted(refused, refusals, memory)[:, None].astype(float)
            opened = refused & (refusals >= self.gate.release_after) & (doubt == 0)
            if opened.any():
                scale = likeliest_scale(seen, np.broadcast_to(opened, seen.innovation.shape))
                belief["covariance"] = belief["covariance"] * scale[:, None]
                releases = releases + opened.any(axis=-1, keepdims=True)
                refusals = np.where(opened, 0.0, refusals)
            observation = observation.without(np.broadcast_to(refused, observation.value.shape))
        passes = there & ~refused
        posterior, innovation = super().update(belief, observation, epoch)
        counts = {
            "refusals": np.where(passes, 0.0, refusals),
            "passed": np.where(passes & self._sharp(seen), 1.0, passed),
            "rejected": memory["rejected"] + (refused & np.isfinite(seen.innovation)),
            "releases": releases,
            "starts": memory["starts"],
            "seen": np.stack([self._surprise(nis, innovation, refused), rows], axis=-1),
            "doubt": doubt,
        }
        return {**posterior, **counts}, innovation

    def _at_odds(self, seen: Screened, refused: Mask, fresh: NDArray[np.intp]) -> Mask:
        """Return which rows of trials that are `fresh` from a start are refused because all together are improbable.

        The belief is wide then, each row by itself passes easily, and what a gross error of the start says of other
        components of the state is taken for true.
        """
        left = np.where(refused[fresh], np.nan, seen.innovation[fresh])
        nis, rows = normalised(Screened(left, seen.own[fresh], seen.noise[fresh]))
        together: Mask = np.isfinite(left) & self.gate.improbable(nis, rows)[:, None]
        return together

    def _beyond_doubt(self, seen: Screened, rows: Array, fresh: NDArray[np.intp]) -> Mask:
        r"""Return which epochs (fresh, 1) a row by itself makes improbable, or are told by a belief that is sharp.

        A wide belief that was given is bent by the measurements' curvature within it: rows that it knows well only
        together are then at odds with it though nothing is wrong. No row by itself has a larger
        :math:`\nu_i^2 / S_{ii}` than all together, so that fewer sound epochs are refused, and not more.
        """
        there = np.isfinite(seen.innovation[fresh])
        spread = np.where(there, (seen.own_variances + seen.noise_variances)[fresh], 1.0)
        ratio = (np.where(there, seen.innovation[fresh], 0.0) ** 2 / spread).max(axis=-1, initial=0.0)
        beyond: Mask = self._sharp(seen)[fresh] | self.gate.improbable(ratio, rows[fresh])[:, None]
        return beyond

    def _settling(self, passed: Array, there: Mask, likely: Mask) -> Array:
        """Return `passed` after an epoch: a belief has settled when `release_after` epochs in a row were likely.

        Where rows share what moves freely (the bias of a beacon's oscillator) it is never sharp for a row by itself,
        and would be taken for a belief that is still wide until the end of the run.
        """
        gained = np.where(likely, passed + 1.0 / self.gate.release_after, 0.0)
        return np.where(there & (passed < _SETTLED), np.minimum(gained, 1.0), passed)

    def _sharp(self, seen: Screened) -> Mask:
        """Return which tests tell of the start (trials, tests): before it a row was known about as well as it measures.

        What a wide belief lets pass is no second opinion: it only sets the belief.
        """
        sharp: Mask = seen.own_variances <= _SHARP * seen.noise_variances
        return sharp if self.gate.per == "row" else np.all(sharp, axis=-1)[:, None]

    def _doubted(self, refused: Mask, refusals: Array, memory: Memory) -> Mask:
        """Return which trials' start is to be doubted (trials,)."""
        if not self.beginning:
            return np.zeros(refused.shape[0], dtype=bool)
        enough = _DOUBT * 2.0 ** memory["starts"]
        doubted = refused & (memory["passed"] == 0) & (refusals >= enough) & (enough <= self.gate.release_after)
        some: Mask = np.any(doubted, axis=-1)
        return some

    # ---- being lost

    def _surprise(self, nis: Array, innovation: Innovation, refused: Mask) -> Array:
        """Return the NIS of all rows (trials,); of one that is refused, as much as just passes, however far off it is.

        A gross error says nothing of the filter, but rows that are refused again and again do.
        """
        if not refused.any():
            return nis
        passing = np.where(innovation.nis_dof > 0, innovation.nis, 0.0)
        limit = self.gate.limit(1) * np.count_nonzero(refused, axis=-1)
        return np.where(refused.any(axis=-1), passing + limit if self.gate.per == "row" else nis, nis)

    def evidence(self, memory: Memory, innovation: Innovation) -> tuple[Array, Array]:
        """See `Watching.evidence`: of all rows that were there."""
        return memory["seen"][:, 0], memory["seen"][:, 1]

    def asks_to_begin_again(self, memory: Memory) -> Mask | None:
        """See `Watching.asks_to_begin_again`."""
        doubted: Mask = memory["doubt"][:, 0] > 0
        return doubted

    def keep_beginning(self, memory: Memory, begun: Memory) -> Memory:
        """See `Watching.keep_beginning`: counts go on."""
        kept = {group: memory[group] for group in _LASTING}
        return {**begun, **kept, "starts": memory["starts"] + 1}
