"""Every model's compiled equations against the same written in NumPy, and what compiled filters must share."""

import numpy as np
import pytest

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.evaluating import linearized, values
from tests.laws.cases import GEOMETRIES, MEASUREMENTS, MOTIONS
from tests.oracle import oracle

COMPILED = [name for name, (model, _) in MEASUREMENTS.items() if program(model) is not None]


def example(name):
    model, geometry = MEASUREMENTS[name]
    return model, GEOMETRIES[geometry].targets, GEOMETRIES[geometry].platforms


@pytest.mark.parametrize("name", COMPILED)
def test_kernel_is_the_model(name):
    model, targets, platforms = example(name)
    value, jacobian = linearized(program(model), targets, platforms)
    apart = oracle(model)
    assert program(apart) is None
    expected, derivative = apart.linearize(targets, platforms)
    # differences of ranges are a tenth of them: 1e-10 of the largest, five digits over rounding
    np.testing.assert_allclose(value, expected, rtol=1e-10, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_allclose(jacobian, derivative, rtol=1e-10, atol=1e-10 * np.abs(derivative).max(axis=(0, 2)).min())
    np.testing.assert_array_equal(values(program(model), targets, platforms), value)


# the stop rule never stops: so both make as many steps
ALGORITHMS = {
    "ekf": IteratedExtendedKalman(1),
    "iekf": IteratedExtendedKalman(4, 1e-300),
    "ukf": UnscentedKalman(),
    "ukf, scaled": UnscentedKalman(0.5, 2.0, 1.0),
}


@pytest.mark.parametrize("name", COMPILED)
@pytest.mark.parametrize("kind", ALGORITHMS)
def test_update_is_that_in_numpy_alone_and_in_a_batch(name, kind, monkeypatch):
    """Rows of two trials are missing, and all rows of a third."""
    model, targets, platforms = example(name)
    rng = np.random.default_rng(5)
    spread = np.array([300.0] * 3 + [10.0] * 3) if np.abs(targets).max() > 100 else np.full(6, 0.1)
    mean = targets + spread * rng.standard_normal(targets.shape)
    covariance = np.tile(np.diag(spread**2), (len(mean), 1, 1))
    value = model.represent(model.predict(targets, platforms) + model.sigmas * rng.standard_normal(model.size))
    value[1, 0] = value[2, -1] = np.nan
    value[3] = np.nan
    told = Observation(value, platforms, Whitener(model.noise_covariance()))
    algorithm = ALGORITHMS[kind]
    compiled = algorithm.update(mean, covariance, told, model)
    for i in range(len(mean)):
        alone = algorithm.update(mean[i : i + 1], covariance[i : i + 1], told.rows(np.array([i])), model)
        for one, all_ in zip(alone, compiled, strict=True):
            np.testing.assert_array_equal(one[0], all_[i])
    monkeypatch.setattr(f"{type(algorithm).__module__}.program", lambda model: None)
    expected = algorithm.update(mean, covariance, told, model)
    scale = np.sqrt(np.einsum("tii->ti", expected.covariance))
    # of a posterior sigma, whose own digits are lost to the spread of the prior against it, and again in iterations
    digits = 1e-10 if kind.startswith("ukf") else 1e-6
    np.testing.assert_allclose((compiled.mean - expected.mean) / scale, 0, atol=digits)
    ratio = compiled.covariance / scale[:, :, None] / scale[:, None, :]
    np.testing.assert_allclose(ratio, expected.covariance / scale[:, :, None] / scale[:, None, :], atol=digits)
    np.testing.assert_allclose(
        compiled.innovation / model.sigmas, expected.innovation / model.sigmas, rtol=1e-9, atol=1e-7
    )
    np.testing.assert_allclose(compiled.nis, expected.nis, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(compiled.nis_dof, expected.nis_dof)


@pytest.mark.parametrize("name", [name for name, (motion, _) in MOTIONS.items() if not motion.linear])
def test_unscented_prediction_is_that_in_numpy_alone_and_in_a_batch(name, monkeypatch):
    motion, states = MOTIONS[name]
    if motion.equations(7.0) is None:
        pytest.skip("has no kernel")
    covariance = np.tile(np.diag(np.where(np.arange(motion.size) < 3, 1e4, 1.0)), (len(states), 1, 1))
    states = states.copy()
    states[0, 1] = np.nan
    algorithm = UnscentedKalman(0.5, 2.0, 1.0)
    compiled = algorithm.predict(states, covariance, motion, 7.0)
    for i in range(len(states)):
        alone = algorithm.predict(states[i : i + 1], covariance[i : i + 1], motion, 7.0)
        for one, all_ in zip(alone, compiled, strict=True):
            np.testing.assert_array_equal(one[0], all_[i])
    monkeypatch.setattr("quietfix.systems.filters.unscented.are_own", lambda kind: False)
    expected = algorithm.predict(states, covariance, motion, 7.0)
    np.testing.assert_array_equal(np.isfinite(compiled[0]).all(axis=-1), np.arange(len(states)) > 0)
    np.testing.assert_allclose(compiled[0][1:], expected[0][1:], rtol=1e-10)
    np.testing.assert_allclose(compiled[1][1:], expected[1][1:], rtol=1e-10, atol=1e-10)
