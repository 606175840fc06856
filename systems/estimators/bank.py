"""A bank of filters, one per root of the ranging equation: no prior, decided by likelihood."""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from systems.documented import count, number
from systems.estimators.base import Epoch, Estimator, Innovation, Memory, Wiring
from systems.estimators.options import EstimatorOptions
from systems.estimators.start import Start
from systems.filters.gaussian import GaussianFilter
from systems.filters.iterated_extended import IteratedExtendedKalman
from systems.filters.linear_algebra import cholesky
from systems.filters.whitening import Whitener, missing_rows
from systems.measurement.base import MeasurementModel
from systems.measurement.ranged_position import ranging_equation
from systems.measurement.relative_kinematics import RelativeKinematics
from systems.motion.base import MotionModel

__all__ = ["Bank", "NoPrior", "RootBank"]

Array = NDArray[np.float64]

_ROOTS = 3


class NoPrior(Start):
    """Begin without any belief: the estimator makes its own from the first measurement that allows it."""

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`; the zeros only say that every trial begins."""
        trials = measurement.shape[0]
        return np.zeros((trials, 6)), np.zeros((trials, 6, 6))


class RootBank(Estimator):
    r"""One filter per root of the first epoch's ranging equation.

    Root j starts at its own position and velocity with `inflation` times their covariance; every filter then takes all
    rows. Hypotheses are weighed by their likelihood,

    .. math:: \log L_j = -\tfrac12\sum_k\left(\nu^T S^{-1}\nu + \log\det S\right)

    (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 11.6.2, the
    static multiple-model estimator). The estimate is the mixture until `decide_after` epochs have been used, then the
    best filter alone. The innovation is that of the best one. An epoch spent on the start is not used again; a trial
    without a possible root waits for the next epoch.

    Parameters
    ----------
    name, model, motion, wiring
        See `Estimator`; the model must be a `RelativeKinematics` of all six rows.
    algorithm : GaussianFilter, optional
        The filter.
    decide_after : int
        See above.
    inflation : float
        Factor of the starting covariance: the ranging equation is not linear over its own error.
    minimum_height : float
        Roots lower than this [m], or unbound, are impossible.
    """

    def __init__(
        self,
        name: str,
        model: MeasurementModel,
        motion: MotionModel,
        wiring: Wiring,
        algorithm: GaussianFilter | None = None,
        decide_after: int = 30,
        inflation: float = 4.0,
        minimum_height: float = 100e3,
    ) -> None:
        self.equation = ranging_equation(model)
        assert isinstance(model, RelativeKinematics)
        self._observer = model.observer
        self._algorithm = algorithm or IteratedExtendedKalman(max_iterations=8)
        self._whitener = Whitener(model.noise_covariance())
        self._decide_after, self._inflation = decide_after, inflation
        self._minimum_height = minimum_height
        super().__init__(name, model, motion, NoPrior(), wiring)

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        return {"mean": _ROOTS * 6, "covariance": _ROOTS * 36, "log_likelihood": _ROOTS, "age": 1}

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        memory = {group: np.full((mean.shape[0], size), np.nan) for group, size in self.memory_sizes().items()}
        memory["log_likelihood"][:] = -np.inf
        memory["age"][:] = 0
        return memory

    @staticmethod
    def _unpack(memory: Memory) -> tuple[Array, Array, Array]:
        return (
            memory["mean"].reshape(-1, _ROOTS, 6),
            memory["covariance"].reshape(-1, _ROOTS, 6, 6),
            memory["log_likelihood"],
        )

    def weights(self, memory: Memory) -> Array:
        """Return the probability of each hypothesis, shape (trials, 3); 0 everywhere before there are any."""
        likelihood = memory["log_likelihood"]
        top = likelihood.max(axis=-1, keepdims=True)
        share = np.exp(likelihood - np.where(np.isfinite(top), top, 0.0))
        total = share.sum(axis=-1, keepdims=True)
        return share / np.where(total > 0, total, 1.0)

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`: of the mixture."""
        means, covariances, _ = self._unpack(memory)
        weight = self.weights(memory)
        alive = weight > 0
        means = np.where(alive[..., None], means, 0.0)
        mean = np.einsum("tj,tji->ti", weight, means)
        apart = np.where(alive[..., None], means - mean[:, None], 0.0)
        spread = np.where(alive[..., None, None], covariances, 0.0) + apart[..., :, None] * apart[..., None, :]
        covariance = np.einsum("tj,tjik->tik", weight, spread)
        none = ~alive.any(axis=-1)
        return np.where(none[:, None], np.nan, mean), np.where(none[:, None, None], np.nan, covariance)

    def move(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.move`."""
        means, covariances, likelihood = self._unpack(memory)
        alive = np.isfinite(likelihood)
        means, covariances = means.copy(), covariances.copy()
        if alive.any():
            means[alive], covariances[alive] = self._algorithm.predict(
                means[alive], covariances[alive], self.motion, dt
            )
        return self._pack(memory, means, covariances, likelihood, memory["age"])

    @staticmethod
    def _pack(memory: Memory, means: Array, covariances: Array, likelihood: Array, age: Array) -> Memory:
        trials = means.shape[0]
        return {
            "mean": means.reshape(trials, -1),
            "covariance": covariances.reshape(trials, -1),
            "log_likelihood": likelihood,
            "age": age,
        }

    def correct(
        self,
        memory: Memory,
        measurement: Array,
        platforms: Array,
        noise_covariance: Array | None,
        epoch: Epoch,
    ) -> tuple[Memory, Innovation]:
        """See `Estimator.correct`."""
        trials, m = measurement.shape
        means, covariances, likelihood = (part.copy() for part in self._unpack(memory))
        age = memory["age"].copy()
        report = Innovation(np.full((trials, m), np.nan), np.full(trials, np.nan), np.zeros(trials))
        alive = np.isfinite(likelihood)
        if alive.any():
            report = self._update(alive, means, covariances, likelihood, measurement, platforms)
            age[alive.any(axis=-1) & ~np.isnan(measurement).all(axis=-1)] += 1
            decided = age[:, 0] > self._decide_after
            if decided.any():
                best = likelihood == likelihood.max(axis=-1, keepdims=True)
                gone = decided[:, None] & ~best
                likelihood[gone], means[gone], covariances[gone] = -np.inf, np.nan, np.nan
        waiting = ~alive.any(axis=-1)
        if waiting.any():
            observer = np.broadcast_to(platforms[:, self._observer], (trials, 6))[waiting]
            seen = measurement[waiting]
            ranges, states = self.equation.candidates(seen, observer, self._minimum_height)
            spread = self._inflation * self.equation.state_covariance(
                ranges, seen[:, None], observer[:, None], self.model.sigmas
            )
            good = np.isfinite(spread).all(axis=(-1, -2)) & np.isfinite(states).all(axis=-1)
            means[waiting], covariances[waiting] = states, spread
            likelihood[waiting] = np.where(good, 0.0, -np.inf)
            age[waiting] = np.where(good.any(axis=-1), 1.0, 0.0)[:, None]
        return self._pack(memory, means, covariances, likelihood, age), report

    def _update(
        self,
        alive: NDArray[np.bool_],
        means: Array,
        covariances: Array,
        likelihood: Array,
        measurement: Array,
        platforms: Array,
    ) -> Innovation:
        """Update the living hypotheses in place; return what the best one of each trial has to report."""
        trial = np.nonzero(alive)[0]
        mean, covariance, seen = means[alive], covariances[alive], measurement[trial]
        carriers = platforms if platforms.shape[0] == 1 else platforms[trial]
        jacobian = self.model.jacobian(mean, carriers)
        missing = missing_rows(seen, jacobian.sum(axis=-1))
        whiten = self._whitener.matrix(missing)
        rows = whiten @ (np.where(np.isfinite(jacobian), jacobian, 0.0) @ cholesky(covariance))
        gram = rows @ np.swapaxes(rows, -1, -2) + np.eye(rows.shape[-2])
        volume = np.linalg.slogdet(gram)[1]
        result = self._algorithm.update(mean, covariance, seen, carriers, self.model, self._whitener)
        gain = -0.5 * (np.where(np.isnan(result.nis), 0.0, result.nis) + volume)
        lost = ~(np.isfinite(result.mean).all(axis=-1) & np.isfinite(result.covariance).all(axis=(-1, -2)))
        means[alive], covariances[alive] = result.mean, result.covariance
        likelihood[alive] += np.where(lost | ~np.isfinite(gain), -np.inf, gain)
        # a trial whose every hypothesis is lost begins anew at the next epoch
        best = np.argmax(np.where(alive, likelihood, -np.inf), axis=-1)
        place = np.full(alive.shape, -1)
        place[alive] = np.arange(trial.size)
        index = place[np.arange(alive.shape[0]), best]
        there = index >= 0
        return Innovation(
            np.where(there[:, None], result.innovation[index], np.nan),
            np.where(there, result.nis[index], np.nan),
            np.where(there, result.nis_dof[index], 0.0),
        )


@dataclass
class Bank(EstimatorOptions):
    """One iterated extended Kalman filter per root of the first epoch, decided by likelihood; needs no prior."""

    decide_after: int = count("epochs after which only the likeliest filter goes on", 30)
    inflation: float = number("factor of the covariance that a root starts with", 4.0, above=0)
    max_iterations: int = count("at most so many linearisations per update; 1 is the EKF", 8)
    tolerance: float = number("stop rule ||x_{j+1} - x_j|| <= tolerance, SI units mixed", 1e-2, above=0)
    minimum_height_km: float = number("roots lower than this above the equatorial radius are impossible [km]", 100.0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block; it does not use the start."""
        return RootBank(
            name,
            model,
            motion,
            wiring,
            IteratedExtendedKalman(self.max_iterations, self.tolerance),
            self.decide_after,
            self.inflation,
            1e3 * self.minimum_height_km,
        )
