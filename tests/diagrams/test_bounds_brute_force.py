"""The bounds that studies show against what they bound: Kalman's covariance, and the spread of maximum likelihood."""

import numpy as np
import pytest

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.library.models.three_satellite import models, satellite_orbit, target_state
from quietfix.diagrams.statistics.bounds import bound_squares
from quietfix.diagrams.statistics.posterior_bound import posterior_bound
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.motion.random_walk import RandomWalk
from quietfix.systems.trajectories.great_circle import straight_line


class Linear(MeasurementModel):
    """z = H x, rows correlated."""

    def __init__(self, size, rows, seed):
        rng = np.random.default_rng(seed)
        self.rows = rng.standard_normal((rows, size))
        root = rng.standard_normal((rows, rows)) + 2 * np.eye(rows)
        self.covariance = root @ root.T
        self.names = tuple(f"row_{i}" for i in range(rows))
        self.units = ("m",) * rows

    def predict(self, target, platforms):
        return np.einsum("mi,...i->...m", self.rows, target)

    def jacobian(self, target, platforms):
        return np.broadcast_to(self.rows, (*target.shape[:-1], *self.rows.shape))

    def noise_covariance(self):
        return self.covariance


@pytest.mark.parametrize("algorithm", [IteratedExtendedKalman(), UnscentedKalman()], ids=["iekf", "ukf"])
@pytest.mark.parametrize(
    "motion",
    [ConstantVelocity(0.0), ConstantVelocity(0.5), WhiteNoiseAcceleration(0.3), RandomWalk([0.1, 2.0], "ab", "mm")],
    ids=["no noise", "piecewise constant", "white", "random walk"],
)
def test_on_a_linear_gaussian_system_the_bound_is_the_covariance_of_the_filter(motion, algorithm):
    """The filters that studies run, and the recursion that studies show, 40 epochs, some rows missing."""
    n, trials, times = motion.size, 3, np.cumsum(np.r_[0.0, np.random.default_rng(3).uniform(0.2, 3.0, 39)])
    model = Linear(n, 2, seed=n)
    root = np.random.default_rng(5).standard_normal((n, n)) + 3 * np.eye(n)
    start = root @ root.T
    rng = np.random.default_rng(9)
    present = rng.random((trials, times.size, 2)) < 0.8
    platforms = np.zeros((1, 1, 6))
    truth = rng.standard_normal((trials, times.size, n))
    bound = posterior_bound(
        truth, np.zeros((1, times.size, 1, 6)), times, model, motion, start, first_epoch_used=False, present=present
    )
    mean, covariance = np.zeros((trials, n)), np.broadcast_to(start, (trials, n, n))
    whitener = Whitener(model.noise_covariance())
    for k in range(times.size):
        if k:
            mean, covariance = algorithm.predict(mean, covariance, motion, float(times[k] - times[k - 1]))
        measured = np.where(present[:, k], rng.standard_normal((trials, 2)), np.nan)
        posterior = algorithm.update(mean, covariance, Observation(measured, platforms, whitener), model)
        mean, covariance = posterior.mean, posterior.covariance
        sigma = np.sqrt(np.einsum("tii->ti", covariance))
        scale = sigma[:, :, None] * sigma[:, None, :]
        assert np.abs((bound[:, k] - covariance) / scale).max() < 1e-10


def gauss_newton(measured, start, platforms, times, model, iterations=12):
    """Maximum likelihood of the state at the first epoch of targets that fly straight, all trials at once.

    Parameters are counted in km and in 100 m/s, so that the normal equations are conditioned.
    """
    unit = np.array([1e3] * 3 + [100.0] * 3)
    weight = 1 / model.sigmas
    state = start.copy()
    phi = np.tile(np.eye(6), (times.size, 1, 1))
    phi[:, :3, 3:] = times[:, None, None] * np.eye(3)
    for _ in range(iterations):
        path = straight_line(state[:, None, :], times)
        predicted, jacobian = model.linearize(path, platforms)
        residual = (model.residual(measured, predicted) * weight).reshape(len(state), -1)
        rows = ((jacobian @ phi) * weight[:, None] * unit).reshape(len(state), -1, 6)
        columns = np.swapaxes(rows, -1, -2)
        step = np.linalg.solve(columns @ rows, columns @ residual[..., None])[..., 0]
        state = state + unit * step
    assert np.abs(step).max() < 1e-6  # a millimetre and 0.1 mm/s
    return state


