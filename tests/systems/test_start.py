"""How estimators start: once, when they can, and without using the first measurement twice."""

import numpy as np
import pytest

from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.known_height import known_height_fix
from quietfix.systems.starts.known_height_start import KnownHeightStart
from quietfix.systems.starts.start import GivenStart, PortStart, Start
from tests.laws.cases import estimators, tdoa
from tests.laws.rig import Scene, run

TRIALS, EPOCHS = 4, 8
ESTIMATORS = estimators()
each_estimator = pytest.mark.parametrize("name", ESTIMATORS)


class CountedStart(Start):
    """The given belief, from the trial's first measurement on; counts how often it is asked."""

    uses_measurement = True

    def __init__(self, mean, covariance):
        self.mean, self.covariance, self.calls = mean, covariance, 0

    def begin(self, measurement, platforms, inputs):
        self.calls += 1
        able = np.isfinite(measurement[:, :1])
        return np.where(able, self.mean, np.nan), np.broadcast_to(self.covariance, (len(able), 6, 6))


def from_epoch(scene, algorithm, first, trial, use_first):
    """The bare filter of one trial from its first epoch on; rows before it are NaN."""
    whitener = Whitener(scene.model.noise_covariance())
    mean, covariance = scene.mean[trial : trial + 1], scene.covariance[None]
    rows = []
    for k in range(first, scene.epochs):
        if k > first:
            mean, covariance = algorithm.predict(mean, covariance, scene.motion, 1.0)
        if k > first or use_first:
            platforms = scene.platforms[k].reshape(-1, 3, 6)
            z = scene.measurement[k, trial : trial + 1]
            result = algorithm.update(mean, covariance, Observation(z, platforms, whitener), scene.model)
            mean, covariance = result.mean, result.covariance
        rows.append(mean[0])
    return np.concatenate([np.full((first, 6), np.nan), rows])


@each_estimator
def test_a_start_from_the_measurement_uses_it_once(name):
    """Trials that hear something at epochs 0, 0, 3 and never."""
    scene = Scene(TRIALS, EPOCHS)
    scene.measurement[:3, 2] = np.nan
    scene.measurement[:, 3] = np.nan
    start = CountedStart(scene.mean, scene.covariance)
    block = scene.estimator(name, ESTIMATORS[name], start=start)
    _, values = run(block, scene.measurement, scene.platforms, scene.clock)
    first = [0, 0, 3]
    for i, k in enumerate(first):
        np.testing.assert_array_equal(values["estimate"][k, i], scene.mean[i])
        assert np.isnan(values["estimate"][:k, i]).all() and np.isfinite(values["estimate"][k:, i]).all()
        assert np.isnan(values["nis"][: k + 1, i]).all() and np.isfinite(values["nis"][k + 1 :, i]).all()
        assert not values["nis_dof"][: k + 1, i].any() and np.all(values["nis_dof"][k + 1 :, i] == 6)
        assert np.isnan(values["innovation"][: k + 1, i]).all()
        if isinstance(block, KalmanEstimator):
            expected = from_epoch(scene, block.algorithm, k, i, use_first=False)
            np.testing.assert_allclose(
                values["estimate"][:, i], expected, rtol=0, atol=1e-2 if "iekf" in name else 1e-6
            )
    assert np.isnan(values["estimate"][:, 3]).all() and np.isnan(values["nis"][:, 3]).all()


@each_estimator
def test_a_start_is_asked_only_until_every_trial_has_begun(name):
    scene = Scene(TRIALS, EPOCHS)
    start = CountedStart(scene.mean, scene.covariance)
    scene.run(name, ESTIMATORS[name], start=start)
    assert start.calls == 1
    late = CountedStart(scene.mean, scene.covariance)
    scene.measurement[:3, 1] = np.nan
    scene.run(name, ESTIMATORS[name], start=late)
    assert late.calls == 1 + 3  # at the beginning, at epochs 1 and 2 in vain, at epoch 3


@each_estimator
def test_a_given_start_uses_the_first_measurement(name):
    scene = Scene(TRIALS, EPOCHS)
    block = scene.estimator(name, ESTIMATORS[name])
    _, values = run(block, scene.measurement, scene.platforms, scene.clock)
    np.testing.assert_array_equal(values["prediction"][0], scene.mean)
    assert np.all(values["nis_dof"] == 6)
    if isinstance(block, KalmanEstimator):
        expected = from_epoch(scene, block.algorithm, 0, 1, use_first=True)
        np.testing.assert_allclose(values["estimate"][:, 1], expected, rtol=0, atol=1e-2 if "iekf" in name else 1e-6)


@pytest.mark.parametrize("own_mean", [True, False])
@pytest.mark.parametrize("own_covariance", [True, False])
def test_given_start_shapes(own_mean, own_covariance):
    mean = np.arange(18.0).reshape(3, 6) if own_mean else np.arange(6.0)
    covariance = np.stack([np.eye(6) * k for k in (1, 2, 3)]) if own_covariance else np.eye(6)
    x, p = GivenStart(mean, covariance).begin(np.zeros((3, 2)), np.zeros((1, 3, 6)), {})
    np.testing.assert_array_equal(x, np.broadcast_to(mean, (3, 6)))
    np.testing.assert_array_equal(p, np.broadcast_to(covariance, (3, 6, 6)))


