"""The fixed-lag block tells, while the run goes on, what the smoother of that lag says when it is over."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.lagging.fixed_lag import FixedLag
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.recorder import record
from quietfix.systems.smoothing.smoother import Smoother
from tests.laws.rig import Feed, Scene, with_gaps

EPOCHS = 18


def run(scene, options, lag, clock, times):
    """Return what estimator and block say, and the filter's algorithm."""
    builder = DiagramBuilder()
    scene.clock = clock
    block = builder.AddSystem(scene.estimator("iekf", options))
    for port in ("measurement", "platforms"):
        feed = builder.AddSystem(Feed(getattr(scene, port), clock, port))
        builder.Connect(feed.GetOutputPort("value"), block.GetInputPort(port))
    late = builder.AddSystem(FixedLag(block, lag, times[-1]))
    for port in ("estimate", "covariance"):
        builder.Connect(block.GetOutputPort(port), late.GetInputPort(port))
    ports = {port: block.GetOutputPort(port) for port in ("estimate", "covariance")}
    ports |= {f"late_{port}": late.GetOutputPort(port) for port in ("estimate", "covariance", "time")}
    recorder = record(builder, ports, clock)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(times[-1])
    return recorder.result(simulator.get_context())[1], block.algorithm


@pytest.mark.parametrize("lag", [0.0, 1.0, 4.0, 4.5, 100.0])
@pytest.mark.parametrize("irregular", [False, True], ids=["regular", "irregular"])
@pytest.mark.parametrize("options", [Iekf(), Ukf()], ids=["iekf", "ukf"])
def test_is_the_smoother_of_that_lag(options, irregular, lag):
    scene = Scene(6, EPOCHS)
    scene.measurement = with_gaps(scene.measurement)
    scene.mean[2] = np.nan  # never starts, and harms none
    times = np.cumsum(np.where(np.arange(EPOCHS) % 3, 0.5, 2.0)) - 2.0 if irregular else np.arange(float(EPOCHS))
    found, algorithm = run(scene, options, lag, Times(times) if irregular else Periodic(1.0), times)
    covariances = found["covariance"].reshape(EPOCHS, 6, 6, 6)
    told = found["late_time"][:, 0, 0]
    assert np.isnan(told[times < lag - 1e-9]).all() and np.isfinite(told[times >= lag]).all()
    for k in np.flatnonzero(np.isfinite(told)):
        at = int(np.searchsorted(times, times[k] - lag - 1e-9))
        assert told[k] == pytest.approx(times[at])
        smoother = Smoother(algorithm, scene.motion)
        mean, of = smoother.smooth(times[at : k + 1], found["estimate"][at : k + 1], covariances[at : k + 1])
        np.testing.assert_array_equal(found["late_estimate"][k], mean[0])
        np.testing.assert_array_equal(found["late_covariance"][k].reshape(6, 6, 6), of[0])
    assert np.isnan(found["late_estimate"][:, 2]).all()


def test_a_lag_that_is_none_is_refused():
    block = Scene(2, 3).estimator("iekf", Iekf())
    for lag in (-1.0, np.nan):
        with pytest.raises(ValueError, match="lag_s"):
            FixedLag(block, lag, 2.0)
