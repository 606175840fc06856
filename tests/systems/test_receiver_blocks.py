"""Transmitter, receivers and link as blocks of a diagram."""

import copy

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.modulation import Qpsk
from quietfix.systems.iq.quantise import quantise
from quietfix.systems.iq.reception import delay_over, receive, straight, with_acceleration
from quietfix.systems.iq.waveform import Emission
from quietfix.systems.signal_chain.inter_satellite_link import InterSatelliteLink
from quietfix.systems.signal_chain.receiver import Receiver
from quietfix.systems.signal_chain.transmitter import Transmitter
from quietfix.systems.signals import Constant, Draw, set_draw
from quietfix.systems.trajectories.gravity import acceleration
from tests.systems.dual_scene import CARRIER, CONSTANTS, scene

HERE = scene(0.0)
RATE = 4e6


def _chain(trials=1, samples=2048, target=HERE.target, margin=100, **options):
    """Return the diagram and its receivers, both satellites and a link."""
    builder = DiagramBuilder()
    targets = np.atleast_2d(target)
    truth = builder.AddSystem(Constant("target", targets))
    platforms = builder.AddSystem(Constant("satellites", HERE.platforms.reshape(1, 12)))
    transmitter = builder.AddSystem(Transmitter(Qpsk(), CARRIER))
    blocks = {}
    for i, name in enumerate(("main_receiver", "auxiliary_receiver")):
        block = builder.AddSystem(
            Receiver(
                i,
                Periodic(1.0),
                trials,
                2,
                RATE,
                samples,
                margin * i,
                constants=CONSTANTS,
                target_trials=targets.shape[0],
                name=name,
                **options,
            )
        )
        builder.Connect(truth.GetOutputPort("state"), block.GetInputPort("target"))
        builder.Connect(platforms.GetOutputPort("state"), block.GetInputPort("platforms"))
        builder.Connect(transmitter.GetOutputPort("emission"), block.GetInputPort("emission"))
        blocks[name] = block
    link = builder.AddSystem(InterSatelliteLink(1e-3, bits=8))
    builder.Connect(blocks["auxiliary_receiver"].GetOutputPort("iq"), link.GetInputPort("iq"))
    blocks["link"] = link
    return builder.Build(), blocks


def _blocks(time=0.0, draw=None, **options):
    diagram, blocks = _chain(**options)
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, draw or Draw())
    context.SetTime(time)
    return {name: block.GetOutputPort("iq").Eval(block.GetMyContextFromRoot(context)) for name, block in blocks.items()}


def test_a_block_is_centred_on_its_tick():
    heard = _blocks(time=3.0)
    main, auxiliary = heard["main_receiver"], heard["auxiliary_receiver"]
    assert (main.size, auxiliary.size) == (2048, 2248)
    for block in (main, auxiliary):
        assert block.mid_time[0] == pytest.approx(3.0, abs=1e-14)
        assert (block.sample_rate, block.centre_frequency) == (RATE, CARRIER)
    # the sample instants of the two are the same
    assert (main.start_time - auxiliary.start_time)[0] * RATE == pytest.approx(100, abs=1e-6)


def test_without_noise_it_is_the_reception():
    heard = _blocks(snr_db=np.inf, gain=0.5j, draw=Draw(7))["auxiliary_receiver"]
    pull = acceleration(HERE.platforms[1:, :3], CONSTANTS)
    offsets = (np.arange(2248) - 1123.5) / RATE
    delay = delay_over(straight(HERE.target[None]), with_acceleration(HERE.platforms[1:], pull), 1124 / RATE)
    expected = receive(Emission(Qpsk(), CARRIER, 7, "transmitter"), delay, 0.0, offsets)
    np.testing.assert_allclose(heard.samples, 0.5j * expected, atol=1e-12)


def test_noise_is_white_independent_and_as_strong_as_stated():
    """SNR in the sample rate; over 20 x 16384 samples a variance is known to 0.2 %, a correlation too."""
    trials, samples = 20, 16384
    clean, noisy = (_blocks(trials=trials, samples=samples, snr_db=snr, gain=2.0) for snr in (np.inf, -12.0))
    noise = [noisy[name].samples - clean[name].samples for name in ("main_receiver", "auxiliary_receiver")]
    count = trials * samples
    for n in noise:
        assert np.mean(abs(n) ** 2) == pytest.approx(4 * 10**1.2, rel=4 / np.sqrt(count))
        unit = n / np.sqrt(4 * 10**1.2)
        for other in (unit.conj(), np.roll(unit, 1, axis=-1), np.roll(unit, 1, axis=0)):
            assert abs(np.mean(unit.conj() * other)) < 4 / np.sqrt(count)
    power = np.mean(abs(noise[0]) ** 2)
    assert abs(np.mean(noise[0].conj() * noise[1][:, 100:-100])) / power < 4 / np.sqrt(count)


def test_a_trial_alone_is_a_trial_of_a_batch():
    targets = HERE.target + np.arange(4)[:, None] * np.array([1e3, 0, 0, 0, 5.0, 0])
    batch = _blocks(trials=4, target=targets, snr_db=-5.0, draw=Draw(1, 10))
    alone = _blocks(trials=1, target=targets[2], snr_db=-5.0, draw=Draw(1, 12))
    for name in ("main_receiver", "auxiliary_receiver", "link"):
        np.testing.assert_array_equal(batch[name].samples[2], alone[name].samples[0])


