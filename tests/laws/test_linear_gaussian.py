"""On a linear Gaussian problem every Kalman-type filter is the Kalman filter, written out in `rig.textbook`."""

import numpy as np
import pytest

from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import FILTERS, estimators
from tests.laws.rig import Linear, make, run, textbook

TRIALS, EPOCHS, ROWS = 6, 40, 4
MISSING = ["none", "some", "whole epochs"]


class Problem:
    """Four correlated rows of very different sizes, read from a state of six."""

    def __init__(self, missing, motion=None, correlated=True):
        rng = np.random.default_rng(6)
        self.motion = motion or WhiteNoiseAcceleration(0.3)
        sigma = np.array([2.0, 1e-6, 5e3, 0.1])
        mixing = rng.normal(size=(ROWS, ROWS)) / 2 if correlated else np.zeros((ROWS, ROWS))
        correlation = mixing @ mixing.T + np.eye(ROWS)
        self.model = Linear(sigma[:, None] * rng.normal(size=(ROWS, 6)) / 5, correlation * np.outer(sigma, sigma))
        root = np.linalg.cholesky(self.model.noise_covariance())
        mixing = rng.normal(size=(6, 6))
        self.covariance = mixing @ mixing.T * np.outer([30, 20, 10, 3, 2, 1], [30, 20, 10, 3, 2, 1])
        self.mean = rng.normal(size=(TRIALS, 6)) * np.sqrt(np.diag(self.covariance))
        truth = np.zeros(6)
        self.measurement = np.empty((EPOCHS, TRIALS, ROWS))
        for k in range(EPOCHS):
            noise = rng.normal(size=(TRIALS, ROWS)) @ root.T
            self.measurement[k] = self.model.predict(truth, None) + noise
            truth = self.motion.propagate(truth + rng.normal(size=6) * [0, 0, 0, 1, 1, 1], 1.0)
        if missing == "some":
            self.measurement[rng.uniform(size=self.measurement.shape) < 0.3] = np.nan
        elif missing == "whole epochs":
            self.measurement[5:25, 2] = np.nan
            self.measurement[9:14] = np.nan
            self.measurement[:, 4] = np.nan

    def expected(self):
        """Return the ports' values by the textbook, shape (epochs, trials, ...)."""
        phi, q = self.motion.transition(np.zeros(6), 1.0), self.motion.process_noise(np.zeros(6), 1.0)
        h, r = self.model.jacobian(np.zeros(6), None), self.model.noise_covariance()
        columns = {
            port: []
            for port in (
                "prediction",
                "prediction_covariance",
                "estimate",
                "covariance",
                "innovation",
                "nis",
                "nis_dof",
            )
        }
        for i in range(TRIALS):
            x, p = self.mean[i], self.covariance
            rows = []
            for k in range(EPOCHS):
                move = (phi, q) if k else (np.eye(6), np.zeros((6, 6)))
                before, (x, p), innovation, nis, dof = textbook(x, p, *move, h, r, self.measurement[k, i])
                rows.append((*before, x, p, innovation, nis, dof))
            for port, values in zip(columns, zip(*rows, strict=True), strict=True):
                columns[port].append(np.array(values))
        return {port: np.stack(values, axis=1) for port, values in columns.items()}


def assert_same(values, expected, problem, tolerance=1e-10):
    """Compare every port, each number in units of its own standard deviation."""
    sigma = np.sqrt(np.diagonal(expected["prediction_covariance"], axis1=-2, axis2=-1))
    noise = problem.model.sigmas
    scales = {
        "estimate": sigma,
        "prediction": sigma,
        "covariance": sigma[..., None] * sigma[..., None, :],
        "prediction_covariance": sigma[..., None] * sigma[..., None, :],
        "innovation": noise,
        "nis": np.maximum(expected["nis"], 1.0),
        "nis_dof": 1.0,
    }
    for port, scale in scales.items():
        np.testing.assert_array_equal(np.isnan(values[port]), np.isnan(expected[port]), err_msg=port)
        error = np.nanmax(np.abs(values[port] - expected[port]) / scale)
        assert error < tolerance, f"{port}: {error:.2g}"


@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize("correlated", [True, False], ids=["correlated", "independent"])
@pytest.mark.parametrize("name", estimators())
def test_registered_estimator(name, correlated, missing):
    problem = Problem(missing, correlated=correlated)
    start = GivenStart(problem.mean, problem.covariance)
    clock = Periodic(1.0)
    block = make(name, estimators()[name], problem.model, problem.motion, start, TRIALS, clock)
    if not isinstance(block, KalmanEstimator):
        pytest.skip(f"{name} is no Kalman-type filter")
    _, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), clock)
    assert_same(values, problem.expected(), problem)


@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize("motion", [ConstantVelocity(0.5), WhiteNoiseAcceleration(0.3)], ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("name", FILTERS)
def test_bare_filter(name, motion, missing):
    problem, algorithm = Problem(missing, motion), FILTERS[name]
    whitener = Whitener(problem.model.noise_covariance())
    mean, covariance = problem.mean, np.broadcast_to(problem.covariance, (TRIALS, 6, 6))
    rows = []
    for k in range(EPOCHS):
        if k:
            mean, covariance = algorithm.predict(mean, covariance, motion, 1.0)
        before = mean, covariance
        result = algorithm.update(
            mean, covariance, Observation(problem.measurement[k], np.zeros((1, 3, 6)), whitener), problem.model
        )
        mean, covariance = result.mean, result.covariance
        rows.append((*before, *result))
    ports = ("prediction", "prediction_covariance", "estimate", "covariance", "innovation", "nis", "nis_dof")
    values = {port: np.array(column) for port, column in zip(ports, zip(*rows, strict=True), strict=True)}
    # Sigma points that lie c = alpha sqrt(n) close lose 1/c^2 of the digits of the values they difference.
    assert_same(values, problem.expected(), problem, 1e-8 if "alpha 0.1" in name else 1e-10)
