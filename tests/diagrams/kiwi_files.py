"""Recordings as KiwiSDRs write them, of a transmitter at a known place: any receivers, frequency, and faults."""

import struct

import numpy as np

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.geometry.wave_path import WavePath
from quietfix.systems.iq.resample import interpolate

BASE = 24000.0  # Hz; of the signal before it is received
BLOCK = 512

PLACES = {
    "ALFA": (40.42, -3.70),
    "BRAVO": (43.60, 1.44),
    "CH-3": (41.15, -8.61),
    "DELTA": (37.39, -5.99),
    "ECHO": (38.35, -0.48),
}
"""Receivers by name: latitude and longitude [deg]; nowhere near DCF77."""

TRANSMITTER = (41.65, -0.88)


def place(degrees):
    """Earth-fixed position of latitude and longitude [deg] on the ellipsoid."""
    return geodetic_to_ecef(*np.radians(degrees), 0.0)


def delays(names, source=TRANSMITTER, path=None):
    """Travel times of a wave along the ground [s]."""
    chord = [np.linalg.norm(place(PLACES[name]) - place(source)) for name in names]
    return (path or WavePath()).length(np.array(chord)) / SPEED_OF_LIGHT


def wav(path, samples, stamps, rate=12001):
    """Write blocks with their stamps; samples as complex numbers of up to 32767."""
    head = struct.pack("<HHIIHH", 1, 2, rate, 4 * rate, 4, 16)
    body = b"WAVE" + b"fmt " + struct.pack("<I", 16) + head
    for k, stamp in enumerate(stamps):
        part = samples[BLOCK * k : BLOCK * (k + 1)]
        both = np.stack([part.real, part.imag], axis=-1).round().astype("<i2").tobytes()
        whole, rest = divmod(round(stamp % 604800.0 * 1e9), 10**9)
        body += b"kiwi" + struct.pack("<IBBII", 10, 1, 0, whole, rest)
        body += b"data" + struct.pack("<I", len(both)) + both
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)


def write(
    folder,
    seed,
    names=tuple(PLACES),
    seconds=6.0,
    frequency=198000,
    noise=1.0,
    start=604797.3,
    extra=None,
    known=True,
    time="20210605T235937Z",
    edit=None,
    path=None,
):
    """Write recordings and ``stations.csv``; returns the folder.

    Parameters: `noise` is that of a receiver over the signal's power in its band, `extra` delays by receiver [s],
    `edit` takes (name, samples, stamps) and returns the two as they are written.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    count = int((seconds + 1.0) * BASE)
    spectrum = rng.normal(size=count) + 1j * rng.normal(size=count)
    spectrum[np.abs(np.fft.fftfreq(count, 1 / BASE)) > 2500.0] = 0.0
    sent = np.fft.ifft(spectrum)
    sent *= 2000.0 / np.sqrt(np.mean(np.abs(sent) ** 2))
    for i, (name, delay) in enumerate(zip(names, delays(names, path=path), strict=True)):
        rate = 12001.0 + 0.03 * i
        begin = 0.2 + 0.05 * i  # in the time of the signal
        blocks = int(seconds * rate / BLOCK)
        when = begin + np.arange(blocks * BLOCK) / rate
        heard = interpolate(sent, (when - delay - (extra or {}).get(name, 0.0)) * BASE)
        heard = heard + 2000.0 * np.sqrt(noise / 2) * (rng.normal(size=when.size) + 1j * rng.normal(size=when.size))
        stamps = start + when[::BLOCK]
        stamps[: 1 + i % 2] = 1234.5 + i
        if edit is not None:
            heard, stamps = edit(name, heard, stamps)
        wav(folder / f"{time}_{frequency}_{name}_iq.wav", heard, stamps)
    rows = [f"{name},receiver,{PLACES[name][0]},{PLACES[name][1]}" for name in names]
    rows += [f"Zaragoza,transmitter,{TRANSMITTER[0]},{TRANSMITTER[1]}"] if known else []
    (folder / "stations.csv").write_text("\n".join(["name,role,latitude_deg,longitude_deg", *rows]) + "\n")
    return folder
