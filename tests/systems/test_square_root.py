"""The measurement update in square-root terms, and the factors it needs, against exact arithmetic."""

import numpy as np
import pytest

from quietfix.systems.filters.square_root import Gains
from quietfix.systems.linear_algebra import cholesky, semidefinite_root, symmetric
from tests.laws.exact import exact, exact_update, solve_exactly


def problem(trials=5, n=6, m=4, size=3.0, seed=0):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(trials, n, n))
    return np.linalg.cholesky(a @ np.swapaxes(a, -1, -2)), size * rng.normal(size=(trials, m, n)), rng


def test_update_is_kalmans():
    root, h, rng = problem()
    innovation = rng.normal(size=(5, 4))
    gains = Gains(root, h @ root)  # unit noise: already white
    step, nis = gains.update(innovation)
    covariance = gains.covariance()
    for i in range(5):
        p = root[i] @ root[i].T
        x, expected, statistic = exact_update(np.zeros(6), p, h[i], np.eye(4), innovation[i])
        np.testing.assert_allclose(step[i], x, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(covariance[i], expected, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(nis[i], statistic, rtol=1e-10)
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    np.testing.assert_allclose(gains.correction(innovation), step, rtol=1e-12)
    half = gains.root()
    np.testing.assert_allclose(half @ np.swapaxes(half, -1, -2), covariance, rtol=1e-13)


def test_rows_of_nought_are_no_rows():
    root, h, rng = problem()
    innovation = rng.normal(size=(5, 4))
    h[:, 2], innovation[:, 2] = 0.0, 0.0
    kept = [0, 1, 3]
    full, short = Gains(root, h @ root), Gains(root, h[:, kept] @ root)
    for a, b in zip(full.update(innovation), short.update(innovation[:, kept]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    np.testing.assert_allclose(full.covariance(), short.covariance(), rtol=1e-12)
    nothing = Gains(root, np.zeros((5, 4, 6)))
    step, nis = nothing.update(np.zeros((5, 4)))
    assert not step.any() and not nis.any()
    np.testing.assert_allclose(nothing.covariance(), root @ np.swapaxes(root, -1, -2), rtol=1e-14)


def test_nis_where_the_innovation_is_huge():
    """A prior wide against the noise and an innovation to match: r^T r - g^T g would lose all digits of the sum."""
    root, h, _ = problem(m=6, size=1e3)
    rng = np.random.default_rng(8)
    y = h @ root
    innovation = (y @ rng.normal(size=(5, 6, 1)))[..., 0]
    _, nis = Gains(root, y).update(innovation)
    for i in range(5):
        s = exact(y[i]) @ exact(y[i]).T + exact(np.eye(6))
        r = exact(innovation[i])
        np.testing.assert_allclose(nis[i], float(r @ solve_exactly(s, r[:, None])[:, 0]), rtol=1e-8)


def test_a_trial_that_is_nan_hides_no_wide_one():
    """The choice of the factorisation is each trial's own."""
    root, h, rng = problem(size=1e6)
    innovation = rng.normal(size=(5, 4))
    alone = Gains(root[3:4], h[3:4] @ root[3:4]).update(innovation[3:4])
    h[0] = np.nan
    gains = Gains(root, h @ root)
    assert gains._wide is not None and not gains._wide[0] and gains._wide[1:].all()
    for a, b in zip(gains.update(innovation), alone, strict=True):
        np.testing.assert_allclose(a[3:4], b, rtol=1e-12)
        assert np.isnan(a[0]).all()


def test_the_two_factorisations_meet():
    """Where one takes over from the other nothing jumps."""
    rng = np.random.default_rng(9)
    rows = rng.normal(size=(20, 6, 6))
    scale = np.sqrt(np.max(np.swapaxes(rows, -1, -2) @ rows, axis=(-1, -2)))
    rows *= (1e4 / scale * np.linspace(0.99, 1.01, 20))[:, None, None]
    gains = Gains(np.eye(6), rows)
    assert 5 < np.count_nonzero(gains._wide) < 15
    whitened = rng.normal(size=(20, 6)) * 1e4
    step, nis = gains.update(whitened)
    covariance = gains.covariance()
    for i in range(20):
        y, r = exact(rows[i]), exact(whitened[i])
        gram, s = y.T @ y + exact(np.eye(6)), y @ y.T + exact(np.eye(6))
        expected = solve_exactly(gram, exact(np.eye(6)))
        np.testing.assert_allclose(covariance[i], expected.astype(float), rtol=0, atol=1e-7)
        np.testing.assert_allclose(step[i], (expected @ y.T @ r).astype(float), rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(nis[i], float(r @ solve_exactly(s, r[:, None])[:, 0]), rtol=1e-7)


# ----------------------------------------------------------------------------------------------- linear algebra


def test_cholesky_of_a_batch_with_bad_ones():
    """Each matrix for itself: a sound one, one with NaN, one that rounding has made indefinite, one of rank one."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=(4, 4))
    sound = a @ a.T
    indefinite = np.diag([1.0, 1.0, 1.0, -1e-17])
    one = np.outer([1.0, 1e3, 1e-3, 1.0], [1.0, 1e3, 1e-3, 1.0])
    batch = np.stack([sound, np.full((4, 4), np.nan), indefinite, one, sound])
    factors = cholesky(batch)
    np.testing.assert_array_equal(factors[[0, 4]], np.linalg.cholesky(batch[[0, 4]]))
    assert np.isnan(factors[1]).all()
    for i in (2, 3):
        np.testing.assert_array_equal(factors[i], np.tril(factors[i]))
        assert np.all(np.diag(factors[i]) > 0)
        scale = np.sqrt(np.maximum(np.diag(batch[i]), 1e-300))
        error = (factors[i] @ factors[i].T - batch[i]) / np.outer(scale, scale)
        # the eigenvalues of the correlation matrix are raised to 1e-12
        assert np.abs(error[np.isfinite(error)]).max() < 4e-12 or i == 2
        np.testing.assert_array_equal(cholesky(batch[i]), factors[i])
    assert not cholesky(np.zeros((0, 3, 3))).size


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_semidefinite_root_of_what_is_drawn(rank):
    a = np.random.default_rng(rank).normal(size=(3, rank)) * np.array([[1e-8], [1.0], [1e4]])
    root = semidefinite_root(a @ a.T)
    sigma = np.sqrt(np.diag(a @ a.T))
    np.testing.assert_allclose(root @ root.T / np.outer(sigma, sigma), a @ a.T / np.outer(sigma, sigma), atol=1e-12)


def test_symmetric_part():
    a = np.random.default_rng(0).normal(size=(3, 4, 4))
    np.testing.assert_array_equal(symmetric(a), np.swapaxes(symmetric(a), -1, -2))
    np.testing.assert_allclose(symmetric(symmetric(a)), symmetric(a), rtol=0)
