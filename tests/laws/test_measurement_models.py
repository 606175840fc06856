"""What every measurement model must obey."""

import numpy as np
import pytest

from quietfix.systems.measurement.stack import Stack
from tests.laws.cases import GEOMETRIES, MEASUREMENTS

pytestmark = pytest.mark.parametrize("name", MEASUREMENTS)


def example(name):
    model, geometry = MEASUREMENTS[name]
    return model, GEOMETRIES[geometry].targets, GEOMETRIES[geometry].platforms


def derivative(function, state, steps):
    """Return the five-point central difference; its error is of the fourth order in the step."""
    columns = []
    for j, step in enumerate(steps):
        move = np.zeros(state.shape[-1])
        move[j] = step
        near = function(state + move) - function(state - move)
        far = function(state + 2 * move) - function(state - 2 * move)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


def test_jacobian_is_the_central_difference(name):
    model, targets, platforms = example(name)
    # A thousandth of the range: the difference is then exact to (1/1000)^4 and rounding to 1e-16 * 1000.
    reach = 1e-3 * np.linalg.norm(targets[:, None, :3] - platforms[..., :3], axis=-1).min()
    steps = [reach] * 3 + [100.0] * 3
    jacobian = model.jacobian(targets, platforms)
    assert np.isfinite(jacobian).all()
    numeric = derivative(lambda x: model.predict(x, platforms), targets, steps)
    assert jacobian.shape == (len(targets), model.size, 6)
    for columns in (slice(0, 3), slice(3, 6)):
        # a row is as large as its largest element; position and velocity are rows of their own (1/m and s/m)
        scale = np.abs(numeric[..., columns]).max(axis=-1, keepdims=True)
        error = np.abs(jacobian[..., columns] - numeric[..., columns])
        # A delay of one wave front depends on the velocity by 1e-2 m/c per m/s only: there rounding of the range,
        # 1e-10 m, is 1e-8 of what 100 m/s change.
        assert np.all(error <= 1e-6 * scale), (error / np.where(scale > 0, scale, 1)).max()


def test_linearize_is_predict_and_jacobian(name):
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    np.testing.assert_array_equal(value, model.predict(targets, platforms))
    np.testing.assert_array_equal(jacobian, model.jacobian(targets, platforms))