def test_truth_that_is_shared_is_received_once():
    diagram, blocks = _chain(trials=3, snr_db=0.0)
    receiver = blocks["main_receiver"]
    context = receiver.GetMyContextFromRoot(diagram.CreateDefaultContext())
    assert receiver.cached(context, receiver._clean).shape == (1, 2048)


def test_between_ticks_below_the_horizon_and_without_truth_nothing_is_heard():
    assert np.isnan(_blocks(time=0.5)["main_receiver"].samples).all()
    assert np.isnan(_blocks(time=0.5)["link"].samples).all()
    hidden = np.stack([HERE.target, -HERE.target, np.full(6, np.nan)])
    heard = _blocks(trials=3, target=hidden, mask=ElevationMask())["main_receiver"].samples
    np.testing.assert_array_equal(np.isnan(heard).all(axis=-1), [False, True, True])
    assert np.isfinite(heard[0]).all()


def test_epochs_have_their_own_noise_and_symbols():
    diagram, blocks = _chain(snr_db=0.0)
    simulator = Simulator(diagram)
    context = blocks["main_receiver"].GetMyContextFromRoot(simulator.get_mutable_context())
    port = blocks["main_receiver"].GetOutputPort("iq")
    first = port.Eval(context).samples
    simulator.AdvanceTo(1.0)
    second = port.Eval(context).samples
    assert abs(np.vdot(first, second)) / np.linalg.norm(first) / np.linalg.norm(second) < 4 / np.sqrt(2048)


def test_the_link_takes_the_known_delay_out_and_leaves_the_unknown_one():
    block = IqBlock(np.ones((2, 4)) + 0j, RATE, CARRIER, [1.0, 2.0])

    def carried(*arguments, **options):
        link = InterSatelliteLink(*arguments, **options)
        context = link.CreateDefaultContext()
        link.GetInputPort("iq").FixValue(context, block)
        return link.GetOutputPort("iq").Eval(context)

    assert carried(2e-3) is block
    np.testing.assert_allclose(carried(2e-3, 1.9e-3).start_time, [1.0001, 2.0001], rtol=0, atol=1e-15)
    assert carried(0.0, bits=4).samples.shape == (2, 4)


def test_quantisation_noise_is_that_of_the_step():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(3, 20000)) + 1j * rng.normal(size=(3, 20000))
    for bits in (6, 8, 12):
        step = 2 * 5.0 / 2**bits  # standard deviation of I and Q is 1
        error = quantise(x, bits, 5.0) - x
        # uniform in a step: a twelfth of its square in each of I and Q; nothing of 1.2e5 numbers is beyond 5 sigma
        assert np.mean(abs(error) ** 2) == pytest.approx(step**2 / 6, rel=0.03)
        assert np.abs(error.real).max() < 0.51 * step


def test_one_bit_costs_two_decibels():
    """Weak signal in Gaussian noise, one side hard limited: the correlation falls by sqrt(2/pi) (Van Vleck)."""
    rng = np.random.default_rng(2)
    common, own, other = rng.normal(size=(3, 200000)) + 1j * rng.normal(size=(3, 200000))
    x, y = 0.3 * common + own, 0.3 * common + other

    def correlation(a, b):
        return abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b)

    ratio = correlation(x, quantise(y, 1)) / correlation(x, y)
    assert ratio == pytest.approx(np.sqrt(2 / np.pi), abs=0.02)


def test_quantisation_clips_and_keeps_nan_and_nothing():
    x = np.array([[100.0 + 0j, 0.1, 0.1, 0.1], [0, 0, 0, 0], [np.nan, 1, 1, 1]])
    out = quantise(x, 8, 1.0)
    assert out[0, 0].real == pytest.approx(np.sqrt(np.mean(abs(x[0]) ** 2) / 2), rel=0.01)
    np.testing.assert_array_equal(out[1], 0)
    assert np.isnan(out[2]).all()


def test_blocks_and_emissions_are_their_own_copies():
    emission = Emission(Qpsk(), CARRIER)
    assert copy.deepcopy(emission) is emission


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"platform": 2}, "platform: 2 is not allowed; 0 to 1"),
        ({"sample_rate": 0.0}, "sample_rate: 0.0 is not allowed"),
        ({"samples": 0}, "samples: 0 is not allowed"),
        ({"margin": -1}, "margin: -1 is not allowed"),
        ({"snr_db": np.nan}, "snr_db: nan is not allowed"),
        ({"gain": 0.0}, "gain: 0.0 is not allowed"),
        ({"target_trials": 2}, "target has 2 trials; 1 or 3 are allowed"),
    ],
)
def test_a_receiver_says_what_is_wrong(options, words):
    given = {"platform": 0, "clock": Periodic(1.0), "trials": 3, "platforms": 2, "sample_rate": RATE, "samples": 8}
    with pytest.raises(ValueError, match=words):
        Receiver(**{**given, **options})


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: InterSatelliteLink(np.inf), "delay, assumed_delay: inf"),
        (lambda: InterSatelliteLink(bits=0), "bits: 0 is not allowed"),
        (lambda: InterSatelliteLink(bits=8, full_scale=0.0), "full_scale: 0.0 is not allowed"),
        (lambda: Transmitter(Qpsk(), -1.0), "carrier: -1.0 is not allowed"),
    ],
)
def test_the_other_blocks_say_what_is_wrong(make, words):
    with pytest.raises(ValueError, match=words):
        make()
