"""Quietfix itself: a filter as bare functions in a loop, and the same filter as a block in a Drake diagram."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.recorder import record
from quietfix.systems.sensors.recorded import RecordedMeasurements, Recording
from quietfix.systems.starts.start import GivenStart
from tests.benchmarks.recorded_pass import PERIOD, RecordedPass

__all__ = ["History", "diagram", "loop"]

Array = NDArray[np.float64]
History = tuple[Array, Array]
"""Means (epochs, trials, n) and covariances (epochs, trials, n, n)."""


def loop(algorithm: GaussianFilter, recorded: RecordedPass) -> History:
    """Call prediction and update of all trials at once, epoch by epoch."""
    mean, covariance = recorded.mean, recorded.covariance
    means, covariances = [mean], [covariance]
    whitener = Whitener(recorded.model.noise_covariance())
    for k in range(1, len(recorded.times)):
        mean, covariance = algorithm.predict(mean, covariance, recorded.motion, PERIOD)
        mean, covariance, *_ = algorithm.update(
            mean, covariance, Observation(recorded.measurement[k], recorded.platforms[k], whitener), recorded.model
        )
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


def diagram(algorithm: GaussianFilter, recorded: RecordedPass) -> Callable[[], History]:
    """Build a diagram of playback, estimator and recorder; return what runs it once, in a new context."""
    builder = DiagramBuilder()
    source = builder.AddSystem(
        RecordedMeasurements([Recording(recorded.times, recorded.measurement, recorded.platforms)])
    )
    wiring = Wiring(recorded.trials, recorded.model.names, source.clock, platforms=source.platforms)
    start = GivenStart(recorded.mean, recorded.covariance)
    estimator = builder.AddSystem(
        KalmanEstimator("estimator", algorithm, recorded.model, recorded.motion, start, wiring)
    )
    for port in ("measurement", "platforms"):
        builder.Connect(source.GetOutputPort(port), estimator.GetInputPort(port))
    ports = {port: estimator.GetOutputPort(port) for port in ("estimate", "covariance")}
    recorder = record(builder, ports, source.clock)
    built = builder.Build()
    simulator = Simulator(built)

    def run() -> History:
        context = built.CreateDefaultContext()
        simulator.reset_context(context)
        simulator.Initialize()
        simulator.AdvanceTo(recorded.times[-1])
        _, signals = recorder.result(context)
        n = recorded.mean.shape[-1]
        return signals["estimate"], signals["covariance"].reshape(-1, recorded.trials, n, n)

    return run
