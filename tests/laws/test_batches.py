"""A trial is the same alone and in a batch, whatever its size."""

import numpy as np
import pytest

from systems.filters.whitening import Whitener
from systems.noise import normal
from tests.laws.cases import FILTERS, estimators
from tests.laws.rig import PORTS, Scene

TRIALS, EPOCHS = 100, 25
PARTS = {"1": slice(37, 38), "7": slice(33, 40), "100": slice(0, 100)}


def allowed(options):
    """How far the estimate may be off: iterated filters stop within a tolerance, the others agree to rounding."""
    iterated = getattr(options, "max_iterations", 1) > 1
    return options.tolerance if iterated else None


def assert_same(part, batch, tolerance):
    sigma = np.sqrt(np.diagonal(batch["covariance"], axis1=-2, axis2=-1))
    scales = {
        "estimate": sigma,
        "prediction": sigma,
        "covariance": sigma[..., None] * sigma[..., None, :],
        "prediction_covariance": sigma[..., None] * sigma[..., None, :],
    }
    for port in PORTS:
        np.testing.assert_array_equal(np.isnan(part[port]), np.isnan(batch[port]))
        error = np.abs(part[port] - batch[port]) / np.maximum(np.abs(batch[port]), scales.get(port, 1e-300))
        if tolerance is None:
            assert np.nanmax(error, initial=0.0) < 1e-9, f"{port}: {np.nanmax(error):.2g}"
        elif port in ("estimate", "prediction"):
            assert np.nanmax(np.abs(part[port] - batch[port])) <= tolerance
        elif port != "innovation":
            # the point of linearisation may differ by the tolerance, a ten millionth of the range
            assert np.nanmax(error, initial=0.0) < 1e-5, f"{port}: {np.nanmax(error):.2g}"


@pytest.fixture(scope="module")
def scene():
    return Scene(TRIALS, EPOCHS)


@pytest.fixture(scope="module")
def batches(scene):
    return {name: scene.run(name, options) for name, options in estimators().items()}


@pytest.mark.parametrize("size", PARTS)
@pytest.mark.parametrize("name", estimators())
def test_estimator(scene, batches, name, size):
    options = estimators()[name]
    part = scene.only(PARTS[size]).run(name, options)
    whole = {port: values[:, PARTS[size]] for port, values in batches[name].items()}
    assert np.isfinite(whole["estimate"]).all()
    assert_same(part, whole, allowed(options))


@pytest.mark.parametrize("name", FILTERS)
def test_filter_of_fixed_iterations_to_rounding(scene, name):
    """Bare functions, through a whole pass; here the iterated filter, too, is to make the same decisions."""
    algorithm, whitener = FILTERS[name], Whitener(scene.model.noise_covariance())

    def run(part):
        mean, covariance = part.mean, np.broadcast_to(part.covariance, (part.trials, 6, 6))
        for k in range(EPOCHS):
            if k:
                mean, covariance = algorithm.predict(mean, covariance, part.motion, 1.0)
            platforms = part.platforms[k].reshape(-1, 3, 6)
            result = algorithm.update(mean, covariance, part.measurement[k], platforms, part.model, whitener)
            mean, covariance = result.mean, result.covariance
        return result

    batch = run(scene)
    sigma = np.sqrt(np.diagonal(batch.covariance, axis1=-2, axis2=-1))
    for rows in PARTS.values():
        alone = run(scene.only(rows))
        assert np.abs((alone.mean - batch.mean[rows]) / sigma[rows]).max() < 1e-9
        scale = sigma[rows, :, None] * sigma[rows, None, :]
        assert np.abs((alone.covariance - batch.covariance[rows]) / scale).max() < 1e-9
        np.testing.assert_allclose(alone.nis, batch.nis[rows], rtol=1e-9)


def test_a_trials_own_platforms(scene):
    """Platforms per trial instead of shared ones change nothing but rounding."""
    own = scene.only(slice(0, 7))
    own.platforms = np.tile(scene.platforms, (1, 7, 1))
    for name, options in estimators().items():
        shared = scene.only(slice(0, 7)).run(name, options)
        assert_same(own.run(name, options), shared, allowed(options))


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 9])
def test_noise_is_bit_equal(size):
    batch = normal(3, "sensor", 0, 100, 17, size)
    for part in PARTS.values():
        rows = normal(3, "sensor", part.start, part.stop - part.start, 17, size)
        np.testing.assert_array_equal(rows, batch[part])
