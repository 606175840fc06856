"""A station that stays and an oscillator that starts anew in every pass; rows with heavy tails."""

import numpy as np
import pytest

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.robust import StudentRows
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.pass_oscillator import PassOscillator

SIGMAS = [1e3, 2.0, 0.01]


def test_within_a_pass_the_bias_is_a_polynomial():
    model = PassOscillator(SIGMAS, 100.0)
    moved = model.propagate(np.array([1.0, 2.0, 3.0, 10.0, 2.0, 0.4]), 5.0)
    np.testing.assert_allclose(moved, [1, 2, 3, 10 + 2 * 5 + 0.4 * 12.5, 2 + 0.4 * 5, 0.4])
    assert not model.process_noise(moved, 5.0).any()


def test_noise_adds_up_within_a_pass():
    model = PassOscillator(SIGMAS, 100.0, density=0.3)
    x = np.zeros(6)
    phi, half, whole = model.transition(x, 2.0), model.process_noise(x, 2.0), model.process_noise(x, 4.0)
    np.testing.assert_allclose(phi @ half @ phi.T + half, whole, rtol=1e-12)


def test_after_a_pause_the_oscillator_is_unknown_and_the_station_is_not():
    model = PassOscillator(SIGMAS, 100.0)
    phi, q = model.transition(np.zeros(6), 101.0), model.process_noise(np.zeros(6), 101.0)
    mixing = np.random.default_rng(0).normal(size=(6, 6))
    p = mixing @ mixing.T
    after = phi @ p @ phi.T + q
    np.testing.assert_allclose(after[:3, :3], p[:3, :3])
    assert not after[:3, 3:].any()
    np.testing.assert_allclose(after[3:, 3:], np.diag(np.square(SIGMAS)))


@pytest.mark.parametrize(
    ("arguments", "message"), [(([], 1.0), "sigmas"), (([-1.0], 1.0), "sigmas"), (([1.0], 0.0), "pause")]
)
def test_what_is_not_allowed(arguments, message):
    with pytest.raises(ValueError, match=message):
        PassOscillator(*arguments)


@pytest.fixture
def scene():
    rng = np.random.default_rng(4)
    stations = np.concatenate([rng.uniform(-3e5, 3e5, (6, 3)) * [1, 0.01, 1], np.zeros((6, 3))], axis=-1)[None]
    truth = np.array([5e4, 4e4, 1e3, 1500.0, 900.0, -10.0])
    covariance = np.broadcast_to(np.diag(np.square([50.0] * 3 + [2.0] * 3)), (3, 6, 6))
    model = RangeRate(0.5, range(6))
    return model, stations, truth + rng.normal(size=(3, 6)) * 0.1, covariance, np.tile(
        model.predict(truth, stations[0]), (3, 1)
    )  # fmt: skip


def update(filter_, scene, z):
    model, stations, mean, covariance, _ = scene
    return filter_.update(mean, covariance, Observation(z, stations, Whitener(model.noise_covariance())), model)


def test_rows_that_fit_are_left_alone(scene):
    plain, robust = update(IteratedExtendedKalman(), scene, scene[4]), update(StudentRows(), scene, scene[4])
    for a, b in zip(plain, robust, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_pull_of_an_outlier_falls(scene):
    def pull(size, filter_):
        z = scene[4].copy()
        z[1, 2] += size
        shift = update(filter_, scene, z).mean - update(filter_, scene, scene[4]).mean
        assert not shift[[0, 2]].any()
        return np.linalg.norm(shift[1, :3])

    sizes = [20.0, 200.0, 2000.0]
    robust = [pull(size, StudentRows(freedom=4.0)) for size in sizes]
    plain = [pull(size, IteratedExtendedKalman()) for size in sizes]
    assert robust[0] > robust[1] > robust[2] > 0.0
    assert plain[2] > 50 * plain[0]  # a Gaussian believes it
    z = scene[4] + np.array([0, 0, 500.0, 0, 0, 0])
    kept = update(StudentRows(freedom=4.0, rows=[0, 1]), scene, z)
    np.testing.assert_allclose(kept.mean, update(IteratedExtendedKalman(), scene, z).mean, rtol=1e-6)


def test_freedom_is_checked():
    with pytest.raises(ValueError, match="freedom"):
        StudentRows(freedom=0.0)
