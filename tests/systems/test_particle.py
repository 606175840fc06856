"""Particle filters: their parts, a textbook loop, and the Kalman filter on a problem that it is exact for."""

import math

import numpy as np
import pytest

from quietfix.systems.clocks import Periodic
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.particle.draws import Draws
from quietfix.systems.filters.particle.health import LEAST_EVIDENCE, evidence, follow
from quietfix.systems.filters.particle.kernel import bandwidth, lost_spread, shrunk_kernel
from quietfix.systems.filters.particle.likelihood import Likelihood, Reading
from quietfix.systems.filters.particle.tempering import conditional_share, next_exponent
from quietfix.systems.filters.particle.update import Cloud, ParticleUpdate
from quietfix.systems.filters.particle.weights import effective_size, moments, normalise, unique_sorted
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.noise import many_normal
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.pf import Pf
from quietfix.systems.options.pf_sir import PfSir
from quietfix.systems.starts.start import GivenStart
from tests.laws.rig import Linear, make, run, textbook

# ------------------------------------------------------------------------------------------------------- parts


def test_weights_of_a_likelihood_that_underflows():
    """Log likelihoods of -5000 and less, as a collapsed filter has them: no NaN, and the right ratio."""
    log_weight = np.array([[-5631.0, -5632.0, -math.inf], [0.0, 0.0, 0.0]])
    weight, log_sum = normalise(log_weight)
    np.testing.assert_allclose(weight[0], [1 / (1 + math.exp(-1)), math.exp(-1) / (1 + math.exp(-1)), 0])
    np.testing.assert_allclose(log_sum, [-5631 + math.log(1 + math.exp(-1)), math.log(3)])
    np.testing.assert_allclose(effective_size(np.array([[0.5, 0.5, 0], [1, 0, 0]])), [2, 1])


def test_moments_are_numpys():
    rng = np.random.default_rng(0)
    cloud, weight = 6.4e6 + rng.normal(size=(3, 4, 500)) * 30, rng.exponential(size=(3, 500))
    weight /= weight.sum(axis=-1, keepdims=True)
    mean, covariance = moments(cloud, weight)
    for i in range(3):
        np.testing.assert_allclose(mean[i], np.average(cloud[i], axis=-1, weights=weight[i]), rtol=1e-14)
        # the jitter is 1e-9 of a variance
        np.testing.assert_allclose(
            covariance[i], np.cov(cloud[i], aweights=weight[i], ddof=0), rtol=1e-6, atol=1e-6 * 900
        )


def test_a_collapsed_cloud_has_a_definite_covariance():
    _, covariance = moments(np.full((1, 6, 50), 6e6), np.full((1, 50), 0.02))
    np.linalg.cholesky(covariance)


def test_unique_ancestors():
    np.testing.assert_array_equal(unique_sorted(np.array([[0, 0, 3, 3, 9], [4, 4, 4, 4, 4]])), [3, 1])


def test_kernel_keeps_mean_and_covariance():
    """In expectation; 200,000 particles know a covariance to 1 %."""
    rng = np.random.default_rng(1)
    root = np.array([[3.0, 0, 0], [1, 2, 0], [-1, 0.5, 0.2]])
    cloud = 100 + root @ rng.normal(size=(1, 3, 200_000))
    equal = np.full((1, 200_000), 1 / 200_000)
    mean, covariance = moments(cloud, equal)
    moved = shrunk_kernel(cloud, mean, np.linalg.cholesky(covariance), rng.normal(size=cloud.shape), 0.4, np.zeros(1))
    after_mean, after = moments(moved, equal)
    np.testing.assert_allclose(after_mean, mean, atol=0.02)
    np.testing.assert_allclose(after, covariance, rtol=0.02, atol=0.02)
    assert np.abs(moved - cloud).max() > 1  # or else nothing moved


