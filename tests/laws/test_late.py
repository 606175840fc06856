"""Late measurements: an estimator that goes back knows what the textbook's does with what has come by then."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.recovery.gate import Gate
from quietfix.systems.late.delay import Delay, Latency
from quietfix.systems.late.rollback import Rollback, goes_back
from quietfix.systems.options.batch import Batch
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.interacting.imm import Imm
from quietfix.systems.options.interacting.transitions import Sojourn
from quietfix.systems.options.motions import WhiteNoiseAcceleration
from quietfix.systems.options.pf import Pf
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw
from quietfix.systems.starts.start import GivenStart, PortStart, Start
from tests.laws.rig import Feed, Scene, make, textbook, with_gaps
from tests.laws.test_linear_gaussian import EPOCHS, TRIALS, Problem

PORTS = ("estimate", "covariance", "nis", "nis_dof", "innovation", "prediction", "dropped")
CONSTANT = [Latency([0, 1, 2, 3], 3.0)]
MIXED = [Latency([0, 2], 4.0, 4.0), Latency([1], 2.0)]  # out of order; row 3 is not late
SIX = [Latency([0, 1, 2, 3, 4, 5], 4.0, 3.5)]


def run(block, measurement, platforms, latencies, clock=None, ticks=None, first_trial=0, inputs=None, more=()):
    """Run an estimator behind a delay; return what its ports and those of the delay carry, and at which ticks."""
    clock = clock or Periodic(1.0)
    end = clock.ticks(1e6 if isinstance(clock, Times) else len(measurement) - 1.0)[-1]
    trials = measurement.shape[1]
    builder = DiagramBuilder()
    feeds = {"measurement": measurement, "platforms": platforms, **(inputs or {})}
    feeds = {port: builder.AddSystem(Feed(values, clock, port)) for port, values in feeds.items()}
    delay = builder.AddSystem(Delay(latencies, measurement.shape[-1], clock, end, trials))
    builder.Connect(feeds["measurement"].GetOutputPort("value"), delay.GetInputPort("measurement"))
    block = builder.AddSystem(Rollback(block, delay.ages, ticks or delay.ages))
    sources = {port: feed.GetOutputPort("value") for port, feed in feeds.items()}
    sources |= {port: delay.GetOutputPort(port) for port in ("measurement", "arrivals", "measured_at")}
    for i in range(block.num_input_ports()):
        builder.Connect(sources[block.get_input_port(i).get_name()], block.get_input_port(i))
    ports = {port: block.GetOutputPort(port) for port in (*PORTS, *more)}
    ports |= {
        f"delay/{port}": delay.GetOutputPort(port) for port in ("measurement", "arrivals", "measured_at", "arrival")
    }
    recorder = record(builder, ports, clock)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), Draw(seed=5, first_trial=first_trial))
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(simulator.get_context())


def expected(problem, arrival, buffer=None):
    """Return estimates and covariances of the textbook's filter at every epoch, with the rows that have come."""
    phi, q = problem.motion.transition(np.zeros(6), 1.0), problem.motion.process_noise(np.zeros(6), 1.0)
    h, r = problem.model.jacobian(np.zeros(6), None), problem.model.noise_covariance()
    means, covariances = np.empty((EPOCHS, TRIALS, 6)), np.empty((EPOCHS, TRIALS, 6, 6))
    late = arrival - np.arange(float(EPOCHS))[:, None, None]
    for k in range(EPOCHS):
        for i in range(TRIALS):
            x, p = problem.mean[i], problem.covariance
            for j in range(k + 1):
                move = (phi, q) if j else (np.eye(6), np.zeros((6, 6)))
                come = (arrival[j, i] <= k) & (late[j, i] < (buffer or np.inf))
                _, (x, p), *_ = textbook(x, p, *move, h, r, np.where(come, problem.measurement[j, i], np.nan))
            means[k, i], covariances[k, i] = x, p
    return means, covariances