@pytest.mark.parametrize(
    ("mean", "covariance", "message"),
    [
        (np.zeros(6), np.eye(5), "does not fit"),
        (np.zeros(6), np.zeros(6), "does not fit"),
        (np.full(6, np.nan), np.eye(6), None),  # a trial that cannot start is no mistake
    ],
)
def test_given_start_that_does_not_fit(mean, covariance, message):
    if message is None:
        GivenStart(mean, covariance)
        return
    with pytest.raises(ValueError, match=message):
        GivenStart(mean, covariance)


def test_given_start_for_another_number_of_trials():
    with pytest.raises(ValueError, match="3 trials"):
        GivenStart(np.zeros((3, 6)), np.eye(6)).begin(np.zeros((5, 2)), np.zeros((1, 3, 6)), {})


@each_estimator
def test_a_prior_on_a_port_is_a_prior(name):
    """It waits for what the port carries, and then uses the measurement of that instant, too."""
    scene = Scene(TRIALS, EPOCHS)
    prior = np.full((EPOCHS, TRIALS, 6), np.nan)
    prior[:] = scene.mean
    prior[:2, 2] = np.nan  # comes late
    block = scene.estimator(name, ESTIMATORS[name], start=PortStart(scene.covariance))
    inputs = {"initial_estimate": prior}
    _, values = run(block, scene.measurement, scene.platforms, scene.clock, inputs=inputs)
    assert np.all(values["nis_dof"][:, [0, 1, 3]] == 6)
    np.testing.assert_array_equal(values["nis_dof"][:, 2], [0, 0, 6, 6, 6, 6, 6, 6])
    assert np.isnan(values["estimate"][:2, 2]).all() and np.isfinite(values["estimate"][2:, 2]).all()
    if isinstance(block, KalmanEstimator):
        for i, k in ((0, 0), (2, 2)):
            expected = from_epoch(scene, block.algorithm, k, i, use_first=True)
            np.testing.assert_allclose(
                values["estimate"][:, i], expected, rtol=0, atol=1e-2 if "iekf" in name else 1e-6
            )


@each_estimator
def test_measurements_that_begin_after_the_run(name):
    """The clock's first tick is at 2.5 s: nothing before it, then a start from it."""
    scene = Scene(TRIALS, EPOCHS)
    scene.clock = Periodic(1.0, 2.5)
    start = CountedStart(scene.mean, scene.covariance)
    block = scene.estimator(name, ESTIMATORS[name], start=start)
    times, values = run(block, scene.measurement, scene.platforms, scene.clock, end=2.5 + EPOCHS - 1, log=Periodic(0.5))
    before = times < 2.5
    assert before.sum() == 5 and np.isnan(values["estimate"][before]).all()
    at = np.flatnonzero(times == 2.5)[0]
    np.testing.assert_array_equal(values["estimate"][at], scene.mean)
    assert not values["nis_dof"][at].any()
    assert np.all(values["nis_dof"][at + 2] == 6)


def known_height(scene, **options):
    return KnownHeightStart(tdoa(), scene.model.names, 3e3, 400.0, **options)


@each_estimator
def test_known_height(name):
    """The block begins at the fix of its first epoch, at rest, and takes no NIS from that epoch."""
    scene = Scene(TRIALS, EPOCHS)
    height = np.broadcast_to(10e3 + 3e3 * np.random.default_rng(4).normal(size=(TRIALS, 1)), (EPOCHS, TRIALS, 1))
    scene.measurement[0, 1, 0] = np.nan  # no fix yet
    scene.measurement[0, 3, 2:] = np.nan  # what the fix does not need
    start = known_height(scene)
    block = scene.estimator(name, ESTIMATORS[name], start=start)
    _, values = run(block, scene.measurement, scene.platforms, scene.clock, inputs={"assumed_height": height})
    carriers = scene.platforms.reshape(EPOCHS, 1, 3, 6)
    fix = known_height_fix(scene.measurement[0][:, :2], carriers[0], height[0, :, 0])
    later = known_height_fix(scene.measurement[1][:, :2], carriers[1], height[1, :, 0])
    assert np.isnan(values["estimate"][0, 1]).all()
    if not isinstance(block, KalmanEstimator):  # it may know more: what the phases allow, a cloud of particles
        error = values["estimate"][0, [0, 2], :3] - fix[[0, 2]]
        sigma = np.sqrt(np.trace(start.covariance_at(scene.truth[0], carriers[0, 0])[:3, :3]))
        assert np.linalg.norm(error, axis=-1).max() < sigma
        return
    np.testing.assert_allclose(values["estimate"][0, [0, 2, 3], :3], fix[[0, 2, 3]], atol=1e-6)
    np.testing.assert_allclose(values["estimate"][1, 1, :3], later[1], atol=1e-6)
    assert not values["estimate"][0, [0, 2, 3], 3:].any() and not values["estimate"][1, 1, 3:].any()
    np.testing.assert_array_equal(values["nis_dof"][:2], [[0, 0, 0, 0], [6, 0, 6, 6]])
    np.testing.assert_allclose(
        values["covariance"][0, 0], start.covariance_at(values["estimate"][0, 0], carriers[0, 0]), rtol=1e-6
    )
