"""A smoother: the textbook's on a linear Gaussian problem, a trial alone as in a batch, and NaN in its trial alone."""

import numpy as np
import pytest

from quietfix.diagrams.statistics.paths.smoothing_bound import smoothing_bound
from quietfix.diagrams.statistics.posterior_bound import bound_steps
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.smoothing.smoother import Smoother
from tests.laws.cases import FILTERS, Turning
from tests.laws.test_linear_gaussian import EPOCHS, MISSING, TRIALS, Problem

TIMES = np.arange(float(EPOCHS))


def whole_path(problem, trial, last):
    """Return means and covariances of all epochs given the measurements up to `last`, from the joint Gaussian.

    The path as one vector, its prior covariance and all rows at once: no recursion, forward or backward. Bar-Shalom,
    Li and Kirubarajan, 2001, eq. (8.1.2-1) asks for the same.
    """
    phi, q = problem.motion.transition(np.zeros(6), 1.0), problem.motion.process_noise(np.zeros(6), 1.0)
    h, r = problem.model.jacobian(np.zeros(6), None), problem.model.noise_covariance()
    mean, prior = np.empty((EPOCHS, 6)), np.zeros((EPOCHS, 6, EPOCHS, 6))
    mean[0], prior[0, :, 0] = problem.mean[trial], problem.covariance
    for k in range(1, EPOCHS):
        mean[k] = phi @ mean[k - 1]
        for j in range(k):
            prior[k, :, j] = phi @ prior[k - 1, :, j]
            prior[j, :, k] = prior[k, :, j].T
        prior[k, :, k] = phi @ prior[k - 1, :, k - 1] @ phi.T + q
    there = np.isfinite(problem.measurement[:, trial])
    there[last + 1 :] = False
    size, rows = EPOCHS * 6, int(there.sum())
    big_h = np.einsum("kj,mn->kmjn", np.eye(EPOCHS), h).reshape(-1, size)[there.ravel()]
    big_r = np.einsum("kj,mn->kmjn", np.eye(EPOCHS), r).reshape(EPOCHS * len(r), -1)
    big_r = big_r[np.ix_(there.ravel(), there.ravel())]
    wide = prior.reshape(size, size)
    unit = 1 / np.sqrt(np.diag(big_r))
    big_h, big_r = unit[:, None] * big_h, unit[:, None] * big_r * unit
    cross = wide @ big_h.T
    innovation = unit * problem.measurement[:, trial][there] - big_h @ mean.ravel()
    gain = np.linalg.solve(big_h @ cross + big_r, cross.T).T if rows else np.zeros((size, 0))
    after = (wide - gain @ cross.T).reshape(EPOCHS, 6, EPOCHS, 6)
    return (mean.ravel() + gain @ innovation).reshape(EPOCHS, 6), np.einsum("kikj->kij", after)


def textbook(problem, means, covariances):
    """Return the Rauch-Tung-Striebel recursion, a trial and an epoch at a time, as it is printed."""
    phi, q = problem.motion.transition(np.zeros(6), 1.0), problem.motion.process_noise(np.zeros(6), 1.0)
    found, of = means.copy(), covariances.copy()
    for i in range(means.shape[1]):
        for k in range(EPOCHS - 2, -1, -1):
            before, p = means[k, i], covariances[k, i]
            ahead = phi @ p @ phi.T + q
            gain = p @ phi.T @ np.linalg.inv(ahead)
            found[k, i] = before + gain @ (found[k + 1, i] - phi @ before)
            of[k, i] = p + gain @ (of[k + 1, i] - ahead) @ gain.T
    return found, of


def filtered(problem):
    """Return means (epochs, trials, 6) and covariances of the textbook's filter."""
    expected = problem.expected()
    return expected["estimate"], expected["covariance"]


def off(found, expected, covariances):
    """Return the largest difference of means and covariances, in units of the standard deviations."""
    sigma = np.sqrt(np.einsum("...ii->...i", covariances))
    mean = np.abs(found[0] - expected[0]) / sigma
    return max(mean.max(), (np.abs(found[1] - expected[1]) / (sigma[..., :, None] * sigma[..., None, :])).max())