def test_spread_that_a_weighted_covariance_has_lost():
    """Sixty particles weighted in one of three directions: the variance of the others, over 4000 trials.

    Their effective size is about 34, so that 3 % are missing. The mean over the trials is known to
    sqrt(2/34/8000) = 0.3 %: four of these.
    """
    cloud = np.random.default_rng(8).normal(size=(4000, 3, 60))
    weight, _ = normalise(-0.5 * (2.0 * (cloud[:, 0] - 0.3)) ** 2)
    _, covariance = moments(cloud, weight)
    others = np.einsum("tii->ti", covariance)[:, 1:].mean(axis=-1)
    assert others.mean() < 0.98
    assert (others * (1 + lost_spread(effective_size(weight)))).mean() == pytest.approx(1.0, abs=0.012)
    assert lost_spread(np.array([1.0])) == 1.0  # one particle left: no more than that


def test_bandwidths():
    """Six states: 0.467, 0.371, 0.295 for 1e3, 1e4, 1e5 particles."""
    for count, h in ((1e3, 0.467), (1e4, 0.371), (1e5, 0.295)):
        assert bandwidth(6, count) == pytest.approx(h, abs=1e-3)
    assert bandwidth(6, 1) <= 1


def test_exponents_keep_their_share():
    """Likelihoods from flat to 1e-5 of the cloud's width; all at once where that keeps the share."""
    rng = np.random.default_rng(2)
    x = rng.normal(size=(60, 2000, 2)) * 10 ** rng.uniform(-2, 5, size=(60, 1, 1))
    log_likelihood = -0.5 * (x**2).sum(axis=-1)
    weight = np.full((60, 2000), 1 / 2000)
    remaining = rng.uniform(0.2, 1.0, size=60)
    exponent = next_exponent(weight, log_likelihood, remaining, 0.5)
    scaled = log_likelihood - log_likelihood.max(axis=-1, keepdims=True)
    share = conditional_share(weight, scaled, exponent)
    whole = exponent == remaining
    assert 5 < whole.sum() < 55
    assert np.all(share >= 0.5) and np.all(exponent <= remaining)
    assert share[~whole].max() < 0.55
    # equal weights: the conditional share is the effective one
    flat, _ = normalise(exponent[:, None] * log_likelihood)
    np.testing.assert_allclose(share, effective_size(flat) / 2000, rtol=1e-9)
    for i in range(3):
        np.testing.assert_array_equal(
            next_exponent(weight[i : i + 1], log_likelihood[i : i + 1], remaining[i : i + 1], 0.5), exponent[i]
        )


def test_many_normal_numbers():
    batch = many_normal(3, "pf:motion", range(40, 45), 7, (3, 5000))
    np.testing.assert_array_equal(many_normal(3, "pf:motion", [42], 7, (3, 5000))[0], batch[2])
    # mean and variance of 75,000 numbers: five standard errors
    assert abs(batch.mean()) < 5 / math.sqrt(batch.size) and abs(batch.var() - 1) < 5 * math.sqrt(2 / batch.size)
    others = [
        many_normal(4, "pf:motion", [42], 7, (3, 5000)),
        many_normal(3, "pf:kernel", [42], 7, (3, 5000)),
        many_normal(3, "pf:motion", [42], 8, (3, 5000)),
        many_normal(3, "pf:motion", [43], 7, (3, 5000)),
    ]
    for other in others:
        assert abs(np.corrcoef(other.ravel(), batch[2].ravel())[0, 1]) < 5 / math.sqrt(15_000)
    with pytest.raises(ValueError, match="sample"):
        many_normal(0, "x", [0], -1, (2,))


# ---------------------------------------------------------------------------------------------------- textbook


