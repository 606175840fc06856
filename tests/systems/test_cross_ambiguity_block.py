"""The cross-ambiguity block in a diagram: clock, ports, windows, and the loop through an estimator."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.ambiguity.differences import Flag, Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.ambiguity.prefilter import RootRaisedCosine
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.recorder import record
from quietfix.systems.signal_chain.cross_ambiguity import QUALITY, Aim, CrossAmbiguitySensor
from quietfix.systems.signals import Constant, EnsembleBlock
from quietfix.systems.starts.start import GivenStart
from tests.systems.iq_scene import CARRIER, ROLL_OFF, SYMBOLS, pair

CAF = CrossAmbiguity(prefilter=RootRaisedCosine(SYMBOLS, ROLL_OFF))
DELAY, FREQUENCY = 30e-6, 400.0
AT = Window(DELAY + 2e-6, FREQUENCY + 50.0, 10e-6, 1000.0)


class Antenna(EnsembleBlock):
    """Hears the same at all times; counts how often it is asked."""

    def __init__(self, name, value):
        super().__init__(name)
        self.calls = 0
        self.value = value
        self.declare_abstract_output("iq", self._hear, {self.time_ticket()})

    def _hear(self, context):
        self.calls += 1
        return self.value


@pytest.fixture(scope="module")
def blocks():
    """Main and auxiliary, two trials, the second of which is deaf at the main receiver."""
    main, auxiliary = pair(DELAY, FREQUENCY, size=8192, guard=500)
    two = np.concatenate([main.samples, np.full_like(main.samples, np.nan)])
    return IqBlock(two, main.sample_rate, CARRIER), auxiliary


def wired(blocks, builder, **options):
    """Antennas and the block."""
    settings = {"window": AT, "clock": Periodic(1.0), "trials": 2, **options}
    antennas = [builder.AddSystem(Antenna(name, b)) for name, b in zip(("main", "auxiliary"), blocks, strict=True)]
    block = builder.AddSystem(CrossAmbiguitySensor(CAF, **settings))
    for antenna in antennas:
        builder.Connect(antenna.GetOutputPort("iq"), block.GetInputPort(antenna.get_name()))
    return antennas, block


def ports(block):
    return {name: block.GetOutputPort(name) for name in ("measurement", "noise_covariance", "quality")}


def run(builder, signals, end=1.0, clock=None):
    """Record signals and return them."""
    recorder = record(builder, signals, clock or Periodic(0.5))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(simulator.get_context())


def test_measures_at_its_ticks_only(blocks):
    builder = DiagramBuilder()
    antennas, block = wired(blocks, builder)
    times, logs = run(builder, ports(block), end=2.0)
    assert_array_equal(times, [0.0, 0.5, 1.0, 1.5, 2.0])
    assert [antenna.calls for antenna in antennas] == [3, 3]  # not read between the ticks, and once for all ports
    measured, noise, quality = logs["measurement"], logs["noise_covariance"].reshape(5, 2, 2, 2), logs["quality"]
    assert np.isnan(measured[1::2]).all() and np.isnan(noise[1::2]).all() and np.isnan(quality[1::2]).all()
    assert_allclose(measured[::2, 0], np.tile([DELAY, FREQUENCY], (3, 1)), rtol=1e-4)
    assert (np.diagonal(noise[::2, 0], axis1=-2, axis2=-1) > 0).all() and (noise[::2, 0, 0, 1] == 0).all()
    # a trial whose main receiver is deaf has nothing, and the flag says why
    assert np.isnan(measured[:, 1]).all() and np.isnan(noise[:, 1]).all()
    assert (quality[::2, :, QUALITY.index("flag")] == [Flag.GOOD, Flag.NO_SIGNAL]).all()
    assert (quality[::2, 0, QUALITY.index("coherence")] > 0.999).all()


def test_flagged_ones_are_left_out_or_kept(blocks):
    beside = Window(DELAY, FREQUENCY + 3000.0, 10e-6, 1000.0)
    found = {}
    for keep in (False, True):
        builder = DiagramBuilder()
        _, block = wired(blocks, builder, window=beside, keep_flagged=keep)
        found[keep] = run(builder, ports(block), end=0.1)[1]
    assert np.isnan(found[False]["measurement"]).all()
    assert np.isfinite(found[True]["measurement"][0, 0]).all()
    assert_array_equal(found[True]["quality"], found[False]["quality"])


def test_a_window_on_a_port(blocks):
    builder = DiagramBuilder()
    _, block = wired([blocks[1], blocks[1]], builder, window=None)
    given = builder.AddSystem(Constant("aim", [[0.0, 0.0, 10e-6, 1000.0], [np.nan, 0.0, 10e-6, 1000.0]]))
    builder.Connect(given.GetOutputPort("state"), block.GetInputPort("window"))
    measured = run(builder, ports(block), end=0.1)[1]["measurement"]
    assert_allclose(measured[0, 0], 0.0, atol=1e-3)
    assert np.isnan(measured[0, 1]).all()


# Two satellites and an emitter that is at rest, so that differences of the signal are those of the geometry.
EMITTER = np.array([6378e3, 0.0, 0.0, 0.0, 0.0, 0.0])
PLATFORMS = np.array([[7000e3, 200e3, 0.0, 0.0, 7.4e3, 0.0], [7000e3, 100e3, 20e3, 0.0, 7.4e3, 0.0]])


def model():
    return Stack([Tdoa(50e-9, [1]), Fdoa(5.0, CARRIER, [1])])


def aimed(builder, heard, clock, offset, aim=None):
    """Emitter, receivers, block and an EKF whose prediction aims the block: a loop."""
    aim = aim or Aim(model(), platforms=2, state=6, half_delay=5e-6, half_frequency=500.0)
    blind = Window(0.0, 0.0, 1e-6, 300.0)
    _, block = wired(heard, builder, window=blind, clock=clock, trials=1, aim=aim)
    carriers = builder.AddSystem(Constant("platforms", PLATFORMS.reshape(1, -1)))
    spread = np.diag(np.square([2e3, 2e3, 2e3, 1.0, 1.0, 1.0]))
    wiring = Wiring(1, model().names, clock, platforms=2, noise_port=True)
    start = GivenStart(EMITTER + offset, spread)
    estimator = builder.AddSystem(Ekf().make("ekf", model(), WhiteNoiseAcceleration(1e-6), start, wiring))
    for reader in (block, estimator):
        builder.Connect(carriers.GetOutputPort("state"), reader.GetInputPort("platforms"))
    for port in ("measurement", "noise_covariance"):
        builder.Connect(block.GetOutputPort(port), estimator.GetInputPort(port))
    builder.Connect(estimator.GetOutputPort("prediction"), block.GetInputPort("prediction"))
    if aim.sigmas:
        builder.Connect(estimator.GetOutputPort("prediction_covariance"), block.GetInputPort("prediction_covariance"))
    return block, estimator


@pytest.mark.parametrize("sigmas", [0.0, 4.0])
def test_the_prediction_aims_the_window(sigmas):
    """The blind window would miss; the loop through the estimator builds, and the estimator uses what is found."""
    delay, frequency = model().predict(EMITTER, PLATFORMS)
    assert abs(delay) > 2e-6 and abs(frequency) > 1e3
    heard = pair(delay, frequency, size=8192, guard=2000)
    builder = DiagramBuilder()
    aim = Aim(model(), 2, 6, 2e-6, 300.0, sigmas)
    block, estimator = aimed(builder, heard, Periodic(1.0), [500.0, -300.0, 0.0, 0.0, 0.0, 0.0], aim)
    signals = {**ports(block), "nis_dof": estimator.GetOutputPort("nis_dof")}
    _, logs = run(builder, signals, end=2.0, clock=Periodic(1.0))
    assert_allclose(logs["measurement"][:, 0], np.tile([delay, frequency], (3, 1)), atol=1e-9 * 300, rtol=1e-4)
    assert (logs["nis_dof"] == 2).all()


def test_without_a_prediction_the_blind_window_serves():
    aim = Aim(model(), 2, 6, 2e-6, 300.0)
    state = np.stack([EMITTER, np.full(6, np.nan)])
    window = aim.window(state, None, PLATFORMS, Window(1.0, 2.0, 3.0, 4.0))
    expected = model().predict(EMITTER, PLATFORMS)
    assert_allclose(np.stack(window.over(2), axis=-1), [[*expected, 2e-6, 300.0], [1.0, 2.0, 3.0, 4.0]])


def test_the_spread_of_the_prediction_widens_the_window():
    aim = Aim(model(), 2, 6, 1e-9, 1e-3, sigmas=3.0)
    covariance = np.diag([1e6, 4e6, 1e6, 1.0, 2.0, 3.0])[None]
    window = aim.window(EMITTER[None], covariance, PLATFORMS, Window(0.0, 0.0, 1.0, 1.0))
    h = model().jacobian(EMITTER, PLATFORMS)
    expected = 3 * np.sqrt(np.diag(h @ covariance[0] @ h.T))
    assert_allclose([window.half_delay[0], window.half_frequency[0]], expected)


def test_what_is_wrong_is_said(blocks):
    builder = DiagramBuilder()
    _, block = wired([blocks[0], np.zeros(3)], builder)
    context = builder.Build().CreateDefaultContext()
    with pytest.raises(ValueError, match="cross_ambiguity: input auxiliary carries ndarray; IqBlock is needed"):
        block.GetOutputPort("measurement").Eval(block.GetMyContextFromRoot(context))
    builder = DiagramBuilder()
    _, block = wired(blocks, builder, trials=3)
    context = builder.Build().CreateDefaultContext()
    with pytest.raises(ValueError, match="main has 2 trials; 1 or 3 are allowed"):
        block.GetOutputPort("measurement").Eval(block.GetMyContextFromRoot(context))
    with pytest.raises(ValueError, match="one fdoa at least"):
        Aim(Tdoa(1e-9, [1]), 2, 6, 1e-6, 1.0)
    with pytest.raises(ValueError, match="half_delay"):
        Aim(model(), 2, 6, -1.0, 1.0)
    with pytest.raises(ValueError, match="an aim needs a window"):
        CrossAmbiguitySensor(CAF, None, Periodic(1.0), 1, Aim(model(), 2, 6, 1e-6, 1.0))
    with pytest.raises(ValueError, match="trials"):
        CrossAmbiguitySensor(CAF, AT, Periodic(1.0), 0)
