"""SigMF recordings with an offset, with several captures, and archives of several recordings."""

import io
import json
import tarfile

import numpy as np
import pytest
import sigmf
from numpy.testing import assert_allclose, assert_array_equal

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.iq.sigmf_file import read_sigmf
from quietfix.diagrams.recorded.iq import declare_recordings
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from tests.golden.recordings import report_of

RATE, SIZE, DELAY = 1e6, 40_000, 12.3e-6
NOON = "2026-03-01T12:00:00"


def heard(delay, seed, start=0.0):
    """Noise of an emitter in 0.8 MHz, periodic, so that it is delayed exactly; and white noise 20 dB below."""
    tone = np.fft.fftfreq(SIZE, 1 / RATE)
    spectrum = (np.random.default_rng(11).standard_normal((SIZE, 2)) @ [1, 1j]) * (np.abs(tone) < 0.4e6)
    clean = np.fft.ifft(spectrum * np.exp(2j * np.pi * tone * (start - delay))) * np.sqrt(SIZE / 2 / 0.8)
    return clean + 0.1 * np.random.default_rng(seed).standard_normal((SIZE, 2)) @ [1, 1j] / np.sqrt(2)


def write(folder, name, samples, captures, annotations=(), **info):
    """Write a recording; a capture is a mapping without ``core:``; return the path of its metadata."""
    samples.astype("<c8").tofile(folder / f"{name}.sigmf-data")
    about = {"datatype": "cf32_le", "sample_rate": RATE, "version": "1.2.0", **info}
    meta = {
        "global": {f"core:{k}": v for k, v in about.items()},
        "captures": [{f"core:{k}": v for k, v in one.items()} for one in captures],
        "annotations": [{f"core:{k}": v for k, v in one.items()} for one in annotations],
    }
    path = folder / f"{name}.sigmf-meta"
    path.write_text(json.dumps(meta))
    return path


def compared(*files, **settings):
    chosen = Settings(**{"integration_s": 0.01, **settings})
    return report_of("iq", declare_recordings([one for file in files for one in read_sigmf(file)], chosen), chosen)


@pytest.fixture(scope="module")
def signals():
    return heard(0.0, 1), heard(DELAY, 2)


def test_an_offset_counts_once(tmp_path, signals):
    """Indices that count from the offset, and indices that count from the file's first sample, are the same file.

    Read as the other, each would be 100 samples, 100 us, off; the annotation is of the last samples.
    """
    plain = write(tmp_path, "plain", signals[0], [{"sample_start": 0, "datetime": f"{NOON}Z"}])
    for name, start in (("absolute", 100), ("of_the_file", 0)):
        last = {"sample_start": start + SIZE - 50, "sample_count": 50}
        capture = {"sample_start": start, "datetime": f"{NOON}Z"}
        other = write(tmp_path, name, signals[1], [capture], [last], offset=100)
        pair = compared(plain, other).pairs[0]
        assert pair.good.all() and np.median(pair.sigma_tdoa) < 5e-9
        assert_allclose(pair.tdoa, DELAY, atol=25e-9)
    beyond = {"sample_start": 100 + SIZE - 49, "sample_count": 50}
    write(tmp_path, "beyond", signals[1], [{"sample_start": 100}], [beyond], offset=100)
    with pytest.raises(UserError, match=f"cut off: {SIZE} samples, where its metadata speak of {SIZE + 1}"):
        read_sigmf(tmp_path / "beyond.sigmf-meta")


def test_captures_that_follow_each_other_are_one(tmp_path, signals):
    """By their samples, by a date to its last digit, and by a date of whole seconds that is too early otherwise."""
    for i, second in enumerate(
        ({}, {"datetime": f"{NOON}.0200000Z"}, {"datetime": f"{NOON}.02Z"}, {"datetime": f"{NOON}Z"})
    ):
        captures = [{"sample_start": 0, "datetime": f"{NOON}Z"}, {"sample_start": 20_000, **second}]
        (one,) = read_sigmf(write(tmp_path, f"two_{i}", signals[0], captures))
        assert len(one.segments) == 1
        assert_array_equal(one.segments[0].samples, signals[0].astype("c8"))


@pytest.mark.parametrize("how", ["datetime", "global_index"])
def test_a_gap_stays_a_gap(tmp_path, signals, how, capsys):
    """5000 samples are lost in the middle of the second recording: all that is left is compared, at its own times."""
    plain = write(tmp_path, "plain", signals[0], [{"sample_start": 0, "datetime": f"{NOON}Z"}])
    kept = np.concatenate([signals[1][:15_000], signals[1][20_000:]])
    after = {"datetime": {"datetime": f"{NOON}.020000Z"}, "global_index": {"global_index": 20_000}}[how]
    captures = [{"sample_start": 0, "datetime": f"{NOON}Z"}, {"sample_start": 15_000, **after}]
    other = write(tmp_path, "other", kept, captures)
    (read,) = read_sigmf(other)
    assert [part.begin for part in read.segments] == [0.0, 0.02]
    result = replay("iq", file=[plain, other], progress=False, settings=["integration_s=0.005"])
    assert result.pairs[0].good.all()
    assert_allclose(result.pairs[0].tdoa, DELAY, atol=30e-9)
    assert not np.any((result.times > 0.0125) & (result.times < 0.0225)) and result.times[-1] > 0.0325
    assert result.times.size == 5
    said = " ".join(capsys.readouterr().out.split())
    assert "2 captures that do not follow each other, 0.005 s between them" in said
    assert "0.035 s in common, in 2 pieces" in said


