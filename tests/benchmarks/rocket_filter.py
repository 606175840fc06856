"""The unscented filter of the beacon rocket against Stone Soup's and FilterPy's, and what its whole study takes."""

from __future__ import annotations

import datetime
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import UnscentedKalmanUpdater

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.parts.launch import rocket_model, station_positions
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.plants.rocket import Rocket
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.own_peers import History
from tests.benchmarks.report import Section, Threshold, microseconds, spread

__all__ = ["Problem", "RangeRates", "compare", "loop", "problem"]

Array = NDArray[np.float64]

PERIOD = 0.05
STATIONS = 7
# All peers are Kalman filters with the same sigma points; 1e-6 m is a millionth of the standard deviation here.
POSITION = 1e-4

QUIETFIX = "quietfix ukf, functions in a loop"
STONE_SOUP = "Stone Soup UnscentedKalmanPredictor and -Updater"
STONE_SOUP_LINEAR = "Stone Soup KalmanPredictor, UnscentedKalmanUpdater"
FILTERPY = "FilterPy UnscentedKalmanFilter"


@dataclass(frozen=True)
class Problem:
    """Measurements (epochs, trials, 7) of the rocket, and what a filter needs to know."""

    measurement: Array
    stations: Array
    mean: Array
    covariance: Array
    model: RangeRate
    motion: CurrentStatistical

    @property
    def work(self) -> int:
        """Trials times steps."""
        return self.measurement.shape[0] * self.measurement.shape[1]

    @property
    def transition(self) -> Array:
        """F, the same at every step."""
        return self.motion.transition(self.mean, PERIOD)

    @property
    def noise(self) -> Array:
        """Q, the same at every step."""
        return self.motion.process_noise(self.mean[0], PERIOD)


def problem(trials: int, steps: int) -> Problem:
    """Return the flight of the packaged rocket from 100 s on, seen by the first seven stations."""
    scenario = load_scenario("beacon_rocket")
    stations = np.zeros((STATIONS, 6))
    stations[:, :3] = station_positions(scenario)[:STATIONS]
    plant = Rocket(rocket_model(scenario), 100.0 + PERIOD * (steps + 1))
    truth = np.array([[*np.concatenate(plant.at(100.0 + PERIOD * k)), 220.0] for k in range(steps + 1)])
    model = RangeRate(0.03, range(STATIONS), bias=9)
    rng = np.random.default_rng(0)
    exact = model.predict(truth[1:, None], stations)
    sigma = np.array([5.0] * 3 + [0.3] * 3 + [1.0] * 3 + [3.0])  # settled: FilterPy loses definiteness from 300 m/s
    mean = truth[0] + sigma * rng.normal(size=(trials, 10))
    # The mean acceleration is held at zero: F and Q are then the same at every step, for every peer.
    motion = CurrentStatistical(0.01, [44.0, 14.0, 0.5], [-0.6, -9.7, -0.5], 10.0, [20.0], mean=np.zeros(3))
    return Problem(
        exact + 0.03 * rng.normal(size=(steps, trials, STATIONS)),
        stations,
        mean,
        np.broadcast_to(np.diag(sigma**2), (trials, 10, 10)),
        model,
        motion,
    )


def loop(given: Problem) -> History:
    """Run all trials at once."""
    algorithm, whitener = UnscentedKalman(), Whitener(given.model.noise_covariance())
    mean, covariance = given.mean, given.covariance
    means, covariances = [mean], [covariance]
    for z in given.measurement:
        mean, covariance = algorithm.predict(mean, covariance, given.motion, PERIOD)
        mean, covariance, *_ = algorithm.update(
            mean, covariance, Observation(z, given.stations[None], whitener), given.model
        )
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


class RangeRates:
    """Range rates and shared bias, written for one state vector or a matrix of columns: what a user would write."""

    def __init__(self, stations: Array) -> None:
        self._stations = stations[:, :3].copy()

    def __call__(self, x: Array) -> Array:
        """Return the measurement, shape (7,), of a state (10,)."""
        offset = x[:3] - self._stations
        return offset @ x[3:6] / np.sqrt((offset * offset).sum(axis=1)) + x[9]

    def columns(self, x: Array) -> Array:
        """Return the measurements, shape (7, k), of states (10, k)."""
        offset = x[:3] - self._stations[:, :, None]
        return (offset * x[3:6]).sum(axis=1) / np.sqrt((offset * offset).sum(axis=1)) + x[9]


def filterpy(given: Problem) -> Callable[[], History]:
    """Return what runs FilterPy's filter over all trials."""
    function, transition = RangeRates(given.stations), given.transition

    def one(trial: int) -> tuple[list[Array], list[Array]]:
        points = MerweScaledSigmaPoints(n=10, alpha=1.0, beta=0.0, kappa=0.0)
        ukf = UnscentedKalmanFilter(10, STATIONS, PERIOD, hx=function, fx=lambda x, dt: transition @ x, points=points)
        ukf.x, ukf.P, ukf.Q = given.mean[trial], given.covariance[trial], given.noise
        ukf.R = given.model.noise_covariance()
        means, covariances = [ukf.x], [ukf.P]
        for z in given.measurement[:, trial]:
            ukf.predict()
            # FilterPy would use the points of before the process noise: another filter than the others'
            ukf.sigmas_f = points.sigma_points(ukf.x, ukf.P)
            ukf.update(z)
            means.append(ukf.x)
            covariances.append(ukf.P)
        return means, covariances

    def run() -> History:
        means, covariances = zip(*(one(trial) for trial in range(len(given.mean))), strict=True)
        return np.array(means).swapaxes(0, 1), np.array(covariances).swapaxes(0, 1)

    return run


