"""A small diagram around an estimator: measurements and platforms as the test gives them, everything recorded."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, EnsembleBlock, set_draw
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import PASS, PLACES, place, satellites, six

__all__ = ["PORTS", "Feed", "Linear", "Scene", "assert_same", "make", "run", "textbook", "with_gaps"]

PORTS = ("estimate", "covariance", "prediction", "prediction_covariance", "innovation", "nis", "nis_dof")


def with_gaps(measurement, rate=0.15):
    """Return measurements (ticks, trials, m) of which rows are missing, and of each trial all at one tick, 2 to 4."""
    gone = np.random.default_rng(9).random(measurement.shape) < rate
    trials = np.arange(measurement.shape[1])
    gone[2 + trials % 3, trials] = True
    return np.where(gone, np.nan, measurement)


def assert_same(part, whole):
    """Assert that two runs agree bit for bit in all that an estimator's ports carry."""
    for port in PORTS:
        np.testing.assert_array_equal(part[port], whole[port], err_msg=port)


class Feed(EnsembleBlock):
    """A port that carries given values at the ticks of a clock, and NaN between them.

    `values` has shape (ticks, trials, size).
    """

    def __init__(self, values, clock, name):
        super().__init__(name)
        values = np.asarray(values, dtype=float)
        _, trials, size = values.shape

        def calc(context):
            tick = clock.index(context.get_time())
            return np.full((trials, size), np.nan) if tick is None else values[tick]

        self.declare_output("value", trials, size, calc, {self.time_ticket()})


class Linear(MeasurementModel):
    """z = H x with any covariance: what a Kalman filter is exact for."""

    def __init__(self, matrix, covariance):
        self._matrix, self._covariance = np.asarray(matrix, dtype=float), np.asarray(covariance, dtype=float)
        self.names = tuple(f"row_{i}" for i in range(len(self._matrix)))
        self.units = ("m",) * self.size

    def predict(self, target, platforms):
        return np.einsum("ij,...j->...i", self._matrix, target)

    def jacobian(self, target, platforms):
        return np.broadcast_to(self._matrix, (*target.shape[:-1], *self._matrix.shape))

    def noise_covariance(self):
        return self._covariance

    def rows(self, kept):
        """Return the model of some rows alone, under the same names."""
        part = Linear(self._matrix[kept], self._covariance[np.ix_(kept, kept)])
        part.names = tuple(self.names[i] for i in kept)
        return part


def textbook(x, p, phi, q, h, r, z):
    """One step of the Kalman filter as every textbook has it, for one trial; rows of z that are NaN are left out."""
    x, p = phi @ x, phi @ p @ phi.T + q
    prediction = x, p
    there = np.flatnonzero(np.isfinite(z))
    innovation = np.full(len(z), np.nan)
    if there.size == 0:
        return prediction, (x, p), innovation, np.nan, 0
    h, r = h[there], r[np.ix_(there, there)]
    nu = z[there] - h @ x
    s = h @ p @ h.T + r
    k = p @ h.T @ np.linalg.inv(s)
    innovation[there] = nu
    return prediction, (x + k @ nu, p - k @ s @ k.T), innovation, nu @ np.linalg.inv(s) @ nu, len(there)