@pytest.mark.parametrize("buffer", [None, 3])
@pytest.mark.parametrize("missing", ["none", "some", "whole epochs"])
@pytest.mark.parametrize("latencies", [CONSTANT, MIXED], ids=["constant", "mixed"])
def test_is_the_textbooks(latencies, missing, buffer):
    """Constant and out of order, rows missing, and with a buffer that is too short."""
    problem = Problem(missing)
    block = make("ekf", Ekf(), problem.model, problem.motion, GivenStart(problem.mean, problem.covariance), TRIALS)
    _, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), latencies, ticks=buffer)
    means, covariances = expected(problem, values["delay/arrival"], buffer)
    sigma = np.sqrt(np.einsum("...ii->...i", covariances))
    assert np.abs((values["estimate"] - means) / sigma).max() < 1e-10
    difference = values["covariance"].reshape(covariances.shape) - covariances
    assert np.abs(difference / (sigma[..., :, None] * sigma[..., None, :])).max() < 1e-10
    late = values["delay/arrival"] - np.arange(float(EPOCHS))[:, None, None]
    come = np.isfinite(problem.measurement) & np.isfinite(late)
    assert values["dropped"][-1].sum() == (come & (late >= (buffer or np.inf))).sum()


def test_not_late_is_the_filter_itself():
    """To the bit, ports and all: nothing is done twice, and nothing is late."""
    scene = Scene(12, 20)
    scene.measurement = with_gaps(scene.measurement)
    for name, options in {"ekf": Ekf(), "iekf": Iekf(), "ukf": Ukf()}.items():
        plain = scene.run(name, options)
        _, values = run(scene.estimator(name, options), scene.measurement, scene.platforms, [])
        for port in ("estimate", "covariance", "nis", "nis_dof", "prediction", "innovation"):
            got = values[port].reshape(plain[port].shape)
            scale = np.maximum(np.abs(plain[port]), 1.0)
            # prediction and update are one compiled call there, and two here
            np.testing.assert_allclose(got / scale, plain[port] / scale, rtol=0, atol=1e-9, err_msg=f"{name} {port}")
        assert not values["dropped"].any()


@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf"])
def test_a_trial_alone(name):
    """Bit for bit, whatever comes late in the others; one that is never measured stays with its start alone."""
    scene = Scene(9, 15)
    scene.measurement[:, 5] = np.nan
    options = {"ekf": Ekf(), "iekf": Iekf(), "ukf": Ukf()}[name]
    _, batch = run(scene.estimator(name, options), scene.measurement, scene.platforms, SIX)
    assert np.isfinite(batch["estimate"]).all()
    for trial in (0, 5, 8):
        own = scene.only(slice(trial, trial + 1))
        _, alone = run(own.estimator(name, options), own.measurement, own.platforms, SIX, first_trial=trial)
        for port, values in alone.items():
            np.testing.assert_array_equal(values[:, 0], batch[port][:, trial], err_msg=port)


class FirstMeasurement(Start):
    """Starts at what the first complete measurement says."""

    uses_measurement = True

    def begin(self, measurement, platforms, inputs):
        return np.concatenate([measurement, measurement[:, :2]], axis=-1), np.broadcast_to(
            np.eye(6), (len(measurement), 6, 6)
        )


def test_a_start_from_a_measurement_waits_for_it():
    """And is made at the time of it, whichever row comes last."""
    problem = Problem("none")
    block = make("ekf", Ekf(), problem.model, problem.motion, FirstMeasurement(), TRIALS)
    _, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), MIXED)
    started = np.isfinite(values["estimate"]).all(axis=-1)
    complete = values["delay/arrival"].max(axis=-1)
    first = complete.min(axis=0)  # the one that is complete first need not be that of t = 0
    for trial in range(TRIALS):
        assert not started[: int(first[trial]), trial].any() and started[int(first[trial]) :, trial].all()


def test_a_start_from_a_port_is_made_once():
    """What is on the port later does not count, although the first instants are done again."""
    problem = Problem("none")
    port = np.random.default_rng(1).normal(size=(EPOCHS, TRIALS, 6)) * 1e6
    port[0] = problem.mean
    start = PortStart(problem.covariance)
    block = make("ekf", Ekf(), problem.model, problem.motion, start, TRIALS)
    zeros = np.zeros((EPOCHS, 1, 18))
    _, values = run(block, problem.measurement, zeros, MIXED, inputs={"initial_estimate": port})
    given = GivenStart(problem.mean, problem.covariance)
    _, same = run(make("ekf", Ekf(), problem.model, problem.motion, given, TRIALS), problem.measurement, zeros, MIXED)
    np.testing.assert_array_equal(values["estimate"], same["estimate"])


