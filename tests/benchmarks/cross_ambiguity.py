"""The cross-ambiguity function of a 65,536-sample block, against one Fourier transform of that length."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy import fft

from quietfix.systems.ambiguity.differences import Differences, Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.ambiguity.prefilter import RootRaisedCosine
from quietfix.systems.iq.block import IqBlock
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.report import Section, Threshold, spread
from tests.systems.iq_scene import CARRIER, RATE, ROLL_OFF, SYMBOLS, pair

__all__ = ["compare"]

DELAY, FREQUENCY, RATE_OF_FREQUENCY = 100e-6, 3e3, 50.0
LIMITS = {"ms": 60.0, "transforms": 50.0}
"""Milliseconds an epoch may take, and the time of how many transforms of its length."""


def compare(size: Size) -> Section:
    """Return the table."""
    samples = 8192 if size.tiny else 65536
    section = Section(
        f"Cross-ambiguity function, {samples} samples at 4 MHz: prefilter, coarse and fine, an epoch",
        ("what", "ms: median (range)", "over one transform (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    main, auxiliary = _noisy(samples)
    function = CrossAmbiguity(prefilter=RootRaisedCosine(SYMBOLS, ROLL_OFF))
    aided = Window(DELAY + 3e-6, FREQUENCY + 100.0, 20e-6, 600.0 * 65536 / samples)
    wide = Window(DELAY, FREQUENCY, 20e-6, 9.5e3)
    whole = Window(0.0, 0.0, 340e-6, 9.5e3)
    peers: dict[str, Callable[[], Any]] = {
        "window of 20 us, 600 Hz": partial(function, main, auxiliary, aided),
        "window of 20 us, 9.5 kHz": partial(function, main, auxiliary, wide),
        "window of 340 us, 9.5 kHz": partial(function, main, auxiliary, whole),
        "one complex transform, double": partial(fft.fft, main.samples[0]),
        "one complex transform, single": partial(fft.fft, main.samples[0].astype(np.complex64)),
    }
    timings = race([Peer(name, run, 1) for name, run in peers.items()], size)
    for name in peers:
        if name.startswith("window"):
            _check(timings[name].result)
    alone = timings["one complex transform, double"]
    for name, timing in timings.items():
        spent, multiple = [1e3 * cost for cost in timing.costs], ratios(timing, alone)
        cells = ("", "")
        if name == "window of 20 us, 600 Hz":
            ms, transforms = (Threshold(limit, at_least=False) for limit in LIMITS.values())
            verdicts = section.judge(spent, ms), section.judge(multiple, transforms)
            cells = (f"{ms} ms; {transforms} transforms", "; ".join(verdicts))
        section.rows.append((name, spread(spent), spread(multiple), *cells))
    section.notes += [
        "QPSK of 2 MBd, roll-off 0.25, -10 dB in the sample rate; windows of the direction of arrival, blind in "
        "frequency, and of the whole footprint. All have found the peak, to five times the sigmas that they give.",
        "The thresholds are for an idle core of 2 GHz.",
    ]
    return section


def _noisy(samples: int) -> list[IqBlock]:
    rng = np.random.default_rng(0)
    clean = pair(DELAY, FREQUENCY, size=samples, guard=1600, rng=rng, frequency_rate=RATE_OF_FREQUENCY)
    sigma = 10**0.5
    return [
        IqBlock(
            block.samples + sigma * np.sqrt(0.5) * (rng.standard_normal((1, block.size, 2)) @ np.array([1, 1j])),
            RATE,
            CARRIER,
            block.start_time,
        )
        for block in clean
    ]


def _check(found: Differences) -> None:
    error = np.abs([found.delay[0] - DELAY, found.frequency[0] - FREQUENCY])
    if not (found.good[0] and (error < 5 * np.sqrt(found.variance[0])).all()):
        raise ArithmeticError(f"the peak should have been found, but it is {error} off")
