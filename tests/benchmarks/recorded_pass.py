"""The problem that all peers solve: the packaged `three_satellite` pass, recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw
from tests.benchmarks.harness import Size

__all__ = ["RecordedPass", "record_pass"]

Array = NDArray[np.float64]

PERIOD = 1.0
"""Time between measurements [s]."""


@dataclass(frozen=True)
class RecordedPass:
    """Measurements of one pass and what a filter needs to know.

    Attributes
    ----------
    times : ndarray, shape (epochs,)
        [s], `PERIOD` apart.
    measurement : ndarray, shape (epochs, trials, 6)
        TDOA [s], FDOA [Hz], phases [rad] with their ambiguities resolved. The first epoch is spent on the start
        and NaN.
    platforms : ndarray, shape (epochs, 1, 3, 6)
        Satellites, Earth-fixed.
    mean, covariance : ndarray, shapes (trials, 6) and (trials, 6, 6)
        The start, at the first epoch.
    estimate : ndarray, shape (epochs, trials, 6)
        What `iekf` of the packaged diagram made of it, with everything else in that diagram running.
    model : MeasurementModel
        What the estimators believe of the sensor.
    motion : MotionModel
        What they believe of the motion.
    algorithm : IteratedExtendedKalman
        The filter of `iekf` with the packaged options.
    """

    times: Array
    measurement: Array
    platforms: Array
    mean: Array
    covariance: Array
    estimate: Array
    model: MeasurementModel
    motion: MotionModel
    algorithm: IteratedExtendedKalman

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.mean.shape[0]

    @property
    def work(self) -> int:
        """Trials times steps (prediction and update)."""
        return self.trials * (len(self.times) - 1)

    def first(self, trials: int) -> RecordedPass:
        """Return the first trials alone."""
        return replace(
            self,
            measurement=self.measurement[:, :trials].copy(),
            mean=self.mean[:trials].copy(),
            covariance=self.covariance[:trials].copy(),
            estimate=self.estimate[:, :trials].copy(),
        )


def record_pass(size: Size) -> RecordedPass:
    """Run the packaged scenario with `iekf` and record what its estimator saw and said."""
    scenario = load_scenario("three_satellite", settings=[f"duration_s={size.duration}", f"period_s={PERIOD}"])
    builder = DiagramBuilder()
    wired = find("three_satellite").system.build(builder, scenario, ["iekf"], size.trials)
    iekf = wired.estimators["iekf"]
    assert isinstance(iekf, KalmanEstimator) and isinstance(iekf.algorithm, IteratedExtendedKalman)
    ports = {
        "measurement": wired.measurement,
        "platforms": wired.platforms,
        "estimate": iekf.GetOutputPort("estimate"),
        "covariance": iekf.GetOutputPort("covariance"),
    }
    recorder = record(builder, ports, wired.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw())
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(wired.duration)
    times, signals = recorder.result(context)
    assert iekf.start.uses_measurement
    measurement = signals["measurement"][:, :, [list(iekf.wiring.stream).index(row) for row in iekf.model.names]]
    measurement[0] = np.nan
    return RecordedPass(
        times,
        measurement,
        signals["platforms"].reshape(len(times), -1, 3, 6),
        signals["estimate"][0],
        signals["covariance"][0].reshape(-1, 6, 6),
        signals["estimate"],
        iekf.model,
        iekf.motion,
        iekf.algorithm,
    )
