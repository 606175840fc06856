"""The compiled loops over particles against the same in NumPy; and a trial alone is the trial in a batch."""

import numpy as np
import pytest

from quietfix.systems.filters.particle.motion import propagate
from quietfix.systems.filters.particle.resampling import parents, systematic
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.particles import calls
from tests.laws.cases import MOTIONS
from tests.oracle import particles as oracle

SIZES = [2, 511, 1300]  # below, and not a multiple of, what is worked on at a time


def cloud_of(count, trials=3, n=6):
    rng = np.random.default_rng(count)
    cloud = 1e3 * rng.standard_normal((trials, n, count)) + 6e6
    weight = rng.exponential(size=(trials, count)) ** 3
    return rng, cloud, weight / weight.sum(axis=-1, keepdims=True)


def same_alone(whole, alone):
    """Hold a function of a trial against what it gave for all of them."""
    for t in range(len(whole[0])):
        for one, all_ in zip(alone(slice(t, t + 1)), whole, strict=True):
            np.testing.assert_array_equal(one[0], all_[t])


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("weighted", [True, False])
def test_moments(count, weighted):
    _, cloud, weight = cloud_of(count)
    weight = weight if weighted else None
    mean, covariance = calls.weighted_moments(cloud, weight)
    expected, spread = oracle.moments(cloud, weight)
    np.testing.assert_allclose(mean, expected, rtol=1e-12)
    # a mean that is rounded to 1e-9 m moves a covariance by its square
    scale = np.sqrt(np.einsum("tii->ti", spread))
    np.testing.assert_allclose((covariance - spread) / scale[:, :, None] / scale[:, None], 0, atol=1e-10)
    same_alone((mean, covariance), lambda t: calls.weighted_moments(cloud[t], None if weight is None else weight[t]))


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("diagonal", [True, False])
def test_likelihood(count, diagonal):
    """With a row missing in a trial, two in another, and a particle for which the model has no value."""
    rng = np.random.default_rng(count)
    residual = rng.standard_normal((3, 4, count))
    missing = np.zeros((3, 4), dtype=bool)
    missing[1, 2] = missing[2, 0] = missing[2, 3] = True
    residual[1, 2, 1] = residual[0, 1, 0] = np.nan
    noise = np.diag([1.0, 2.0, 3.0, 4.0]) if diagonal else np.diag([1.0, 2.0, 3.0, 4.0]) + 0.5
    weight = Whitener(noise).matrix(missing)
    white, logarithm = calls.likelihoods(residual, missing, weight)
    expected = oracle.likelihood(residual, missing, weight)
    np.testing.assert_allclose(white, expected[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(logarithm, expected[1], rtol=1e-12)
    assert logarithm[0, 0] == -np.inf
    assert np.isfinite(logarithm[1]).all()
    same_alone((white, logarithm), lambda t: calls.likelihoods(residual[t], missing[t], weight[t]))


@pytest.mark.parametrize("count", SIZES)
def test_resampling(count):
    rng, cloud, weight = cloud_of(count)
    weight[0, count // 2 :] = 0.0
    uniform = rng.uniform(size=(3, 1))
    counts = systematic(weight, uniform)
    np.testing.assert_array_equal(counts, oracle.systematic(weight, uniform))
    chosen = parents(counts)
    np.testing.assert_array_equal(chosen, oracle.parents(counts))
    ancestor, fresh, line = weight + 1.0, np.empty_like(cloud), np.empty_like(weight)
    calls.gather(cloud, ancestor, chosen, fresh, line)
    np.testing.assert_array_equal(fresh, np.take_along_axis(cloud, chosen[:, None], axis=2))
    np.testing.assert_array_equal(line, np.take_along_axis(ancestor, chosen, axis=1))


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize("shared", [True, False])
def test_moved(count, shared):
    rng, cloud, _ = cloud_of(count)
    phi, root = rng.standard_normal((1 if shared else 3, 6, 6)), rng.standard_normal((1 if shared else 3, 6, 2))
    offset, white = rng.standard_normal((3, 6)), rng.standard_normal((3, 2, count))
    found = calls.moved(cloud, phi[0] if shared else phi, offset, root[0] if shared else root, white)
    # of the largest of the products that are added up
    np.testing.assert_allclose(found, oracle.moved(cloud, phi, offset, root, white), rtol=1e-12, atol=1e-12 * 2e7)

    def own(t):
        return (calls.moved(cloud[t], phi[0 if shared else t], offset[t], root[0 if shared else t], white[t]),)

    same_alone((found,), own)


@pytest.mark.parametrize("name", MOTIONS)
def test_cloud_moves_as_its_particles_do(name):
    motion, states = MOTIONS[name]
    states = np.resize(states, (3, *states.shape)) * (1 + 1e-6 * np.arange(3))[:, None, None]
    cloud = np.ascontiguousarray(states.swapaxes(1, 2))
    mean = states.mean(axis=1)
    if motion.input_size:
        motion = motion.driven(mean[:, 6:9])
    n, count = cloud.shape[1:]
    rng = np.random.default_rng(1)
    root, white, out = rng.standard_normal((n, n)), rng.standard_normal((3, n, count)), np.empty_like(cloud)
    propagate(motion, mean, cloud, 0.5, root, white, out)
    alone = motion.driven(mean[:, None, 6:9]) if motion.input_size else motion
    expected = alone.propagate(states, 0.5).swapaxes(1, 2) + root @ white
    np.testing.assert_allclose(out, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("count", [1, 3, 300_000])
def test_normals_are_numpys(count):
    """Three hundred thousand: some hundred lie beyond the last layer of the ziggurat, two thousand in its wedges."""
    key = 2**100 + count
    drawn = np.empty(count)
    ready("particles.normals:fill")(np.random.SFC64(key).state["state"]["state"], drawn)
    np.testing.assert_array_equal(drawn, oracle.normals(key, count))