class Problem:
    """Two rows of a state of four, and a prior as wide as they leave it after a while."""

    def __init__(self, trials, epochs):
        rng = np.random.default_rng(6)
        self.motion, self.epochs = WhiteNoiseAcceleration(0.5, axes=2), epochs
        self.model = Linear(np.array([[1.0, 0.3, 0, 0], [0, 1e-6, 0, 2e-6]]), np.diag([4.0, 1e-12]))
        self.covariance = np.diag([9.0, 25.0, 1.0, 4.0])
        truth = rng.normal(size=(trials, 4)) * np.sqrt(np.diag(self.covariance))
        root = np.linalg.cholesky(self.motion.process_noise(truth, 1.0))
        self.mean, self.measurement = np.zeros((trials, 4)), np.empty((epochs, trials, 2))
        for k in range(epochs):
            if k:
                truth = self.motion.propagate(truth, 1.0) + rng.normal(size=truth.shape) @ root.T
            self.measurement[k] = self.model.predict(truth, None) + rng.normal(size=(trials, 2)) * self.model.sigmas

    def run(self, name, options):
        start = GivenStart(self.mean, self.covariance)
        clock = Periodic(1.0)
        block = make(name, options, self.model, self.motion, start, len(self.mean), clock)
        return run(block, self.measurement, np.zeros((self.epochs, 1, 18)), clock)[1]

    def kalman(self):
        phi, q = self.motion.transition(self.mean, 1.0), self.motion.process_noise(self.mean, 1.0)
        h, r = self.model.jacobian(np.zeros(4), None), self.model.noise_covariance()
        columns = []
        for i in range(len(self.mean)):
            x, p, rows = self.mean[i], self.covariance, []
            for k in range(self.epochs):
                move = (phi, q) if k else (np.eye(4), np.zeros((4, 4)))
                before, (x, p), _, nis, _ = textbook(x, p, *move, h, r, self.measurement[k, i])
                rows.append((x, p, *before, nis))
            columns.append(rows)
        return [np.stack([np.array([row[j] for row in rows]) for rows in columns], axis=1) for j in range(5)]


@pytest.mark.parametrize("kind", [Pf, PfSir])
def test_agrees_with_the_kalman_filter(kind):
    """Linear and Gaussian: the difference is scatter, which sixteen times the particles make a quarter of.

    20,000 particles of which some tenth counts know a mean to 0.02 standard deviations; the filter remembers an error
    for some epochs: 0.06 is asserted for the root mean square over trials and epochs, six of these for the largest of
    960 numbers. The ratio of two such root mean squares scatters by about a fifth.
    """
    problem = Problem(6, 40)
    mean, covariance, before, _, nis = problem.kalman()
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    errors = {}
    for count in (1250, 20_000):
        values = problem.run("pf", kind(particles=count))
        errors[count] = (values["estimate"] - mean) / sigma
    scatter = {count: np.sqrt(np.mean(error**2)) for count, error in errors.items()}
    assert scatter[20_000] < 0.06 and np.abs(errors[20_000]).max() < 0.36, scatter
    assert 2.4 < scatter[1250] / scatter[20_000] < 6.5, scatter
    scale = sigma[..., None] * sigma[..., None, :]
    assert np.sqrt(np.mean(((values["covariance"] - covariance) / scale) ** 2)) < 0.06
    wide = np.sqrt(np.diagonal(values["prediction_covariance"], axis1=-2, axis2=-1))
    assert np.sqrt(np.mean(((values["prediction"] - before) / wide) ** 2)) < 0.06
    np.testing.assert_allclose(values["nis"], nis, rtol=0.15, atol=0.2)
    assert np.all(values["nis_dof"] == 2)


def test_bootstrap_filter_is_the_textbook_loop():
    """The same draws through a loop over particles: the same numbers."""
    count = 40
    problem = Problem(2, 5)
    values = problem.run("pf_sir", PfSir(particles=count))
    h, sigmas = problem.model.jacobian(np.zeros(4), None), problem.model.sigmas
    q = problem.motion.process_noise(np.zeros(4), 1.0)
    for trial in range(2):
        which = np.array([trial])
        for k in range(5):
            draws = Draws(11, "pf_sir", k, np.arange(2))
            if k == 0:
                white = draws.normal("start", which, (4, count))[0]
                particles = [np.sqrt(np.diag(problem.covariance)) * white[:, i] for i in range(count)]
            else:
                white = draws.normal("motion", which, (4, count))[0]
                phi = problem.motion.transition(np.zeros(4), 1.0)
                particles = [phi @ x + np.linalg.cholesky(q) @ white[:, i] for i, x in enumerate(particles)]
            likelihood = [
                math.exp(-0.5 * sum(((problem.measurement[k, trial] - h @ x) / sigmas) ** 2)) for x in particles
            ]
            weight = [value / sum(likelihood) for value in likelihood]
            estimate = sum(w * x for w, x in zip(weight, particles, strict=True))
            np.testing.assert_allclose(values["estimate"][k, trial], estimate, rtol=1e-9, atol=1e-9)
            u = draws.uniform("resample:0", which, 1)[0, 0]
            chosen, total, i = [], weight[0], 0
            for j in range(count):
                while (j + u) / count >= total:
                    i += 1
                    total += weight[i]
                chosen.append(particles[i])
            particles = chosen


