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
