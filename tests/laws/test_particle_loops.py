"""Kernels in loops over particles: bit for bit what they say of one state; and the arithmetic that stands for calls."""

from dataclasses import replace

import numpy as np
import pytest

from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import compiled, load
from quietfix.systems.kernels.equations import _made, of_kernel, program
from quietfix.systems.kernels.evaluating import values
from quietfix.systems.kernels.models.arctangent import angle
from quietfix.systems.kernels.particles import calls, staging
from quietfix.systems.kernels.particles.exponential import exponential
from tests.laws.cases import GEOMETRIES, MEASUREMENTS
from tests.oracle import particles as oracle


@compiled("void(float64[::1],float64[::1],float64[::1])")
def angles(y, x, out):
    for i in range(out.shape[0]):
        out[i] = angle(y[i], x[i])


@compiled("void(float64[::1],float64[::1])")
def exponentials(x, out):
    for i in range(out.shape[0]):
        out[i] = exponential(x[i])


COMPILED = [name for name, (model, _) in MEASUREMENTS.items() if program(model) is not None]


@pytest.mark.parametrize("name", COMPILED)
def test_a_kernel_says_the_same_in_a_loop(name):
    """Seven particles more than a block: the last ones are done one by one, as all are alone."""
    model, geometry = MEASUREMENTS[name]
    code, state, seen = program(model), GEOMETRIES[geometry].targets[0], GEOMETRIES[geometry].platforms[:1]
    cloud = state + 1e-3 * np.abs(state) * np.random.default_rng(1).standard_normal((2, 519, state.size))
    measured = np.zeros((2, len(code.chosen)))
    straight = np.ascontiguousarray(cloud.swapaxes(1, 2))
    found = calls.residuals(_made(replaced(code)), straight, measured, seen)
    expected = -values(code, cloud, seen[:, None]).swapaxes(1, 2)
    np.testing.assert_array_equal(found.rows, expected)
    np.testing.assert_array_equal(found.there, np.isfinite(expected).sum(axis=-1))
    for part in (slice(0, 1), slice(500, 519)):
        alone = calls.residuals(_made(replaced(code)), np.ascontiguousarray(straight[:, :, part]), measured, seen)
        np.testing.assert_array_equal(alone.rows, found.rows[:, :, part])


def replaced(code):
    """Return the equations without wrapping."""
    return replace(code.equations, moduli=(0.0,) * len(code.chosen))


@kernel
def picky(state, platforms, parameters, value, jacobian):
    if state[0] > parameters[0]:
        raise ValueError("too far")
    for i in range(value.shape[0]):
        value[i] += state[i] * state[i]


def test_a_users_kernel_in_a_loop():
    cloud = np.random.default_rng(0).uniform(0, 1, (3, 4, 700))
    code = _made(of_kernel(picky, [2.0], rows=2, states=2))
    found = calls.residuals(code, cloud, np.zeros((3, 2)), np.zeros((1, 0, 6)))
    np.testing.assert_array_equal(found.rows, -np.square(cloud[:, :2]))
    cloud[1, 0, 600] = 2.5
    with pytest.raises(ValueError, match=r"kernel picky: for a target at \[2.5, .*too far"):
        calls.residuals(code, cloud, np.zeros((3, 2)), np.zeros((1, 0, 6)))


def test_residuals_are_wrapped_where_one_needs_it():
    code = _made(of_kernel(picky, [1e9], rows=2, states=2, modulus=[1.0, 0.0]))
    cloud = np.random.default_rng(0).uniform(-2, 2, (1, 2, 600))
    found = calls.residuals(code, cloud, np.full((1, 2), 0.3), np.zeros((1, 0, 6))).rows
    difference = 0.3 - np.square(cloud)
    np.testing.assert_array_equal(found[:, 0], (difference[:, 0] + 0.5) % 1.0 - 0.5)
    np.testing.assert_array_equal(found[:, 1], difference[:, 1])


def test_angle_is_that_of_mathematics():
    """Within two units in the last place, in all quadrants, near the axes and the diagonals."""
    rng = np.random.default_rng(2)
    y, x = rng.standard_normal((2, 60_000)) * 10.0 ** rng.uniform(-9, 9, (2, 60_000))
    y[::2] = x[::2] * rng.uniform(-3, 3, 30_000)
    special = np.array([[0, 0, 1, -1, 0, np.nan, 1, np.inf], [0, -1, 0, 0, 5, 1, np.nan, 1]])
    y, x = np.concatenate([y, special[0]]), np.concatenate([x, special[1]])
    out = np.empty_like(y)
    load(angles)(y, x, out)
    expected = np.arctan2(y, x)
    np.testing.assert_allclose(out, expected, rtol=2 * np.finfo(float).eps, atol=0)


