"""Waveforms: closed forms, any time, spectra, and the same symbols for whoever asks."""

import math

import numpy as np
import pytest

from quietfix.systems.iq.modulation import BandLimitedNoise, Qpsk
from quietfix.systems.iq.pulse_train import PulseTrain
from quietfix.systems.iq.root_raised_cosine import pulse, raised_cosine
from quietfix.systems.iq.waveform import Emission

WAVEFORMS = [Qpsk(), BandLimitedNoise(), PulseTrain()]
NAMES = ["qpsk", "noise", "pulse_train"]


@pytest.mark.parametrize("roll_off", [0.1, 0.25, 0.5, 1.0])
def test_the_pulse_is_smooth_through_its_limits(roll_off):
    step = 1e-4
    for place in (0.0, 1 / (4 * roll_off), -1 / (4 * roll_off)):
        around = pulse(place + step * np.array([-2, -1, 1, 2]), roll_off)
        # fourth-order interpolation of a function whose derivatives are below 40: 40 h^4
        expected = (-around[0] + 4 * around[1] + 4 * around[2] - around[3]) / 6
        assert pulse(place, roll_off) == pytest.approx(expected, abs=1e-10)


def test_the_pulse_without_roll_off_is_a_sinc():
    x = np.linspace(-5.3, 5.3, 77)
    np.testing.assert_allclose(pulse(x, 0.0), np.sinc(x), atol=1e-15)


def test_two_pulses_in_a_row_do_not_disturb_the_other_symbols():
    x = np.arange(-200, 200, 0.125)
    autocorrelation = np.correlate(pulse(x, 0.25), pulse(x, 0.25), "full")[x.size - 1 :: 8] * 0.125
    # what lies beyond 200 symbols: (1/(4 pi alpha 200^2))^2 * 200, 1e-8
    np.testing.assert_allclose(autocorrelation[:50], [1.0] + [0.0] * 49, atol=1e-6)


def test_the_envelope_is_the_sum_of_closed_form_pulses():
    waveform = Qpsk()
    times = np.linspace(-3e-4, 2e-4, 1001)
    k = np.arange(-900, 700)
    symbols = waveform.symbols(-900, k.size, seed=5, name="a")
    x = times[:, None] * waveform.symbol_rate - k
    interval = np.floor(times * waveform.symbol_rate)[:, None]
    cut = (k - interval > -32) & (k - interval <= 32)  # as documented
    exact = (pulse(x, 0.25) * cut) @ symbols
    # polynomials of degree 10 over one symbol: 7e-9 of a pulse, a few pulses add up
    np.testing.assert_allclose(waveform.envelope(times, 5, "a"), exact, atol=2e-8)
    # and what the cut leaves out: 3e-4 and less from each of the many pulses
    assert np.abs(waveform.envelope(times, 5, "a") - pulse(x, 0.25) @ symbols).max() < 5e-3


@pytest.mark.parametrize("waveform", WAVEFORMS, ids=NAMES)
def test_a_time_alone_is_the_time_in_a_block(waveform):
    times = 17.0 + np.arange(5000).reshape(2, 2500) / 1.7e6
    whole = waveform.envelope(times, 3, "x")
    assert whole.shape == times.shape
    assert whole[1, 77] == waveform.envelope(times[1, 77], 3, "x")
    np.testing.assert_array_equal(whole[:, ::-13], waveform.envelope(times[:, ::-13], 3, "x"))
    assert waveform.envelope(np.zeros((0,))).shape == (0,)


@pytest.mark.parametrize("waveform", [Qpsk(), BandLimitedNoise()], ids=["qpsk", "noise"])
def test_symbols_depend_on_seed_name_and_index_alone(waveform):
    whole = waveform.symbols(-5000, 10000, 1, "a")
    np.testing.assert_array_equal(whole[3000:3100], waveform.symbols(-2000, 100, 1, "a"))
    for seed, name in ((2, "a"), (1, "b")):
        other = waveform.symbols(-5000, 10000, seed, name)
        assert abs(np.vdot(whole, other)) / 10000 < 0.04  # 4 sigma of independent symbols


def test_qpsk_uses_four_symbols_alike():
    symbols = Qpsk().symbols(0, 40000)
    angle, counts = np.unique(np.round(np.angle(symbols) / (np.pi / 4)), return_counts=True)
    np.testing.assert_array_equal(angle, [-3, -1, 1, 3])
    assert np.abs(counts - 10000).max() < 4 * math.sqrt(40000 * 0.25 * 0.75)


def _power_spectrum(waveform, rate, count=4096, blocks=200):
    """Welch's: mean of windowed periodograms, density [1/Hz]."""
    window = np.hanning(count)
    times = np.arange(blocks * count).reshape(blocks, count) / rate
    lines = np.abs(np.fft.fft(waveform.envelope(times, 11) * window, axis=-1)) ** 2
    return np.fft.fftfreq(count, 1 / rate), lines.mean(axis=0) / (rate * (window**2).sum())


