"""Start from one direction, delay and Doppler difference: Gaussian, and as a cloud."""

import numpy as np
import pytest

from quietfix.systems.angles.direction import Direction, DirectionCosines
from quietfix.systems.filters.particle.weights import effective_size, normalise
from quietfix.systems.fixes.ray_height import ray_at_height
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.direction_start import DirectionStart
from tests.laws.cases import CARRIER, PASS, place, satellites

HEIGHT, VELOCITY = 3e3, 200.0
PLATFORMS = satellites(PASS / 2, "line")[None, 1:]
"""Two satellites 160 km apart in one orbit."""


class Problem:
    """Many draws of truth and measurement: height and velocity from their priors, one place on the ground."""

    def __init__(self, trials, sigma_deg=0.5, cosines=False, seed=0, noise_port=False):
        rng = np.random.default_rng(seed)
        direction = (DirectionCosines if cosines else Direction)(np.radians(sigma_deg))
        delay, doppler = Tdoa(20e-9, receivers=(1,)), Fdoa(1.0, CARRIER, receivers=(1,))
        self.model = Stack([direction, delay, doppler])
        self.start = DirectionStart(
            direction, delay, doppler, ["other", *self.model.names], HEIGHT, VELOCITY, noise_port
        )
        self.truth = np.tile(place(100e3, 450e3, 10e3), (trials, 1))
        self.truth[:, 3:] = VELOCITY * rng.normal(size=(trials, 3))
        measured = self.model.predict(self.truth, PLATFORMS) + rng.normal(size=(trials, 4)) * self.model.sigmas
        self.stream = np.concatenate([np.full((trials, 1), np.nan), measured], axis=-1)
        self.inputs = {"assumed_height": 10e3 + HEIGHT * rng.normal(size=(trials, 1))}
        self.rng = rng

    def begin(self):
        return self.start.begin(self.stream, PLATFORMS, self.inputs)

    def cloud(self, particles=2000):
        white = self.rng.normal(size=(len(self.truth), particles, 6))
        return self.start.cloud(self.stream, PLATFORMS, self.inputs, white)


def nees(mean, covariance, truth):
    error = truth - mean
    return np.einsum("ti,ti->t", error, np.linalg.solve(covariance, error[..., None])[..., 0])


@pytest.mark.parametrize("cosines", [False, True])
def test_gaussian_start_is_as_far_off_as_it_says(cosines):
    """NEES of 1000 trials: 6 within four standard errors of 0.11, and a tenth for what is not linear."""
    problem = Problem(1000, 0.1, cosines)
    mean, covariance = problem.begin()
    assert nees(mean, covariance, problem.truth).mean() == pytest.approx(6.0, abs=0.55)
    at_truth = problem.start.covariance_at(problem.truth, PLATFORMS)
    ratio = np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2) / np.trace(at_truth[:, :3, :3], axis1=1, axis2=2))
    np.testing.assert_allclose(ratio, 1, atol=0.05)


def test_covariance_is_the_inverse_information():
    """Written out, in rows and states of unit size."""
    problem = Problem(1)
    h = problem.model.jacobian(problem.truth, PLATFORMS)[0] / problem.model.sigmas[:, None]
    up = problem.truth[0, :3] / np.linalg.norm(problem.truth[0, :3])
    rows = np.concatenate([h, [np.concatenate([up, np.zeros(3)]) / HEIGHT], np.eye(6)[3:] / VELOCITY])
    scale = np.array([1e3] * 3 + [100.0] * 3)
    scaled = rows * scale
    expected = np.linalg.inv(scaled.T @ scaled) * np.outer(scale, scale)
    got = problem.start.covariance_at(problem.truth, PLATFORMS)[0]
    # 0.2 deg between the geocentric and the ellipsoid's vertical, and 1000 km that stand for nothing known
    np.testing.assert_allclose(np.sqrt(np.diag(got)), np.sqrt(np.diag(expected)), rtol=0.01)


@pytest.mark.parametrize(("sigma", "least"), [(0.5, 0.12), (0.1, 0.6)])
def test_cloud_keeps_a_good_part_of_its_particles(sigma, least):
    """Prototypes keep .24 at 0.5 deg and .99 at 0.1 deg of another geometry; position alone would keep 1e-4."""
    problem = Problem(50, sigma)
    _, log_weight = problem.cloud()
    share = effective_size(normalise(log_weight)[0]) / log_weight.shape[1]
    assert np.median(share) > least, share