# ------------------------------------------------------------------------------------------------------ health


def one_update(update, shift, count=4000, trials=40, sigma=0.3):
    """Update N(0, I) in two dimensions with a measurement of both, `shift` standard deviations off."""
    draws = Draws(0, "x", 0, np.arange(trials))
    everyone = np.arange(trials)
    particles = draws.normal("start", everyone, (2, count))
    cloud = Cloud(particles, np.zeros((trials, count)), np.tile(np.arange(count, dtype=float), (trials, 1)))
    model = Linear(np.eye(2), sigma**2 * np.eye(2))
    spread = math.sqrt(1 + sigma**2)
    z = spread * (draws.normal("z", everyone, (2,)) + shift)
    reading = Reading(model, Observation(z, np.zeros((1, 1, 6)), Whitener(model.noise_covariance())))
    residual = reading.residual(particles, everyone).rows
    return update(cloud, Likelihood(reading, np.zeros((trials, 2), dtype=bool)), residual, draws), z, spread


@pytest.mark.parametrize("update", [ParticleUpdate(), ParticleUpdate(share=None, kernel=False, threshold=math.inf)])
def test_evidence_is_the_predictive_likelihood(update):
    """Against the Gaussian integral; 4000 particles know it to 0.1 (the effective sample is a few hundred)."""
    result, z, spread = one_update(update, 0.0)
    exact = -0.5 * (z**2).sum(axis=-1) / spread**2 + 2 * math.log(0.3 / spread)
    np.testing.assert_allclose(result.log_evidence, exact, atol=0.25)
    score = evidence(result.log_evidence, result.spread, np.full(40, 2))
    # (m - chi^2_m)/2 has mean 0 and standard deviation 1: five standard errors of 40
    assert abs(score.mean()) < 5 / math.sqrt(40)


def test_a_measurement_that_no_particle_explains():
    """A hundred sigma away: finite numbers, and an evidence that says so. All likelihoods zero: the cloud stays."""
    result, _, _ = one_update(ParticleUpdate(), 100.0, count=500)
    assert np.isfinite(result.mean).all() and np.isfinite(result.cloud.particles).all()
    assert np.all(evidence(result.log_evidence, result.spread, np.full(40, 2)) < -1000)
    assert result.stages.max() <= ParticleUpdate().max_stages


def test_one_outlier_is_no_divergence_but_some_are():
    recent = follow(np.zeros(1), np.array([-1e9]))
    assert recent > LEAST_EVIDENCE
    assert follow(recent, np.array([-1e9])) < LEAST_EVIDENCE
    assert follow(np.zeros(1), np.array([-math.inf])) > LEAST_EVIDENCE


def test_a_trial_that_is_done_is_not_touched():
    """A sharp measurement beside a vague one: the vague trial has one stage, and the result it has alone."""
    trials, count = 2, 500
    draws = Draws(0, "x", 0, np.arange(trials))
    particles = draws.normal("start", np.arange(trials), (2, count))
    ancestor = np.tile(np.arange(count, dtype=float), (trials, 1))
    cloud = Cloud(particles, np.zeros((trials, count)), ancestor)
    noise = np.stack([1e-8 * np.eye(2), 100 * np.eye(2)])
    model = Linear(np.eye(2), np.eye(2))

    def update(which):
        which = np.array(which)
        z = np.zeros((len(which), 2))
        reading = Reading(model, Observation(z, np.zeros((1, 1, 6)), Whitener(noise[which])))
        part = cloud.rows(which)
        everyone = np.arange(len(which))
        residual = reading.residual(part.particles, everyone).rows
        return ParticleUpdate()(part, Likelihood(reading, np.zeros(z.shape, dtype=bool)), residual, draws.of(which))

    both = update([0, 1])
    assert both.stages[0] > 5 and both.stages[1] == 1
    for i in range(2):
        alone = update([i])
        np.testing.assert_array_equal(alone.cloud.particles[0], both.cloud.particles[i])
        np.testing.assert_array_equal(alone.mean[0], both.mean[i])
        assert alone.log_evidence[0] == both.log_evidence[i]


