"""Recordings of one's own: SigMF files that the tests write, compared by the command."""

import json

import numpy as np
import pytest
import sigmf
from numpy.testing import assert_allclose

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.iq.sigmf_file import read_sigmf
from quietfix.diagrams.recorded.iq import declare_recordings
from quietfix.diagrams.recorded.settings.iq_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER
from tests.fitting import check_fits
from tests.golden.recordings import report_of


def compare(recordings, settings):
    return report_of("iq", declare_recordings(recordings, settings), settings)


RATE, CARRIER = 250e3, 433.9e6
DELAYS, FREQUENCIES = (0.0, 37.25e-6, -120.5e-6), (0.0, 40.0, -15.0)
SIZE = 50_000  # 0.2 s


def write(folder, name, samples, rate=RATE, frequency=CARRIER, stamp=None, datatype="cf32_le", **more):
    """Write a recording; return the path of its metadata."""
    data = folder / f"{name}.sigmf-data"
    if datatype == "ci16_le":
        both = np.stack([samples.real, samples.imag], axis=-1)
        np.rint(both / np.abs(both).max() * 30000).astype("<i2").tofile(data)
    else:
        samples.astype("<c8" if datatype == "cf32_le" else "<f4").tofile(data)
    info = {"core:datatype": datatype, "core:sample_rate": rate, "core:version": "1.0.0", **more}
    recording = sigmf.SigMFFile(data_file=str(data), global_info=info)
    capture = {} if frequency is None else {"core:frequency": frequency}
    if stamp is not None:
        capture["core:datetime"] = stamp
    recording.add_capture(0, metadata=capture)
    path = folder / f"{name}.sigmf-meta"
    recording.tofile(str(path))
    return path


def heard(delay, frequency, rng_noise, start=0.0, noise=0.5):
    """Noise of the emitter in a band of 180 kHz, periodic, so that it is delayed exactly; and white noise."""
    rng = np.random.default_rng(11)
    tone = np.fft.fftfreq(SIZE, 1 / RATE)
    spectrum = (rng.standard_normal((SIZE, 2)) @ [1, 1j]) * (np.abs(tone) < 90e3) * np.sqrt(0.5 * SIZE * RATE / 180e3)
    t = start + np.arange(SIZE) / RATE
    clean = np.fft.ifft(spectrum * np.exp(2j * np.pi * tone * (start - delay))) * np.exp(2j * np.pi * frequency * t)
    white = rng_noise.standard_normal((2, SIZE)) * np.sqrt(0.5) * noise
    return clean + white[0] + 1j * white[1]


@pytest.fixture(scope="module")
def signals():
    rng = np.random.default_rng(1)
    return [heard(delay, f, rng) for delay, f in zip(DELAYS, FREQUENCIES, strict=True)]


@pytest.fixture(scope="module")
def files(tmp_path_factory, signals):
    folder = tmp_path_factory.mktemp("iq")
    kinds = ("cf32_le", "ci16_le", "cf32_le")
    return [
        write(folder, f"receiver_{i}", s, datatype=kind) for i, (s, kind) in enumerate(zip(signals, kinds, strict=True))
    ]


