"""Quietfix itself: a filter as bare functions in a loop, and the same filter as a block in a Drake diagram."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from systems.clocks import Clock, Periodic
from systems.estimators.base import Wiring
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.start import GivenStart
from systems.filters.gaussian import GaussianFilter
from systems.filters.whitening import Whitener
from systems.recorder import record
from systems.signals import EnsembleBlock
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
            mean, covariance, recorded.measurement[k], recorded.platforms[k], recorded.model, whitener
        )
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


class Playback(EnsembleBlock):
    """Outputs ``measurement`` and ``platforms`` from arrays."""

    def __init__(self, recorded: RecordedPass, clock: Clock) -> None:
        super().__init__("playback")
        self._recorded = recorded
        self._clock = clock
        ticket = {self.time_ticket()}
        self.declare_output("measurement", recorded.trials, recorded.model.size, self._measurement, ticket)
        self.declare_output("platforms", 1, recorded.platforms[0].size, self._platforms, ticket)

    def _measurement(self, context: Context) -> Array:
        tick = self._clock.index(context.get_time())
        return self._recorded.measurement[0] * np.nan if tick is None else self._recorded.measurement[tick]

    def _platforms(self, context: Context) -> Array:
        tick = self._clock.index(context.get_time())
        return self._recorded.platforms[0] * np.nan if tick is None else self._recorded.platforms[tick]


def diagram(algorithm: GaussianFilter, recorded: RecordedPass) -> Callable[[], History]:
    """Build a diagram of playback, estimator and recorder; return what runs it once, in a new context."""
    builder, clock = DiagramBuilder(), Periodic(PERIOD)
    source = builder.AddSystem(Playback(recorded, clock))
    wiring = Wiring(recorded.trials, recorded.model.names, clock, platforms=recorded.platforms.shape[2])
    start = GivenStart(recorded.mean, recorded.covariance)
    estimator = builder.AddSystem(
        KalmanEstimator("estimator", algorithm, recorded.model, recorded.motion, start, wiring)
    )
    for port in ("measurement", "platforms"):
        builder.Connect(source.GetOutputPort(port), estimator.GetInputPort(port))
    ports = {port: estimator.GetOutputPort(port) for port in ("estimate", "covariance")}
    recorder = record(builder, ports, clock)
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
