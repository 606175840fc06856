"""Covariances stay symmetric and positive definite, and right, however the scales differ."""

import numpy as np
import pytest

from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.starts.known_height_start import KnownHeightStart
from tests.laws.cases import FILTERS, PASS, PLACES, fdoa, phase, place, satellites, tdoa
from tests.laws.exact import exact_update
from tests.laws.rig import Linear


def assert_definite(covariance):
    """Exactly symmetric, and positive definite without scaling and after scaling to unit diagonal."""
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    assert np.all(sigma > 0)
    np.linalg.cholesky(covariance / (sigma[..., None] * sigma[..., None, :]))
    np.linalg.cholesky(covariance)


def known_height():
    """P1 of the known-height start: the height's 3 km against metres across it."""
    target = place(*PLACES["(0,300)"])
    start = KnownHeightStart(tdoa(), six_names(), 3e3, 400.0)
    return start.covariance_at(target, satellites(PASS / 2))


def six_names():
    return Stack([tdoa(), fdoa(), phase()]).names


PRIORS = {
    "known height": known_height(),
    "known height, a metre": known_height() * np.diag([1, 1, 1, 0, 0, 0]) + np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6]),
    "huge": np.diag([1e9**2] * 3 + [1e6**2] * 3),
    "tiny": np.diag([1e-3**2] * 3 + [1e-6**2] * 3),
    "huge beside tiny": np.diag([1e8**2, 1e-2**2, 1e3**2, 1e5**2, 1e-4**2, 1.0]),
}


def many_updates(name, acceleration, updates):
    """Assert the law over passes of the satellites, again and again, for all priors and two places side by side."""
    algorithm, motion = FILTERS[name], ConstantVelocity(acceleration)
    model = Stack([tdoa(correlated=True), fdoa(correlated=True), phase()])
    whitener = Whitener(model.noise_covariance())
    rng = np.random.default_rng(0)
    targets = place(*np.array([PLACES["(0,50)"], PLACES["(-300,700)"]]).T)
    targets = np.tile(targets, (len(PRIORS), 1))
    covariance = np.repeat(np.stack(list(PRIORS.values())), 2, axis=0)
    # A linearisation far from the truth is another matter: the mean begins within a kilometre of it.
    sigma = np.sqrt(np.minimum(np.diagonal(covariance, axis1=-2, axis2=-1), [1e6] * 3 + [100.0] * 3))
    mean = targets + rng.normal(size=targets.shape) * sigma
    passes = satellites(np.arange(PASS))[:, None]
    means, covariances = [], []
    for k in range(updates):
        here = passes[k % len(passes)]
        value = model.predict(targets, here)
        measurement = value + rng.normal(size=value.shape) * model.sigmas
        if k % 7 == 3:
            measurement[::2] = np.nan
        if k % 11 == 5:
            measurement[1::2, :4] = np.nan
        result = algorithm.update(mean, covariance, Observation(measurement, here, whitener), model)
        mean, covariance = algorithm.predict(result.mean, result.covariance, motion, 0.1)
        mean[:, :3] -= 0.1 * mean[:, 3:]  # the place stays: it is the covariance that is looked at
        means.append(mean)
        covariances += [result.covariance, covariance]
    assert np.isfinite(np.array(means)).all()
    assert_definite(np.array(covariances))


@pytest.mark.parametrize("name", FILTERS)
def test_two_hundred_updates(name):
    """More than one pass, so that every place, every gap and every prior has had its turn."""
    many_updates(name, 0.1, 200)


@pytest.mark.slow
@pytest.mark.parametrize("acceleration", [0.0, 0.1, 1e3])
@pytest.mark.parametrize("name", FILTERS)
def test_many_thousands_of_updates(name, acceleration):
    many_updates(name, acceleration, 5000)


# ------------------------------------------------------------------------------- accuracy, against exact arithmetic


@pytest.mark.parametrize("spread", [1.0, 1e3, 1e5, 1e7, 1e9])
@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf"])
def test_wide_priors_keep_their_digits(name, spread):
    """Priors up to 1e9 times the noise: three rows of four states, so that one direction stays as wide as it was."""
    rng = np.random.default_rng(4)
    h = rng.normal(size=(3, 4))
    model = Linear(h, np.diag([1.0, 4.0, 0.25]))
    mixing = rng.normal(size=(5, 4, 4))
    covariance = spread**2 * (mixing @ np.swapaxes(mixing, -1, -2) + 0.1 * np.eye(4))
    covariance[1] /= spread**2  # an ordinary trial beside the wide ones
    mean = (np.linalg.cholesky(covariance) @ rng.normal(size=(5, 4, 1)))[..., 0]
    z = rng.normal(size=(5, 3))
    whitener = Whitener(model.noise_covariance())
    result = FILTERS[name].update(mean, covariance, Observation(z, np.zeros((1, 1, 6)), whitener), model)
    assert_definite(result.covariance)
    for i in range(5):
        x, p, nis = exact_update(mean[i], covariance[i], h, model.noise_covariance(), z[i])
        width = 1.0 if i == 1 else spread
        sigma = np.sqrt(np.diag(p))
        errors = (
            np.abs((result.mean[i] - x) / sigma).max(),
            np.abs((result.covariance[i] - p) / np.outer(sigma, sigma)).max(),
            abs(result.nis[i] / nis - 1),
        )
        # What is formed with |Y| <= 1e4 loses 1e-16 |Y|^2, what is wider 1e-16 |Y|; |Y| is ten times the spread here.
        squared, plain = min(10 * width, 1e4) ** 2, 10 * width
        assert max(errors) < 1e-13 + 1e-16 * (squared + 10 * plain), errors
