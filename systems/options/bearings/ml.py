"""Batch maximum likelihood from all bearings, as an estimator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.documented import count, documented
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.bearings.lines import BearingLocator, Lately, Sighting
from quietfix.systems.estimators.memory import Epoch, Memory
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.fixes.bearing_likelihood import BearingHistory, Fit, QuadraticPrior, fold, maximum_likelihood
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["MaximumLikelihood", "Ml"]

Array = NDArray[np.float64]

_VAGUE = 0.1  # a fit whose standard deviation is more than this share of the range is tried from the start again


class MaximumLikelihood(BearingLocator):
    r"""At every epoch the maximum-likelihood state given all bearings so far; `maximum_likelihood`.

    The fit goes on from the last one; while it is vague, also from the start's belief, and the likelier one is kept.
    Bearings beyond the window are folded, linearised at the estimate, into a prior: nothing is lost, and the cost of an
    epoch stays bounded.

    .. math:: \hat x = \arg\min_x \sum_k \frac{\mathrm{wrap}^2(z_k - h_k(x))}{2\sigma^2}

    Parameters
    ----------
    name, model, motion, start, wiring
        See `BearingLocator`.
    window : int
        Bearings that are kept as they are.
    prior : bool
        Whether the start's belief of range and velocity counts; else the bearings alone.
    """

    def __init__(
        self,
        name: str,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        window: int = 1024,
        prior: bool = False,
    ) -> None:
        if wiring.noise_port:
            raise ValueError(f"{name}: maximum likelihood takes raw bearings; filtered ones are not independent")
        self.prior = prior
        self._lately = Lately(window, model.size, model.size + 1, timed=motion.size > model.size + 1, weighed=False)
        super().__init__(name, model, motion, start, wiring)

    def kept_sizes(self) -> Mapping[str, int]:
        """See `BearingLocator.kept_sizes`."""
        n = self.motion.size
        return {**self._lately.sizes(), "anchor": n, "vector": n, "information": n * n}

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`: the prior is one of the state now."""
        moved = super().predict(memory, dt, epoch)
        n = self.motion.size
        if n == self.axes:
            return moved
        back = self.motion.transition(memory["mean"], -dt)
        information = memory["information"].reshape(-1, n, n)
        return {
            **moved,
            "anchor": self.motion.propagate(memory["anchor"], dt),
            "vector": (np.swapaxes(back, -1, -2) @ memory["vector"][..., None])[..., 0],
            "information": (np.swapaxes(back, -1, -2) @ information @ back).reshape(-1, n * n),
        }

    def locate(self, kept: Memory, sighting: Sighting, mean: Array, covariance: Array) -> tuple[Memory, Array, Array]:
        """See `BearingLocator.locate`."""
        trials, n = mean.shape
        prior = QuadraticPrior(kept["anchor"], kept["vector"], kept["information"].reshape(-1, n, n))
        new = np.any(np.isnan(prior.anchor), axis=-1) & np.all(np.isfinite(mean), axis=-1)
        if new.any():
            prior = self._begun(prior, new, mean, covariance)
        into_history = sighting
        if self.prior and new.any():  # that bearing is in the belief already
            angles = np.where(new[:, None], np.nan, sighting.angles)
            into_history = Sighting(angles, sighting.variance, sighting.place, sighting.time)
        rings, lost = self._lately.push(kept, into_history)
        if np.isfinite(lost["angles"]).any():
            gone = self._lately.history({name: value[:, None] for name, value in lost.items()}, sighting.time)
            prior = fold(prior, mean, gone, self.sensor)
        history = self._lately.history(self._lately.unpack(rings), sighting.time)
        fit = self._fit(history, mean, covariance, prior, sighting)
        kept = {
            **rings,
            "anchor": prior.anchor,
            "vector": prior.vector,
            "information": prior.information.reshape(trials, -1),
        }
        return kept, fit.state, fit.covariance

    def _begun(self, prior: QuadraticPrior, new: NDArray[np.bool_], mean: Array, covariance: Array) -> QuadraticPrior:
        n = mean.shape[-1]
        information = np.zeros((mean.shape[0], n, n))
        if self.prior:
            information[new] = np.linalg.inv(covariance[new])
        return QuadraticPrior(
            np.where(new[:, None], mean, prior.anchor),
            np.where(new[:, None], 0.0, prior.vector),
            np.where(new[:, None, None], information, prior.information),
        )

    def _fit(
        self, history: BearingHistory, mean: Array, covariance: Array, prior: QuadraticPrior, sighting: Sighting
    ) -> Fit:
        model = self.sensor
        if history.places.shape[1] == 0:
            return Fit(mean, covariance, np.zeros(mean.shape[0]))
        fit = maximum_likelihood(history, model, mean, prior)
        axes = self.axes
        spread = np.sqrt(np.einsum("...ii->...i", fit.covariance)[:, :axes].sum(axis=-1))
        distance = np.linalg.norm(fit.state[:, :axes] - sighting.place, axis=-1)
        vague = np.all(np.isfinite(prior.anchor), axis=-1) & ~(spread < _VAGUE * distance)
        if not vague.any():
            return fit
        rows = np.flatnonzero(vague)
        again = maximum_likelihood(
            history.take(rows), model, prior.anchor[rows], QuadraticPrior(*(field[rows] for field in prior))
        )
        likelier = again.cost < fit.cost[rows]
        chosen = rows[likelier]
        fit.state[chosen], fit.covariance[chosen] = again.state[likelier], again.covariance[likelier]
        return fit


@dataclass(frozen=True)
class Ml(EstimatorOptions):
    """Batch maximum likelihood from all raw bearings (Levenberg and Marquardt)."""

    window: int = count("so many bearings are kept as they are, older ones as a linearised prior", 1024, at_least=2)
    prior: bool = documented("whether range and velocity of the start count as a prior", False)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return MaximumLikelihood(name, model, motion, start, wiring, self.window, self.prior)
