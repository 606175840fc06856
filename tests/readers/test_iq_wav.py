"""WAV files of samples, and files of samples alone: every width, the chunk auxi, and what is broken."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.diagrams.readers.iq.any_file import read_iq
from quietfix.diagrams.schema.errors import UserError

RATE, SIZE = 48_000, 400
WIDTHS = [(1, 8), (1, 16), (1, 24), (1, 32), (3, 32), (3, 64)]


def tone(channels=1, size=SIZE):
    n = np.arange(size)[:, None]
    return 0.5 * np.exp(2j * np.pi * (0.01 * n + 0.1 * np.arange(channels)))


def packed(samples, kind, bits):
    """Bytes of I and Q (or real samples) side by side."""
    numbers = samples.view(float) if np.iscomplexobj(samples) else samples
    if kind == 3:
        return numbers.astype(f"<f{bits // 8}").tobytes()
    whole = np.rint(numbers * (2 ** (bits - 1) - 1)).astype("<i8")
    if bits == 8:
        return (whole + 128).astype("u1").tobytes()
    return whole.reshape(-1, 1).view("u1")[:, : bits // 8].tobytes()


def chunk(name, body):
    return name + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


def layout(kind=1, channels=2, rate=RATE, bits=16, extensible=False):
    frame = channels * bits // 8
    head = struct.pack("<HHIIHH", 0xFFFE if extensible else kind, channels, rate, rate * frame, frame, bits)
    guid = struct.pack("<H", kind) + bytes.fromhex("000000001000800000aa00389b71")
    return head + (struct.pack("<HHI", 22, bits, 3) + guid if extensible else b"")


def wav(samples, kind=1, bits=16, extra=b"", extensible=False, **about):
    channels = samples.shape[1] * (2 if np.iscomplexobj(samples) else 1)
    head = layout(kind, channels, bits=bits, extensible=extensible, **about)
    body = b"WAVE" + chunk(b"fmt ", head) + extra
    body += chunk(b"data", packed(samples, kind, bits))
    return b"RIFF" + struct.pack("<I", len(body)) + body


def auxi(year=2026, frequency=7_100_000, milli=250):
    start = struct.pack("<8H", year, 3, 0, 1, 12, 0, 5, milli)
    return chunk(b"auxi", start + start + struct.pack("<9I", frequency, *[0] * 8))


def read(folder, content, name="heard.wav", **raw):
    (folder / name).write_bytes(content)
    (one,) = read_iq(folder / name, **raw)
    return one


@pytest.mark.parametrize("extensible", [False, True])
@pytest.mark.parametrize(("kind", "bits"), WIDTHS)
def test_every_width(tmp_path, kind, bits, extensible):
    """To a unit of the last place; of 8 bits 1/127."""
    one = read(tmp_path, wav(tone(), kind, bits, extensible=extensible))
    assert (one.name, one.sample_rate, one.start, one.others) == ("heard", RATE, None, ())
    assert_allclose(one.segments[0].samples, tone()[:, 0], atol=max(2.0 ** (1 - bits) * 1.5 if kind == 1 else 0, 1e-7))


def test_what_the_chunk_auxi_says(tmp_path):
    one = read(tmp_path, wav(tone(), extra=auxi()))
    assert one.segments[0].frequency == 7.1e6
    assert one.start == (1_772_366_405, 0.25)  # 2026-03-01T12:00:05Z
    assert "digits down to 0.001 s, 48 samples" in one.notes[0]
    text = '<?xml version="1.0"?><D RadioCenterFreq="145800000" UTCSeconds="1772366405"/>'
    for encoding in ("utf-16-le", "utf-8"):
        one = read(tmp_path, wav(tone(), extra=chunk(b"auxi", text.encode(encoding))))
        assert (one.segments[0].frequency, one.start) == (145.8e6, (1_772_366_405, 0.0))
    one = read(tmp_path, wav(tone(), extra=auxi(year=0)))
    assert one.start is None and "is none" in one.notes[0]
    one = read(tmp_path, wav(tone(), extra=chunk(b"auxi", b"12")))
    assert one.start is None and "not understood" in one.notes[0]


def test_channels_real_samples_and_long_files(tmp_path):
    four = read(tmp_path, wav(tone(3)))
    assert [part[0].samples.size for part in four.channels] == [SIZE] * 3
    assert_allclose(four.others[1][0].samples, tone(3)[:, 2], atol=1e-4)
    n = np.arange(SIZE)
    real = read(tmp_path, wav(np.cos(2 * np.pi * 0.2 * n)[:, None]))
    assert real.sample_rate == RATE / 2 and real.segments[0].samples.size == SIZE // 2
    assert real.segments[0].frequency == RATE / 4
    # 0.2 of the rate is 0.05 below a quarter of it, twice that of the lower rate; off the ends, which are disturbed
    expected = np.exp(-2j * np.pi * 0.1 * n[: SIZE // 2])
    assert_allclose(real.segments[0].samples[20:-20], expected[20:-20], atol=0.02)
    content = wav(tone())
    at = content.index(b"data") + 4
    long = chunk(b"ds64", struct.pack("<QQQI", 0, 4 * SIZE, SIZE, 0))
    rf64 = b"RF64" + b"\xff" * 4 + b"WAVE" + long + content[12:at] + b"\xff" * 4 + content[at + 4 :]
    assert read(tmp_path, rf64).segments[0].samples.size == SIZE
    unsaid = read(tmp_path, content[:at] + bytes(4) + content[at + 4 :])
    assert unsaid.segments[0].samples.size == SIZE and "does not say how many" in unsaid.notes[0]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "it does not begin with RIFF"),
        (b"RIFF1234WAVX" + bytes(40), "it does not begin with RIFF"),
        (b"RIFF1234WAVE" + chunk(b"data", bytes(8)), "chunk `fmt `: it is missing"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", bytes(3)), "chunk `fmt `: 3 bytes are not allowed"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout(kind=2)), "format 0x2 is not allowed; 1 .whole numbers. or 3"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout(bits=12)), "12 bits are not allowed for format 1; 8, 16, 24, 32"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout(kind=3)), "16 bits are not allowed for format 3; 32, 64"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout(channels=3)), "3 channels are not allowed"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout(rate=0)), "sample rate of 0 Hz is not allowed"),
        (b"RIFF1234WAVE" + chunk(b"fmt ", layout()[:12] + b"\x09\0\x10\0"), "frames of 9 bytes are not allowed; 4"),
        (wav(tone())[:-1], "cut off at byte"),
        (wav(tone(size=1)), "1 samples are not allowed"),
        (wav(tone(), extra=chunk(b"kiwi", bytes(10))), "heard.wav"),
    ],
)
def test_each_field_that_is_wrong_has_its_line(tmp_path, content, said):
    with pytest.raises(UserError, match=said) as caught:
        read(tmp_path, content)
    assert "\n" not in str(caught.value) and "heard.wav" in str(caught.value)


def test_a_file_cut_anywhere(tmp_path):
    """At every tenth byte: one line, or what is there."""
    content = wav(tone(size=60), extra=auxi())
    for end in range(0, len(content), 10):
        with pytest.raises(UserError, match=r"heard\.wav"):
            read(tmp_path, content[:end])


@pytest.mark.parametrize("kind", ["ci16_le", "cu8", "cf32_be", "ri16_le", "cf64", "ci32_be", "ru16_be", "ci8"])
def test_samples_alone(tmp_path, kind):
    """Every type: the same tone, to a unit of its last place."""
    bits = int("".join(c for c in kind[2:4] if c.isdigit()))
    dtype = np.dtype(f"{'>' if kind.endswith('be') else '<'}{kind[1]}{bits // 8}")
    source = tone()[:, 0] if kind[0] == "c" else np.cos(2 * np.pi * 0.2 * np.arange(SIZE))
    numbers = source.view(float) if kind[0] == "c" else source
    if kind[1] != "f":
        numbers = np.rint(numbers * (2 ** (bits - 1) - 1)) + (2 ** (bits - 1) if kind[1] == "u" else 0)
    one = read(tmp_path, numbers.astype(dtype).tobytes(), "a.bin", raw_rate=1e6, raw_type=kind, raw_frequency=1e8)
    samples = one.segments[0].samples
    if kind[0] == "r":
        assert (one.sample_rate, one.segments[0].frequency) == (5e5, 1e8 + 2.5e5)
        samples, source = samples[20:-20], np.exp(-2j * np.pi * 0.1 * np.arange(SIZE // 2))[20:-20]
    assert_allclose(samples, source, atol=0.02 if kind[0] == "r" else max(2.0 ** (1 - bits) * 1.5, 1e-6))


def test_samples_alone_that_are_none(tmp_path):
    for content, raw, said in (
        (bytes(7), {"raw_rate": 1e6, "raw_type": "ci16_le"}, "7 bytes are no whole number of samples"),
        (bytes(8), {"raw_rate": 1e6, "raw_type": "ci12"}, "raw.type: ci12 is not allowed; c or r, then f32"),
        (bytes(8), {"raw_rate": np.inf, "raw_type": "ci16"}, "raw.rate_hz: inf is not allowed"),
        (bytes(8), {}, "a.bin.* cannot be read"),
    ):
        with pytest.raises(UserError, match=said):
            read(tmp_path, content, "a.bin", **raw)
    with pytest.raises(UserError, match="cannot be read"):
        read_iq(tmp_path / "nowhere.bin", 1e6, "ci16_le")
