"""Stone Soup's Kalman filters on a recorded pass, one trial after the other."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater import Updater
from stonesoup.updater.kalman import IteratedKalmanUpdater

from quietfix.systems.measurement.stack import Stack
from tests.benchmarks.own_peers import History
from tests.benchmarks.recorded_pass import PERIOD, RecordedPass
from tests.benchmarks.single_target import SingleTarget

__all__ = ["StoneSoup", "iterated"]

Array = NDArray[np.float64]

_EPOCH = datetime.datetime(2024, 1, 1)
_ALL = (0, 1, 2, 3, 4, 5)


class Measurement(NonLinearGaussianMeasurement):
    """`SingleTarget` as Stone Soup wants it: column vectors, and states instead of arrays."""

    target: SingleTarget = Property(doc="The measurement function and its analytic Jacobian.")

    @property
    def ndim_meas(self) -> int:
        """Number of rows."""
        return 6

    def function(self, state: GaussianState, noise: object = False, **kwargs: object) -> StateVector:
        """Return the measurement, without noise."""
        return self.target.function(np.asarray(state.state_vector)[:, 0])[:, None].view(StateVector)

    def jacobian(self, state: GaussianState, **kwargs: object) -> Array:
        """Return its derivative."""
        return self.target.jacobian(np.asarray(state.state_vector)[:, 0])


class StoneSoup:
    """A Stone Soup updater on a recorded pass, from the same arrays as everybody else.

    The satellites move, so every epoch has a measurement model of its own; all trials share it.

    Parameters
    ----------
    recorded : RecordedPass
        The measurements.
    updater : callable
        Makes the updater of one trial; its cache of earlier predictions is then empty.
    """

    def __init__(self, recorded: RecordedPass, updater: Callable[[], Updater]) -> None:
        assert isinstance(recorded.model, Stack)
        self._recorded = recorded
        self._stack = recorded.model
        self._updater = updater
        self._motion = LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=recorded.motion.transition(recorded.mean, PERIOD),
            covariance_matrix=CovarianceMatrix(recorded.motion.process_noise(recorded.mean, PERIOD)),
        )
        self._noise = CovarianceMatrix(recorded.model.noise_covariance())
        self._stamps = [_EPOCH + datetime.timedelta(seconds=float(t)) for t in recorded.times]
        self._models: list[Measurement] = []

    def run(self) -> History:
        """Filter all trials."""
        return self._run(range(self._recorded.trials), first=True)

    def parts(self, count: int) -> list[Callable[[], History]]:
        """Return `run` in parts, by trials, to be called in this order; empty where equal parts are not to be had."""
        trials = self._recorded.trials
        if count == 1 or trials % count:
            return []
        share = trials // count
        return [partial(self._run, range(k, k + share), first=k == 0) for k in range(0, trials, share)]

    def _run(self, trials: range, first: bool) -> History:
        if first:
            self._models = [self._model(platforms) for platforms in self._recorded.platforms[:, 0]]
        histories = [self._run_one(trial) for trial in trials]
        means, covariances = zip(*histories, strict=True)
        return np.array(means).swapaxes(0, 1)[..., 0], np.array(covariances).swapaxes(0, 1)

    def _model(self, platforms: Array) -> Measurement:
        target = SingleTarget(self._stack, platforms)
        return Measurement(ndim_state=6, mapping=_ALL, noise_covar=self._noise, target=target)

    def _run_one(self, trial: int) -> tuple[list[Array], list[Array]]:
        recorded, predictor, updater = self._recorded, KalmanPredictor(self._motion), self._updater()
        state = GaussianState(
            StateVector(recorded.mean[trial]), CovarianceMatrix(recorded.covariance[trial]), timestamp=self._stamps[0]
        )
        means, covariances = [state.state_vector], [state.covar]
        for z, stamp, model in zip(recorded.measurement[1:, trial], self._stamps[1:], self._models[1:], strict=True):
            detection = Detection(StateVector(z), timestamp=stamp, measurement_model=model)
            prediction = predictor.predict(state, timestamp=stamp)
            state = updater.update(SingleHypothesis(prediction, detection))
            means.append(state.state_vector)
            covariances.append(state.covar)
        return means, covariances


def iterated(recorded: RecordedPass) -> StoneSoup:
    """Return the iterated extended Kalman filter with the stop rule of the recorded `iekf`.

    Stone Soup counts differently: its limit n allows n + 2 linearisations.
    """
    algorithm = recorded.algorithm
    return StoneSoup(
        recorded,
        lambda: IteratedKalmanUpdater(
            measurement_model=None, tolerance=algorithm.tolerance, max_iterations=algorithm.max_iterations - 2
        ),
    )
