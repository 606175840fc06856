"""SigMF in full: every type, header bytes, channels, collections, places; each field that is wrong has its line."""

import hashlib
import json
import tarfile

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from quietfix.diagrams.readers.iq.sigmf_file import read_sigmf
from quietfix.diagrams.schema.errors import UserError

SIZE = 200
TYPES = ["cf32_le", "cf32_be", "cf64_le", "ci32_be", "ci16_le", "cu16_be", "cu32_le", "ci8", "cu8"]


def tone(channels=1, size=SIZE):
    n = np.arange(size)[:, None]
    return 0.5 * np.exp(2j * np.pi * (0.01 * n + 0.1 * np.arange(channels)))


def packed(samples, kind):
    """Bytes of samples of a SigMF type."""
    bits = int("".join(c for c in kind[2:4] if c.isdigit()))
    numbers = samples.view(float) if np.iscomplexobj(samples) else samples
    if kind[1] != "f":
        numbers = np.rint(numbers * (2 ** (bits - 1) - 1)) + (2 ** (bits - 1) if kind[1] == "u" else 0)
    return numbers.astype(f"{'>' if kind.endswith('_be') else '<'}{kind[1]}{bits // 8}").tobytes()


def write(folder, name="a", content=None, captures=({"sample_start": 0},), annotations=(), data=None, **info):
    """Write a recording; fields are without ``core:``."""
    about = {"datatype": "cf32_le", "sample_rate": 1e3, **info}
    data = data or f"{name}.sigmf-data"
    if content is None:
        content = packed(tone(), about["datatype"] if about["datatype"] in TYPES else TYPES[0])
    (folder / data).write_bytes(content)
    meta = {
        "global": {f"core:{k}": v for k, v in about.items()},
        "captures": [{f"core:{k}": v for k, v in one.items()} for one in captures],
        "annotations": [{f"core:{k}": v for k, v in one.items()} for one in annotations],
    }
    path = folder / f"{name}.sigmf-meta"
    path.write_text(json.dumps(meta))
    return path


@pytest.mark.parametrize("kind", TYPES)
def test_every_type(tmp_path, kind):
    (one,) = read_sigmf(write(tmp_path, datatype=kind))
    bits = int("".join(c for c in kind[2:4] if c.isdigit()))
    assert_allclose(one.segments[0].samples, tone()[:, 0], atol=2.0 ** (1 - bits) * 1.5 if kind[1] != "f" else 1e-7)


@pytest.mark.parametrize("kind", ["rf32_le", "ri16_be", "ru8", "rf64_be"])
def test_real_samples_are_made_complex(tmp_path, kind):
    """At half the rate about a quarter of it: 0.2 of 1 kHz is 50 Hz below 250 Hz. Ends are disturbed."""
    n = np.arange(2 * SIZE)
    real = 0.5 * np.cos(2 * np.pi * 0.2 * n)
    captures = [{"sample_start": 0, "frequency": 1e6}]
    (one,) = read_sigmf(write(tmp_path, content=packed(real, kind), datatype=kind, captures=captures))
    assert (one.sample_rate, one.segments[0].frequency, one.segments[0].samples.size) == (500.0, 1e6 + 250.0, SIZE)
    expected = 0.5 * np.exp(-2j * np.pi * 0.1 * n[:SIZE])
    assert_allclose(one.segments[0].samples[20:-20], expected[20:-20], atol=0.03)
    assert "core:frequency is taken to be that of 0 Hz" in one.notes[-1]


def test_header_and_trailing_bytes(tmp_path):
    """Bytes before two of three captures and behind all are no samples; the captures still follow each other."""
    body = packed(tone(), "ci16_le")
    content = b"12345" + body[:400] + b"1" + body[400:] + b"123"
    captures = [{"sample_start": 0, "header_bytes": 5}, {"sample_start": 50}, {"sample_start": 100, "header_bytes": 1}]
    (one,) = read_sigmf(write(tmp_path, content=content, captures=captures, datatype="ci16_le", trailing_bytes=3))
    assert [part.samples.size for part in one.segments] == [100, 100]
    assert_allclose([part.begin for part in one.segments], [0.0, 0.1])
    assert_allclose(np.concatenate([part.samples for part in one.segments]), tone()[:, 0], atol=1e-4)


def test_channels_with_a_gap(tmp_path):
    """Three channels lie beside each other, and each has both captures."""
    captures = [{"sample_start": 0}, {"sample_start": 120, "global_index": 150}]
    path = write(tmp_path, content=packed(tone(3), "ci16_be"), captures=captures, datatype="ci16_be", num_channels=3)
    (one,) = read_sigmf(path)
    assert len(one.channels) == 3
    for i, parts in enumerate(one.channels):
        assert [part.begin for part in parts] == [0.0, 0.15]
        assert_allclose(np.concatenate([part.samples for part in parts]), tone(3)[:, i], atol=1e-4)


def test_places(tmp_path):
    """Of captures with their times, in another order than the numbers; else of the whole recording."""
    here, there = ({"type": "Point", "coordinates": one} for one in ([11.5, 48.1, 500.0], [11.6, 48.2]))
    captures = [{"sample_start": 0, "geolocation": here}, {"sample_start": 50}, {"sample_start": 100}]
    captures[2] |= {"geolocation": there}
    (one,) = read_sigmf(write(tmp_path, captures=captures, geolocation=there))
    assert_array_equal(one.places, [[0.0, 48.1, 11.5, 500.0], [0.1, 48.2, 11.6, 0.0]])
    (one,) = read_sigmf(write(tmp_path, geolocation=here))
    assert_array_equal(one.places, [[0.0, 48.1, 11.5, 500.0]])
    assert read_sigmf(write(tmp_path))[0].places is None