def test_leading_axes(name):
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    for i, target in enumerate(targets):
        # einsum sums in an order that may depend on the strides: a few rounding errors of the range, not of the
        # difference, which is a tenth of it
        one, row = model.linearize(target, platforms[0])
        assert one.shape == (model.size,) and row.shape == (model.size, 6)
        np.testing.assert_allclose(one, value[i], rtol=1e-12, atol=1e-14 * np.abs(value).max())
        np.testing.assert_allclose(row, jacobian[i], rtol=1e-9, atol=1e-12 * np.abs(jacobian).max())
    grid = targets[:12].reshape(3, 4, 6)
    shared, own = model.linearize(grid, platforms), model.linearize(grid, np.tile(platforms, (3, 4, 1, 1)))
    for a, b, flat in zip(shared, own, (value, jacobian), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
        np.testing.assert_allclose(a.reshape(flat[:12].shape), flat[:12], rtol=1e-12)


def test_sigma_points_of_every_trial(name):
    """The shapes an unscented filter uses: (trials, points, n) with platforms (1, 1, p, 6)."""
    model, targets, platforms = example(name)
    points = targets[:, None] + np.arange(3)[:, None] * np.array([10.0, 0, 0, 1, 0, 0])
    values = model.predict(points, platforms[:, None])
    np.testing.assert_allclose(values[:, 1], model.predict(points[:, 1], platforms), rtol=1e-12)


def test_further_states_do_not_matter(name):
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    wide = np.concatenate([targets, np.full((len(targets), 2), 7.0)], axis=-1)
    wide_value, wide_jacobian = model.linearize(wide, platforms)
    np.testing.assert_array_equal(wide_value, value)
    np.testing.assert_array_equal(wide_jacobian[..., :6], jacobian)
    assert not wide_jacobian[..., 6:].any()


def test_names_units_and_noise_fit(name):
    model, targets, platforms = example(name)
    assert len(model.names) == len(model.units) == model.size == model.predict(targets, platforms).shape[-1]
    assert len(set(model.names)) == model.size
    covariance = model.noise_covariance()
    assert covariance.shape == (model.size, model.size)
    np.testing.assert_array_equal(covariance, covariance.T)
    np.testing.assert_array_equal(model.sigmas, np.sqrt(np.diag(covariance)))
    assert np.linalg.eigvalsh(covariance / np.outer(model.sigmas, model.sigmas)).min() > 0.1


def test_noise_correlated_through_the_reference_alone(name):
    model, _, _ = example(name)
    correlation = model.noise_covariance() / np.outer(model.sigmas, model.sigmas)
    expected = np.eye(model.size)
    start = 0
    for part in leaves(model):
        rows = slice(start, start := start + part.size)
        if getattr(part, "correlated", False):
            expected[rows, rows] = 0.5 * (np.eye(part.size) + np.ones((part.size, part.size)))
    np.testing.assert_allclose(correlation, expected, atol=1e-14)


def leaves(model):
    return [leaf for part in model.models for leaf in leaves(part)] if isinstance(model, Stack) else [model]


def test_a_platform_that_is_not_used_does_not_matter_and_one_that_is_used_does(name):
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    used = model.platforms_used(platforms.shape[-2])
    assert used.shape == (model.size, platforms.shape[-2]) and used.dtype == bool
    for i in range(platforms.shape[-2]):
        gone = platforms.copy()
        gone[..., i, :] = np.nan
        without, rows = model.linearize(targets, gone)
        np.testing.assert_array_equal(np.isnan(without), np.broadcast_to(used[:, i], without.shape))
        np.testing.assert_array_equal(without[:, ~used[:, i]], value[:, ~used[:, i]])
        np.testing.assert_array_equal(rows[:, ~used[:, i]], jacobian[:, ~used[:, i]])


def test_a_target_that_is_nan_changes_no_other(name):
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    broken = targets.copy()
    broken[3] = np.nan
    other = np.arange(len(targets)) != 3
    with np.errstate(all="raise"):
        without, rows = model.linearize(broken, platforms)
    assert np.isnan(without[3]).all()
    np.testing.assert_array_equal(without[other], value[other])
    np.testing.assert_array_equal(rows[other], jacobian[other])


def test_residual_undoes_what_the_sensor_reports(name):
    """What a sensor reports of a value, wrapped or not, has no residual against that value."""
    model, targets, platforms = example(name)
    value = model.predict(targets, platforms)
    reported = model.represent(value)
    np.testing.assert_array_equal(model.represent(reported), reported)
    # wrapping takes the phase modulo 2 pi and loses 1e-16 of 2 pi 30
    np.testing.assert_allclose(model.residual(reported, value) / model.sigmas, 0, atol=1e-12)
    shifted = model.residual(model.represent(value + 0.1 * model.sigmas), value)
    np.testing.assert_allclose(shifted / model.sigmas, 0.1, atol=1e-9)
    kept = np.array([unit != "rad" for unit in model.units])
    np.testing.assert_array_equal(reported[..., kept], value[..., kept])
    if "wrapped" in name:
        assert np.all(np.abs(reported[..., ~kept]) <= np.pi)
        assert np.abs(value[..., ~kept]).max() > np.pi  # or else nothing was tested


def test_nothing_is_remembered_from_call_to_call(name):
    """Platforms that move, in the same array or in another, are seen where they are."""
    model, targets, platforms = example(name)
    moving = platforms.copy()
    before = model.linearize(targets, moving)
    moving[..., :3] *= 1.001
    fresh = model.linearize(targets, np.tile(moving, (len(targets), 1, 1)))  # nothing of that shape was asked before
    for value, expected in zip(model.linearize(targets, moving), fresh, strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-12)
    for value, expected in zip(model.linearize(targets, platforms), before, strict=True):
        np.testing.assert_array_equal(value, expected)


def test_targets_and_platforms_broadcast(name):
    """Leading axes meet from the right: one target and platforms with an axis more, targets and platforms without."""
    model, targets, platforms = example(name)
    value, jacobian = model.linearize(targets, platforms)
    for target, platform in ((targets[:1], platforms[0]), (targets[0], platforms), (targets[0], platforms[0])):
        one, derivative = model.linearize(target, platform)
        np.testing.assert_allclose(np.reshape(one, -1), value[0], rtol=1e-12)
        np.testing.assert_allclose(np.reshape(derivative, jacobian[0].shape), jacobian[0], rtol=1e-9, atol=1e-300)