@pytest.mark.parametrize("kinds", [("tdoa", "fdoa"), ("tdoa", "fdoa", "phase")], ids="+".join)
def test_maximum_likelihood_reaches_the_bound_where_noise_is_small(kinds):
    """Three satellites, a straight flight, no process noise and no prior; a tenth of the packaged noise."""
    settings = ["truth.phase=unambiguous"]
    settings += ["truth.sigma_tdoa_ns=2", "truth.sigma_fdoa_hz=0.1", "truth.sigma_phase_deg=1.5"]
    scenario = load_scenario("three_satellite", settings=settings)
    model = Stack([models(scenario, believed=False)[kind] for kind in kinds])
    times = np.arange(0.0, 150.1, 7.5)
    orbit = satellite_orbit(scenario)
    platforms = inertial_to_earth_fixed(orbit.at(times), times[:, None])
    truth = target_state(scenario, orbit)
    path = straight_line(truth, times)
    trials = 4000
    rng = np.random.default_rng(1)
    noise = model.sigmas * rng.standard_normal((trials, times.size, model.size))
    measured = model.predict(path, platforms) + noise
    guess = truth + np.array([300.0] * 3 + [20.0] * 3) * rng.standard_normal((trials, 6))
    found = straight_line(gauss_newton(measured, guess, platforms, times, model), times[-1])
    error = found - path[-1]

    # no prior: 1e4 km and 10 km/s leave less than 1e-6 of the information of any direction
    open_start = np.diag([1e7**2] * 3 + [1e4**2] * 3)
    bound = posterior_bound(
        path[None], platforms[None], times, model, ConstantVelocity(0.0), open_start, first_epoch_used=False
    )[0, -1]
    position, height, velocity, speed, course = np.sqrt(bound_squares(bound, path[-1]))[:5]
    # A root mean square that one weak direction makes is known to 1/sqrt(2 x 4000) = 1.1 %: 5 % are 4.5 of them.
    assert np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=-1))) == pytest.approx(position, rel=0.05)
    assert np.sqrt(np.mean(np.sum(error[:, 3:] ** 2, axis=-1))) == pytest.approx(velocity, rel=0.05)
    from quietfix.systems.earth.geodetic import course_speed, ecef_to_geodetic

    high = ecef_to_geodetic(found[:, :3])[2] - ecef_to_geodetic(path[-1, :3])[2]
    assert np.sqrt(np.mean(high**2)) == pytest.approx(height, rel=0.05)
    turned, fast, _ = course_speed(found[:, :3], found[:, 3:])
    real, quick, _ = course_speed(path[-1, :3], path[-1, 3:])
    assert np.sqrt(np.mean((fast - quick) ** 2)) == pytest.approx(speed, rel=0.05)
    assert np.degrees(np.sqrt(np.mean((turned - real) ** 2))) == pytest.approx(course, rel=0.05)
    # Every direction: in the bound's own axes the sample covariance is I, its six eigenvalues within
    # (1 +- sqrt(6/4000))^2 = 1 +- 8 % (Marchenko and Pastur), its mean to sqrt(2/(6 x 4000)) = 0.9 %.
    white = np.linalg.solve(np.linalg.cholesky(bound), error.T)
    values = np.linalg.eigvalsh(white @ white.T / trials)
    assert values[0] > 0.89 and values[-1] < 1.11
    assert values.mean() == pytest.approx(1.0, abs=0.04)
