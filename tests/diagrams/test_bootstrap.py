"""The paired bootstrap against SciPy's and against theory."""

import numpy as np
import pytest
from scipy.stats import bootstrap

from quietfix.diagrams.statistics.bootstrap import Interval, PairedBootstrap, Replicates, best_of, interval, log_ratio

RMSE = np.sqrt


def replicates(squares, resamples=999, seed=0):
    return PairedBootstrap(squares.shape[0], resamples, seed).apply(squares, RMSE)


def test_equals_scipy():
    """One column, the same kind of interval: equal within the scatter of 9999 resamples of either."""
    squares = np.random.default_rng(1).chisquare(1, (80, 1))
    ours = interval(replicates(squares, 9999))
    theirs = bootstrap(
        (squares[:, 0],),
        lambda x, axis: np.sqrt(x.mean(axis=axis)),
        n_resamples=9999,
        method="BCa",
        rng=np.random.default_rng(2),
    )
    width = theirs.confidence_interval.high - theirs.confidence_interval.low
    assert abs(ours.low[0] - theirs.confidence_interval.low) < 0.04 * width
    assert abs(ours.high[0] - theirs.confidence_interval.high) < 0.04 * width


def test_interval_covers_the_true_rmse():
    """95 % asked for. Squared errors of one dimension, 100 trials, 2000 repetitions: SciPy's BCa covers 92-93 % there
    (skewness 2.8 at 100 trials), and 3 sigma of 2000 are 1.7 %."""
    squares = np.random.default_rng(3).chisquare(1, (100, 2000))
    found = interval(replicates(squares))
    covered = np.mean((found.low <= 1) & (found.high >= 1))
    assert 0.905 < covered < 0.967
    # three-dimensional errors are less skewed
    found = interval(replicates(np.random.default_rng(4).chisquare(3, (100, 2000)) / 3))
    assert 0.925 < np.mean((found.low <= 1) & (found.high >= 1)) < 0.967


def test_pairing_narrows_the_ratio_and_keeps_its_coverage():
    """Errors with correlation 0.95 and a true RMSE ratio of 1.1: the paired interval of the ratio covers 95 % (3 sigma
    of 1000 are 2 %, and 1 % is the bootstrap's own error at 100 trials), and is a third of the unpaired one."""
    rng = np.random.default_rng(5)
    common, own = rng.standard_normal((2, 100, 1000))
    a, b = common**2, (1.1 * (0.95 * common + np.sqrt(1 - 0.95**2) * own)) ** 2
    paired = interval(log_ratio(replicates(b), replicates(a)))
    covered = (paired.low <= np.log(1.1)) & (paired.high >= np.log(1.1))
    assert 0.92 < covered.mean() < 0.975
    apart = interval(log_ratio(replicates(b, seed=1), replicates(a, seed=2)))
    assert (paired.high - paired.low).mean() < 0.45 * (apart.high - apart.low).mean()


def test_marks_do_not_hang_on_a_seed():
    """Where the interval of 9999 resamples ends now above 1 and now below, the mark is the same for 20 seeds.

    The errors of the best are scaled so that its nearest interval ends at 1, and so that it ends well above.
    """
    rng = np.random.default_rng(13)
    common, own = rng.standard_normal((100, 1)), rng.standard_normal((100, 4))
    error = 0.9 * common + np.sqrt(1 - 0.81) * own
    nearest = best_of(replicates(error**2 * [0.1, 1.0, 1.0, 1.0], 99_999))[1].low[1:].min()
    marks = {}
    for end in (1.0, 1.1):
        squares = error**2 * [0.1 * (nearest / end) ** 2, 1.0, 1.0, 1.0]
        marks[end] = []
        for seed in range(20):
            few = replicates(squares, 9999, seed)
            marks[end].append((best_of(few)[1].low[1:].min() > 1, best_of(few)[2]))
    shown, marked = zip(*marks[1.0], strict=True)
    assert 0 < sum(shown) < 20 and set(marked) == {False}
    assert set(marks[1.1]) == {(True, True)}