def test_a_collection(tmp_path):
    """Its recordings in its order; one that is another file than the collection's is refused."""
    metas = [write(tmp_path, name) for name in ("west", "east")]
    streams = [{"name": path.name[:-11], "hash": hashlib.sha512(path.read_bytes()).hexdigest()} for path in metas]
    file = tmp_path / "both.sigmf-collection"
    file.write_text(json.dumps({"collection": {"core:version": "1.2.0", "core:streams": streams}}))
    assert [one.name for one in read_sigmf(file)] == ["west", "east"]
    metas[1].write_text(metas[1].read_text() + " ")
    with pytest.raises(UserError, match=r"core:streams: east.sigmf-meta is another file than the collection's"):
        read_sigmf(file)
    for streams, said in (
        (None, "core:streams: null"),
        ([], r"core:streams: \[\]"),
        ([{"name": "../x"}], "core:streams"),
        ([{"name": "gone"}], "gone.sigmf-meta cannot be read"),
    ):
        file.write_text(json.dumps({"collection": {"core:streams": streams}}))
        with pytest.raises(UserError, match=said):
            read_sigmf(file)


def test_a_file_of_samples_of_another_name(tmp_path):
    path = write(tmp_path, data="samples.bin", dataset="samples.bin")
    assert_allclose(read_sigmf(path)[0].segments[0].samples, tone()[:, 0], atol=1e-7)
    path = write(tmp_path, data="samples.bin", dataset="../samples.bin")
    with pytest.raises(UserError, match=r'core:dataset: "../samples.bin" is not allowed'):
        read_sigmf(path)


POINT = {"type": "Point", "coordinates": [11.5, 48.1]}


@pytest.mark.parametrize(
    ("about", "said"),
    [
        ({"datatype": "cf16_le"}, "core:datatype: cf16_le is not allowed; c or r, then f32"),
        ({"datatype": 3}, "core:datatype: 3 is not allowed"),
        ({"sample_rate": "fast"}, "core:sample_rate: fast is not allowed"),
        ({"sample_rate": None}, "core:sample_rate: None is not allowed"),
        ({"num_channels": 3}, "cut off: 1600 bytes of samples are no multiple of 24 bytes"),
        ({"num_channels": True}, "core:num_channels: true is not allowed; 1 to 64"),
        ({"offset": -1}, "core:offset: -1 is not allowed"),
        ({"trailing_bytes": 1}, "cut off: 1599 bytes"),
        ({"metadata_only": True}, "core:metadata_only: true is not allowed"),
        ({"sha512": "00"}, "cut off or changed"),
        ({"geolocation": {"type": "Point", "coordinates": [11.5, 98.1]}}, "core:geolocation: .* is not allowed; a Geo"),
        ({"geolocation": {"type": "LineString", "coordinates": [11.5, 48.1]}}, "core:geolocation"),
        ({"captures": [{"sample_start": -1}]}, "core:sample_start: -1 is not allowed"),
        ({"captures": [{"sample_start": 0, "frequency": -1e6}]}, "core:frequency: -1e.06 is not allowed; >= 0 Hz"),
        ({"captures": [{"sample_start": 0, "datetime": "noon"}]}, "core:datetime: 'noon' is not allowed"),
        ({"captures": [{"sample_start": 0, "global_index": 0.5}]}, "core:global_index: 0.5 is not allowed"),
        ({"captures": [{"sample_start": 0, "header_bytes": "2"}]}, "core:header_bytes: 2 is not allowed"),
        ({"captures": [{"sample_start": 0, "geolocation": [1, 2]}]}, r"core:geolocation: \[1, 2\] is not allowed"),
        ({"annotations": [{"sample_start": 150, "sample_count": 51}]}, "cut off: 200 samples, where its metadata"),
    ],
)
def test_each_field_that_is_wrong_has_its_line(tmp_path, about, said):
    with pytest.raises(UserError, match=said) as caught:
        read_sigmf(write(tmp_path, **about))
    assert "\n" not in str(caught.value) and "a.sigmf-meta" in str(caught.value)


@pytest.mark.parametrize("what", ["meta", "tar", "gz"])
def test_a_file_cut_anywhere(tmp_path, what):
    """At every tenth byte of metadata, and of an archive: one line, or, behind its last file, all of it."""
    meta = write(tmp_path, geolocation=POINT, captures=[{"sample_start": 0, "frequency": 1e6}])
    file = meta
    if what != "meta":
        file = tmp_path / f"all.sigmf{'.gz' if what == 'gz' else ''}"
        with tarfile.open(file, "w:gz" if what == "gz" else "w") as tar:
            for name in ("a.sigmf-meta", "a.sigmf-data"):
                tar.add(tmp_path / name, name)
    content = file.read_bytes()
    whole = read_sigmf(file)[0].segments[0].samples
    refused = 0
    for end in range(0, len(content), 10):
        file.write_bytes(content[:end])
        try:
            (one,) = read_sigmf(file)
            assert_array_equal(one.segments[0].samples, whole)
        except UserError as error:
            refused += 1
            assert "\n" not in str(error) and str(file) in str(error)
    assert refused > 10


def test_dates_with_few_digits_are_told(tmp_path):
    for stamp, told in (("12:00:00Z", "digits down to 1 s, 1e.03 samples"), ("12:00:00.0000000Z", "")):
        captures = [{"sample_start": 0, "datetime": f"2026-03-01T{stamp}"}]
        notes = " ".join(read_sigmf(write(tmp_path, captures=captures))[0].notes)
        assert bool(told) == bool(notes) and (not told or told.replace(".", "+") in notes)