def test_exponential_is_that_of_mathematics():
    rng = np.random.default_rng(3)
    x = np.concatenate([-(10.0 ** rng.uniform(-15, 2.85, 50_000)), [0.0, -707.9]])
    out = np.empty_like(x)
    load(exponentials)(x, out)
    np.testing.assert_allclose(out, np.exp(x), rtol=2 * np.finfo(float).eps, atol=0)
    beyond, zero = np.array([-709.0, -1e300, -np.inf, np.nan]), np.ones(4)
    load(exponentials)(beyond, zero)
    np.testing.assert_array_equal(zero, 0.0)


@pytest.mark.parametrize("count", [2, 513, 1300])
def test_a_stage(count):
    """Weights, moments and what a measurement says, against the oracle; trial by trial the same bits."""
    rng = np.random.default_rng(count)
    cloud, before = rng.standard_normal((4, 3, count)), rng.standard_normal((4, count))
    before[2] = 0.0
    residual, missing = rng.standard_normal((4, 2, count)), np.zeros((4, 2), dtype=bool)
    missing[1, 0], residual[0, 1, 1] = True, np.nan
    weight = Whitener(np.array([[2.0, 0.5], [0.5, 1.0]])).matrix(missing)
    shares = staging.prior_shares(before)
    assert shares.alike.tolist() == [False, False, True, False]
    prior = np.exp(before) / np.exp(before).sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(shares.weight[~shares.alike], prior[~shares.alike], rtol=1e-13)
    np.testing.assert_allclose(shares.log_sum, np.log(np.exp(before).sum(axis=-1)), rtol=1e-13)
    seen = calls.look(residual, missing, weight, shares.weight, shares.alike)
    white, logarithm = oracle.likelihood(residual, missing, weight)
    np.testing.assert_allclose(seen.logarithm, logarithm, rtol=1e-12)
    np.testing.assert_array_equal(seen.highest, seen.logarithm.max(axis=-1))
    mean, spread = oracle.moments(white, prior)
    np.testing.assert_allclose(seen.innovation, mean, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(seen.spread, spread, rtol=1e-11, atol=1e-12)
    known = np.where(np.isfinite(residual), residual, 0.0)
    np.testing.assert_allclose(seen.residual, np.einsum("tij,tj->ti", known, prior), rtol=1e-11, atol=1e-12)
    which, step = np.array([3, 0, 2]), np.array([0.2, 1.0, 0.7])
    now = staging.staged(cloud, before, which, shares.alike[which], seen.logarithm[which], step)
    after = before[which] + step[:, None] * logarithm[which]
    after_weight = np.exp(after) / np.exp(after).sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(now.log_weight, after, rtol=1e-12)
    np.testing.assert_allclose(now.weight, after_weight, rtol=1e-12)
    np.testing.assert_allclose(now.effective, 1 / np.square(after_weight).sum(axis=-1), rtol=1e-12)
    for found, expected in zip((now.mean, now.covariance), oracle.moments(cloud[which], after_weight), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
    for k, t in enumerate(which):
        one = np.array([t])
        alone = staging.staged(cloud, before, one, shares.alike[one], seen.logarithm[one], step[k : k + 1])
        for all_, own in zip(now, alone, strict=True):
            np.testing.assert_array_equal(own[0], all_[k])


@pytest.mark.parametrize("apart", [True, False])
@pytest.mark.parametrize("kernel", [True, False])
def test_renewed(apart, kernel):
    """Into others and in place; those that are not resampled stay as they were."""
    rng = np.random.default_rng(5)
    cloud, ancestor = rng.standard_normal((3, 2, 600)), rng.standard_normal((3, 600))
    which, weight, uniform = np.array([2, 0]), rng.exponential(size=(2, 600)), rng.uniform(size=(2, 1))
    chosen = oracle.parents(oracle.systematic(weight, uniform))
    expected = np.take_along_axis(cloud[which], chosen[:, None], axis=2)
    line = np.take_along_axis(ancestor[which], chosen, axis=1)
    drawn = None
    if kernel:
        states = np.stack([np.random.SFC64(key).state["state"]["state"] for key in (8, 9)])
        mean, root = rng.standard_normal((2, 2)), np.tril(rng.standard_normal((2, 2, 2)))
        drawn = mean, root, 0.8, states
        white = np.stack([oracle.normals(key, 1200).reshape(2, 600) for key in (8, 9)])
        expected = 0.8 * expected + 0.2 * mean[..., None] + root @ white
    into = (cloud, ancestor) if not apart else (np.full_like(cloud, 7.0), np.full_like(ancestor, 7.0))
    middle, logarithm = into[0][1].copy(), np.ones((3, 600))
    staging.renewed((cloud, ancestor), which, weight, uniform, drawn, (*into, logarithm))
    np.testing.assert_allclose(into[0][which], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(into[1][which], line)
    np.testing.assert_array_equal(into[0][1], middle)
    np.testing.assert_array_equal(logarithm[:, 0], [0.0, 1.0, 0.0])