class _Measurement(NonLinearGaussianMeasurement):
    """`RangeRates` as Stone Soup wants it: matrices of column vectors, and states instead of arrays."""

    rates: RangeRates = Property(doc="The measurement function.")

    @property
    def ndim_meas(self) -> int:
        """Number of rows."""
        return STATIONS

    def function(self, state: GaussianState, noise: object = False, **kwargs: object) -> StateVectors:
        """Return the measurements, without noise."""
        return self.rates.columns(np.asarray(state.state_vector)).view(StateVectors)


def stone_soup(given: Problem, unscented: bool = True) -> Callable[[range], History]:
    """Return what runs Stone Soup's filter over some trials; the motion is linear, so both predictors are exact."""
    motion = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=given.transition, covariance_matrix=CovarianceMatrix(given.noise)
    )
    begin = datetime.datetime(2024, 1, 1)
    stamps = [begin + datetime.timedelta(seconds=PERIOD * (k + 1)) for k in range(len(given.measurement))]
    model = _Measurement(
        ndim_state=10,
        mapping=list(range(10)),
        noise_covar=CovarianceMatrix(given.model.noise_covariance()),
        rates=RangeRates(given.stations),
    )
    detections = [
        [
            Detection(StateVector(z), timestamp=stamp, measurement_model=model)
            for z, stamp in zip(given.measurement[:, trial], stamps, strict=True)
        ]
        for trial in range(len(given.mean))
    ]

    def one(trial: int) -> tuple[list[Array], list[Array]]:
        predictor = (
            UnscentedKalmanPredictor(motion, alpha=1.0, beta=0.0, kappa=0.0) if unscented else KalmanPredictor(motion)
        )
        updater = UnscentedKalmanUpdater(measurement_model=None, alpha=1.0, beta=0.0, kappa=0.0)
        state = GaussianState(
            StateVector(given.mean[trial]), CovarianceMatrix(given.covariance[trial]), timestamp=begin
        )
        means, covariances = [state.state_vector], [state.covar]
        for detection in detections[trial]:
            prediction = predictor.predict(state, timestamp=detection.timestamp)
            state = updater.update(SingleHypothesis(prediction, detection))
            means.append(state.state_vector)
            covariances.append(state.covar)
        return means, covariances

    def run(trials: range) -> History:
        means, covariances = zip(*(one(trial) for trial in trials), strict=True)
        return np.array(means).swapaxes(0, 1)[..., 0], np.array(covariances).swapaxes(0, 1)

    return run


def compare(size: Size) -> Section:
    """Return the table."""
    trials, steps = (3, 4) if size.tiny else (100, 40)
    given = problem(trials, steps)
    share = trials // size.slices

    def soup(name: str, unscented: bool) -> Peer:
        run = stone_soup(given, unscented)
        parts: Sequence[Callable[[], Any]] = (
            [] if size.slices == 1 else [partial(run, range(k, k + share)) for k in range(0, trials, share)]
        )
        return Peer(name, partial(run, range(trials)), given.work, parts)

    timings = race(
        [
            Peer(QUIETFIX, partial(loop, given), given.work),
            soup(STONE_SOUP, True),
            soup(STONE_SOUP_LINEAR, False),
            Peer(FILTERPY, filterpy(given), given.work),
        ],
        size,
    )
    section = Section(
        f"Unscented Kalman filter, beacon_rocket, 10 states, {STATIONS} range rates, {trials} trials, {steps} steps: "
        "cost of one trial and step",
        ("peer", "microseconds: median (range)", "this / quietfix (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    mine = timings[QUIETFIX]
    section.rows.append((QUIETFIX, microseconds(mine.costs), "1", "", ""))
    limits = {STONE_SOUP: Threshold(40, True), STONE_SOUP_LINEAR: None, FILTERPY: Threshold(100, True)}
    for name, threshold in limits.items():
        gain = ratios(timings[name], mine)
        verdict = ("", "") if threshold is None else (str(threshold), section.judge(gain, threshold))
        section.rows.append((name, microseconds(timings[name].costs), spread(gain), *verdict))
        apart = float(np.abs(timings[name].result[0] - mine.result[0])[..., :6].max())
        if not apart <= POSITION:
            raise ArithmeticError(f"not so: {name} and Quietfix agree within {apart:.1e} m, m/s")
        section.notes.append(f"{name} and Quietfix agree over all epochs and trials within {apart:.1e} m and m/s.")
    section.notes += [
        "The same measurements, start, F, Q and R, weights of the cubature rule. The mean acceleration is held, so "
        "that F and Q are the same at every step for all.",
        "Quietfix predicts in closed form, as the motion is linear. Stone Soup's unscented filter predicts with sigma "
        "points; its linear predictor with the unscented updater stands beside it, without a threshold. FilterPy "
        "predicts with sigma points; for its update they are drawn anew, as the others do.",
        _study(size),
    ]
    return section


def _study(size: Size) -> str:
    trials, seconds = (2, 1.0) if size.tiny else (100, 250.0)
    command = [sys.executable, "-m", "tests.benchmarks.one_study", str(trials), str(seconds), "beacon_rocket"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"the study of beacon_rocket failed:\n{done.stderr}")
    found = json.loads(done.stdout.splitlines()[-1])
    return (
        f"The whole study of beacon_rocket, {trials} trials, {seconds:g} s at 20 Hz, `ukf` alone, with truth, "
        f"stations, bounds and errors: {found['seconds']:.0f} s and {found['megabytes']:.0f} MB at most, in a process "
        "of its own."
    )
