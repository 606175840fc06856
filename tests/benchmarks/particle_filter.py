"""Particle filters of `dual_satellite` against Stone Soup's bootstrap filter."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import ParticleState
from stonesoup.updater.particle import ParticleUpdater

from diagrams.catalogue import load_scenario, system
from systems.clocks import Periodic
from systems.estimators.base import Estimator
from systems.measurement.base import SPEED_OF_LIGHT
from systems.measurement.direction import Direction
from systems.measurement.fdoa import Fdoa
from systems.measurement.stack import Stack
from systems.recorder import record
from systems.signals import Draw, set_draw
from tests.benchmarks.harness import Peer, Size, Timing, race, ratios
from tests.benchmarks.report import Section, Threshold, microseconds, spread

__all__ = ["Measurement", "Scene", "bootstrap", "compare", "make_scene", "run_block"]

Array = NDArray[np.float64]

_EPOCH = datetime.datetime(2024, 1, 1)
_THRESHOLDS = {"pf_sir": Threshold(3.0, at_least=True), "pf": Threshold(1.5, at_least=True)}


@dataclass(frozen=True)
class Scene:
    """A recorded pass: measurements (epochs, trials, 4), platforms (epochs, 2, 6), prior positions (trials, 3).

    Stone Soup filters the first trial; the blocks filter all that are in their diagram.
    """

    measurement: Array
    platforms: Array
    prior: Array
    estimator: Estimator
    spread: Array


def _diagram(name: str, particles: int, trials: int, duration: float):  # type: ignore[no-untyped-def]
    settings = [f"duration_s={duration}", f"estimators.{name}.particles={particles}"]
    scenario = load_scenario("dual_satellite", settings=settings)
    builder = DiagramBuilder()
    wired = system("dual_satellite").wire(builder, scenario, [name], trials)
    return builder, wired


def make_scene(particles: int, duration: float) -> Scene:
    """Record the pass of one trial."""
    builder, wired = _diagram("pf", particles, 1, duration)
    prior = next(s for s in builder.GetSystems() if s.get_name() == "prior_position")
    ports = {"z": wired.measurement, "platforms": wired.platforms, "prior": prior.GetOutputPort("measurement")}
    recorder = record(builder, ports, Periodic(1.0))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw())
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(duration)
    _, signals = recorder.result(context)
    estimator = wired.estimators["pf"]
    covariance = wired.start_covariance("pf", np.zeros((1, 6)), signals["platforms"][0].reshape(1, 2, 6))
    return Scene(signals["z"], signals["platforms"].reshape(-1, 2, 6), signals["prior"][0], estimator, covariance[0])


def run_block(name: str, particles: int, trials: int, duration: float) -> Array:
    """Build and run the packaged diagram with one estimator; return its estimates (epochs, trials, 6)."""
    builder, wired = _diagram(name, particles, trials, duration)
    recorder = record(builder, {"estimate": wired.estimators[name].GetOutputPort("estimate")}, wired.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw())
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(wired.duration)
    return recorder.result(context)[1]["estimate"]


class Measurement(NonLinearGaussianMeasurement):
    """Direction, range difference and FDOA of all particles at once, (6, N) in and (4, N) out, nothing general in it.

    Metres instead of seconds: SciPy takes a covariance with 4e-16 s^2 beside 1 Hz^2 for singular.
    """

    platforms: Array = Property(doc="Satellites, (2, 6).")
    axes: Array = Property(doc="Body frame of the main satellite, (3, 3).")
    carrier: float = Property(doc="Carrier frequency [Hz].")

    @property
    def ndim_meas(self) -> int:
        """Number of rows."""
        return 4

    def function(self, state: ParticleState, noise: object = False, **kwargs: object) -> StateVectors:
        """Return the measurements, without noise."""
        x = np.asarray(state.state_vector, dtype=float)
        distances, rates = [], []
        for platform in self.platforms:
            offset, velocity = x[:3] - platform[:3, None], x[3:] - platform[3:, None]
            distance = np.sqrt((offset * offset).sum(axis=0))
            distances.append(distance)
            rates.append((offset * velocity).sum(axis=0) / distance)
            if len(distances) == 1:
                bx, by, bz = self.axes @ offset
        z = np.empty((4, x.shape[1]))
        z[0], z[1] = np.arctan2(by, bx), np.arctan2(bz, np.hypot(bx, by))
        z[2] = distances[1] - distances[0]
        z[3] = -self.carrier / SPEED_OF_LIGHT * (rates[1] - rates[0])
        return z.view(StateVectors)


def bootstrap(scene: Scene, particles: int) -> Array:
    """Run Stone Soup's bootstrap filter on the first trial; return its estimates (epochs, 6)."""
    model, motion = scene.estimator.model, scene.estimator.motion
    assert isinstance(model, Stack)
    direction, _, doppler = model.models
    assert isinstance(direction, Direction) and isinstance(doppler, Fdoa)
    transition = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=motion.transition(np.zeros(6), 1.0),
        covariance_matrix=CovarianceMatrix(motion.process_noise(np.zeros(6), 1.0)),
    )
    predictor = ParticlePredictor(transition)
    updater = ParticleUpdater(measurement_model=None, resampler=SystematicResampler())
    rng = np.random.default_rng(0)
    np.random.seed(0)  # noqa: NPY002 - Stone Soup draws from it
    cloud = rng.normal(size=(6, particles)) * np.sqrt(np.diag(scene.spread))[:, None]
    cloud[:3] += scene.prior[0, :, None]
    state = ParticleState(StateVectors(cloud), log_weight=np.full(particles, -np.log(particles)), timestamp=_EPOCH)
    metres = np.array([1.0, 1.0, SPEED_OF_LIGHT, 1.0])
    noise, means = CovarianceMatrix(model.noise_covariance() * np.outer(metres, metres)), []
    for k, (z, platforms) in enumerate(zip(scene.measurement[:, 0] * metres, scene.platforms, strict=True)):
        stamp = _EPOCH + datetime.timedelta(seconds=k)
        own = Measurement(
            ndim_state=6,
            mapping=(0, 1, 2, 3, 4, 5),
            noise_covar=noise,
            platforms=platforms,
            axes=_axes(direction, platforms),
            carrier=doppler.carrier,
        )
        prediction = predictor.predict(state, timestamp=stamp) if k else state
        detection = Detection(StateVector(z), timestamp=stamp, measurement_model=own)
        state = updater.update(SingleHypothesis(prediction, detection))
        means.append(np.asarray(state.mean, dtype=float)[:, 0])
    return np.array(means)


