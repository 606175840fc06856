"""What an instant tells a filter: of some trials alone, with rows left out, with another noise."""

import numpy as np
import pytest

from quietfix.systems.filters.observation import Observation, linearised
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.base import MeasurementModel

TRIALS, ROWS = 5, 3


def covariances(shape):
    root = np.random.default_rng(2).normal(size=(*shape, ROWS, ROWS))
    return root @ np.swapaxes(root, -1, -2) + np.eye(ROWS)


def observation(noise, platforms=TRIALS):
    rng = np.random.default_rng(1)
    return Observation(rng.normal(size=(TRIALS, ROWS)), rng.normal(size=(platforms, 2, 6)), Whitener(noise))


NOISES = {
    "of all": covariances(()),
    "of each": covariances((TRIALS,)),
    "uncorrelated, of each": covariances((TRIALS,)) * np.eye(ROWS),
    "a row without": np.where(
        np.arange(TRIALS)[:, None, None] == 1, np.diag([1.0, 2.0, np.nan]), covariances((TRIALS,))
    ),
}


@pytest.mark.parametrize("which", [np.array([3]), np.array([1, 1, 4, 0]), np.arange(TRIALS) > 2], ids=str)
@pytest.mark.parametrize("name", NOISES)
def test_some_trials_are_as_if_they_were_alone(name, which):
    noise = NOISES[name]
    some = observation(noise).rows(which)
    whole = observation(noise)
    np.testing.assert_array_equal(some.value, whole.value[which])
    np.testing.assert_array_equal(some.platforms, whole.platforms[which])
    alone = Whitener(noise if noise.ndim == 2 else noise[which])
    np.testing.assert_array_equal(some.noise_covariance, alone.covariance)
    gone = np.zeros(some.value.shape, dtype=bool)
    gone[:, 2] = True
    np.testing.assert_array_equal(some.whitener.matrix(gone), alone.matrix(gone))
    if np.isfinite(alone.covariance).all():
        np.testing.assert_array_equal(some.whitener.matrix(None), alone.matrix(None))
    else:
        with pytest.raises(ValueError, match="finite in every row"):
            some.whitener.matrix(None)


def test_what_all_trials_share_stays():
    whole = observation(NOISES["of all"], platforms=1)
    some = whole.rows(np.array([4, 2]))
    assert some.platforms is whole.platforms and some.whitener is whole.whitener


def test_rows_are_left_out_of_a_copy():
    whole = observation(NOISES["of each"])
    before = whole.value.copy()
    trials = np.arange(TRIALS)[:, None] == 2
    np.testing.assert_array_equal(np.isnan(whole.without(trials).value), np.repeat(trials, ROWS, axis=1))
    one = np.arange(ROWS) == 1
    np.testing.assert_array_equal(np.isnan(whole.without(one).value), np.tile(one, (TRIALS, 1)))
    np.testing.assert_array_equal(whole.value, before)


def test_another_noise():
    whole = observation(NOISES["of all"])
    wider = whole.with_noise(4 * whole.noise_covariance)
    np.testing.assert_allclose(wider.whitener.matrix(None), 0.5 * whole.whitener.matrix(None), rtol=1e-12)
    assert wider.value is whole.value and wider.platforms is whole.platforms


class Square(MeasurementModel):
    """Each of three numbers squared; it has no value where a number is negative."""

    names, units = ("a", "b", "c"), ("1", "1", "1")

    def noise_covariance(self):
        return np.eye(3)

    def predict(self, target, platforms):
        return np.where(target < 0, np.nan, target**2)

    def jacobian(self, target, platforms):
        return 2 * target[..., None] * np.eye(3)


def test_what_it_says_about_a_state():
    """0 in rows that are not measured and in those for which the model has no value, W as if they were not there."""
    state = np.array([[1.0, 2.0, 3.0], [1.0, -2.0, 3.0]])
    r = covariances(())
    given = Observation(np.array([[2.0, np.nan, 9.5], [1.0, 4.0, 9.0]]), np.zeros((1, 1, 6)), Whitener(r))
    innovation, jacobian, weight, missing = linearised(given, Square(), state)
    np.testing.assert_array_equal(missing, [[False, True, False], [False, True, False]])
    np.testing.assert_array_equal(innovation, [[1.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(jacobian, np.array([np.diag([2.0, 0.0, 6.0])] * 2))
    left = np.ix_([0, 2], [0, 2])
    for w in weight:
        np.testing.assert_allclose(w[left].T @ w[left], np.linalg.inv(r[left]), rtol=1e-12)
        assert not w[1].any()
