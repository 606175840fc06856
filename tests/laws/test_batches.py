"""A trial is the same alone and in a batch, whatever its size and whatever is missing in which trial: bit for bit."""

import math

import numpy as np
import pytest

from quietfix.systems.filters.hypotheses import branch
from quietfix.systems.filters.modified_gain import ModifiedGainKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Gains
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.linear_algebra import dot
from quietfix.systems.noise import normal
from tests.laws.cases import FILTERS, estimators
from tests.laws.rig import Scene, assert_same, with_gaps

TRIALS, EPOCHS = 100, 25
PARTS = {"1": slice(37, 38), "7": slice(33, 40), "11": slice(30, 41)}
each_scene = pytest.mark.parametrize("rows", ["complete", "with gaps"])


@pytest.fixture(scope="module")
def scenes():
    """A scene whose rows are all there, and one of which a seventh is missing, and of each trial a whole epoch."""
    complete = Scene(TRIALS, EPOCHS)
    gaps = complete.only(slice(None))
    gaps.measurement = with_gaps(complete.measurement)
    return {"complete": complete, "with gaps": gaps}


@pytest.fixture(scope="module")
def batches(scenes):
    return {(rows, name): scenes[rows].run(name, each) for rows in scenes for name, each in estimators().items()}


def some(values, trials):
    return {port: value[:, trials] for port, value in values.items()}


@each_scene
@pytest.mark.parametrize("size", PARTS)
@pytest.mark.parametrize("name", estimators())
def test_estimator(scenes, batches, name, size, rows):
    whole = some(batches[rows, name], PARTS[size])
    assert np.isfinite(whole["estimate"]).all()
    assert_same(scenes[rows].only(PARTS[size]).run(name, estimators()[name]), whole)


@each_scene
@pytest.mark.parametrize("name", FILTERS)
def test_filter(scenes, name, rows):
    """Bare functions, through a whole pass."""
    algorithm, whitener = FILTERS[name], Whitener(scenes[rows].model.noise_covariance())

    def run(part):
        mean, covariance = part.mean, np.broadcast_to(part.covariance, (part.trials, 6, 6))
        for k in range(EPOCHS):
            if k:
                mean, covariance = algorithm.predict(mean, covariance, part.motion, 1.0)
            platforms = part.platforms[k].reshape(-1, 3, 6)
            result = algorithm.update(
                mean, covariance, Observation(part.measurement[k], platforms, whitener), part.model
            )
            mean, covariance = result.mean, result.covariance
        return result

    batch = run(scenes[rows])
    for trials in PARTS.values():
        for alone, whole in zip(run(scenes[rows].only(trials)), batch, strict=True):
            np.testing.assert_array_equal(alone, whole[trials])


@pytest.mark.parametrize("name", estimators())
def test_a_trials_own_platforms(scenes, batches, name):
    """Platforms per trial instead of shared ones change nothing."""
    own = scenes["with gaps"].only(PARTS["7"])
    own.platforms = np.tile(own.platforms, (1, 7, 1))
    assert_same(own.run(name, estimators()[name]), some(batches["with gaps", name], PARTS["7"]))


@pytest.mark.parametrize("length", [3, 1000, 8192, 8193, 20_000])
def test_sum_of_products(length):
    a, b = np.random.default_rng(1).normal(size=(2, 7, length))
    whole = dot(a, b)
    for i in range(7):
        np.testing.assert_array_equal(dot(a[i : i + 1], b[i : i + 1]), whole[i : i + 1])
    exact = np.array([math.fsum(row) for row in a * b])
    # rounding of a sum in any order: at most length * eps * sum|ab| (Higham, Accuracy and Stability, section 4.2)
    assert np.all(np.abs(whole - exact) <= length * np.finfo(float).eps * np.abs(a * b).sum(axis=-1))


def test_another_trials_doubt_reorders_no_hypotheses():
    """Trial 0 knows its integers, but its second hypothesis fits better than its first; trial 1 is in doubt."""
    turns, sigma = np.array([[0.2], [0.0], [0.45]]), np.array([[0.02], [0.02], [0.2]])
    weights, trial, slot = np.array([0.5, 0.4, 1.0]), np.array([0, 0, 1]), np.array([0, 1, 0])
    parent, integers, place = branch(turns, sigma, weights, trial, slot, 4)
    own = trial[parent] == 0
    alone = branch(turns[:2], sigma[:2], weights[:2], trial[:2], slot[:2], 4)
    order = np.argsort(parent[own])
    for value, expected in zip((parent, integers, place), alone, strict=True):
        np.testing.assert_array_equal(value[own][order], expected)
    assert np.count_nonzero(~own) > 1  # trial 1 did branch


def test_modified_gain_of_another_trial():
    """A prior so wide that its covariance is inflated, beside a trial with a gain of its own."""
    rng = np.random.default_rng(2)
    root, rows = np.tile(np.eye(3), (2, 1, 1)), 1e5 * rng.normal(size=(2, 2, 3))
    difference = np.zeros((2, 2, 3))
    difference[1] = rng.normal(size=(2, 3))
    both = ModifiedGainKalman._covariance(Gains(root, rows), difference)
    for i in range(2):
        one = slice(i, i + 1)
        np.testing.assert_array_equal(
            ModifiedGainKalman._covariance(Gains(root[one], rows[one]), difference[one]), both[one]
        )


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 9])
def test_noise(size):
    batch = normal(3, "sensor", 0, 100, 17, size)
    for part in PARTS.values():
        rows = normal(3, "sensor", part.start, part.stop - part.start, 17, size)
        np.testing.assert_array_equal(rows, batch[part])
