"""Whitening: unit noise from any covariance, and rows taken out."""

import numpy as np
import pytest

from quietfix.systems.filters.whitening import Whitener, missing_rows, unknown_rows
from tests.laws.cases import MEASUREMENTS

SIGMA = np.array([2e-8, 1.0, 0.26, 3e3])


def covariance(seed=0, trials=()):
    a = np.random.default_rng(seed).normal(size=(*trials, 4, 4))
    correlation = a @ np.swapaxes(a, -1, -2) + np.eye(4)
    return correlation * np.outer(SIGMA, SIGMA)


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_white_for_every_model(name):
    r = MEASUREMENTS[name][0].noise_covariance()
    w = Whitener(r).matrix(None)
    np.testing.assert_allclose(w @ r @ w.T, np.eye(len(r)), atol=1e-12)


def test_white_per_trial():
    r = covariance(trials=(5,))
    w = Whitener(r).matrix(None)
    np.testing.assert_allclose(w @ r @ np.swapaxes(w, -1, -2), np.broadcast_to(np.eye(4), (5, 4, 4)), atol=1e-12)


@pytest.mark.parametrize("diagonal", [True, False])
@pytest.mark.parametrize("own", [True, False], ids=["per trial", "shared"])
def test_missing_rows_are_zero_and_the_others_white(diagonal, own):
    r = covariance(trials=(6,) if own else ())
    if diagonal:
        r = r * np.eye(4)
    rng = np.random.default_rng(2)
    missing = rng.uniform(size=(6, 4)) < 0.4
    missing[0], missing[1] = True, False
    w = Whitener(r).matrix(missing)
    each = np.broadcast_to(r, (6, 4, 4))
    for i in range(6):
        there = np.flatnonzero(~missing[i])
        assert not w[i][missing[i]].any() and not w[i][:, missing[i]].any()
        block = w[i][np.ix_(there, there)]
        np.testing.assert_allclose(block @ each[i][np.ix_(there, there)] @ block.T, np.eye(len(there)), atol=1e-11)


def test_a_gap_in_the_covariance_is_allowed_where_the_row_is_missing():
    r = covariance(trials=(3,))
    broken = r.copy()
    broken[1, 2, :], broken[1, :, 2] = np.nan, np.nan
    missing = np.zeros((3, 4), dtype=bool)
    missing[1, 2] = True
    np.testing.assert_allclose(Whitener(broken).matrix(missing), Whitener(r).matrix(missing), rtol=1e-12)
    with pytest.raises(ValueError, match="finite in every row that is measured"):
        Whitener(broken).matrix(None)


def test_unknown_rows():
    r = covariance(trials=(4,))
    r[1, 2, :], r[1, :, 2] = np.nan, np.nan  # variance and all
    r[2, 0, 3], r[2, 3, 0] = np.nan, np.nan  # a covariance alone: of the two, neither can be used
    r[3, 1, 1] = np.inf
    expected = np.zeros((4, 4), dtype=bool)
    expected[1, 2] = expected[2, 0] = expected[2, 3] = expected[3, 1] = True
    np.testing.assert_array_equal(unknown_rows(r), expected)
    np.testing.assert_array_equal(unknown_rows(r[0]), expected[0])


def test_missing_is_what_is_not_finite_anywhere():
    residual = np.ones((3, 4))
    assert missing_rows(residual, np.ones((3, 4, 6))) is None
    jacobian = np.ones((3, 4, 6))
    residual[0, 1], jacobian[2, 3, 5], residual[1, 0] = np.nan, -np.inf, np.inf
    more = np.ones((3, 4))
    more[1, 2] = np.nan
    expected = np.zeros((3, 4), dtype=bool)
    expected[0, 1] = expected[2, 3] = expected[1, 0] = expected[1, 2] = True
    np.testing.assert_array_equal(missing_rows(residual, jacobian, more), expected)


@pytest.mark.filterwarnings("ignore:invalid value encountered in reduce")
def test_infinities_that_cancel_are_seen():
    np.testing.assert_array_equal(missing_rows(np.array([[np.inf, -np.inf, 1.0]])), [[True, True, False]])


@pytest.mark.parametrize(
    ("r", "message"),
    [
        ([[0.0]], "variance <= 0"),
        ([[-1.0]], "variance <= 0"),
        ([[1.0, 2.0], [2.0, 1.0]], "positive definite"),
        ([[1.0, 1.0], [1.0, 1.0]], "fully correlated"),
        ([[[1.0, 0.0], [0.0, 1.0]], [[1.0, -1.5], [-1.5, 1.0]]], "positive definite"),
    ],
)
def test_what_is_no_noise_covariance(r, message):
    with pytest.raises(ValueError, match=message):
        Whitener(np.array(r))
