"""Laws of whole diagrams, on the packaged scenarios: reproducibility, chunks, noise, cost in calls."""

import numpy as np
import pytest

from quietfix.systems.counting import counting
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.sensors.sensor import Sensor
from tests.laws.packaged import Packaged

SHORT = {"duration_s": 25}


@pytest.fixture(scope="module")
def hundred():
    packaged = Packaged("three_satellite", 100, SHORT)
    return packaged, packaged.run(seed=5)[1]


@pytest.mark.parametrize(("first", "count"), [(37, 1), (33, 7)])
def test_trial_37_alone_is_trial_37_of_the_batch(hundred, first, count):
    """Five estimators, resolver with feedback, start, sensors: bit for bit."""
    batch = hundred[1]
    alone = Packaged("three_satellite", count, SHORT).run(seed=5, first_trial=first)[1]
    for port, values in batch.items():
        shared = values.shape[1] == 1
        expected = values if shared else values[:, first : first + count]
        np.testing.assert_array_equal(alone[port], expected, err_msg=port)


def test_other_seeds_and_trials_are_other_draws(hundred):
    packaged, batch = hundred
    other = packaged.run(seed=6)[1]["measurement"]
    later = packaged.run(seed=5, first_trial=100)[1]["measurement"]
    for values in (other, later):
        assert not np.isin(values[..., 0], batch["measurement"][..., 0]).any()


def test_an_extra_block_changes_no_noise(hundred):
    """Another sensor and another random plant in the diagram: the same draws for those that were there."""
    _, batch = hundred

    def extra(builder, wired):
        clock, trials = wired.clock, 100
        other = builder.AddSystem(Sensor(Altitude(10.0), clock, trials, 3, name="altimeter"))
        builder.Connect(wired.truth, other.GetInputPort("target"))
        builder.Connect(wired.platforms, other.GetInputPort("platforms"))
        drift = builder.AddSystem(
            ModelPlant(wired.model.truth_motion, clock, np.zeros(6), np.eye(6), trials, name="drift")
        )
        return {"altimeter": other.GetOutputPort("measurement"), "drift": drift.GetOutputPort("state")}

    signals = Packaged("three_satellite", 100, SHORT, extra=extra).run(seed=5)[1]
    for port in batch:
        np.testing.assert_array_equal(signals[port], batch[port], err_msg=port)
    assert np.unique(signals["altimeter"]).size == signals["altimeter"].size


def test_fewer_estimators_change_nothing_of_the_first(hundred):
    """The first one's prediction resolves the phases; who else is there does not matter to it."""
    _, batch = hundred
    signals = Packaged("three_satellite", 100, SHORT, estimators=["iekf"]).run(seed=5)[1]
    for port in signals:
        np.testing.assert_array_equal(signals[port], batch[port], err_msg=port)


def test_a_hundred_trials_cost_as_many_calls_as_one():
    """Sensor and filters are called once an epoch, whatever the number of trials."""
    counts = []
    for trials in (1, 100):
        packaged = Packaged("three_satellite", trials, SHORT, ["iekf", "ekf", "ukf"])
        with counting() as calls:
            packaged.run()
        counts.append(calls)
    assert counts[0] == counts[1]
    epochs = SHORT["duration_s"] + 1
    for name in ("iekf", "ekf", "ukf"):
        # once an epoch; the start and the last epoch, whose update is pending, may ask once more
        assert epochs <= counts[0][f"{name}.posterior"] <= epochs + 2
        assert epochs <= counts[0][f"{name}.prior"] <= epochs + 2
    assert epochs <= counts[0]["sensor.reading"] <= epochs + 2
    assert 1 <= counts[0]["assumed_height.reading"] <= 2  # the height is assumed once
