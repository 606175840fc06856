"""The rocket's filters in a plain loop: NumPy alone, no diagram. What the diagram gives is held against it."""

import numpy as np

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.parts.launch import launch_site, rocket_model
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.plants.rocket import Rocket

__all__ = ["PERIOD", "Projected", "flight", "layout", "loop", "measure", "motion", "start_covariance"]

PERIOD = 0.05
SIGMA = 0.03
NOMINAL = [44.0895, 13.8471, 0.4919], [-0.6046, -9.6578, -0.4547]
"""Largest and smallest acceleration of the packaged flight from 50 to 300 s [m/s^2]."""


class Projected(MeasurementModel):
    """Range rates projected orthogonally to what they have in common: blind to any shared bias."""

    def __init__(self, stations):
        self._model = RangeRate(SIGMA, range(stations))
        # the columns after the first of an orthogonal matrix whose first column is (1, ..., 1)
        basis = np.linalg.qr(np.column_stack([np.ones(stations), np.eye(stations)[:, 1:]]))[0]
        self.projection = basis[:, 1:].T
        self.names = tuple(f"projected_{i}" for i in range(stations - 1))
        self.units = ("m/s",) * len(self.names)

    def predict(self, target, platforms):
        return np.einsum("ij,...j->...i", self.projection, self._model.predict(target, platforms))

    def jacobian(self, target, platforms):
        return self.projection @ self._model.jacobian(target, platforms)

    def noise_covariance(self):
        return SIGMA**2 * np.eye(len(self.names))


def flight(stop=300.0, start=50.0):
    """Return the epochs and the truth (time, 9): position, velocity, acceleration."""
    plant = Rocket(rocket_model(load_scenario("beacon_rocket")), stop)
    times = start + PERIOD * np.arange(round((stop - start) / PERIOD) + 1)
    return times, np.array([np.concatenate(plant.at(min(float(t), stop))) for t in times])


def layout(rng, count):
    """Return a random layout of stations on both sides of the ground track, shape (count, 6).

    At least 50 km off it: with stations as near as 20 km one layout of twenty has a standard deviation of 10 m in z, as
    the track then runs nearly through all of them.
    """
    down = np.linspace(-30e3, 1000e3, count) + rng.uniform(-40e3, 40e3, count)
    cross = rng.uniform(50e3, 150e3, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
    site = launch_site(load_scenario("beacon_rocket"))
    return np.concatenate([site.from_track(down, cross, rng.uniform(200.0, 1200.0, count)), np.zeros((count, 3))], -1)


def measure(truth, stations, bias, rng, trials):
    """Return measurements (time, trials, p) of the truth (time, 9) with a bias (time, 1) or (time, p)."""
    model = RangeRate(SIGMA, range(stations.shape[-2]))
    exact = model.predict(truth[:, None], stations[None]) + bias[:, None]
    return exact + SIGMA * rng.normal(size=(len(truth), trials, stations.shape[-2]))


def motion(alpha=0.01, margin=1.2, floor=2.0, per_step=1.0, biased=True, rule="estimate"):
    """Return the current statistical model as the scenario has it."""
    limits = (margin * np.array(limit) for limit in NOMINAL)
    return CurrentStatistical(alpha, *limits, floor, [per_step / PERIOD] if biased else [], rule)


def start_covariance(biased=True, sigma_bias=300.0):
    """Return the covariance of the start."""
    return np.diag(np.square([50.0] * 3 + [1.0] * 3 + [5.0] * 3 + [sigma_bias] * biased))


def loop(z, truth, stations, model, moves, covariance, algorithm=None):
    """Return estimates (time, trials, n); the start is the truth and 50 m and 1 m/s per axis, the bias 0."""
    algorithm = algorithm or UnscentedKalman()
    n, trials = moves.size, z.shape[1]
    mean = np.zeros((trials, n))
    mean[:, :9] = truth[0] + np.array([50.0] * 3 + [1.0] * 3 + [0.0] * 3)
    covariance = np.broadcast_to(covariance, (trials, n, n))
    whitener = Whitener(model.noise_covariance())
    carried = moves.initial_input(mean)
    seen = []
    for k in range(len(truth)):
        if k:
            carried = moves.next_input(mean, carried, PERIOD)
            mean, covariance = algorithm.predict(mean, covariance, moves.driven(carried), PERIOD)
        mean, covariance, *_ = algorithm.update(mean, covariance, Observation(z[k], stations, whitener), model)
        seen.append(mean)
    return np.array(seen)
