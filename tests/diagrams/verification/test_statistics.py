"""Confidence intervals against what others compute, and what a lost trial does to them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, binomtest, bootstrap

from quietfix.diagrams.commands.judging.verifying import verification_figure
from quietfix.diagrams.statistics.intervals import MeanRatio, Proportion, Quantile, SettlingTime, SignedMean
from quietfix.diagrams.statistics.sequential import FAILS, HOLDS, UNDECIDED, Limit, judge
from quietfix.diagrams.verification import metrics
from quietfix.diagrams.verification.specification import Requirement, Specification
from quietfix.diagrams.verification.verify import Finding, Report

STATISTICS = [MeanRatio(), MeanRatio(root=True), SignedMean(), Quantile(0.5), Quantile(0.9), Proportion()]


def positive(shape, seed=1, columns=1):
    return np.random.default_rng(seed).chisquare(3, (*shape, columns))


@pytest.mark.parametrize("count", [1, 7, 60, 400])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_order_statistics_are_the_narrowest_that_cover(count, share):
    ranks = np.arange(1.0, count + 1)[:, None]
    for tail in (0.2, 0.025, 0.003):
        lower, upper = Quantile(share).interval(ranks, tail)
        # P(X_(r) < quantile) = P(Bin >= r), P(X_(s) > quantile) = P(Bin <= s - 1)
        rank = np.arange(1, count + 1)
        fits = rank[binom.sf(rank - 1, count, share) <= tail]
        assert upper == (fits[0] if fits.size else np.inf)
        fits = rank[binom.cdf(rank - 1, count, share) <= tail]
        assert lower == (fits[-1] if fits.size else -np.inf)
        assert (upper < np.inf) == (count >= Quantile(share).fewest(tail, upper=True))
        assert (lower > -np.inf) == (count >= Quantile(share).fewest(tail, upper=False))


@pytest.mark.parametrize("true", [0, 1, 17, 49, 50])
def test_proportions_are_clopper_and_pearsons(true):
    samples = (np.arange(50) < true).astype(float)[:, None]
    expected = binomtest(true, 50).proportion_ci(0.95, method="exact")
    found = Proportion().interval(samples, 0.025)
    np.testing.assert_allclose(found, [expected.low, expected.high], rtol=1e-8)  # SciPy searches for a root


def test_a_mean_is_that_of_scipys_bootstrap_where_nothing_is_skewed():
    """BCa, another method, on symmetric numbers: within a tenth of the width, half of it for the worst trial twice."""
    values = 10 + np.random.default_rng(3).standard_normal(400)
    other = bootstrap((values,), np.mean, confidence_level=0.9, rng=np.random.default_rng(1)).confidence_interval
    width = other.high - other.low
    for statistic in (MeanRatio(), SignedMean()):
        np.testing.assert_allclose(statistic.interval(values[:, None], 0.05), other, atol=0.1 * width)


@pytest.mark.parametrize("statistic", STATISTICS, ids=repr)
def test_repetitions_side_by_side_are_each_alone(statistic):
    samples = positive((4, 60))
    samples = (samples > 3).astype(float) if isinstance(statistic, Proportion) else samples
    together = np.array([*statistic.interval(samples, 0.02), statistic.estimate(samples)])
    for i in range(4):
        alone = np.array([*statistic.interval(samples[i], 0.02), statistic.estimate(samples[i])])
        # products with matrices of another width round differently, and an order statistic may change places
        np.testing.assert_allclose(alone, together[:, i], rtol=1e-3)
    assert np.all(together[0] <= together[2]) and np.all(together[2] <= together[1])


def test_a_ratio_of_the_same_is_one_and_is_paired():
    both = np.repeat(positive((80,)), 2, axis=-1)
    assert MeanRatio().interval(both, 0.01) == (1.0, 1.0)
    apart = positive((80,), columns=2)
    noise = positive((80,)) * [1.0, 1.0] + 0.01 * apart
    width = [np.subtract(*MeanRatio().interval(x, 0.05)[::-1]) for x in (noise, apart)]
    assert width[0] < 0.1 * width[1]


def verdict(samples, statistic, limit):
    return int(judge(lambda n: samples[:n], statistic, limit, 0.95, (samples.shape[-2],)).verdict)


def test_a_lost_trial():
    samples = positive((100,))
    samples[3] = np.inf
    assert MeanRatio(root=True).estimate(samples) == np.inf
    # the mean square over all trials is infinite as soon as one can be lost
    assert verdict(samples, MeanRatio(root=True), Limit(at_most=1e9)) == FAILS
    assert verdict(samples, MeanRatio(root=True), Limit(at_least=1.0)) == HOLDS
    assert verdict(samples, SignedMean(), Limit(-10.0, 10.0)) == UNDECIDED
    # a median does not mind
    assert verdict(samples, Quantile(0.5), Limit(at_most=5.0)) == HOLDS
    # nothing is known of a ratio of two infinite numbers; a lost reference makes it zero
    assert verdict(np.repeat(samples, 2, -1), MeanRatio(), Limit(at_most=2.0)) == UNDECIDED
    assert verdict(np.concatenate([positive((100,)), samples], -1), MeanRatio(), Limit(at_most=2.0)) == HOLDS


def test_samples_without_any_spread():
    zeros, ones = np.zeros((60, 1)), np.ones((60, 1))
    assert MeanRatio(root=True).interval(zeros, 0.01) == (0.0, 0.0)
    assert MeanRatio().interval(ones, 0.01) == (1.0, 1.0) and SignedMean().interval(zeros, 0.01) == (0.0, 0.0)
    rare = zeros.copy()
    rare[0] = 1.0  # two resamples of five are all zero
    lower, upper = MeanRatio().interval(rare, 0.01)
    assert 0 <= lower < 1 / 60 < upper


def test_too_few_trials_decide_nothing():
    few = positive((49,))
    assert verdict(few, MeanRatio(), Limit(at_most=1e9)) == UNDECIDED
    assert verdict(few, Proportion(), Limit(at_least=0.5)) == HOLDS
    assert verdict(few[:0], Quantile(0.5), Limit(at_most=1e9)) == UNDECIDED


def test_settling_time():
    times = (0.0, 1.0, 2.0, 3.0, 4.0)
    curve = np.array([9.0, 0.5, 9.0, 0.5, 0.5])
    samples = positive((300, 5))[..., 0] / 3 * curve**2
    statistic = SettlingTime(times, 1.0)
    # below at 1 s, but not for good: the upper limit knows, the lower one does not commit itself
    assert statistic.estimate(samples) == 3.0 and statistic.interval(samples, 0.01) == (1.0, 3.0)
    assert SettlingTime(times, 0.1).estimate(samples) == np.inf
    assert SettlingTime(times, 0.1).interval(samples, 0.01) == (np.inf, np.inf)
    assert SettlingTime(times, 100.0).interval(samples, 0.01) == (0.0, 0.0)
    samples[7, 4] = np.inf  # a trial that is lost at the end
    assert statistic.estimate(samples) == np.inf and statistic.interval(samples, 0.01)[1] == np.inf


def test_the_figure_shows_what_lies_beyond():
    def finding(name, least, most, verdict_, *numbers):
        asked = Requirement(name, metrics.Rmse(time_s=1.0), "iekf", "", least, most, 0.95)
        return Finding(asked, "m", verdict_, 100, *map(float, numbers), 0.01)

    findings = (
        finding("inside", None, 100.0, HOLDS, 80, 70, 95),
        finding("far out", None, 100.0, FAILS, 900, 700, 1200),
        finding("far below", -10.0, 10.0, FAILS, -60, -80, -50),
        finding("no rate at all", None, 0.0, FAILS, 0.2, 0.1, 0.3),
        finding("lost", None, 100.0, FAILS, np.inf, np.inf, np.inf),
        finding("no trial", 50.0, 100.0, UNDECIDED, np.nan, -np.inf, np.inf),
    )
    figure = verification_figure(Report(Path("x.yaml"), Specification("three_satellite"), 0, (100,), findings, ""))
    (axes,) = figure.axes
    assert [label.get_text().splitlines()[0] for label in axes.get_yticklabels()] == [
        "inside", "far out", "far below", "no rate at all", "lost", "no trial",
    ]  # fmt: skip
    assert axes.get_xlim() == (pytest.approx(-1.1), 2.0)
    arrows = [text.xy for text in axes.texts]
    assert arrows == [(2.0, 1), (pytest.approx(-1.1), 2), (2.0, 4), (2.0, 5), (pytest.approx(-1.1), 5)]