def test_irregular_ticks():
    """What comes between two ticks is there at the second."""
    problem = Problem("none")
    times = np.cumsum(np.where(np.arange(EPOCHS) % 4, 0.5, 2.0)) - 2.0
    given = GivenStart(problem.mean, problem.covariance)
    clock = Times(times)
    block = make("ekf", Ekf(), problem.model, problem.motion, given, TRIALS, clock)
    at, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), [Latency([0, 1, 2, 3], 1.2)], clock)
    np.testing.assert_allclose(at, times)
    due = np.append(times, np.inf)[np.searchsorted(times, times + 1.2)]
    np.testing.assert_allclose(values["delay/arrival"], np.broadcast_to(due[:, None, None], (EPOCHS, TRIALS, 4)))
    assert not values["dropped"].any()


def test_nothing_before_the_first_arrives():
    """NaN, not 0; then each measurement once, with the time that it was made."""
    problem = Problem("none")
    block = make("ekf", Ekf(), problem.model, problem.motion, GivenStart(problem.mean, problem.covariance), TRIALS)
    _, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), CONSTANT)
    assert np.isnan(values["delay/measurement"][:3]).all()
    np.testing.assert_array_equal(values["delay/measurement"][3:], problem.measurement[:-3])
    arrivals = values["delay/arrivals"].reshape(EPOCHS, TRIALS, 4, 4)
    assert np.isnan(arrivals[:, :, :3]).all()
    np.testing.assert_array_equal(arrivals[3:, :, 3], problem.measurement[:-3])
    np.testing.assert_array_equal(values["delay/measured_at"][3:, 0, 3], np.arange(EPOCHS - 3.0))


def test_jitter_is_uniform_and_comes_out_of_order():
    """Every measurement comes once, at the first tick not before mean +- jitter."""
    rng = np.random.default_rng(3)
    measurement = rng.normal(size=(60, 200, 1))
    problem = Problem("none")
    problem.model.names = problem.model.names[:1]
    clock, end = Periodic(0.1), 5.9
    builder = DiagramBuilder()
    feed = builder.AddSystem(Feed(measurement, clock, "measurement"))
    delay = builder.AddSystem(Delay([Latency([0], 1.0, 0.8)], 1, clock, end, 200))
    builder.Connect(feed.GetOutputPort("value"), delay.GetInputPort("measurement"))
    recorder = record(builder, {port: delay.GetOutputPort(port) for port in ("arrivals", "arrival")}, clock)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    set_draw(diagram, simulator.get_mutable_context(), Draw(seed=5))
    simulator.Initialize()
    simulator.AdvanceTo(end)
    times, values = recorder.result(simulator.get_context())
    late = values["arrival"][:40, :, 0] - times[:40, None]
    assert late.min() >= 0.2 - 1e-9 and late.max() <= 1.8 + 0.1
    assert abs(late.mean() - 1.05) < 0.02  # half a tick later than the mean; 8000 of them, 0.46 / sqrt(8000) = 0.005
    assert (np.diff(values["arrival"][:40, :, 0], axis=0) < 0).mean() > 0.2
    came = np.isfinite(values["arrivals"]).sum(axis=(0, 2))
    np.testing.assert_array_equal(came, np.isfinite(values["arrival"][..., 0]).sum(axis=0))


def test_what_cannot_go_back_is_refused():
    """An estimator with inputs of its own, and latencies that are none."""

    class Ahead(KalmanEstimator):
        def _declare_ports(self):
            self.declare_input("preview", self.wiring.trials, 1)
            super()._declare_ports()

    problem = Problem("none")
    wiring = Wiring(TRIALS, problem.model.names, Periodic(1.0), 3)
    given = GivenStart(problem.mean, problem.covariance)
    block = Ahead("ekf", Ekf(), problem.model, problem.motion, given, wiring)
    assert not goes_back(block)
    with pytest.raises(ValueError, match="late measurements are not allowed"):
        Rollback(block, 2, 2)
    for mean, jitter in ((-1.0, 0.0), (1.0, 2.0), (np.nan, 0.0)):
        with pytest.raises(ValueError, match="0 to the mean"):
            Delay([Latency([0], mean, jitter)], 1, Periodic(1.0), 5.0, 2)