def test_a_capture_may_be_tuned_elsewhere(tmp_path, signals):
    """The second half is heard 50 kHz off: the tuned frequencies of that half count for it."""
    plain = write(tmp_path, "plain", signals[0], [{"sample_start": 0, "frequency": 1e8}])
    shift = np.exp(-2j * np.pi * 50e3 * np.arange(SIZE) / RATE)
    both = np.where(np.arange(SIZE) < 20_000, signals[1], signals[1] * shift)
    captures = [{"sample_start": 0, "frequency": 1e8}, {"sample_start": 20_000, "frequency": 1e8 + 50e3}]
    other = write(tmp_path, "other", both, captures)
    pair = compared(plain, other, integration_s=0.005).pairs[0]
    assert pair.good.all()
    assert_allclose(pair.tdoa, DELAY, atol=30e-9)
    assert_allclose(pair.fdoa, 0.0, atol=1.0)


def test_the_first_date_may_come_late(tmp_path, signals):
    captures = [{"sample_start": 0}, {"sample_start": 20_000, "datetime": "2026-03-01T13:00:00.015+01:00"}]
    (one,) = read_sigmf(write(tmp_path, "late", signals[0], captures))
    (other,) = read_sigmf(write(tmp_path, "plain", signals[0], [{"sample_start": 0, "datetime": f"{NOON}Z"}]))
    assert other.start is not None and one.start == (other.start[0] - 1, pytest.approx(0.995))
    assert len(one.segments) == 1


def test_what_is_before_the_first_capture_is_told(tmp_path, signals):
    plain = write(tmp_path, "plain", signals[0], [])
    other = write(tmp_path, "other", signals[1], [{"sample_start": 300}])
    assert any("300 samples before its first capture" in line for line in compared(plain, other).notes())


@pytest.mark.parametrize(
    ("captures", "said"),
    [
        ([{"sample_start": 0, "datetime": f"{NOON}.500Z"}, {"sample_start": 9, "datetime": f"{NOON}.400Z"}], "before"),
        ([{"sample_start": 0, "global_index": 50}, {"sample_start": 9, "global_index": 50}], "before the one before"),
        ([{"sample_start": 9}, {"sample_start": 0}], "in the order"),
        ([{"sample_start": 0}, {"sample_start": 9, "header_bytes": -8}], "core:header_bytes: -8"),
        ([{"sample_start": 0}, {"sample_start": 9, "header_bytes": 3}], "cut off: 319997 bytes"),
        ([{"sample_start": SIZE}], "a capture that has samples"),
    ],
)
def test_captures_that_cannot_be_are_refused(tmp_path, signals, captures, said):
    with pytest.raises(UserError, match=said):
        read_sigmf(write(tmp_path, "odd", signals[0], captures))


def packed(folder, names):
    """Put files into an archive; return its path."""
    path = folder / "all.sigmf"
    with tarfile.open(path, "w") as tar:
        for name in names:
            content = (folder / name).read_bytes()
            about = tarfile.TarInfo(f"all/{name}")
            about.size = len(content)
            tar.addfile(about, io.BytesIO(content))
    return path


def test_all_recordings_of_an_archive(tmp_path, signals):
    """Each with its own samples and name; one archive of two is enough to be compared."""
    names = []
    for name, samples in zip(("b_first", "a_second"), signals, strict=True):
        write(tmp_path, name, samples, [{"sample_start": 0}])
        names += [f"{name}.sigmf-meta", f"{name}.sigmf-data"]
    path = packed(tmp_path, names)
    found = read_sigmf(path)
    assert [one.name for one in found] == ["a_second", "b_first"]
    assert_array_equal(found[0].segments[0].samples, signals[1].astype("c8"))
    assert_allclose(compared(path).pairs[0].tdoa, -DELAY, atol=25e-9)
    for left_out, said in ((1, "b_first.sigmf-meta: its data are missing"), (2, "sigmf-data has no file beside it")):
        with pytest.raises(UserError, match=said):
            read_sigmf(packed(tmp_path, [name for i, name in enumerate(names) if i != left_out]))


@pytest.mark.parametrize("ending", [".sigmf", ".sigmf.gz", ".sigmf.zip"])
def test_archives_of_the_package_are_read(tmp_path, signals, ending):
    sigmf.fromfile(str(write(tmp_path, "one", signals[0], [{"sample_start": 0}]))).archive(
        str(tmp_path / f"one{ending}")
    )
    (one,) = read_sigmf(tmp_path / f"one{ending}")
    assert_array_equal(one.segments[0].samples, signals[0].astype("c8"))
    (tmp_path / f"one{ending}").write_bytes(b"no archive")
    with pytest.raises(UserError, match="cannot be read"):
        read_sigmf(tmp_path / f"one{ending}")