@pytest.mark.parametrize("waveform", [Qpsk(), BandLimitedNoise(2.5e6, 0.1)], ids=["qpsk", "noise"])
def test_the_spectrum_is_that_of_the_signal(waveform):
    frequency, measured = _power_spectrum(waveform, 5e6)
    expected = waveform.spectrum(frequency)
    # each line has 200 independent estimates: 7 %; mean over 64 lines 1 %, 4 sigma
    smooth = (measured - expected).reshape(-1, 64).mean(axis=-1)
    assert np.abs(smooth).max() < 0.04 * expected.max()
    # outside the band: the steps of the cut pulses, 3e-4 in amplitude
    assert measured[np.abs(frequency) > 0.55 * waveform.bandwidth].max() < 1e-5 * expected.max()


@pytest.mark.parametrize("waveform", [*WAVEFORMS, PulseTrain(edge=0.5)], ids=[*NAMES, "soft_pulses"])
def test_power_and_rms_bandwidth_are_those_of_the_spectrum(waveform):
    frequency = np.linspace(-8e6, 8e6, 400001)
    density = waveform.spectrum(frequency)
    assert np.trapezoid(density, frequency) == pytest.approx(1.0, abs=1e-5)
    # (the pulse train's spectrum is sampled 4 times per line width: a per mille; hard edges have far tails)
    second = (2 * np.pi) ** 2 * np.trapezoid(frequency**2 * density, frequency)
    assert waveform.rms_bandwidth == pytest.approx(math.sqrt(second), rel=2e-3)
    assert waveform.noise_bandwidth == waveform.bandwidth


def test_rms_bandwidth_of_the_default_qpsk():
    # 2 pi 2 MHz sqrt(1/12 + alpha^2 (1/4 - 2/pi^2))
    assert Qpsk().rms_bandwidth == pytest.approx(3.6916e6, rel=1e-4)


def test_mean_power_is_one():
    times = np.arange(400000) / 4e6
    # QPSK 2e5 symbols of constant modulus; noise 2.5e5 exponential powers, 4 sigma = 0.8 %
    for waveform, tolerance in zip(WAVEFORMS, (2e-3, 8e-3, 1e-6), strict=True):
        assert np.mean(np.abs(waveform.envelope(times)) ** 2) == pytest.approx(1.0, abs=tolerance)


def test_band_limited_noise_is_stationary():
    place = np.linspace(0, 1, 9)[:, None] - np.arange(-32, 33)
    power = (pulse(place / 1.25, 0.25) ** 2 / 1.25).sum(axis=-1)
    np.testing.assert_allclose(power, power.mean(), rtol=1e-5)  # the cut tails


def test_a_pulse_train_repeats_itself_and_stays_in_its_band():
    train = PulseTrain()
    times = np.linspace(-60e-6, 60e-6, 481)
    np.testing.assert_allclose(train.envelope(times + 7e-3), train.envelope(times), atol=1e-9 / 1e-3)
    assert np.all(train.envelope(times)[np.abs(times) > 25.1e-6] == 0)
    frequency = np.linspace(-1e6, 1e6, 20001)
    assert np.trapezoid(train.spectrum(frequency), frequency) > 0.98
    # the frequency rises through the carrier at the centre of the pulse
    inside = train.envelope(np.linspace(-15e-6, 15e-6, 601))
    slope = np.diff(np.unwrap(np.angle(inside))) / (2 * np.pi * 0.05e-6)
    np.testing.assert_allclose(slope, 2e6 / 50e-6 * np.linspace(-15e-6, 15e-6, 601)[:-1] + 1e3, atol=20)


def test_raised_cosine_without_roll_off_is_a_box():
    np.testing.assert_array_equal(raised_cosine([0.0, 0.49, -0.49, 0.51], 0.0), [1, 1, 1, 0])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Qpsk(0.0), "symbol_rate: 0.0 is not allowed"),
        (lambda: Qpsk(roll_off=1.5), "roll_off: 1.5 is not allowed"),
        (lambda: BandLimitedNoise(-1.0), "band: -1.0 is not allowed"),
        (lambda: PulseTrain(width=2e-3), "width: 0.002 s is not allowed; at most the interval"),
        (lambda: PulseTrain(edge=-0.1), "edge: -0.1 is not allowed"),
        (lambda: PulseTrain(sweep=math.inf), "sweep: inf is not allowed"),
        (lambda: Emission(Qpsk(), 0.0), "carrier: 0.0 is not allowed"),
        (lambda: Qpsk().envelope([0.0, math.nan]), "times: all must be finite"),
        (lambda: PulseTrain().envelope([math.inf]), "times: all must be finite"),
        (lambda: Qpsk().envelope([0.0, 1e5]), "times: they spread over"),
    ],
)
def test_what_is_wrong_is_said(make, words):
    with pytest.raises(ValueError, match=words.replace("(", r"\(")):
        make()
