"""FilterPy's extended and unscented Kalman filters on a recorded pass, one trial after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.measurement.stack import Stack
from tests.benchmarks.own_peers import History
from tests.benchmarks.recorded_pass import PERIOD, RecordedPass
from tests.benchmarks.single_target import SingleTarget

__all__ = ["extended", "unscented"]

Array = NDArray[np.float64]

# FilterPy inverts S as it is: with TDOA in seconds beside Hz SciPy warns at every step, which takes its time.
METRES = np.array([SPEED_OF_LIGHT, SPEED_OF_LIGHT, 1.0, 1.0, 1.0, 1.0])
"""Turns the rows TDOA [s], FDOA [Hz], phase [rad] into range difference [m], [Hz], [rad]."""


def extended(recorded: RecordedPass) -> Callable[[], History]:
    """Return what runs the extended Kalman filter over all trials."""
    measurement = recorded.measurement * METRES

    def one(trial: int, targets: Sequence[SingleTarget]) -> tuple[list[Array], list[Array]]:
        ekf = ExtendedKalmanFilter(dim_x=6, dim_z=6)
        ekf.F = recorded.motion.transition(recorded.mean, PERIOD)
        _set_up(ekf, recorded, trial)
        means, covariances = [ekf.x], [ekf.P]
        for target, z in zip(targets[1:], measurement[1:, trial], strict=True):
            ekf.predict()
            ekf.update(z, target.jacobian, target.function)
            means.append(ekf.x)
            covariances.append(ekf.P)
        return means, covariances

    return _over_trials(recorded, one)


def unscented(recorded: RecordedPass) -> Callable[[], History]:
    """Return what runs the unscented Kalman filter with the weights of the cubature rule over all trials."""
    transition = recorded.motion.transition(recorded.mean, PERIOD)
    measurement = recorded.measurement * METRES

    def move(x: Array, dt: float) -> Array:
        return transition @ x

    def one(trial: int, targets: Sequence[SingleTarget]) -> tuple[list[Array], list[Array]]:
        points = MerweScaledSigmaPoints(n=6, alpha=1.0, beta=0.0, kappa=0.0)
        ukf = UnscentedKalmanFilter(dim_x=6, dim_z=6, dt=PERIOD, hx=None, fx=move, points=points)
        _set_up(ukf, recorded, trial)
        means, covariances = [ukf.x], [ukf.P]
        for target, z in zip(targets[1:], measurement[1:, trial], strict=True):
            ukf.predict()
            ukf.update(z, hx=target.function)
            means.append(ukf.x)
            covariances.append(ukf.P)
        return means, covariances

    return _over_trials(recorded, one)


def _set_up(kalman: ExtendedKalmanFilter | UnscentedKalmanFilter, recorded: RecordedPass, trial: int) -> None:
    kalman.x, kalman.P = recorded.mean[trial], recorded.covariance[trial]
    kalman.Q = recorded.motion.process_noise(recorded.mean, PERIOD)
    kalman.R = recorded.model.noise_covariance() * METRES[:, None] * METRES


def _over_trials(
    recorded: RecordedPass, one: Callable[[int, Sequence[SingleTarget]], tuple[list[Array], list[Array]]]
) -> Callable[[], History]:
    assert isinstance(recorded.model, Stack)
    stack = recorded.model

    def run() -> History:
        targets = [SingleTarget(stack, platforms, speed=1.0) for platforms in recorded.platforms[:, 0]]
        means, covariances = zip(*(one(trial, targets) for trial in range(recorded.trials)), strict=True)
        return np.array(means).swapaxes(0, 1), np.array(covariances).swapaxes(0, 1)

    return run
