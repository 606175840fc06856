"""What every motion model must obey."""

import numpy as np
import pytest

from tests.laws.cases import MOTIONS

pytestmark = pytest.mark.parametrize("name", MOTIONS)
DT = 1.7


def test_transition_is_the_central_difference(name):
    model, states = MOTIONS[name]
    transition = np.broadcast_to(model.transition(states, DT), (len(states), model.size, model.size))
    # a step of a thousandth of the state's size, and at least of one unit: the models are at most trigonometric
    steps = np.where(np.array(model.units) == "m", 10.0, np.where(np.array(model.units) == "m/s", 1.0, 1e-4))
    for j, step in enumerate(steps):
        move = np.zeros(model.size)
        move[j] = step
        numeric = (model.propagate(states + move, DT) - model.propagate(states - move, DT)) / (2 * step)
        # rounding of 6.4e6 m over a step of 1 m/s: 1e-9 of the column's largest element
        scale = np.abs(numeric).max(axis=-1, keepdims=True)
        assert np.all(np.abs(transition[..., j] - numeric) <= 1e-6 * scale)


def test_noise_is_a_covariance(name):
    model, states = MOTIONS[name]
    q = np.broadcast_to(model.process_noise(states, DT), (len(states), model.size, model.size))
    np.testing.assert_array_equal(q, np.swapaxes(q, -1, -2))
    values = np.linalg.eigvalsh(q)
    assert np.all(values >= -1e-14 * np.abs(values).max(axis=-1, keepdims=True))


def test_names_and_units_fit(name):
    model, states = MOTIONS[name]
    assert len(model.names) == len(model.units) == model.size == states.shape[-1]
    assert len(set(model.names)) == model.size


def test_leading_axes(name):
    model, states = MOTIONS[name]
    grid = np.stack([states, states + 1.0])
    moved = model.propagate(grid, DT)
    assert moved.shape == grid.shape
    for i in range(2):
        for k in range(len(states)):
            np.testing.assert_allclose(model.propagate(grid[i, k], DT), moved[i, k], rtol=1e-14)
            for function in (model.transition, model.process_noise):
                whole = np.broadcast_to(function(grid, DT), (*grid.shape, model.size))
                np.testing.assert_allclose(np.broadcast_to(function(grid[i, k], DT), whole.shape[2:]), whole[i, k])


def test_a_state_that_is_nan_changes_no_other_and_the_argument_stays(name):
    model, states = MOTIONS[name]
    states = np.concatenate([states, states])
    kept = states.copy()
    clean = model.propagate(states, DT)
    np.testing.assert_array_equal(states, kept)
    states[-1] = np.nan
    np.testing.assert_array_equal(model.propagate(states, DT)[:-1], clean[:-1])


def test_no_time_no_change(name):
    model, states = MOTIONS[name]
    np.testing.assert_array_equal(model.propagate(states, 0.0), states)
    identity = np.broadcast_to(np.eye(model.size), (len(states), model.size, model.size))
    np.testing.assert_array_equal(np.broadcast_to(model.transition(states, 0.0), identity.shape), identity)
    assert not np.asarray(model.process_noise(states, 0.0)).any()


def test_linear_means_linear(name):
    """Where a model says so, filters leave out what it then makes superfluous."""
    model, states = MOTIONS[name]
    if not model.linear:
        assert np.ptp(model.transition(states, DT), axis=0).max() > 0  # or else it should say that it is linear
        return
    phi = model.transition(states, DT)
    assert phi.shape == (model.size, model.size)
    np.testing.assert_allclose(model.propagate(states, DT), states @ phi.T, rtol=1e-14)
    twice = model.propagate(model.propagate(states, DT), 0.3)
    np.testing.assert_allclose(twice, model.propagate(states, DT + 0.3), rtol=1e-14)