class Scene:
    """A pass of the three satellites over one target: states, noise-free measurements, draws, a start.

    Parameters
    ----------
    trials, epochs : int
        Size; one epoch a second.
    where : str
        One of the reference's places.
    model : MeasurementModel, optional
        By default all six rows.
    """

    def __init__(self, trials, epochs, where="(0,300)", model=None, seed=3, spread=(3e3, 50.0)):
        rng = np.random.default_rng(seed)
        self.trials, self.epochs = trials, epochs
        self.model = model or six()
        self.motion = ConstantVelocity(0.1)
        self.clock = Periodic(1.0)
        times = np.arange(epochs) + (PASS - epochs) / 2
        start = place(*PLACES[where])
        start[:3] += (times[0] - PASS / 2) * start[3:]
        self.truth = start + np.concatenate([start[3:], np.zeros(3)]) * np.arange(epochs)[:, None]
        self.platforms = satellites(times).reshape(epochs, 1, 18)
        exact = self.model.predict(self.truth[:, None], self.platforms.reshape(epochs, 1, 3, 6))
        root = np.linalg.cholesky(self.model.noise_covariance())
        noise = np.einsum("ij,ktj->kti", root, rng.normal(size=(epochs, trials, self.model.size)))
        self.measurement = self.model.represent(exact + noise)
        self.covariance = np.diag([spread[0] ** 2] * 3 + [spread[1] ** 2] * 3)
        draws = rng.normal(size=(trials, 6)) * np.sqrt(np.diag(self.covariance))
        self.mean = self.truth[0] + draws

    def only(self, trials):
        """Return the same scene with some trials alone."""
        part = object.__new__(Scene)
        part.__dict__.update(self.__dict__)
        part.measurement, part.mean = self.measurement[:, trials], self.mean[trials]
        part.trials = len(part.mean)
        if self.platforms.shape[1] > 1:
            part.platforms = self.platforms[:, trials]
        return part

    def estimator(self, name, options, start=None, model=None, noise_port=False):
        """Return the estimator block of a registered name for this scene."""
        return make(
            name,
            options,
            model or self.model,
            self.motion,
            start or GivenStart(self.mean, self.covariance),
            self.trials,
            self.clock,
            self.model.names,
            platform_trials=self.platforms.shape[1],
            noise_port=noise_port,
        )

    def run_with_noise(self, name, options, noise_covariance):
        """Return what the ports carry where R comes with the measurement, shape (epochs, trials, m, m)."""
        block = self.estimator(name, options, noise_port=True)
        inputs = {"noise_covariance": noise_covariance.reshape(self.epochs, self.trials, -1)}
        return run(block, self.measurement, self.platforms, self.clock, inputs=inputs)[1]

    def run(self, name, options, **changes):
        """Return what the ports of the estimator carry, by name, shape (epochs, trials, ...)."""
        block = self.estimator(name, options, **changes)
        return run(block, self.measurement, self.platforms, self.clock)[1]


def make(
    name,
    options,
    model=None,
    motion=None,
    start=None,
    trials=1,
    clock=None,
    stream=None,
    platform_trials=1,
    noise_port=False,
):
    """Return an estimator block; by default of the six rows of three satellites."""
    model = model or six()
    start = start or GivenStart(np.zeros(6), np.eye(6))
    wiring = Wiring(trials, stream or model.names, clock or Periodic(1.0), 3, platform_trials, noise_port)
    return options.make(name.split()[0], model, motion or ConstantVelocity(0.1), start, wiring)


def run(block, measurement, platforms, clock, end=None, log=None, inputs=None, first_trial=0, ports=PORTS):
    """Run one estimator block on given measurements; return times and what its ports carried.

    Parameters
    ----------
    measurement, platforms : ndarray, shape (ticks, trials, size)
        What the input ports carry at the ticks of `clock`.
    end : float, optional
        Last time [s]; by default that of the last measurement at one a second.
    log : Clock, optional
        When to record; by default at the ticks.
    inputs : mapping of str to ndarray, optional
        What further input ports carry.
    first_trial : int
        Number of the first trial, for what draws random numbers.
    ports : sequence of str
        Which are recorded.
    """
    builder = DiagramBuilder()
    builder.AddSystem(block)
    for port, values in {"measurement": measurement, "platforms": platforms, **(inputs or {})}.items():
        feed = builder.AddSystem(Feed(values, clock, port))
        builder.Connect(feed.GetOutputPort("value"), block.GetInputPort(port))
    recorder = record(builder, {port: block.GetOutputPort(port) for port in ports}, log or clock)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), Draw(seed=11, first_trial=first_trial))
    simulator.Initialize()
    simulator.AdvanceTo(len(measurement) - 1.0 if end is None else end)
    times, values = recorder.result(simulator.get_context())
    n = values["estimate"].shape[-1]
    for port in {"covariance", "prediction_covariance"} & set(ports):
        values[port] = values[port].reshape(*values[port].shape[:2], n, n)
    values["nis"], values["nis_dof"] = values["nis"][..., 0], values["nis_dof"][..., 0]
    return times, values
