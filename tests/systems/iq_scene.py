"""Test signals: QPSK heard by two receivers, with the delay between them and its rates given."""

import numpy as np

from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.modulation import Qpsk

RATE, SYMBOLS, ROLL_OFF = 4e6, 2e6, 0.25
CARRIER = 3e9


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
    both = Qpsk(SYMBOLS, ROLL_OFF).envelope(np.concatenate([t_sent, s_sent]), int(rng.integers(2**31)))
    turns = carrier * (np.concatenate([t, u]) - np.concatenate([t_sent, s_sent]))
    both *= np.exp(-2j * np.pi * (turns - np.rint(turns)))
    return [IqBlock(both[:size], rate, carrier, 0.0), IqBlock(both[size:], other, carrier, u[0])]
