"""Resampling schemes: counts, bias, spread, and that a trial does not depend on its neighbours."""

import numpy as np
import pytest

from quietfix.systems.filters.particle.resampling import SCHEMES, parents, residual, systematic

each_scheme = pytest.mark.parametrize("name", SCHEMES)


def weights(trials, n, seed=0):
    """Weights from nearly equal to nearly all on one particle."""
    rng = np.random.default_rng(seed)
    w = rng.exponential(size=(trials, n)) ** rng.uniform(0.1, 8.0, size=(trials, 1))
    return w / w.sum(axis=-1, keepdims=True)


def counts(name, w, seed=1):
    scheme = SCHEMES[name]
    return scheme.counts(w, np.random.default_rng(seed).uniform(size=(len(w), 1 if scheme.one_number else w.shape[1])))


def textbook(name, w, u):
    """One trial as the books have it: points into the distribution function, one after the other."""
    n = len(w)
    edges = np.cumsum(w / w.sum())
    edges[-1] = 1.0
    taken = np.zeros(n, dtype=int)
    points = u
    if name == "systematic":
        points = (np.arange(n) + u[0]) / n
    elif name == "stratified":
        points = (np.arange(n) + u) / n
    elif name == "residual":
        taken = np.floor(n * w).astype(int)
        left = n * w - taken
        points, edges = u[: n - taken.sum()], np.cumsum(left / left.sum())
        edges[-1] = 1.0
    for point in points:
        taken[np.flatnonzero(point < edges)[0]] += 1
    return taken


@each_scheme
def test_as_the_books_have_it(name):
    w = weights(20, 50)
    u = np.random.default_rng(1).uniform(size=(20, 1 if SCHEMES[name].one_number else 50))
    expected = [textbook(name, w[i], u[i]) for i in range(20)]
    np.testing.assert_array_equal(SCHEMES[name].counts(w, u), expected)


@each_scheme
@pytest.mark.parametrize("n", [1, 2, 3, 1000])
def test_counts_sum_to_the_number_of_particles(name, n):
    w = weights(200, n)
    taken = counts(name, w)
    assert taken.min() >= 0
    np.testing.assert_array_equal(taken.sum(axis=-1), n)
    rows = parents(taken)
    assert rows.shape == w.shape and np.all(np.diff(rows, axis=-1) >= 0)
    for i in range(3):
        np.testing.assert_array_equal(np.bincount(rows[i], minlength=n), taken[i])


@each_scheme
@pytest.mark.parametrize("u", [1e-17, 0.5, 1 - 2**-53])
def test_counts_at_the_ends(name, u):
    """The smallest and the largest uniform numbers; all weight on the first, on the last, or equal."""
    n = 10
    w = np.stack([np.eye(n)[0], np.eye(n)[-1], np.full(n, 1 / n)])
    taken = SCHEMES[name].counts(w, np.full((3, 1 if SCHEMES[name].one_number else n), u))
    np.testing.assert_array_equal(taken.sum(axis=-1), n)
    assert taken[0, 0] == n and taken[1, -1] == n
    if name != "multinomial" and u == 0.5:  # at the ends a sum of tenths is a rounding error off
        np.testing.assert_array_equal(taken[2], 1)


@each_scheme
def test_unbiased(name):
    """Mean counts of 20,000 drawings: within five of their standard errors of N w."""
    w, draws = weights(1, 8, seed=3), 20_000
    taken = counts(name, np.repeat(w, draws, axis=0))
    error = np.sqrt(np.maximum(taken.var(axis=0), 1e-4) / draws)
    assert np.all(np.abs(taken.mean(axis=0) - 8 * w[0]) < 5 * error)


def test_distance_from_the_expected_counts():
    """Systematic: less than one; stratified: less than two; residual: the whole part is certain."""
    w = weights(500, 200)
    expected = 200 * w
    rounding = 1e-9
    assert np.abs(counts("systematic", w) - expected).max() <= 1 + rounding
    assert np.abs(counts("stratified", w) - expected).max() <= 2 + rounding
    assert np.all(counts("residual", w) >= np.floor(expected - rounding))
    assert np.abs(counts("multinomial", w) - expected).max() > 3  # or else nothing was tested


def test_spread_of_the_resampled_mean():
    """Weights exp(-((x - 1)/.3)^2/2) on N(0, 1): the order of the schemes, and the variance of plain drawing.

    N times the variance of the resampled mean is the weighted variance for multinomial drawing, 0.083; 2000 drawings
    know it to 3 %.
    """
    rng = np.random.default_rng(2)
    x = rng.normal(size=1000)
    w = np.exp(-(((x - 1) / 0.3) ** 2) / 2)
    w /= w.sum()
    many = np.repeat(w[None], 2000, axis=0)
    spread = {name: 1000 * np.var(counts(name, many) @ x / 1000) for name in SCHEMES}
    plain = w @ (x - w @ x) ** 2
    assert spread["multinomial"] == pytest.approx(plain, rel=0.12)
    assert spread["systematic"] < spread["residual"] < spread["multinomial"]
    assert spread["stratified"] < spread["residual"]


@each_scheme
def test_a_trial_does_not_depend_on_its_neighbours(name):
    w = weights(30, 400)
    u = np.random.default_rng(5).uniform(size=(30, 1 if SCHEMES[name].one_number else 400))
    batch = SCHEMES[name].counts(w, u)
    for rows in (slice(7, 8), slice(7, 14)):
        np.testing.assert_array_equal(SCHEMES[name].counts(w[rows], u[rows]), batch[rows])


def test_weights_need_not_be_normalised():
    w = weights(5, 100)
    u = np.full((5, 1), 0.3)
    np.testing.assert_array_equal(systematic(1e-200 * w, u), systematic(w, u))


def test_nothing_left_to_draw():
    """Equal weights: every particle once, for certain."""
    np.testing.assert_array_equal(residual(np.full((2, 4), 0.25), np.full((2, 4), 0.9)), 1)
