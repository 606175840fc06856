"""Test signals in closed form: QPSK with root-raised-cosine pulses, heard by two receivers."""

import numpy as np

from systems.iq.block import IqBlock

RATE, SYMBOLS, ROLL_OFF = 4e6, 2e6, 0.25
CARRIER = 3e9


def pulse(x, a=ROLL_OFF):
    """Root-raised-cosine pulse at x symbols."""
    x = np.asarray(x, dtype=float)
    out = np.empty_like(x)
    zero, pole = np.abs(x) < 1e-8, np.abs(np.abs(4 * a * x) - 1) < 1e-7
    out[zero] = 1 + a * (4 / np.pi - 1)
    out[pole] = a / np.sqrt(2) * ((1 + 2 / np.pi) * np.sin(np.pi / (4 * a)) + (1 - 2 / np.pi) * np.cos(np.pi / (4 * a)))
    rest = ~(zero | pole)
    y = x[rest]
    out[rest] = (np.sin(np.pi * y * (1 - a)) + 4 * a * y * np.cos(np.pi * y * (1 + a))) / (
        np.pi * y * (1 - (4 * a * y) ** 2)
    )
    return out


def envelope(time, rng, reach=10):
    """QPSK of unit power at emission times (n,) [s]."""
    place = time * SYMBOLS
    low = int(np.floor(place.min())) - reach
    symbols = rng.choice([1, 1j, -1, -1j], int(np.ceil(place.max())) + reach - low + 2)
    nearest = np.rint(place).astype(int)
    out = np.zeros(time.size, dtype=complex)
    for k in range(-reach, reach + 1):
        out += symbols[nearest + k - low] * pulse(place - nearest - k)
    return out


def pair(
    delay, frequency, size=65536, guard=0, rng=None, rate=RATE, noise=(0.0, 0.0), frequency_rate=0.0, carrier=CARRIER
):
    """Main and auxiliary `IqBlock` whose TDOA and FDOA at mid block are `delay` and `frequency`, of motion alone.

    The delay at the auxiliary receiver is D(t) = delay - frequency/carrier (t - mid) - frequency_rate/carrier
    (t - mid)^2 / 2, with t the time at the main receiver.
    """
    rng = rng or np.random.default_rng(0)
    middle = 0.5 * (size - 1) / rate
    t = np.arange(size) / rate
    u = np.arange(-guard, size + guard) / rate  # at the auxiliary receiver
    s = u.copy()  # what arrives there at u arrived at the main receiver at s = u - D(s)
    for _ in range(6):
        d = s - middle
        s = u - (delay - frequency / carrier * d - 0.5 * frequency_rate / carrier * d * d)
    both = envelope(np.concatenate([t, s]), rng)
    turns = carrier * (u - s)
    y = both[size:] * np.exp(-2j * np.pi * (turns - np.rint(turns)))
    blocks = []
    for clean, sigma, start in ((both[:size], noise[0], 0.0), (y, noise[1], u[0])):
        white = rng.standard_normal((clean.size, 2)) @ np.array([1, 1j]) * np.sqrt(0.5)
        blocks.append(IqBlock(clean + sigma * white, rate, carrier, start))
    return blocks
