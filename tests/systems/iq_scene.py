"""Test signals in closed form: QPSK with root-raised-cosine pulses, heard by two receivers."""

import numpy as np

from systems.iq.block import IqBlock

RATE, SYMBOLS, ROLL_OFF = 4e6, 2e6, 0.25
CARRIER = 3e9


def pulses(d, k, a=ROLL_OFF):
    """Root-raised-cosine pulse at d - k symbols, for d (n, 1) within half a symbol and integers k (m,)."""
    x = d - k
    low, high = np.pi * (1 - a), np.pi * (1 + a)
    # sums of angles: two tables instead of a sine of every number
    sine = np.sin(low * d) * np.cos(low * k) - np.cos(low * d) * np.sin(low * k)
    cosine = np.cos(high * d) * np.cos(high * k) + np.sin(high * d) * np.sin(high * k)
    with np.errstate(divide="ignore", invalid="ignore"):
        out = (sine + 4 * a * x * cosine) / (np.pi * x * (1 - (4 * a * x) ** 2))
    out[np.abs(x) < 1e-8] = 1 + a * (4 / np.pi - 1)
    at_pole = (1 + 2 / np.pi) * np.sin(np.pi / (4 * a)) + (1 - 2 / np.pi) * np.cos(np.pi / (4 * a))
    out[np.abs(np.abs(4 * a * x) - 1) < 1e-7] = a / np.sqrt(2) * at_pole
    return out


def envelope(time, rng, reach=10):
    """QPSK of unit power at emission times (n,) [s]."""
    place = time * SYMBOLS
    low = int(np.floor(place.min())) - reach
    symbols = rng.choice([1, 1j, -1, -1j], int(np.ceil(place.max())) + reach - low + 2)
    nearest = np.rint(place).astype(int)
    k = np.arange(-reach, reach + 1)
    out = np.empty(time.size, dtype=complex)
    for part in np.array_split(np.arange(time.size), max(1, time.size // 4096)):
        d = (place - nearest)[part, None]
        out[part] = (symbols[nearest[part, None] + k - low] * pulses(d, k)).sum(axis=-1)
    return out


def pair(
    delay,
    frequency,
    size=65536,
    guard=0,
    rng=None,
    rate=RATE,
    frequency_rate=0.0,
    carrier=CARRIER,
    auxiliary_rate=None,
    doppler=0.0,
):
    """Main and auxiliary `IqBlock` whose TDOA and FDOA at mid block are `delay` and `frequency`, of motion alone.

    What reaches the main receiver at t reaches the auxiliary one at t + D(t), where it has the frequency
    (carrier + doppler) / (1 + D'(t)); at the main receiver it is carrier + doppler.
    """
    rng = rng or np.random.default_rng(0)
    middle = 0.5 * (size - 1) / rate
    t = np.arange(size) / rate
    other = auxiliary_rate or rate
    u = np.arange(-guard, int(size * other / rate) + guard) / other  # at the auxiliary receiver
    rate_of_delay = 1 / (1 + frequency / (carrier + doppler)) - 1
    s = u.copy()  # what arrives there at u arrived at the main receiver at s = u - D(s)
    for _ in range(6):
        d = s - middle
        s = u - (delay + rate_of_delay * d - 0.5 * frequency_rate / carrier * d * d)
    t_sent, s_sent = (middle + (time - middle) * (1 + doppler / carrier) for time in (t, s))
    both = envelope(np.concatenate([t_sent, s_sent]), rng)
    turns = carrier * (np.concatenate([t, u]) - np.concatenate([t_sent, s_sent]))
    both *= np.exp(-2j * np.pi * (turns - np.rint(turns)))
    return [IqBlock(both[:size], rate, carrier, 0.0), IqBlock(both[size:], other, carrier, u[0])]
