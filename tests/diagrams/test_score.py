"""The normalised error where covariances are not what they should be."""

import numpy as np

from quietfix.diagrams.statistics.score import normalised_error


def test_a_singular_covariance_gives_nan_in_its_trial_only():
    """Rank one to the last bit, so that LAPACK refuses the batch: a filter that believes itself to death."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((5, 3, 3))
    covariance = root @ root.swapaxes(-1, -2)
    error = rng.standard_normal((5, 3))
    expected = np.array([e @ np.linalg.solve(p, e) for e, p in zip(error, covariance, strict=True)])
    covariance[2] = np.outer([1.0, 2.0, 4.0], [1.0, 2.0, 4.0])
    nees = normalised_error(error, covariance)
    others = [0, 1, 3, 4]
    np.testing.assert_allclose(nees[others], expected[others], rtol=1e-9)
    assert np.isnan(nees[2])


def test_indefinite_and_uneven_covariances_are_solved_as_they_stand():
    """What has no triangular factor is not quietly taken for something else: a sign, and both triangles, count."""
    rng = np.random.default_rng(1)
    root = rng.standard_normal((40, 6, 6)) * np.array([1e5, 1e5, 1e3, 10.0, 1.0, 1e-3])[:, None]  # units mix
    covariance = root @ root.swapaxes(-1, -2)
    error = (root @ rng.standard_normal((40, 6, 1)))[..., 0]
    covariance[3, 0, 1] *= 2.0
    covariance[7, 4, 5] = covariance[7, 5, 4] = 3.0 * np.sqrt(covariance[7, 4, 4] * covariance[7, 5, 5])
    size = np.sqrt(np.einsum("...ii->...i", covariance))
    scaled = covariance / (size[:, :, None] * size[:, None, :])
    solved = np.linalg.solve(scaled, (error / size)[..., None])[..., 0]
    expected = np.einsum("ti,ti->t", error / size, solved)
    nees = normalised_error(error, covariance)
    assert (np.linalg.eigvalsh(scaled)[7] < 0).any()
    # two ways to solve differ by the condition of the scaled matrix times rounding
    np.testing.assert_allclose(nees, expected, rtol=50 * np.linalg.cond(scaled).max() * np.finfo(float).eps)


def test_numbers_that_are_not_finite_stay_in_their_trial_and_a_trial_alone_is_that_of_a_batch():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((7, 4, 4))
    covariance, error = root @ root.swapaxes(-1, -2), rng.standard_normal((7, 4))
    whole = normalised_error(error, covariance)
    covariance[1, 0, 3], covariance[2], covariance[4, 2, 2], error[5, 1] = np.nan, np.inf, -1.0, np.inf
    nees = normalised_error(error, covariance)
    np.testing.assert_array_equal(np.isnan(nees), [False, True, True, False, True, True, False])
    for trial in (0, 3, 6):
        assert nees[trial] == whole[trial] == normalised_error(error[trial], covariance[trial])
