"""Covariances stay symmetric and positive definite, and right, however the scales differ."""

import numpy as np
import pytest

from systems.estimators.known_height_start import KnownHeightStart
from systems.filters.linear_algebra import cholesky, semidefinite_root
from systems.filters.square_root import Gains
from systems.filters.whitening import Whitener
from systems.measurement.stack import Stack
from systems.motion.constant_velocity import ConstantVelocity
from tests.laws.cases import FILTERS, PASS, PLACES, fdoa, phase, place, satellites, tdoa
from tests.laws.rig import Linear

UPDATES = 3000


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


@pytest.mark.parametrize("noise", [0.0, 0.1, 1e3], ids=lambda q: f"q {q:g}")
@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("name", FILTERS)
def test_thousands_of_updates(name, prior, noise):
    algorithm, motion = FILTERS[name], ConstantVelocity(noise)
    model = Stack([tdoa(correlated=True), fdoa(correlated=True), phase()])
    whitener = Whitener(model.noise_covariance())
    rng = np.random.default_rng(0)
    target = place(*np.array([PLACES["(0,50)"], PLACES["(-300,700)"]]).T)
    covariance = np.broadcast_to(PRIORS[prior], (2, 6, 6))
    # A linearisation far from the truth is another matter: the mean begins within a kilometre of it.
    mean = target + rng.normal(size=(2, 6)) * np.sqrt(np.minimum(np.diag(PRIORS[prior]), [1e6] * 3 + [100.0] * 3))
    passes = satellites(np.arange(PASS))[:, None]
    steps = UPDATES if noise == 0.1 else UPDATES // 5
    for k in range(steps):
        here = passes[k % len(passes)]
        value = model.predict(target, here)
        measurement = value + rng.normal(size=value.shape) * model.sigmas
        if k % 7 == 3:
            measurement[0, :] = np.nan
        if k % 11 == 5:
            measurement[1, :4] = np.nan
        result = algorithm.update(mean, covariance, measurement, here, model, whitener)
        mean, covariance = result.mean, result.covariance
        assert_definite(covariance)
        assert np.isfinite(mean).all()
        # The satellites pass again and again over one place; the target stands still, as if its speed were nought.
        mean[:, 3:] = target[:, 3:]
        mean, covariance = algorithm.predict(mean, covariance, motion, 0.1)
        mean[:, :3] -= 0.1 * mean[:, 3:]
        assert_definite(covariance)


# ------------------------------------------------------------------------------- accuracy, in extended precision


def solve_extended(a, b):
    """Gauss-Jordan elimination with pivoting in extended precision: no BLAS, no LAPACK."""
    a, b = a.astype(np.longdouble).copy(), b.astype(np.longdouble).copy()
    n = len(a)
    for i in range(n):
        pivot = i + int(np.argmax(np.abs(a[i:, i])))
        a[[i, pivot]], b[[i, pivot]] = a[[pivot, i]], b[[pivot, i]]
        b[i] /= a[i, i]
        a[i] = a[i] / a[i, i]
        for j in range(n):
            if j != i:
                b[j] = b[j] - a[j, i] * b[i]
                a[j] = a[j] - a[j, i] * a[i]
    return b


def information(mean, covariance, h, r, z):
    """The update in information form, in extended precision."""
    eye = np.eye(len(mean), dtype=np.longdouble)
    h, r = h.astype(np.longdouble), r.astype(np.longdouble)
    weight = solve_extended(r, np.eye(len(r)))
    inverse = solve_extended(covariance, eye)
    posterior = solve_extended(inverse + h.T @ weight @ h, eye)
    innovation = z - h @ mean.astype(np.longdouble)
    s = h @ covariance.astype(np.longdouble) @ h.T + r
    return (
        (mean + posterior @ h.T @ weight @ innovation).astype(float),
        posterior.astype(float),
        float(innovation @ solve_extended(s, innovation[:, None])[:, 0]),
    )