def test_differences_against_time(files, tmp_path, capsys):
    """Three receivers: each comparison within five of its own sigmas, in table, summary, CSV and figure."""
    out = tmp_path / "out"
    result = replay("iq", file=files, out=out, progress=False, settings=["integration_s=0.02"])
    assert result.times.size == 9 and [pair.auxiliary for pair in result.pairs] == ["receiver_1", "receiver_2"]
    for pair, delay, frequency in zip(result.pairs, DELAYS[1:], FREQUENCIES[1:], strict=True):
        assert pair.good.all()
        assert (np.abs(pair.tdoa - delay) < 5 * pair.sigma_tdoa).all() and np.median(pair.sigma_tdoa) < 100e-9
        assert (np.abs(pair.fdoa - frequency) < 5 * pair.sigma_fdoa).all() and np.median(pair.sigma_fdoa) < 1.0
    shown = capsys.readouterr().out
    check_fits(result.table())
    assert "37.2" in shown and "begin together" in shown
    summary = json.loads((out / "summary.json").read_text())
    assert_allclose(summary["pairs"]["receiver_2 - receiver_0"]["tdoa_s"], -120.5e-6, atol=1e-6)
    lines = (out / "differences.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * 9 and lines[0].startswith("time_s,main,auxiliary,tdoa_s")
    assert (out / "differences.png").stat().st_size > 10_000


def test_an_earlier_result_is_replaced(files, tmp_path, capsys):
    command = ["replay", "iq", *map(str, files[:2]), "--out", str(tmp_path / "out"), "--set", "integration_s=0.05"]
    for extra in ([], ["--overwrite"]):
        with pytest.raises(SystemExit) as stop:
            main([*command, *extra])
        assert stop.value.code == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        MARKER,
        "diagram.svg",
        "differences.csv",
        "differences.png",
        "measurements.csv",
        "results.zarr",
        "summary.json",
    ]


def test_times_of_the_files_count(tmp_path, signals):
    """The second file begins 1.5 ms later, in the next second: the same wave is as late as before."""
    later = heard(DELAYS[1], FREQUENCIES[1], np.random.default_rng(3), start=1.5e-3)
    one = write(tmp_path, "one", signals[0], stamp="2026-03-01T12:00:00.9990000001Z")
    two = write(tmp_path, "two", later, stamp="2026-03-01T13:00:01.0005000001+01:00")
    result = compare([*read_sigmf(one), *read_sigmf(two)], Settings(integration_s=0.05))
    assert result.dated and result.pairs[0].good.all()
    assert_allclose(result.pairs[0].tdoa, DELAYS[1], atol=0.3e-6)


def test_a_window_beside_the_peak_gives_nothing(files):
    result = compare([read_sigmf(f)[0] for f in files[:2]], Settings(0.05, half_frequency_hz=10.0))
    assert not result.pairs[0].good.any() and "edge" in result.notes()[-1]
    assert "0 of" in result.table().rows[0][-1].text
    json.dumps(result.summary(), allow_nan=False)


def test_a_band(files):
    result = compare([read_sigmf(f)[0] for f in files[:2]], Settings(0.05, low_hz=-40e3, high_hz=30e3, notch_hz=100.0))
    assert result.pairs[0].good.all()
    assert_allclose(result.pairs[0].tdoa, DELAYS[1], atol=2e-6)


def test_an_archive(tmp_path, files):
    recording = sigmf.fromfile(str(files[0]))
    recording.archive(name=str(tmp_path / "packed.sigmf"))
    (packed,), (alone,) = read_sigmf(tmp_path / "packed.sigmf"), read_sigmf(files[0])
    assert packed.name == "packed" and packed.start is None
    assert_allclose(packed.segments[0].samples, alone.segments[0].samples)


def refused(capsys, arguments):
    """Run the command; return its one line on standard error."""
    with pytest.raises(SystemExit) as stop:
        main(["replay", "iq", *map(str, arguments)])
    assert stop.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


def test_cut_off_data(tmp_path, signals, files, capsys):
    """In the middle of a sample, at a whole sample (the checksum tells), and without a checksum (annotations tell)."""
    for cut, said in (
        (4, "cut off or changed"),
        (80, "cut off or changed"),
        (None, "cut off: 49990 samples, where its metadata speak of 50000"),
    ):
        path = write(tmp_path, f"cut_{cut}", signals[0])
        data = path.with_suffix(".sigmf-data")
        if cut is None:
            meta = json.loads(path.read_text())
            del meta["global"]["core:sha512"]
            meta["captures"].append({"core:sample_start": 50_000})
            path.write_text(json.dumps(meta))
        data.write_bytes(data.read_bytes()[: -(cut or 80)])
        assert said in refused(capsys, [files[0], path])