def _axes(direction: Direction, platforms: Array) -> Array:
    from systems.measurement.body_frame import body_frame

    return body_frame(platforms, direction.platform, direction.earth_rate)


def compare(size: Size) -> Section:
    """Return the table: cost of one particle and step."""
    particles = 200 if size.tiny else 10_000
    duration = 4.0 if size.tiny else 30.0
    section = Section(
        f"Particle filters, dual_satellite, {particles} particles, {duration:g} steps: cost of one particle and step",
        ("filter", "microseconds: median (range)", "Stone Soup / this (range)", "aim", ""),
        judged=not size.tiny,
    )
    scene = make_scene(particles, duration)
    steps = int(duration) + 1
    peers = [Peer("Stone Soup, bootstrap", partial(bootstrap, scene, particles), particles * steps)]
    for name in ("pf_sir", "pf"):
        for trials in (1, 2 if size.tiny else 10):
            run = partial(run_block, name, particles, trials, duration)
            peers.append(Peer(f"{name}, {trials} trial{'s' * (trials > 1)}", run, particles * steps * trials))
    timings = race(peers, size)
    theirs: Timing = timings["Stone Soup, bootstrap"]
    for label, mine in timings.items():
        if mine is theirs:
            section.rows.append((label, microseconds(mine.costs), "1", "", ""))
            continue
        ratio, threshold = ratios(theirs, mine), _THRESHOLDS[label.partition(",")[0]]
        section.rows.append(
            (label, microseconds(mine.costs), spread(ratio), str(threshold), section.judge(ratio, threshold))
        )
    section.notes.append(
        "pf_sir and pf are whole diagrams with satellites, sensors and recorder, built anew for every run; Stone Soup "
        "gets the recorded measurements and a measurement function of all its particles at once. A step of pf is one to two "
        "stages of tempering after about ten at the start, with a kernel each; a bootstrap filter has neither, and has "
        "collapsed by then."
    )
    return section