@pytest.mark.parametrize("spread", [1.0, 1e3, 1e5, 1e7, 1e9])
@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf"])
def test_wide_priors_keep_their_digits(name, spread):
    """Priors up to 1e9 times the noise: three rows of four states, so that one direction stays as it was."""
    rng = np.random.default_rng(4)
    h = rng.normal(size=(3, 4))
    model = Linear(h, np.diag([1.0, 4.0, 0.25]))
    mixing = rng.normal(size=(5, 4, 4))
    covariance = spread**2 * (mixing @ np.swapaxes(mixing, -1, -2) + 0.1 * np.eye(4))
    covariance[1] /= spread**2  # an ordinary trial beside the wide ones
    mean = np.einsum("tij,tj->ti", np.linalg.cholesky(covariance), rng.normal(size=(5, 4)))
    z = rng.normal(size=(5, 3))
    whitener = Whitener(model.noise_covariance())
    result = FILTERS[name].update(mean, covariance, z, np.zeros((1, 1, 6)), model, whitener)
    assert_definite(result.covariance)
    for i in range(5):
        x, p, nis = information(mean[i], covariance[i], h, model.noise_covariance(), z[i])
        sigma = np.sqrt(np.diag(p))
        # 1e-16 |Y|^2 up to where the orthogonal factorisation takes over at |Y|^2 = 1e8, and 1e-16 |Y| beyond
        tolerance = 1e-10 + 1e-16 * (min(spread, 1e4) ** 2 * 10 + spread * 100)
        assert np.abs((result.mean[i] - x) / sigma).max() < tolerance * max(1.0, np.abs(mean[i] / sigma).max())
        assert np.abs((result.covariance[i] - p) / np.outer(sigma, sigma)).max() < tolerance
        np.testing.assert_allclose(result.nis[i], nis, rtol=1e-6)


def test_the_two_factorisations_meet():
    """Where one takes over from the other nothing jumps."""
    rng = np.random.default_rng(9)
    root = np.eye(6)
    rows = rng.normal(size=(40, 6, 6))
    scale = np.sqrt(np.max(np.swapaxes(rows, -1, -2) @ rows, axis=(-1, -2)))
    rows *= (1e4 / scale * np.linspace(0.99, 1.01, 40))[:, None, None]
    gains = Gains(root, rows)
    whitened = rng.normal(size=(40, 6)) * 1e4
    assert gains._wide.any() and not gains._wide.all()
    step, nis = gains.update(whitened)
    for i in range(40):
        gram = np.eye(6) + rows[i].astype(np.longdouble).T @ rows[i]
        exact = solve_extended(gram, (rows[i].T.astype(np.longdouble) @ whitened[i])[:, None])[:, 0]
        np.testing.assert_allclose(step[i], exact.astype(float), rtol=0, atol=1e-6 * np.abs(exact).max())
        s = np.eye(6) + rows[i].astype(np.longdouble) @ rows[i].T
        expected = whitened[i] @ solve_extended(s, whitened[i][:, None])[:, 0]
        np.testing.assert_allclose(nis[i], float(expected), rtol=1e-6)


# ----------------------------------------------------------------------------------------------- linear algebra


def test_cholesky_of_a_batch_with_bad_ones():
    """Each matrix for itself: a sound one, one with NaN, one that rounding has made indefinite, one of rank one."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=(4, 4))
    sound = a @ a.T
    indefinite = np.diag([1.0, 1.0, 1.0, -1e-17])
    one = np.outer([1.0, 1e3, 1e-3, 1.0], [1.0, 1e3, 1e-3, 1.0])
    batch = np.stack([sound, np.full((4, 4), np.nan), indefinite, one, sound])
    factors = cholesky(batch)
    np.testing.assert_array_equal(factors[[0, 4]], np.linalg.cholesky(batch[[0, 4]]))
    assert np.isnan(factors[1]).all()
    for i in (2, 3):
        np.testing.assert_array_equal(factors[i], np.tril(factors[i]))
        assert np.all(np.diag(factors[i]) > 0)
        scale = np.sqrt(np.maximum(np.diag(batch[i]), 1e-300))
        error = (factors[i] @ factors[i].T - batch[i]) / np.outer(scale, scale)
        # the eigenvalues of the correlation matrix are raised to 1e-12
        assert np.abs(error[np.isfinite(error)]).max() < 4e-12 or i == 2
        np.testing.assert_array_equal(cholesky(batch[i]), factors[i])
    assert not cholesky(np.zeros((0, 3, 3))).size


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_semidefinite_root_of_what_is_drawn(rank):
    a = np.random.default_rng(rank).normal(size=(3, rank)) * np.array([[1e-8], [1.0], [1e4]])
    root = semidefinite_root(a @ a.T)
    sigma = np.sqrt(np.diag(a @ a.T))
    np.testing.assert_allclose(root @ root.T / np.outer(sigma, sigma), a @ a.T / np.outer(sigma, sigma), atol=1e-12)