IMM = Imm(
    models={"calm": WhiteNoiseAcceleration(0.01), "agile": WhiteNoiseAcceleration(9.0)},
    transitions=Sojourn({"calm": 20.0, "agile": 5.0}),
)


class InOrder:
    """What an estimator says that gets everything in time, of what the delayed one has got by the end."""

    def __init__(self, scene, name, options, latencies, start=None, noise=None):
        block = scene.estimator(name, options, start=start, noise_port=noise is not None)
        inputs = None if noise is None else {"noise_covariance": noise}
        ports = [*block.told, "lost", *(["restarts"] if "restarts" in block.tallies() else [])]
        _, self.late = run(block, scene.measurement, scene.platforms, latencies, inputs=inputs, more=ports)
        come = np.isfinite(self.late["delay/arrival"])
        plain = scene.only(slice(None))
        plain.measurement = np.where(come, scene.measurement, np.nan)
        again = plain.estimator(name, options, start=start, noise_port=noise is not None)
        zero = [Latency(range(scene.measurement.shape[-1]), 0.0)]
        _, self.plain = run(again, plain.measurement, plain.platforms, zero, inputs=inputs, more=ports)

    def assert_same_at_the_end(self, *ports):
        """Bit for bit: the same steps in the same order."""
        for port in ("estimate", "covariance", *ports):
            np.testing.assert_array_equal(self.late[port][-1], self.plain[port][-1], err_msg=port)


def outlying(scene, rate=0.05):
    """Put gross errors of 20 sigma into rows, of the first epoch too."""
    rng = np.random.default_rng(4)
    gross = rng.uniform(size=scene.measurement.shape) < rate
    return scene.measurement + 20 * gross * np.sqrt(np.diag(scene.model.noise_covariance()))


class TwoDelays(FirstMeasurement):
    """Starts about the truth of the scene, off by what the first row of the measurement is off: from a measurement."""

    def __init__(self, scene):
        self._scene = scene

    def begin(self, measurement, platforms, inputs):
        there = np.isfinite(measurement).all(axis=-1)
        scale = np.sqrt(np.diag(self._scene.covariance))
        off = np.where(there, np.sin(1e10 * measurement[:, 0]), np.nan)
        mean = self._scene.truth[0] + np.outer(off, scale)
        return mean, np.broadcast_to(self._scene.covariance, (len(mean), 6, 6))


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("ekf", Ekf(gate=Gate(0.999, "row", 3))),
        ("iekf", Iekf(gate=Gate(0.999, "epoch", 2), restart=True)),
        ("pf", Pf(particles=200)),
        ("pf", Pf(particles=200, restart=True)),
        ("batch", Batch(epochs=4)),
        ("imm", IMM),
    ],
    ids=["gate", "gate and restart", "pf", "pf restart", "batch", "imm"],
)
def test_all_that_is_remembered_goes_back(name, options):
    """Gates with their counts, new beginnings, clouds, windows, several models: at the end as if all were in time."""
    scene = Scene(6, 25)
    scene.measurement = outlying(scene)
    gated = getattr(options, "gate", None) is not None
    found = InOrder(scene, name, options, SIX, start=TwoDelays(scene) if gated else None)
    told = [port for port in found.late if port in ("rejected", "releases", "restarts", "probabilities", "lost")]
    found.assert_same_at_the_end(*told)
    if gated:
        assert found.late["rejected"][-1].sum() > 10 and found.late["restarts"][-1].sum() > 0


def test_noise_that_comes_with_a_measurement():
    """R is that of the instant at which it was made; other in every epoch and trial."""
    scene = Scene(5, 15)
    rng = np.random.default_rng(6)
    scale = rng.uniform(0.5, 2.0, size=(15, 5, 6))
    noise = scale[..., :, None] * scene.model.noise_covariance() * scale[..., None, :]
    InOrder(scene, "ekf", Ekf(), SIX, noise=noise.reshape(15, 5, -1)).assert_same_at_the_end()