# --------------------------------------------------------------------------------------------------- arguments


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"share": 0.0}, "share"),
        ({"share": 1.0}, "share"),
        ({"threshold": 0.0}, "threshold"),
        ({"scheme": "roulette"}, "roulette is not allowed; one of systematic"),
        ({"max_stages": 0}, "max_stages"),
    ],
)
def test_wrong_arguments(arguments, words):
    with pytest.raises(ValueError, match=words):
        ParticleUpdate(**arguments)


def test_wrong_numbers_of_particles():
    problem = Problem(1, 1)
    for options, words in ((Pf(particles=1), "particles: 1"), (Pf(window=-1), "window: -1")):
        with pytest.raises(ValueError, match=words):
            make("pf", options, problem.model, problem.motion, GivenStart(np.zeros(4), np.eye(4)))


def test_between_ticks_the_prediction_is_the_same_every_time():
    """A port read twice between ticks shows one draw of the process noise, and the filter goes on as if unread."""
    problem = Problem(2, 4)
    start, clock = GivenStart(problem.mean, problem.covariance), Periodic(1.0)
    results = []
    for log in (Periodic(0.25), Periodic(1.0)):
        block = make("pf", Pf(particles=200), problem.model, problem.motion, start, 2, clock)
        results.append(run(block, problem.measurement, np.zeros((4, 1, 18)), clock, log=log)[1]["estimate"])
    np.testing.assert_array_equal(results[0][::4], results[1])


def test_particles_of_a_motion_with_an_input():
    """The mean acceleration that an estimator carries is one per trial; a cloud moves by it."""
    motion = CurrentStatistical(0.05, [30.0] * 3, [-30.0] * 3, 1.0)
    model = Linear(np.eye(9)[:3], 25.0 * np.eye(3))
    mean, spread = np.zeros((2, 9)), np.diag([100.0] * 3 + [25.0] * 3 + [4.0] * 3)
    mean[1, 6] = 5.0
    truth = np.array([np.concatenate([mean[:, 6:7] * k**2 / 2, np.zeros((2, 2))], axis=-1) for k in range(8)])
    clock = Periodic(1.0)
    outputs = {}
    for name, options in (("pf", Pf(particles=5000)), ("ekf", Ekf())):
        block = make(name, options, model, motion, GivenStart(mean, spread), 2, clock)
        outputs[name] = run(block, truth, np.zeros((8, 1, 18)), clock)[1]
    sigma = np.sqrt(np.diagonal(outputs["ekf"]["covariance"], axis1=-2, axis2=-1))
    # the process noise follows the estimate, so it is the same only to a few per cent
    assert np.abs((outputs["pf"]["estimate"] - outputs["ekf"]["estimate"]) / sigma).max() < 0.3


def test_one_trial_of_a_motion_with_an_input_is_not_measured():
    motion = CurrentStatistical(0.05, [30.0] * 3, [-30.0] * 3, 1.0)
    model = Linear(np.eye(9)[:3], 25.0 * np.eye(3))
    spread = np.diag([100.0] * 3 + [25.0] * 3 + [4.0] * 3)
    measured, clock, estimates = np.zeros((5, 2, 3)), Periodic(1.0), []
    for missing in (False, True):
        if missing:
            measured[2, 1] = np.nan
        block = make("pf", Pf(particles=200), model, motion, GivenStart(np.zeros((2, 9)), spread), 2, clock)
        estimates.append(run(block, measured, np.zeros((5, 1, 18)), clock)[1]["estimate"])
    assert np.isfinite(estimates[1]).all()
    np.testing.assert_allclose(estimates[1][:, 0], estimates[0][:, 0], rtol=1e-9, atol=1e-9)
