"""Resampling against signals that are known at any time: ripple, what folds back, and the delay."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.modulation import Qpsk
from quietfix.systems.iq.resample import interpolate, resampled

RATE = 1e6


def middle(block, spare):
    return slice(spare, block.size - spare)


@pytest.mark.parametrize("ratio", [1.01, 0.99, 2.5, 0.37, 0.1, 1 / 3])
def test_ripple_and_stop_band(ratio):
    """A tone within 0.44 of the lower rate comes out to 1e-4 (-90 dB of ripple, and what the window leaves over).

    One beyond 0.56 of it is gone to -85 dB: the window's side lobes, three of which may add up.
    """
    n = np.arange(20_000)
    other = ratio * RATE
    lower = min(other, RATE)
    spare = int(60 * max(ratio, 1)) + 30
    for share in (-0.44, -0.31, 0.0, 0.2, 0.43):
        tone = np.exp(2j * np.pi * share * lower / RATE * n)
        out = resampled(IqBlock(tone, RATE, 0.0, 0.25), other)
        t = np.arange(out.size) / other
        inner = middle(out, spare)
        assert out.start_time[0] == 0.25 and out.sample_rate == other
        assert_allclose(out.samples[0, inner], np.exp(2j * np.pi * share * lower * t)[inner], atol=1e-4)
    for share in (0.57, 0.8, -0.6):
        if abs(share) * lower < 0.5 * RATE and ratio < 1:
            tone = np.exp(2j * np.pi * share * lower / RATE * n)
            out = resampled(IqBlock(tone, RATE, 0.0), other)
            assert np.abs(out.samples[0, middle(out, spare)]).max() < 10 ** (-85 / 20)


@pytest.mark.parametrize("ratio", [1.01, 0.99, 1 / 1.01, 0.7])
def test_the_delay_is_exact(ratio):
    """QPSK in 0.5 MHz: the resampled samples are those at the new times; the delay is right to 1e-4 of a sample.

    The symbols fill +-0.31 of the rate; what is left is the truth's: its pulses are cut where they are 3e-4.
    """
    wave, count = Qpsk(0.5e6 * min(ratio, 1.0), 0.25), 40_000
    block = IqBlock(wave.envelope(np.arange(count) / RATE, 5), RATE, 0.0)
    out = resampled(block, ratio * RATE)
    inner = middle(out, 200)
    t = np.arange(out.size)[inner] / out.sample_rate
    truth, got = wave.envelope(t, 5), out.samples[0, inner]
    assert_allclose(got, truth, atol=2e-3)
    step = 1e-9
    slope = (wave.envelope(t + step, 5) - wave.envelope(t - step, 5)) / (2 * step)
    late = np.vdot(slope, got - truth).real / np.vdot(slope, slope).real
    assert abs(late) * RATE < 1e-4


def test_a_cutoff_that_is_none_is_refused():
    for cutoff in (0.0, 2.0, np.nan, 1e-9):
        with pytest.raises(ValueError, match="cutoff"):
            interpolate(np.zeros(10, complex), np.zeros(2), cutoff)
