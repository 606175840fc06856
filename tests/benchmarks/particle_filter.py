"""Particle filters of `dual_satellite` against Stone Soup's bootstrap filter."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, OutputPort
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

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.systems.angles.direction import Direction
from quietfix.systems.clocks import Periodic
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.geometry.body_frame import body_frame
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw
from tests.benchmarks.harness import Peer, Size, Timing, race, ratios
from tests.benchmarks.report import Section, Threshold, microseconds, spread

__all__ = ["Measurement", "Run", "Scene", "block_run", "bootstrap", "compare", "loop", "make_scene"]

Array = NDArray[np.float64]

_EPOCH = datetime.datetime(2024, 1, 1)
_THRESHOLDS = {"pf_sir": Threshold(6.0, at_least=True), "pf": Threshold(4.0, at_least=True)}


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


def _wire(name: str, particles: int, trials: int, duration: float) -> tuple[DiagramBuilder, Assembly]:
    settings = [f"duration_s={duration}", f"estimators.{name}.particles={particles}"]
    scenario = load_scenario("dual_satellite", settings=settings)
    builder = DiagramBuilder()
    return builder, find("dual_satellite").system.build(builder, scenario, [name], trials)


class Run:
    """A diagram with a recorder, built once; each call is one run in a new context.

    Parameters
    ----------
    builder : DiagramBuilder
        The diagram under construction.
    ports : mapping of str to OutputPort
        What is recorded, every second.
    duration : float
        Length of a run [s].
    """

    def __init__(self, builder: DiagramBuilder, ports: Mapping[str, OutputPort], duration: float) -> None:
        self._recorder = record(builder, ports, Periodic(1.0))
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        self._duration = duration

    def __call__(self) -> dict[str, Array]:
        """Return what was recorded, each (epochs, trials, size)."""
        context = self._diagram.CreateDefaultContext()
        set_draw(self._diagram, context, Draw())
        self._simulator.reset_context(context)
        self._simulator.Initialize()
        self._simulator.AdvanceTo(self._duration)
        return self._recorder.result(context)[1]


def make_scene(name: str, particles: int, trials: int, duration: float) -> Scene:
    """Record the pass of some trials with one estimator."""
    builder, wired = _wire(name, particles, trials, duration)
    prior = next(block for block in builder.GetSystems() if block.get_name() == "prior_position")
    ports = {"z": wired.measurement, "platforms": wired.platforms, "prior": prior.GetOutputPort("measurement")}
    signals = Run(builder, ports, duration)()
    estimator = wired.estimators[name]
    covariance, _ = estimator.bound_prior(np.zeros((1, 6)), signals["platforms"][0].reshape(1, 2, 6))
    platforms = signals["platforms"].reshape(-1, 2, 6)
    return Scene(signals["z"], platforms, signals["prior"][0], wired.estimators[name], covariance[0])


def loop(scene: Scene) -> Array:
    """Run the estimator's own functions in a loop over the recorded measurements; return (epochs, trials, 6)."""
    filter_, means, draw = scene.estimator, [], Draw()
    whitener = Whitener(filter_.model.noise_covariance())
    memory, _ = filter_.first(
        scene.measurement[0], scene.platforms[:1], {"prior_position": scene.prior}, Epoch(0.0, 0, draw)
    )
    for k, (z, platforms) in enumerate(zip(scene.measurement, scene.platforms, strict=True)):
        epoch = Epoch(float(k), k, draw)
        if k:
            memory = filter_.predict(memory, 1.0, epoch)
        memory, _ = filter_.update(memory, Observation(z, platforms[None], whitener), epoch)
        means.append(filter_.moments(memory)[0])
    return np.array(means)


def block_run(name: str, particles: int, trials: int, duration: float) -> Run:
    """Return a run of the packaged diagram with one estimator."""
    builder, wired = _wire(name, particles, trials, duration)
    return Run(builder, {"estimate": wired.estimators[name].GetOutputPort("estimate")}, duration)


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
            axes=body_frame(platforms, direction.platform, direction.earth_rate),
            carrier=doppler.carrier,
        )
        prediction = predictor.predict(state, timestamp=stamp) if k else state
        detection = Detection(StateVector(z), timestamp=stamp, measurement_model=own)
        state = updater.update(SingleHypothesis(prediction, detection))
        means.append(np.asarray(state.mean, dtype=float)[:, 0])
    return np.array(means)


def compare(size: Size) -> Section:
    """Return the table: cost of one particle and step."""
    particles = 200 if size.tiny else 10_000
    duration = 4.0 if size.tiny else 60.0
    section = Section(
        f"Particle filters, dual_satellite, {particles} particles, {duration:g} steps: cost of one particle and step",
        ("filter", "microseconds: median (range)", "Stone Soup / this (range)", "aim", ""),
        judged=not size.tiny,
    )
    scene = make_scene("pf", particles, 1, duration)
    steps = int(duration) + 1
    peers = [Peer("Stone Soup, bootstrap", partial(bootstrap, scene, particles), particles * steps)]
    for name in ("pf_sir", "pf"):
        for trials in (1, 2 if size.tiny else 10):
            label, work = f"{name}, {trials} trial{'s' * (trials > 1)}", particles * steps * trials
            own, run = make_scene(name, particles, trials, duration), block_run(name, particles, trials, duration)
            if not np.array_equal(loop(own), run()["estimate"]):
                raise AssertionError(f"{label}: functions and diagram do not agree")
            peers.append(Peer(f"{label}, functions in a loop", partial(loop, own), work))
            peers.append(Peer(f"{label}, Drake diagram", run, work))
    timings = race(peers, size)
    theirs: Timing = timings["Stone Soup, bootstrap"]
    for label, mine in timings.items():
        if mine is theirs:
            section.rows.append((label, microseconds(mine.costs), "1", "", ""))
            continue
        ratio, row = ratios(theirs, mine), (label, microseconds(mine.costs))
        if "10 trials, functions" not in label:
            section.rows.append((*row, spread(ratio), "", ""))
            continue
        threshold = _THRESHOLDS[label.partition(",")[0]]
        section.rows.append((*row, spread(ratio), str(threshold), section.judge(ratio, threshold)))
    section.notes.append(
        "Stone Soup and the functions get the recorded measurements, Stone Soup with a measurement function of all its "
        "particles at once; the diagrams also have satellites, sensors and recorder, and their estimates are those of "
        "the functions bit for bit. A step of pf is one or two stages of "
        "tempering, after about ten at the start; a bootstrap filter has neither, and has collapsed by then."
    )
    return section
