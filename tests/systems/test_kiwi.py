"""Recordings with GPS stamps: the reader, the common base of time, and the block that plays a recording."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.kiwi import GpsRecording, common_base, read_kiwi
from quietfix.systems.iq.resample import interpolate, resampled
from quietfix.systems.iq.stamped import Clock
from quietfix.systems.signal_chain.recorded_iq import RecordedIq

RATE, START = 12001.06, 370358.25


def kiwi_file(
    path,
    samples=None,
    rate=RATE,
    start=START,
    stale=2,
    blocks=40,
    jitter=0.0,
    form=(1, 2, 16),
    drop=0,
    stamps=None,
    age=1,
):
    """Write such a file; samples as complex whole numbers."""
    n = 512 * blocks
    if samples is None:
        samples = (np.arange(n) % 1000) - 1j * (np.arange(n) % 77)
    head = struct.pack("<HHIIHH", form[0], form[1], 12001, 48004, 4, form[2])
    body = b"WAVE" + b"fmt " + struct.pack("<I", 16) + head
    for k in range(blocks):
        stamp = 12345.5 if k < stale else start + 512 * k / rate + jitter * (-1) ** k
        stamp = (stamp if stamps is None else stamps[k]) % 604800.0
        whole, rest = divmod(round(stamp * 1e9), 10**9)
        body += b"kiwi" + struct.pack("<IBBII", 10, age, 0, whole, rest)
        part = samples[512 * k : 512 * (k + 1)]
        both = np.stack([part.real, part.imag], axis=-1).astype("<i2").tobytes()
        body += b"data" + struct.pack("<I", len(both)) + both
    data = b"RIFF" + struct.pack("<I", len(body)) + body
    path.write_bytes(data[: len(data) - drop])
    return samples


@pytest.mark.parametrize("stale", [0, 1, 3])
def test_reader(tmp_path, stale):
    """Blocks whose stamps are left over from before are left out: nothing says when they were."""
    written = kiwi_file(tmp_path / "a.wav", stale=stale)
    read = read_kiwi(tmp_path / "a.wav")
    (part,) = read.parts
    assert_array_equal(part.samples, written[512 * stale :])
    assert (read.stale, read.false, read.lost, read.cut) == (stale, 0, 0, False) and not read.notes()
    assert_allclose(read.sample_rate, RATE, rtol=1e-9)
    assert_allclose(part.start, START + 512 * stale / RATE, rtol=0, atol=5e-9)  # stamps are whole nanoseconds
    assert_allclose(part.end - part.start, (512 * (40 - stale) - 1) / RATE, rtol=1e-9)
    assert read.scatter < 1e-9


@pytest.mark.parametrize("where", [1, 17, 38, 39])
@pytest.mark.parametrize("off", [-3e3, -5e-5, 1.0, 7e5])
def test_a_false_stamp_costs_at_most_its_block(tmp_path, where, off):
    """Wherever it is and however far off; the others tell when its samples were."""
    stamps = START + 512 * np.arange(40) / RATE
    stamps[where] += off
    kiwi_file(tmp_path / "a.wav", stale=0, stamps=stamps)
    read = read_kiwi(tmp_path / "a.wav")
    assert sum(part.samples.size for part in read.parts) >= 512 * (40 - 2) and len(read.parts) == 1
    part = read.parts[0]
    begins = (part.start - START) * RATE / 512
    assert_allclose(begins, round(begins), atol=1e-3)
    if where == 17:  # near an end there are too few beyond that would tell
        assert part.samples.size == 512 * 40 and read.false == 1
        assert "1 time stamp(s) that are not those of a steady clock" in read.notes()[0]


def test_lost_samples_are_a_gap(tmp_path):
    """Two blocks that did not arrive: what follows is a part of its own, at its own time."""
    stamps = START + 512 * np.arange(60) / RATE
    stamps[30:] += 1024 / RATE
    written = kiwi_file(tmp_path / "a.wav", stale=0, blocks=60, stamps=stamps)
    read = read_kiwi(tmp_path / "a.wav")
    assert [part.samples.size for part in read.parts] == [512 * 30, 512 * 30]
    assert_array_equal(read.parts[1].samples, written[512 * 30 :])
    assert_allclose(read.parts[1].start, stamps[30], rtol=0, atol=5e-9)
    assert "0.0853 s of samples are missing" in read.notes()[0] and read.false == 0


def test_the_end_of_the_week(tmp_path):
    kiwi_file(tmp_path / "a.wav", start=604799.5)
    (part,) = read_kiwi(tmp_path / "a.wav").parts
    assert_allclose(part.end - part.start, (512 * 38 - 1) / RATE, rtol=1e-9)


def test_a_clock_that_drifts(tmp_path):
    """Four parts in 1e9 per second, as an oscillator warms up: times follow the stamps, not one line."""
    place = 512.0 * np.arange(1500)
    time = place / RATE + 2e-9 * (place / RATE) ** 2
    kiwi_file(tmp_path / "a.wav", stale=0, blocks=1500, stamps=START + time)
    read = read_kiwi(tmp_path / "a.wav")
    (part,) = read.parts
    # a line would be off by 2e-9 * 64^2 / 6 = 1.4 us at the ends, pieces of 9 s by 2e-9 * 9^2 / 6 = 0.03 us
    assert_allclose(part.clock.time(place), START + time, rtol=0, atol=6e-8)
    assert_allclose(part.clock.place(part.clock.time(place)), place, atol=1e-5)


def test_a_recording_that_was_cut_off(tmp_path):
    written = kiwi_file(tmp_path / "a.wav", stale=0, drop=3)
    read = read_kiwi(tmp_path / "a.wav")
    assert_array_equal(read.parts[0].samples, written[:-512])
    assert read.cut and read.notes() == ["it is cut off; the last block is left out"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"form": (1, 1, 16)}, "format is not allowed"),
        ({"form": (1, 2, 8)}, "format is not allowed"),
        ({"blocks": 5}, "5 stamps are not allowed"),
        ({"jitter": 1e-5}, "off a steady clock"),
        ({"stale": 32}, "not those of a steady clock"),
        ({"age": 255}, "had no GPS"),
    ],
)
def test_broken_files_are_named(tmp_path, options, said):
    kiwi_file(tmp_path / "bad.wav", **options)
    with pytest.raises(ValueError, match=rf"bad\.wav.*{said}"):
        read_kiwi(tmp_path / "bad.wav")


@pytest.mark.parametrize("seed", range(4))
def test_damaged_files(tmp_path, seed):
    """Cut, with other bytes, with other sizes of chunks: refused in one line, or every part is where it was."""
    rng = np.random.default_rng(seed)
    kiwi_file(tmp_path / "whole.wav", stale=0)
    whole = (tmp_path / "whole.wav").read_bytes()
    read = 0
    for k in range(50):
        data = bytearray(whole)
        if k % 3 == 0:
            data = data[: rng.integers(len(data))]
        elif k % 3 == 1:
            for place in rng.integers(len(data), size=20):
                data[place] = rng.integers(256)
        else:
            place = 36 + 2074 * int(rng.integers(40)) + 18 * int(rng.integers(2)) + int(rng.integers(8))
            data[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "bad.wav").write_bytes(data)
        try:
            parts = read_kiwi(tmp_path / "bad.wav").parts
        except ValueError as error:
            assert str(error).startswith(str(tmp_path / "bad.wav")) and "\n" not in str(error)
            continue
        read += 1
        blocks = [(part.start - START) * RATE / 512 for part in parts]
        assert_allclose(blocks, np.round(blocks), atol=1e-3)
    assert read > 25


def test_other_files(tmp_path):
    (tmp_path / "text.wav").write_text("latitude")
    with pytest.raises(ValueError, match="does not begin with RIFF"):
        read_kiwi(tmp_path / "text.wav")
    kiwi_file(tmp_path / "plain.wav")
    data = (tmp_path / "plain.wav").read_bytes().replace(b"kiwi", b"note")
    (tmp_path / "plain.wav").write_bytes(data)
    with pytest.raises(ValueError, match=r"0 stamps .* and 40 blocks"):
        read_kiwi(tmp_path / "plain.wav")


def test_interpolation():
    """A band of 0.8 of the sample rate, exact at any time; the ends have to be left out."""
    rng = np.random.default_rng(0)
    tones, phase = rng.uniform(-0.4, 0.4, 20), rng.uniform(0, 2 * np.pi, 20)

    def signal(n):
        return np.exp(1j * (2 * np.pi * tones * n[:, None] + phase)).sum(axis=-1)

    n = np.arange(400.0)
    place = np.arange(40.3, 360, 0.93)
    both = np.stack([signal(n), 2 * signal(n)])
    # -90 dB of the window, times twenty tones
    assert_allclose(interpolate(both, place), [signal(place), 2 * signal(place)], atol=2e-3)
    assert_allclose(interpolate(both[0], n), both[0], atol=1e-9)
    assert_array_equal(interpolate(both[0], np.array([-500.0, 1e6])), 0.0)


def test_resampled_blocks_keep_their_time():
    block = IqBlock(np.exp(2j * np.pi * 0.05 * np.arange(1000)), 1000.0, 5.0, 7.0)
    other = resampled(block, 900.0)
    assert other.sample_rate == 900.0 and other.centre_frequency == 5.0 and other.start_time[0] == 7.0
    assert other.size == 900
    expected = np.exp(2j * np.pi * 50.0 * np.arange(900) / 900.0)
    assert_allclose(other.samples[0, 50:850], expected[50:850], atol=1e-3)


def recording(samples, start, rate):
    nothing = np.zeros(0)
    return (GpsRecording(samples, Clock(start, rate, nothing, nothing)),)


def test_common_base():
    """A tone heard by two receivers that begin at different times with different rates: the same samples."""
    recordings = []
    for start, rate, count in ((100.2, 12001.0, 5000), (100.25, 11999.5, 4000)):
        time = start + np.arange(count) / rate
        recordings.append(recording(np.exp(2j * np.pi * 300.0 * time), start, rate))
    blocks, begin = common_base(recordings, 12000.0, 77500.0)
    blocks = [block for (block,) in blocks]
    assert begin == 100.25 and blocks[0].size == blocks[1].size == 4000
    inner = slice(50, -50)
    time = begin + np.arange(blocks[0].size) / 12000.0
    for block in blocks:
        assert_allclose(block.samples[0, inner], np.exp(2j * np.pi * 300.0 * time)[inner], atol=1e-4)
    late = recording(recordings[0][0].samples, 200.0, 12001.0)
    with pytest.raises(ValueError, match="no time in common"):
        common_base([recordings[0], late], 12000.0, 77500.0)


def test_common_base_over_the_end_of_the_week():
    tone = np.exp(2j * np.pi * 0.02 * np.arange(6000))
    blocks, begin = common_base([recording(tone, 604799.9, 12000.0), recording(tone, 0.1, 12000.0)], 12000.0, 1e5)
    assert_allclose(begin, 0.1, atol=1e-9)
    assert abs(blocks[0][0].size - 0.3 * 12000) <= 2 and blocks[0][0].size == blocks[1][0].size


def test_a_recording_is_played():
    whole = IqBlock(np.arange(100) + 0j, 10.0, 3.0, 2.0)
    builder = DiagramBuilder()
    block = builder.AddSystem(RecordedIq(whole, Periodic(1.0, 3.0), samples=5, margin=3))
    context = builder.Build().CreateDefaultContext()

    def played(time):
        context.SetTime(time)
        return block.GetOutputPort("iq").Eval(block.GetMyContextFromRoot(context))

    iq = played(4.0)  # 2 s after the first sample: number 20 is the middle
    assert_array_equal(iq.samples[0].real, np.arange(15, 26))
    assert_allclose(iq.mid_time, 4.0)
    assert_allclose(iq.start_time, 3.5)
    assert np.isnan(played(4.5).samples).all() and played(4.5).size == 5
    assert_array_equal(played(12.0).samples[0].real, np.arange(95, 100))  # what there is
    assert np.isnan(played(30.0).samples).all()
    with pytest.raises(ValueError, match="100 samples are not allowed; at least the 101"):
        RecordedIq(whole, Periodic(1.0), 101)
    with pytest.raises(ValueError, match="margin"):
        RecordedIq(whole, Periodic(1.0), 10, -1)
