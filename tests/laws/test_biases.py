"""Biases on a linear Gaussian problem: the augmented filter and Schmidt's, both written out here."""

import numpy as np
import pytest

from quietfix.systems.biases.bias import Bias
from quietfix.systems.biases.biased import BiasedModel
from quietfix.systems.biases.start import BiasedStart
from quietfix.systems.biases.walking import WithBiases
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.interacting.estimator import InteractingModels
from quietfix.systems.starts.start import GivenStart, Start
from tests.laws.cases import estimators
from tests.laws.rig import PORTS, Linear, assert_same, make, run, with_gaps
from tests.laws.test_linear_gaussian import EPOCHS, TRIALS, Problem

MODES = {"estimated": (), "considered": (0, 1, 2), "one of each": (1,)}
KALMAN = [name for name, options in estimators().items() if options.takes_biases]
WITH_BIASES = (*PORTS, "biases", "bias_sigmas")


def biases(considered):
    """Three biases: of one row, of two rows with different shares, and of a row by far the smallest, which walks."""
    rows = [{"row_0": 1.0}, {"row_0": -1.0, "row_3": 0.05}, {"row_1": 1.0}]
    sigmas, walks = [3.0, 2.0, 5e-6], [0.0, 0.3, 1e-6]
    return [Bias(f"bias_{i}", "m", sigmas[i], walks[i], rows[i], considered=i in considered) for i in range(3)]


def schmidt(x, p, phi, q, h, r, z, kept):
    """One step of the Schmidt-Kalman filter by Joseph's form, for one trial; without `kept` it is Kalman's."""
    x, p = phi @ x, phi @ p @ phi.T + q
    there = np.flatnonzero(np.isfinite(z))
    innovation = np.full(len(z), np.nan)
    if there.size == 0:
        return (x, p), innovation, np.nan, 0
    h, r = h[there], r[np.ix_(there, there)]
    nu = z[there] - h @ x
    s = h @ p @ h.T + r
    k = p @ h.T @ np.linalg.inv(s)
    k[kept] = 0.0
    left = np.eye(len(x)) - k @ h
    innovation[there] = nu
    return (x + k @ nu, left @ p @ left.T + k @ r @ k.T), innovation, nu @ np.linalg.inv(s) @ nu, len(there)


class Biased(Problem):
    """The problem of four rows, read with biases."""

    def __init__(self, missing, considered):
        super().__init__(missing)
        self.biases = biases(considered)
        self.kept = [6 + i for i in considered]
        self.whole = BiasedModel(self.model, 6, self.biases)
        drawn = np.random.default_rng(8).normal(size=(TRIALS, 3)) * [bias.sigma for bias in self.biases]
        self.measurement = self.measurement + drawn @ self.whole.shares.T

    def block(self, name, trials=slice(None)):
        mean = self.mean[trials]
        start = BiasedStart(GivenStart(mean, self.covariance), self.biases, self.model.names, 6)
        motion = WithBiases(self.motion, self.biases)
        return make(name, estimators()[name], self.whole, motion, start, len(mean), Periodic(1.0))

    def run(self, name, trials=slice(None)):
        feed = self.measurement[:, trials]
        return run(self.block(name, trials), feed, np.zeros((EPOCHS, 1, 18)), Periodic(1.0), ports=WITH_BIASES)[1]

    def expected(self):
        """Return estimate, covariance, innovation, NIS and rows used by the textbook, (epochs, trials, ...)."""
        phi, q = np.eye(9), np.zeros((9, 9))
        phi[:6, :6], q[:6, :6] = self.motion.transition(np.zeros(6), 1.0), self.motion.process_noise(np.zeros(6), 1.0)
        q[6:, 6:] = np.diag([bias.walk**2 for bias in self.biases])
        h = np.hstack([self.model.jacobian(np.zeros(6), None), self.whole.shares])
        found = []
        for i in range(TRIALS):
            x, p = np.append(self.mean[i], np.zeros(3)), np.zeros((9, 9))
            p[:6, :6], p[6:, 6:] = self.covariance, np.diag([bias.sigma**2 for bias in self.biases])
            rows = []
            for k in range(EPOCHS):
                move = (phi, q) if k else (np.eye(9), np.zeros((9, 9)))
                r = self.model.noise_covariance()
                (x, p), innovation, nis, dof = schmidt(x, p, *move, h, r, self.measurement[k, i], self.kept)
                rows.append((x, p, innovation, nis, dof))
            found.append([np.array(values) for values in zip(*rows, strict=True)])
        return [np.stack(values, axis=1) for values in zip(*found, strict=True)]


def block_of(problem, name):
    """Return the estimator, where it can consider biases or there are none."""
    if problem.kept and not issubclass(type(Biased("none", ()).block(name)), KalmanEstimator):
        with pytest.raises(ValueError, match="not allowed with biases that are considered"):
            problem.block(name)
        pytest.skip("it estimates biases, and considers none: refused in a line")
    return problem.block(name)