def test_cloud_is_the_posterior():
    """Against sampling without any proposal: draws of the prior, weighted by the whole likelihood.

    A wide sensor (20 km of delay, 60 Hz), so that enough of 400,000 prior draws count: some thousand, which know a mean
    to 0.03 standard deviations and a spread to 3 %.
    """
    rng = np.random.default_rng(2)
    direction = Direction(np.radians(0.3))
    delay, doppler = Tdoa(3e-6, receivers=(1,)), Fdoa(60.0, CARRIER, receivers=(1,))
    model = Stack([direction, delay, doppler])
    start = DirectionStart(direction, delay, doppler, model.names, HEIGHT, VELOCITY)
    truth = place(100e3, 450e3, 10e3)[None]
    stream = model.predict(truth, PLATFORMS)
    inputs = {"assumed_height": np.array([[12e3]])}
    cloud, log_weight = start.cloud(stream, PLATFORMS, inputs, rng.normal(size=(1, 40_000, 6)))
    weight = normalise(log_weight)[0]

    count = 400_000
    angles = stream[0, :2] + rng.normal(size=(count, 2)) * model.sigmas[:2]  # flat prior times likelihood
    heights = 12e3 + HEIGHT * rng.normal(size=count)
    origin = np.broadcast_to(PLATFORMS[0, 0, :3], (count, 3))
    position = ray_at_height(origin, direction.unit_vector(angles, PLATFORMS[0]), heights)
    states = np.concatenate([position, VELOCITY * rng.normal(size=(count, 3))], axis=-1)
    residual = (stream - model.predict(states, PLATFORMS[0]))[:, 2:] / model.sigmas[2:]
    plain = normalise(-0.5 * np.sum(residual**2, axis=-1))[0]
    assert effective_size(plain) > 2000 and effective_size(weight[0]) > 4000

    centre = plain @ states
    sigma = np.sqrt(plain @ (states - centre) ** 2)
    assert np.abs((weight[0] @ cloud[0] - centre) / sigma).max() < 0.12
    np.testing.assert_allclose(np.sqrt(weight[0] @ (cloud[0] - centre) ** 2) / sigma, 1, atol=0.08)


def test_what_cannot_start_yet():
    """No direction: NaN. No delay or no Doppler difference: wider, but a start."""
    problem = Problem(5)
    problem.stream[0, 1] = np.nan
    problem.stream[1, 3] = np.nan
    problem.stream[2, 4] = np.nan
    problem.stream[3, 1:] = np.nan
    mean, covariance = problem.begin()
    cloud, log_weight = problem.cloud(300)
    for i, able in enumerate([False, True, True, False, True]):
        assert np.isfinite(mean[i]).all() == able and np.isfinite(covariance[i]).all() == able
        assert np.isfinite(cloud[i]).all() == able and np.isfinite(log_weight[i]).any() == able
    volumes = np.linalg.slogdet(covariance[[1, 2, 4]])[1]
    assert volumes[2] < volumes[0] and volumes[2] < volumes[1]
    sigma = cloud[2, :, 3:].std(axis=0)
    np.testing.assert_allclose(sigma, VELOCITY, rtol=0.2)  # without it the velocity is the prior's; 300 particles


def test_a_trial_alone():
    problem = Problem(4)
    white = problem.rng.normal(size=(4, 500, 6))
    cloud, log_weight = problem.start.cloud(problem.stream, PLATFORMS, problem.inputs, white)
    one = slice(2, 3)
    inputs = {"assumed_height": problem.inputs["assumed_height"][one]}
    alone, own = problem.start.cloud(problem.stream[one], PLATFORMS, inputs, white[one])
    np.testing.assert_allclose(alone[0], cloud[2], rtol=1e-12)
    np.testing.assert_allclose(own[0], log_weight[2], rtol=1e-6, atol=1e-6)


def test_noise_from_the_port():
    """R on a port, the same as the model's: the same start. A variance that is NaN: a row that is not there."""
    problem, told = Problem(3), Problem(3, noise_port=True)
    noise = np.full((3, 5, 5), np.nan)
    noise[:, 1:, 1:] = told.model.noise_covariance()
    told.inputs["start_noise_covariance"] = noise.reshape(3, -1)
    for a, b in zip(problem.begin(), told.begin(), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9)
    noise[1, 3, :], noise[1, :, 3] = np.nan, np.nan
    problem.stream[1, 3] = np.nan
    told.inputs["start_noise_covariance"] = noise.reshape(3, -1)
    for a, b in zip(problem.begin(), told.begin(), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9)


def test_wrong_arguments():
    direction, delay, doppler = Direction(0.01), Tdoa(20e-9, receivers=(1,)), Fdoa(1.0, CARRIER, receivers=(1,))
    with pytest.raises(ValueError, match="are not measured"):
        DirectionStart(direction, delay, doppler, ["azimuth", "depression", "fdoa_10"], 3e3, 200.0)
    rows = [*direction.names, *delay.names, *doppler.names]
    with pytest.raises(ValueError, match="sigma_height: 0"):
        DirectionStart(direction, delay, doppler, rows, 0.0, 200.0)