def test_more_resamples_are_drawn_where_few_do_not_decide():
    """An interval that ends 3 % above 1 is undecided by 499 resamples, and decided by 100 times as many."""
    rng = np.random.default_rng(14)
    common, own = rng.standard_normal((100, 1)), rng.standard_normal((100, 2))
    error = 0.9 * common + np.sqrt(1 - 0.81) * own
    nearest = best_of(replicates(error**2 * [0.1, 1.0], 99_999))[1].low[1]
    squares = error**2 * [0.1 * (nearest / 1.03) ** 2, 1.0]
    asked = []
    marks = {
        best_of(replicates(squares, 499, seed), finer=lambda s=seed: asked.append(s) or replicates(squares, 49_900, s))[
            2
        ]
        for seed in range(5)
    }
    assert marks == {True} and asked
    assert not best_of(replicates(squares, 499))[2]


@pytest.mark.parametrize("size", [2, 4])
def test_best_is_not_marked_by_chance(size):
    """All alike: a best is marked in at most 5 % of 80 repetitions (3 sigma above that: 12.3 %). One that is 30 %
    better on correlated errors is mostly found, though what 9999 resamples leave undecided is not marked."""
    rng = np.random.default_rng(6)
    common, own = rng.standard_normal((60, 80, 1)), rng.standard_normal((60, 80, size))
    errors = 0.9 * common + np.sqrt(1 - 0.81) * own
    better = errors * np.where(np.arange(size) == size - 1, 0.7, 1.0)
    marks = []
    for one in (errors, better):
        together = replicates(one.reshape(60, -1) ** 2, 9999)
        each = [Replicates(*(part[..., i : i + size] for part in together)) for i in range(0, 80 * size, size)]
        marks.append([best_of(found) for found in each])
    assert sum(significant for _, _, significant in marks[0]) <= 0.123 * 80
    assert sum(significant and best == size - 1 for best, _, significant in marks[1]) >= 0.75 * 80
    for _, ratios, _ in marks[1]:
        assert np.all(ratios.low <= ratios.value) and np.all(ratios.value <= ratios.high)


def test_lost_and_unknown_trials():
    """An infinite error makes the RMSE infinite, and the resamples it is in; one that is not known is left out."""
    squares = np.random.default_rng(7).chisquare(1, (40, 3))
    squares[0, 0] = np.inf
    squares[:20, 1] = np.nan
    found = replicates(squares)
    ends = interval(found)
    assert found.value[0] == np.inf and ends.high[0] == np.inf
    np.testing.assert_allclose(found.value[1], np.sqrt(squares[20:, 1].mean()), rtol=1e-12)
    np.testing.assert_allclose(found.value[2], np.sqrt(squares[:, 2].mean()), rtol=1e-12)
    # drawn without the lost trial: (1 - 1/40)^40
    assert abs(np.isfinite(found.resampled[:, 0]).mean() - (39 / 40) ** 40) < 0.05
    # alike but for the lost trial: a third of the resamples do without it, and then there is no difference
    squares = np.where(np.isinf(squares[:, :1]), [np.inf, 1.0], squares[:, 2:])
    best, ratios, significant = best_of(replicates(squares))
    assert best == 1 and ratios.value[0] == np.inf and ratios.low[0] == 1 and not significant


def test_all_unknown_is_undefined():
    found = replicates(np.full((10, 1), np.nan))
    ends = interval(found)
    assert np.isnan(ends.value[0]) and ends.low[0] == -np.inf and ends.high[0] == np.inf


def test_is_deterministic_and_does_not_depend_on_the_columns():
    squares = np.random.default_rng(8).chisquare(2, (3000, 5))  # more trials than fit into one block
    both, alone = replicates(squares, 700), replicates(squares[:, 2:3], 700)
    np.testing.assert_allclose(both.resampled[:, 2], alone.resampled[:, 0], rtol=1e-13)


@pytest.mark.parametrize(("arguments", "word"), [((1,), "at least 2"), ((5, 0), "resamples: 0")])
def test_refuses(arguments, word):
    with pytest.raises(ValueError, match=word):
        PairedBootstrap(*arguments)
    with pytest.raises(ValueError, match="confidence: 1"):
        interval(Replicates(*([np.zeros(1)] + [np.zeros((3, 1))] * 2)), 1)
    assert isinstance(interval(replicates(np.ones((4, 1)))), Interval)  # no spread at all