@pytest.mark.parametrize("missing", ["none", "some", "whole epochs"])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", KALMAN)
def test_linear_gaussian(name, mode, missing):
    problem = Biased(missing, MODES[mode])
    block = block_of(problem, name)
    if isinstance(block, InteractingModels):
        pytest.skip("it mixes several motions, of which the textbook's filter has one")
    values = problem.run(name)
    x, p, innovation, nis, dof = problem.expected()
    sigma = np.sqrt(np.diagonal(p, axis1=-2, axis2=-1))
    pairs = {
        "estimate": (x[..., :6], sigma[..., :6]),
        "covariance": (p[..., :6, :6], sigma[..., :6, None] * sigma[..., None, :6]),
        "biases": (x[..., 6:], sigma[..., 6:]),
        "bias_sigmas": (sigma[..., 6:], sigma[..., 6:]),
        "innovation": (innovation, problem.model.sigmas),
        "nis": (nis, np.maximum(nis, 1.0)),
        "nis_dof": (dof, 1.0),
    }
    for port, (value, scale) in pairs.items():
        np.testing.assert_array_equal(np.isnan(values[port]), np.isnan(value), err_msg=port)
        # in units of each number's own standard deviation: rounding, as for the filters without biases
        assert np.nanmax(np.abs(values[port] - value) / scale) < 1e-10, port
    if mode == "considered":
        assert not values["biases"].any()


@pytest.mark.parametrize("mode", ["estimated", "considered"])
@pytest.mark.parametrize("name", KALMAN)
def test_a_trial_alone(name, mode):
    problem = Biased("none", MODES[mode])
    block_of(problem, name)
    problem.measurement = with_gaps(problem.measurement)
    problem.mean[1] = np.nan  # lost from the beginning
    whole, alone = problem.run(name), problem.run(name, slice(3, 4))
    assert_same(alone, {port: value[:, 3:4] for port, value in whole.items()})
    for port in ("biases", "bias_sigmas"):
        np.testing.assert_array_equal(alone[port], whole[port][:, 3:4])
    assert np.isnan(whole["estimate"][:, 1]).all() and np.isnan(whole["biases"][:, 1]).all()
    assert np.isfinite(np.delete(whole["estimate"], 1, axis=1)).all()


class Measured(Start):
    """The least squares fix of a linear measurement that determines the state."""

    uses_measurement = True

    def __init__(self, model):
        self.uses = model

    def begin(self, measurement, platforms, inputs):
        h, r = self.uses.jacobian(np.zeros(6), None), self.uses.noise_covariance()
        covariance = np.linalg.inv(h.T @ np.linalg.inv(r) @ h)
        mean = np.einsum("ij,tj->ti", covariance @ h.T @ np.linalg.inv(r), measurement)
        return mean, np.broadcast_to(covariance, (len(mean), 6, 6))


def test_a_measured_start_inherits_the_biases():
    """As Schmidt's filter has it after the same measurement from a prior that knows nothing of the state."""
    rng = np.random.default_rng(2)
    model = Linear(rng.normal(size=(8, 6)), np.diag(rng.uniform(0.5, 2.0, 8)))
    own = [Bias(f"bias_{i}", "m", 1.0 + i, rows={f"row_{i}": 1.0, "row_7": 0.5}) for i in range(3)]
    start, z = BiasedStart(Measured(model), own, model.names, 6), rng.normal(size=(1, 8))
    mean, covariance = start.begin(z, np.zeros((1, 1, 6)), {})
    vague = np.diag([1e6] * 6 + [bias.sigma**2 for bias in own])
    h = np.hstack([model.jacobian(np.zeros(6), None), BiasedModel(model, 6, own).shares])
    # R of the fix leaves the biases out, as it does not know of them; the filter that weighs rows so has the gain
    # of the fix, and P by Joseph's form
    r = model.noise_covariance()
    plain = np.diag([1e6] * 6 + [0.0] * 3)
    gain = plain @ h.T @ np.linalg.inv(h @ plain @ h.T + r)
    left = np.eye(9) - gain @ h
    expected = left @ vague @ left.T + gain @ r @ gain.T
    # a prior of 1000 sigma is worth 1e-6 of the fix
    np.testing.assert_allclose(covariance[0], expected, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(mean[0], gain @ z[0], atol=1e-4)


def test_a_start_that_does_not_say_how_is_refused():
    start = Measured(Problem("none").model)
    start.uses = None
    with pytest.raises(ValueError, match="a start by Measured is not allowed"):
        BiasedStart(start, biases(()), ["row_0"], 6)


@pytest.mark.parametrize(("mode", "told"), [("considered", 1.0), ("estimated", 1.0), ("considered", 8.0)])
def test_a_bias_that_was_considered_is_no_sign_of_being_lost(mode, told):
    """A bias as large as said stays in every innovation; of 300 trials 35 were flagged as if each epoch drew its own.

    One that is 8 times as large is told of.
    """
    rng = np.random.default_rng(5)
    trials, epochs = 300, 80
    bias = Bias("bias_0", "m", 10.0, 0.0, {"row_0": 1.0}, considered=mode == "considered")
    model, motion = Linear(np.eye(6)[:1], np.eye(1)), ConstantVelocity(1e-4)
    start = BiasedStart(GivenStart(np.zeros((trials, 6)), 1e-4 * np.eye(6)), [bias], model.names, 6)
    whole = BiasedModel(model, 6, [bias])
    block = make("one", Ekf(), whole, WithBiases(motion, [bias]), start, trials, Periodic(1.0))
    measurement = rng.normal(size=(epochs, trials, 1))
    measurement[..., 0] += told * 10.0 * rng.normal(size=trials)
    values = run(block, measurement, np.zeros((epochs, 1, 18)), Periodic(1.0), ports=(*PORTS, "lost"))[1]
    lost = values["lost"].max(axis=0).sum()
    assert lost > trials / 4 if told > 1 else lost == 0
