"""I/Q recordings of a known place: ground receivers about an emitter of QPSK, sampled by clocks of their own."""

import json
from dataclasses import dataclass, field

import numpy as np

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.iq.modulation import Qpsk

CARRIER, SYMBOLS = 433.92e6, 100e3
EMITTER = (48.03, 11.05, 560.0)
RECEIVERS = {
    "alpha": (48.08, 10.98, 520.0),
    "bravo": (48.06, 11.16, 610.0),
    "charlie": (47.97, 11.10, 480.0),
    "delta": (47.99, 10.93, 700.0),
}
HEIGHT = ["position.height_m=500", "position.sigma_height_m=100"]
"""What is assumed of the emitter: 60 m off, 0.6 of its sigma."""


def ecef(place):
    latitude, longitude, height = place
    return np.array(geodetic_to_ecef(np.radians(latitude), np.radians(longitude), np.asarray(height)))


@dataclass
class Clock:
    """How a receiver samples; `ppm`: so much too fast, from its first sample on, which is at the true `begin`."""

    rate: float = 200e3
    ppm: float = 0.0
    begin: float = 0.0
    gap: tuple[float, float] | None = None
    kind: str = "cf32_le"
    about: dict = field(default_factory=dict)


def times_of(clock, seconds):
    """True times of the samples, and which of them are there."""
    n = np.arange(int(seconds * clock.rate))
    told = n / clock.rate
    there = np.ones(n.size, bool) if clock.gap is None else (told < clock.gap[0]) | (told >= clock.gap[1])
    return clock.begin + told / (1 + 1e-6 * clock.ppm), there


def heard(place, times, seed, snr_db, rng, emitter=EMITTER, rate=200e3):
    """Envelope of the emitter at a receiver, and noise that has `snr_db` in the sample rate of 200 kHz."""
    delay = np.linalg.norm(ecef(emitter) - ecef(place)) / SPEED_OF_LIGHT
    clean = Qpsk(SYMBOLS, 0.25).envelope(times - delay, seed) * np.exp(-2j * np.pi * ((CARRIER * delay) % 1))
    sigma = 10 ** (-snr_db / 20) * np.sqrt(rate / 200e3 / 2)
    return clean + sigma * (rng.standard_normal((times.size, 2)) @ [1, 1j])


def write(folder, name, samples, clock, there=None, **info):
    """Write a recording of one clock."""
    path = folder / f"{name}.sigmf-meta"
    begin = f"2026-03-01T12:00:{clock.begin:012.9f}Z"
    tuned = CARRIER - (0.25 * clock.rate if clock.kind == "rf32_le" else 0.0)
    captures = [{"core:sample_start": 0, "core:frequency": tuned, "core:datetime": begin}]
    if there is not None and not there.all():
        first = int(np.argmin(there))
        after = first + int(np.count_nonzero(~there))
        captures.append({"core:sample_start": first, "core:frequency": CARRIER, "core:global_index": after})
        samples = samples[there]
    if clock.kind == "rf32_le":  # a receiver that samples an intermediate frequency of a quarter of the rate
        content = samples.real.astype("<f4")
    elif clock.kind == "ci16_le":
        both = np.stack([samples.real, samples.imag], axis=-1)
        content = np.rint(both / np.abs(both).max() * 30000).astype("<i2")
    else:
        content = samples.astype("<c8")
    content.tofile(folder / f"{name}.sigmf-data")
    about = {"core:datatype": clock.kind, "core:sample_rate": clock.rate, "core:version": "1.2.0", **info}
    path.write_text(json.dumps({"global": about, "captures": captures, "annotations": []}))
    return path


def record(folder, seed, snr_db=10.0, seconds=0.5, clocks=None, located=True, receivers=RECEIVERS):
    """Write a recording of each receiver; return the paths."""
    rng = np.random.default_rng([seed, 77])
    paths = []
    for name, place in receivers.items():
        clock = (clocks or {}).get(name, Clock())
        times, there = times_of(clock, seconds)
        samples = heard(place, times, seed, snr_db, rng, rate=clock.rate)
        if clock.kind == "rf32_le":  # 2 Re: the signal has the amplitude of the complex ones again
            samples = 2 * (samples * np.exp(0.5j * np.pi * np.arange(times.size))).real
        latitude, longitude, height = place
        point = {"type": "Point", "coordinates": [longitude, latitude, height]}
        info = {"core:geolocation": point} if located else {}
        paths.append(write(folder, name, samples, clock, there, **info, **clock.about))
    return paths


def table(folder, receivers=RECEIVERS):
    """Write a table of platforms."""
    path = folder / "platforms.csv"
    lines = [f"{name},{a},{b},{c}" for name, (a, b, c) in receivers.items()]
    path.write_text("\n".join(["name,latitude_deg,longitude_deg,height_m", *lines]) + "\n")
    return path
