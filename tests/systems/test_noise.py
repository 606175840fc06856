"""Counter-based noise: where it comes from and how it is distributed."""

import hashlib

import numpy as np
import pytest
from scipy import stats

from quietfix.systems.noise import normal, uniform


def test_a_draw_depends_on_what_it_is_of_and_on_nothing_else():
    one = normal(7, "sensor", 0, 5, 3, 6)
    np.testing.assert_array_equal(normal(7, "sensor", 0, 5, 3, 6), one)
    for other in (
        normal(8, "sensor", 0, 5, 3, 6),
        normal(7, "sensor2", 0, 5, 3, 6),
        normal(7, "sensor", 5, 5, 3, 6),
        normal(7, "sensor", 0, 5, 4, 6),
    ):
        assert not np.isin(other, one).any()


def test_frozen_numbers():
    """Studies can be run again years later only if these never change."""
    digest = hashlib.sha256(uniform(1, "sensor", 37, 3, 5, 6).tobytes()).hexdigest()
    assert digest == "96cb7f9ea211b1076a52a86570096a9926729210ed1e81a48a973fdd3f7f4db8"
    np.testing.assert_allclose(
        normal(1, "sensor", 37, 1, 5, 2)[0], [-0.5435047031566993, 0.5198873332087972], rtol=1e-14
    )


@pytest.mark.parametrize("size", [1, 4, 6, 9])
def test_any_slice_of_trials(size):
    whole = normal(0, "sensor", 0, 1000, 17, size)
    for first, trials in ((37, 1), (300, 400), (999, 1), (0, 7)):
        np.testing.assert_array_equal(normal(0, "sensor", first, trials, 17, size), whole[first : first + trials])


def test_far_trials_and_samples():
    """A hundred thousand trials of a million samples, and the largest numbers that travel as doubles."""
    for first, sample in ((10**5, 10**6), (2**53 - 1, 2**53)):
        draw = normal(0, "sensor", first, 2, sample, 6)
        assert np.isfinite(draw).all() and np.unique(draw).size == 12


def test_rows_do_not_depend_on_how_many_there_are_in_a_block_of_four():
    np.testing.assert_array_equal(normal(0, "s", 0, 9, 0, 6)[:, :5], normal(0, "s", 0, 9, 0, 5))


def test_distribution():
    """Kolmogorov-Smirnov over 2e5 draws, tails, and no correlation along any axis."""
    draws = np.stack([normal(11, "sensor", 0, 500, sample, 4) for sample in range(100)])
    # a fixed seed: the value is what it is; a p of 1e-3 would come once in a thousand seeds
    assert stats.kstest(draws.ravel(), "norm").pvalue > 1e-3
    n = draws.size
    assert abs(draws.mean()) < 4 / np.sqrt(n)
    assert abs(draws.var() - 1) < 4 * np.sqrt(2 / n)
    assert abs((draws**4).mean() - 3) < 4 * np.sqrt(96 / n)
    assert abs((np.abs(draws) > 3).mean() - 2 * stats.norm.sf(3)) < 4 * np.sqrt(0.0027 / n)
    for a, b in (
        (draws[1:], draws[:-1]),
        (draws[:, 1:], draws[:, :-1]),
        (draws[..., 1:], draws[..., :-1]),
        (normal(11, "a", 0, 50000, 0, 4), normal(11, "b", 0, 50000, 0, 4)),
        (normal(1, "a", 0, 50000, 0, 4), normal(2, "a", 0, 50000, 0, 4)),
    ):
        assert abs((a * b).mean()) < 4 / np.sqrt(a.size)


def test_uniform_never_touches_the_ends():
    u = uniform(0, "s", 0, 10**6, 0, 4)
    assert u.min() > 0 and u.max() < 1
    assert np.isfinite(normal(0, "s", 0, 10**5, 0, 4)).all()
    smallest, largest = (0 + 0.5) * 2.0**-52, (2**52 - 1 + 0.5) * 2.0**-52
    assert smallest > 0 and largest < 1  # what 52 bits can give; 53 would round to 1


def test_nothing_to_draw():
    assert normal(0, "s", 0, 3, 0, 0).shape == (3, 0)
    assert normal(0, "s", 0, 0, 0, 3).shape == (0, 3)


@pytest.mark.parametrize(("first", "sample"), [(-1, 0), (0, -1)])
def test_bad_counters(first, sample):
    with pytest.raises(ValueError, match=">= 0"):
        uniform(0, "s", first, 1, sample, 1)