def test_a_recording_that_is_much_shorter_is_named(tmp_path, signals):
    """A fifth of one recording: the other four fifths of the rest are compared with nothing."""
    files = [write(tmp_path, f"r{k}", x[: SIZE // 5 if k == 1 else SIZE]) for k, x in enumerate(signals)]
    notes = compare([one for path in files for one in read_sigmf(path)], Settings()).notes()
    told = [note for note in notes if note.startswith("only")]
    assert told == [
        "only 0.04 s are compared, of the 0.2 s of r0: what all have in common; the shortest is r1 with 0.04 s; "
        "is a file cut?"
    ]


def test_what_does_not_fit(tmp_path, signals, files, capsys):
    short = write(tmp_path, "short", signals[0][:1000])
    line = refused(capsys, [files[0], short, "--set", "integration_s=0.1"])
    assert "0.004 s in common are not allowed; at least the 0.1 s" in line
    dated = write(tmp_path, "dated", signals[0], stamp="2026-03-01T12:00:00Z")
    assert "receiver_0 does not say when it begins" in refused(capsys, [files[0], dated])
    elsewhen = write(tmp_path, "elsewhen", signals[0], stamp="2026-03-01T12:00:09Z")
    assert "in common" in refused(capsys, [dated, elsewhen, "--set", "integration_s=0.01"])
    assert "no time in common" in refused(capsys, [dated, elsewhen])
    elsewhere = write(tmp_path, "elsewhere", signals[0], frequency=CARRIER + RATE)
    assert "tuned 250000 Hz apart" in refused(capsys, [files[0], elsewhere])
    odd = write(tmp_path, "odd", signals[0])
    text = odd.read_text()
    for new, said in ((json.dumps("soon"), "core:datetime: 'soon'"), ('"2026-13-01T00:00:00Z"', "core:datetime")):
        odd.write_text(text.replace('"core:sample_start": 0', f'"core:sample_start": 0, "core:datetime": {new}'))
        assert said in refused(capsys, [dated, odd])
    odd.write_text(text.replace("250000.0", '"fast"'))
    assert "core:sample_rate" in refused(capsys, [dated, odd])


def test_what_is_no_recording(tmp_path, signals, files, capsys):
    assert "FILE: 1 recording(s) are not allowed; two or more" in refused(capsys, files[:1])
    assert "FILE: it is missing" in refused(capsys, [])
    assert "nowhere.sigmf-meta cannot be read" in refused(capsys, [files[0], tmp_path / "nowhere.sigmf-meta"])
    broken = tmp_path / "broken.sigmf-meta"
    broken.write_text("{")
    assert "broken.sigmf-meta cannot be read" in refused(capsys, [files[0], broken])
    lonely = write(tmp_path, "lonely", signals[0])
    lonely.with_suffix(".sigmf-data").unlink()
    assert "lonely.sigmf-meta: its data are missing" in refused(capsys, [files[0], lonely])


def test_settings(files, capsys):
    assert "integration" in refused(capsys, [*files, "--set", "integration=1"])
    assert "every_s" in refused(capsys, [*files, "--set", "every_s=-1"])
    assert "confidence" in refused(capsys, [*files, "--set", "confidence=2"])
    assert "half_delay" in refused(capsys, [*files, "--set", "half_delay_us=-3"])
    assert "half_delay_us: 1e+09" in refused(capsys, [*files, "--set", "half_delay_us=1e9"])
    assert "at least a sample" in refused(capsys, [*files, "--set", "every_s=1e-9"])
    assert "frequency_hz: 1e+06" in refused(capsys, [*files, "--set", "frequency_hz=1e6"])
    assert "low_hz, high_hz, notch_hz" in refused(capsys, [*files, "--set", "low_hz=3e5", "--set", "high_hz=4e5"])
    assert "low < high" in refused(capsys, [*files, "--set", "low_hz=2", "--set", "high_hz=1"])
    with pytest.raises(UserError, match="a: a is not known; there are"):
        replay("locards", settings=["a=1"], data="/work")
    with pytest.raises(UserError, match="2 files are not allowed for bearings; one"):
        replay("bearings", file=["a", "b"])
