"""Phase between channels of one receiver, and its standard deviation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.systems.ambiguity.channel_phase import channel_phase
from quietfix.systems.ambiguity.prefilter import Band, Everything
from quietfix.systems.iq.block import IqBlock

TRIALS, SIZE = 400, 512


def channels(rng, phase, snr):
    signal, *noise = (rng.standard_normal((3, TRIALS, SIZE, 2)) @ [1, 1j]) / np.sqrt(2)
    noise = [one / np.sqrt(snr) for one in noise]
    return [IqBlock(signal + noise[0], 1e6, 0.0), IqBlock(signal * np.exp(1j * phase) + noise[1], 1e6, 0.0)]


@pytest.mark.parametrize(("snr", "phase"), [(10.0, 2.9), (0.5, -0.4)])
def test_phase_and_sigma(snr, phase):
    """Against theory (1 - g^2) / (2 n g^2), and the scatter of 400 trials (their deviation is known to 3.5 %)."""
    found = channel_phase(*channels(np.random.default_rng(1), phase, snr), Everything())
    error = np.angle(np.exp(1j * (found[:, 0] - phase)))
    coherence = snr / (1 + snr)
    theory = np.sqrt((1 - coherence**2) / (2 * SIZE * coherence**2))
    assert_allclose(error.std(), theory, rtol=0.12)
    assert_allclose(np.median(found[:, 1]), theory, rtol=0.03)
    assert abs(error.mean()) < 4 * theory / np.sqrt(TRIALS)


def test_a_band_and_silence():
    """In a tenth of the band sigma is the root of ten larger; without samples there is no phase."""
    first, second = channels(np.random.default_rng(2), 1.0, 5.0)
    wide = channel_phase(first, second, Everything())
    narrow = channel_phase(first, second, Band(-50e3, 50e3, 0.0, known=False))
    assert_allclose(np.median(narrow[:, 1]) / np.median(wide[:, 1]), np.sqrt(10), rtol=0.15)
    for value in (0.0, np.nan):
        silent = IqBlock(np.full((1, SIZE), value + 0j), 1e6, 0.0)
        assert np.isnan(channel_phase(silent, silent, Everything())).all()
    with pytest.raises(ValueError, match="second: 100 samples"):
        channel_phase(first, IqBlock(np.zeros((1, 100), complex), 1e6, 0.0), Everything())