@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize("motion", [ConstantVelocity(0.5), WhiteNoiseAcceleration(0.3)], ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("name", FILTERS)
def test_is_the_textbooks(name, motion, missing):
    problem = Problem(missing, motion)
    means, covariances = filtered(problem)
    found = Smoother(FILTERS[name], motion).smooth(TIMES, means, covariances)
    assert off(found, textbook(problem, means, covariances), covariances) < 1e-10
    assert (np.linalg.eigvalsh(found[1]) > 0).all()


@pytest.mark.parametrize("lag", [None, 0.0, 1.0, 7.5, 200.0])
def test_is_the_conditional_mean_of_the_whole_path(lag):
    problem = Problem("some")
    means, covariances = filtered(problem)
    found = Smoother(IteratedExtendedKalman(), problem.motion, lag).smooth(TIMES, means, covariances)
    for trial in (0, 3):
        for k in (0, 5, 20, 38, 39):
            last = EPOCHS - 1 if lag is None else min(k + int(lag), EPOCHS - 1)
            mean, covariance = (part[k] for part in whole_path(problem, trial, last))
            got = found[0][k, trial], found[1][k, trial]
            # one dense matrix of 240 states loses more digits than the recursions
            assert off(got, (mean, covariance), covariance) < 1e-6


def test_irregular_epochs_of_a_lag():
    """The last measurement that counts is the last one not later than the lag, whatever the epochs are."""
    problem = Problem("none")
    means, covariances = filtered(problem)
    times = np.cumsum(np.where(np.arange(EPOCHS) % 3, 1.0, 4.0))
    motion, algorithm = problem.motion, IteratedExtendedKalman()
    found = Smoother(algorithm, motion, 6.0).smooth(times, means, covariances)
    for k in range(EPOCHS):
        until = int(np.searchsorted(times, times[k] + 6.0, side="right"))
        cut = Smoother(algorithm, motion).smooth(times[:until], means[:until], covariances[:until])
        assert off((found[0][k], found[1][k]), (cut[0][k], cut[1][k]), covariances[k]) < 1e-12


MANOEUVRING = CurrentStatistical(0.3, [30.0] * 3, [-20.0] * 3)
CURVED = {"iekf": IteratedExtendedKalman(), "ukf": UnscentedKalman(), "ukf, alpha": UnscentedKalman(0.5, 2.0, 1.0)}


def beliefs(n, trials=40, epochs=30):
    """Return means and covariances as a filter might have them."""
    rng = np.random.default_rng(7)
    mixing = rng.normal(size=(epochs, trials, n, n)) * 0.1
    return rng.normal(size=(epochs, trials, n)), mixing @ np.swapaxes(mixing, -1, -2) + 0.01 * np.eye(n)


@pytest.mark.parametrize("lag", [None, 5.0])
@pytest.mark.parametrize("name", CURVED)
@pytest.mark.parametrize("motion", [Turning(), MANOEUVRING], ids=lambda m: type(m).__name__)
def test_a_trial_alone(motion, name, lag):
    """Bit for bit, and one that is NaN, begins late, or is lost, harms none and stays where it is NaN."""
    means, covariances = beliefs(motion.size)
    means[:, 3], covariances[:, 4], means[:9, 5], means[20:, 6], means[12, 7] = (np.nan,) * 5
    smoother, times = Smoother(CURVED[name], motion, lag), np.arange(30.0)
    found, of = smoother.smooth(times, means, covariances)
    for trial in range(40):
        alone = smoother.smooth(times, means[:, trial : trial + 1], covariances[:, trial : trial + 1])
        np.testing.assert_array_equal(alone[0][:, 0], found[:, trial])
        np.testing.assert_array_equal(alone[1][:, 0], of[:, trial])
    known = np.isfinite(means).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2))
    np.testing.assert_array_equal(np.isfinite(found).all(axis=-1) & np.isfinite(of).all(axis=(-1, -2)), known)
    assert np.isfinite(of[known]).all()
    np.testing.assert_array_equal(found[19, 6], means[19, 6])  # its end


def test_sigma_points_regress_a_curved_motion():
    """A and Lambda of the unscented step give back its own prediction: A P A^T + Lambda is the predicted covariance."""
    motion, algorithm = Turning(), UnscentedKalman()
    means, covariances = beliefs(motion.size)
    step = algorithm.regress(means[0], covariances[0], motion, 2.0)
    mean, covariance = algorithm.predict(means[0], covariances[0], motion, 2.0)
    again = step.transition @ covariances[0] @ np.swapaxes(step.transition, -1, -2) + step.noise
    np.testing.assert_allclose(step.mean, mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again, covariance, rtol=0, atol=1e-12 * np.abs(covariance).max())


def test_the_bound_is_the_covariance_of_the_linear_case():
    """And, with Jacobians at the truth, nothing else: of a linear problem both are the same matrix."""
    problem = Problem("none")
    _, covariances = filtered(problem)
    truth, platforms = np.zeros((1, EPOCHS, 6)), np.zeros((1, EPOCHS, 3, 6))
    steps = bound_steps(truth, platforms, TIMES, problem.model, problem.motion, problem.covariance, False)
    found = smoothing_bound(steps, truth, TIMES, problem.motion, None)
    expected = Smoother(IteratedExtendedKalman(), problem.motion).smooth(
        TIMES, np.zeros((EPOCHS, TRIALS, 6)), covariances
    )
    sigma = np.sqrt(np.einsum("...ii->...i", expected[1]))
    difference = (found - expected[1]) / (sigma[..., :, None] * sigma[..., None, :])
    assert np.abs(difference).max() < 1e-9  # a square root there, a covariance here


@pytest.mark.parametrize("lag", [None, 3.0])
def test_a_new_beginning_ends_what_was_before(lag):
    """Of a trial that begins anew, both parts are smoothed as if each were all there is; others go on, to the bit."""
    rng = np.random.default_rng(8)
    smoother = Smoother(IteratedExtendedKalman(), ConstantVelocity(0.5), lag)
    means = np.cumsum(rng.normal(size=(EPOCHS, 3, 6)), axis=0)
    covariances = np.broadcast_to(np.diag([4.0] * 3 + [1.0] * 3), (EPOCHS, 3, 6, 6))
    anew = np.zeros((EPOCHS, 3), dtype=bool)
    anew[7, 1] = True
    found = smoother.smooth(TIMES, means, covariances, anew)
    whole = smoother.smooth(TIMES, means, covariances)
    parts = [smoother.smooth(TIMES[part], means[part], covariances[part]) for part in (slice(7), slice(7, None))]
    for got, plain, halves in zip(found, whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_array_equal(got[:, [0, 2]], plain[:, [0, 2]])
        np.testing.assert_allclose(got[:, 1], np.concatenate(halves)[:, 1], rtol=1e-12)
        assert (got[:7, 1] != plain[:7, 1]).any()
