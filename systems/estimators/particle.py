"""Particle filters as estimator blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Given, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.observation import Observation, take
from quietfix.systems.filters.particle.draws import Draws
from quietfix.systems.filters.particle.health import COLUMNS, LEAST_EVIDENCE, evidence, follow, normalised_innovation
from quietfix.systems.filters.particle.likelihood import Likelihood, Reading
from quietfix.systems.filters.particle.motion import propagate
from quietfix.systems.filters.particle.update import Cloud, ParticleUpdate
from quietfix.systems.filters.particle.weights import effective_size, moments, normalise, unique_sorted
from quietfix.systems.kernels.equations import are_own, program
from quietfix.systems.kernels.sharing import pieces, side_by_side
from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import CloudStart, Start

__all__ = ["ParticleEstimator"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_AT_ONCE = 100_000  # particles: what fits into a processor's cache; more at once are slower
_EACH = 0.03  # us that a particle takes in a step, at least
_PORTS = COLUMNS[:-1]


@lru_cache(maxsize=16)
def _noise_root(covariance: bytes, shape: tuple[int, ...]) -> Array:
    """Return L (..., n, r) with L L' the covariance; mostly it is the same every epoch.

    Where it is the same in all trials, without columns of zeros, for which numbers would be drawn in vain.
    """
    root = semidefinite_root(np.frombuffer(covariance).reshape(shape))
    return root[:, np.any(root != 0, axis=0)] if root.ndim == 2 else root


class ParticleEstimator(Estimator):
    r"""A cloud of particles per trial behind the common ports.

    ``estimate`` and ``covariance`` are the moments of the weighted cloud, before it is resampled; ``prediction`` and
    ``prediction_covariance`` those of the predicted one. ``innovation`` is the mean of the predicted cloud's residuals,
    ``nis`` is normalised by their covariance and that of the noise.

    Further outputs, each (trials, 1): ``effective_particles``; ``ancestors``, how many particles of the start of the
    present window all of today's come from; ``evidence`` and its recent average, ``recent_evidence``, see
    `quietfix.systems.filters.particle.health.evidence`; ``diverged``, 1 where the recent evidence is too small or the
    ancestors are no more than the state has components; ``stages`` of tempering in this epoch; ``restarts`` so far.

    .. math:: w_i \propto w_i\,p(z \mid x_i), \qquad \hat x = \sum_i w_i x_i, \qquad N_{\mathrm{eff}} = 1/\sum_i w_i^2

    Parameters
    ----------
    name : str
        Name of the block; part of the key of its random numbers.
    particle_update : ParticleUpdate
        What is done with a measurement.
    model, motion, start, wiring
        See `Estimator`. A `CloudStart` gives particles, any other start one Gaussian.
    particles : int
        Particles per trial.
    window : int
        Updates after which ancestors are counted anew; 0: since the start.
    restart : bool
        Begin again from the measurement where the evidence says that the cloud has diverged, if the start knows how
        (`Start.again`).

    Raises
    ------
    ValueError
        If there are fewer particles than 2, or the window is negative.

    Notes
    -----
    Everything random is a function of (seed, name, trial, tick, purpose). Process noise whose covariance depends on
    the state is taken at the mean of the cloud.
    """

    def __init__(
        self,
        name: str,
        particle_update: ParticleUpdate,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        particles: int = 10_000,
        window: int = 0,
        restart: bool = False,
    ) -> None:
        if particles < 2:
            raise ValueError(f"{name}: particles: {particles} is not allowed; a whole number >= 2")
        if window < 0:
            raise ValueError(f"{name}: window: {window} is not allowed; a whole number >= 0")
        self.particle_update, self.particles, self.window, self.restart = particle_update, particles, window, restart
        super().__init__(name, model, motion, start, wiring)
        for i, port in enumerate(_PORTS):
            self.tell(port, 1, partial(self._health, i), [(port, "1")])

    @staticmethod
    def _health(column: int, memory: Memory) -> Array:
        return memory["health"][:, column]

    def diagnostics(self) -> Sequence[str]:
        """See `Estimator.diagnostics`: how the cloud is."""
        return _PORTS

    def cloud(self, context: Context) -> Cloud:
        """Return the clouds after the measurement of now: particles (trials, n, N), log weights and ancestors."""
        return self._cloud(self.posterior_memory(context))

    # ---- memory

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        n, count = self.motion.size, self.particles
        sizes = {
            "particles": n * count,
            "log_weight": count,
            "ancestor": count,
            "mean": n,
            "covariance": n * n,
            "health": len(COLUMNS),
        }
        return {**sizes, "motion_input": self.motion.input_size} if self.motion.input_size else sizes

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`; those of a predicted cloud are worked out when somebody asks for them."""
        n = self.motion.size
        if "mean" not in memory:
            return self._predicted_moments(memory)
        return memory["mean"], memory["covariance"].reshape(-1, n, n)

    def _cloud(self, memory: Memory) -> Cloud:
        particles = memory["particles"].reshape(-1, self.motion.size, self.particles)
        return Cloud(particles, memory["log_weight"], memory["ancestor"])

    def _memory(self, cloud: Cloud, mean: Array, covariance: Array, health: Array) -> Memory:
        trials = mean.shape[0]
        memory = {
            "particles": cloud.particles.reshape(trials, -1),
            "log_weight": cloud.log_weight,
            "ancestor": cloud.ancestor,
            "mean": mean,
            "covariance": covariance.reshape(trials, -1),
            "health": health,
        }
        return {**memory, "motion_input": self.motion.initial_input(mean)} if self.motion.input_size else memory

    def _draws(self, epoch: Epoch) -> Draws:
        """Return the random numbers of an instant; between ticks they are keyed by the time."""
        tick, draw, name = epoch.tick, epoch.draw, self.noise_name()
        if tick is None:
            name, tick = f"{name}@{epoch.time!r}", 0
        return Draws(draw.seed, name, tick, draw.first_trial + np.arange(self.wiring.trials))

    def _groups_of_trials(self, within: slice | None = None) -> Iterator[slice]:
        begin, end = (0, self.wiring.trials) if within is None else (within.start, within.stop)
        step = max(1, _AT_ONCE // self.particles)
        for start in range(begin, end, step):
            yield slice(start, min(start + step, end))

    def _in_groups(self, work: Callable[[slice], None]) -> None:
        """Do the work of all trials by groups; by several threads where all of the work is compiled."""

        def some(piece: slice) -> None:
            for group in self._groups_of_trials(piece):
                work(group)

        trials = self.wiring.trials
        compiled = program(self.model) is not None and (self.motion.linear or are_own(type(self.motion)))
        cut = pieces(trials, _EACH * self.particles) if compiled else [slice(0, trials)]
        if len(cut) == 1:
            some(cut[0])
        else:
            side_by_side([(some, (piece,)) for piece in cut])

    # ---- Estimator

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, Mask]:
        """See `Estimator.first`."""
        if not isinstance(self.start, CloudStart):
            return super().first(measurement, platforms, inputs, epoch)
        return self._first_cloud(self.start, measurement, platforms, inputs, epoch)

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`: draw every cloud from one Gaussian."""
        trials, n = mean.shape
        covariance = np.reshape(covariance, (trials, n, n))
        particles = np.full((trials, n, self.particles), np.nan)
        able = np.flatnonzero(np.isfinite(mean.sum(axis=-1) + covariance.sum(axis=(-1, -2))))
        draws = self._draws(epoch)
        for part in np.array_split(able, max(1, able.size * self.particles // _AT_ONCE)):
            white = draws.normal("start", part, (n, self.particles))
            particles[part] = mean[part, :, None] + semidefinite_root(covariance[part]) @ white
        return self._begun(particles, np.zeros((trials, self.particles)), np.array(mean), covariance.copy())

    def _begun(self, particles: Array, log_weight: Array, mean: Array, covariance: Array) -> Memory:
        trials = mean.shape[0]
        ancestor = np.tile(np.arange(self.particles, dtype=float), (trials, 1))
        health = np.zeros((trials, len(COLUMNS)))
        health[:, :2] = self.particles
        return self._memory(Cloud(particles, log_weight, ancestor), mean, covariance, health)

    def _first_cloud(
        self, start: CloudStart, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, Mask]:
        """Draw every cloud from what the start knows; resample those of which too few particles count."""
        trials, n, count = self.wiring.trials, self.motion.size, self.particles
        draws = self._draws(epoch)
        particles, log_weight = np.full((trials, n, count), np.nan), np.zeros((trials, count))
        mean, covariance = np.full((trials, n), np.nan), np.full((trials, n, n), np.nan)
        effective, able = np.full(trials, float(count)), np.zeros(trials, dtype=bool)
        for group in self._groups_of_trials():
            index = np.arange(group.start, group.stop)
            white = draws.normal("start", index, (count, n))
            some = {port: value[group] for port, value in inputs.items()}
            drawn, drawn_log = start.cloud(measurement[group], take(platforms, index), some, white)
            good = np.isfinite(drawn_log.max(axis=-1)) & np.isfinite(drawn.sum(axis=(-1, -2)))
            index = index[good]
            if index.size == 0:
                continue
            kept = np.ascontiguousarray(np.moveaxis(drawn[good], -1, 1))
            cloud = Cloud(kept, drawn_log[good], np.zeros(drawn_log[good].shape))
            weight, _ = normalise(cloud.log_weight)
            mean[index], covariance[index] = moments(cloud.particles, weight)
            effective[index], able[index] = effective_size(weight), True
            particles[index], log_weight[index] = cloud.particles, cloud.log_weight
            few = np.flatnonzero(effective[index] < self.particle_update.threshold * count)
            if few.size:
                rows = index[few]
                self.particle_update.resample(
                    cloud, few, weight[few], mean[rows], covariance[rows], effective[rows], draws.of(index), -1, cloud
                )
                particles[rows], log_weight[rows] = cloud.particles[few], 0.0
        memory = self._begun(particles, log_weight, mean, covariance)
        memory["health"][:, 0] = effective
        return memory, able

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        cloud, draws, motion, carried = self._cloud(memory), self._draws(epoch), self.motion, {}
        if motion.input_size:
            carried = {"motion_input": motion.next_input(memory["mean"], memory["motion_input"], dt)}
        particles = np.empty_like(cloud.particles)

        def work(group: slice) -> None:
            index, here, own = np.arange(group.start, group.stop), memory["mean"][group], motion
            if motion.input_size:
                own = motion.driven(carried["motion_input"][group])
            # what the noise of a trial is that has not started or is lost does not matter
            here = np.where(np.isfinite(here), here, 1.0)
            noise = own.process_noise(here, dt)
            if not np.isfinite(noise.sum()):
                noise = np.where(np.isfinite(noise).all(axis=(-1, -2), keepdims=True), noise, 0.0)
            white: Array | NDArray[np.uint64]
            if noise.any():
                root = _noise_root(noise.tobytes(), noise.shape)
                white = draws.generators("motion", index)
            else:
                root, white = np.empty((motion.size, 0)), np.empty((len(index), 0, self.particles))
            propagate(own, here, cloud.particles[group], dt, root, white, particles[group])

        self._in_groups(work)
        kept = {group: memory[group] for group in ("log_weight", "ancestor", "health")}
        return {"particles": particles.reshape(len(particles), -1), **kept, **carried}

    def _predicted_moments(self, memory: Memory) -> tuple[Array, Array]:
        cloud, n = self._cloud(memory), self.motion.size
        mean, covariance = np.empty((self.wiring.trials, n)), np.empty((self.wiring.trials, n, n))
        for group in self._groups_of_trials():
            mean[group], covariance[group] = self._moments_of(Cloud(*(array[group] for array in cloud)))
        return mean, covariance

    @staticmethod
    def _moments_of(cloud: Cloud) -> tuple[Array, Array]:
        return moments(cloud.particles, normalise(cloud.log_weight)[0])

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        trials, m, n = observation.value.shape[0], self.model.size, self.motion.size
        carried = {"motion_input": memory["motion_input"]} if self.motion.input_size else {}
        posterior = {name: np.empty_like(value) for name, value in memory.items() if name not in carried}
        posterior |= {"mean": np.empty((trials, n)), "covariance": np.empty((trials, n * n))}
        innovation = Innovation(np.full((trials, m), np.nan), np.full(trials, np.nan), np.zeros(trials))
        draws = self._draws(epoch)

        def work(group: slice) -> None:
            part = {name: value[group] for name, value in memory.items()}
            index = np.arange(group.start, group.stop)
            reading, given = Reading(self.model, observation.rows(index)), draws.of(index)
            new = {name: value[group] for name, value in posterior.items()}
            value, nis, rows = self._correct_group(part, reading, given, new)
            innovation.value[group], innovation.nis[group], innovation.nis_dof[group] = value, nis, rows

        self._in_groups(work)
        return {**posterior, **carried}, innovation

    def _correct_group(self, memory: Memory, reading: Reading, draws: Draws, posterior: Memory) -> Innovation:
        """Put what is known after the reading into `posterior`; return the innovation.

        A trial that is lost, or of which nothing is measured, stays as it is.
        """
        prior, n = self._cloud(memory), self.motion.size
        everyone = np.arange(len(prior.particles))
        residual = reading.residual(prior.particles, everyone)
        missing = ~np.isfinite(reading.observation.value) | (residual.there == 0)
        rows = np.count_nonzero(~missing, axis=-1)
        value, nis = np.full(missing.shape, np.nan), np.full(len(rows), np.nan)
        if not rows.all():
            mean, covariance = self._moments_of(prior)
            after = {**memory, "mean": mean, "covariance": covariance.reshape(len(mean), -1)}
            for name, array in posterior.items():
                array[...] = after[name]
            some = np.flatnonzero(rows)
            if some.size:
                part = {name: array[some] for name, array in posterior.items()}
                new = {name: np.empty_like(array) for name, array in part.items()}
                told = self._correct_group(part, reading.rows(some), draws.of(some), new)
                for name, array in new.items():
                    posterior[name][some] = array
                value[some], nis[some] = told.value, told.nis
            return Innovation(value, nis, rows)
        prior, health = self._window(prior, memory["health"])
        result = self.particle_update(prior, Likelihood(reading, missing), residual.rows, draws, self._cloud(posterior))
        now = evidence(result.log_evidence, result.spread, rows)
        recent = follow(health[:, 3], now)
        ancestors = unique_sorted(result.cloud.ancestor)
        diverged = (recent < LEAST_EVIDENCE) | (ancestors <= n)
        columns = [result.effective, ancestors, now, recent, diverged, result.stages, health[:, 6], health[:, 7] + 1]
        posterior["mean"][...] = result.mean
        posterior["covariance"][...] = result.covariance.reshape(len(rows), -1)
        posterior["health"][...] = np.stack(columns, axis=-1)
        nis = normalised_innovation(result.innovation, result.spread)
        return Innovation(np.where(missing, np.nan, result.residual), nis, rows)

    def _window(self, cloud: Cloud, health: Array) -> tuple[Cloud, Array]:
        """Count ancestors anew in trials whose window is over."""
        over = (health[:, -1] >= self.window) if self.window else np.zeros(len(health), dtype=bool)
        if not over.any():
            return cloud, health
        ancestor = np.where(over[:, None], np.arange(self.particles, dtype=float), cloud.ancestor)
        health = health.copy()
        health[over, -1] = 0.0
        return cloud._replace(ancestor=ancestor), health

    # ---- beginning again

    def settled(self, memory: Memory) -> Memory:
        """See `Estimator.settled`: where nothing was measured, the moments of the prediction."""
        if "mean" in memory:
            return memory
        mean, covariance = self.moments(memory)
        return {**memory, "mean": mean, "covariance": covariance.reshape(len(mean), -1)}

    def recovered(self, memory: Memory, innovation: Innovation, given: Callable[[], Given]) -> Memory:
        """See `Estimator.recovered`: trials whose evidence says so begin again from the measurement, where they can."""
        again = self.start.again
        if not self.restart or again is None:
            return memory
        lost = (memory["health"][:, 3] < LEAST_EVIDENCE) & (innovation.nis_dof > 0)
        if not lost.any():
            return memory
        stream, platforms, inputs, epoch = given()
        if isinstance(again, CloudStart):
            begun, able = self._first_cloud(again, stream, platforms, inputs, epoch)
        else:
            mean, covariance = again.begin(stream, platforms, inputs)
            begun, able = self.begin(mean, covariance, epoch), np.all(np.isfinite(mean), axis=-1)
        begun["health"][:, 6] = memory["health"][:, 6] + 1
        new = (lost & able)[:, None]
        return {group: np.where(new, begun[group], memory[group]) for group in memory}
