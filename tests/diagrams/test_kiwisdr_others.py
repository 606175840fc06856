"""Other receivers, another frequency, faults: recordings made here, of a transmitter at a known place."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.kiwisdr.folder import read_folder
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.geometry.wave_path import WavePath
from tests.diagrams import kiwi_files

SHORT = ["integration_s=0.5"]


def run(folder, *settings):
    return replay("kiwisdr", data=folder, progress=False, settings=[*SHORT, *settings])


def off(report, source=kiwi_files.TRANSMITTER):
    """Distance of the fix from where the transmitter is [m], whether the program knows or not."""
    return np.linalg.norm(report.fix.estimate[-1] - kiwi_files.place(source))


def test_five_receivers_of_a_known_transmitter(tmp_path):
    """A recording over the end of the GPS week, at night, at 198 kHz: 0.2 km are claimed, and hold."""
    found = run(kiwi_files.write(tmp_path, 1))
    assert found.data.frequency == 198e3 and len(found.pairs) == 10 and found.times.size >= 10
    assert found.fix.error < 4 * found.fix.sigma < 1500.0
    for pair, one in found.pairs.items():
        mean = np.mean(one.tdoa[one.good])
        assert abs(mean - found.true_difference(pair)) < 5 * one.typical_sigma / np.sqrt(one.good.sum())
    assert not found.sky.uncovered and found.sky.day is False
    assert any("by night" in note for note in found.notes()) and not any("understates" in n for n in found.notes())


def test_unknown_transmitter_of_three(tmp_path):
    """Two differences meet in two places: the nearer one is taken, and the other one named."""
    found = run(kiwi_files.write(tmp_path, 2, names=("ALFA", "BRAVO", "CH-3"), known=False))
    assert off(found) < 4 * found.fix.sigma < 4e3
    notes = "\n".join(found.notes())
    assert "as well; the fix is the place nearest" in notes and "three receivers leave nothing over" in notes
    summary = found.summary()
    assert summary["fix"]["horizontal_error_m"] is None and summary["pairs"]["BRAVO - ALFA"]["true_s"] is None
    assert summary["sigma_horizontal_with_sky_wave_m"] > 10 * found.fix.sigma


def test_faults_cost_what_they_hit(tmp_path):
    """A false stamp, lost blocks, a file without GPS and one without a place: the others give the fix."""

    def edit(name, samples, stamps):
        if name == "ALFA":
            stamps[60] += 0.3
        if name == "BRAVO":  # three blocks never came
            kept = [k for k in range(stamps.size) if not 70 <= k < 73]
            samples = samples.reshape(-1, 512)[kept].ravel()
            stamps = stamps[kept]
        if name == "ECHO":
            stamps = 0 * stamps
        return samples, stamps

    folder = kiwi_files.write(tmp_path, 3, edit=edit, known=False)
    stray = folder / "20210605T235937Z_198000_F0XYZ_iq.wav"
    stray.write_bytes((folder / "20210605T235937Z_198000_ALFA_iq.wav").read_bytes())
    found = run(folder)
    assert found.data.names == ["ALFA", "BRAVO", "CH-3", "DELTA"] and [
        len(one.parts) for one in found.data.recordings
    ] == [1, 2, 1, 1]
    assert off(found) < 4 * found.fix.sigma
    notes = "\n".join(found.notes())
    assert "ALFA: 1 time stamp(s)" in notes and "BRAVO: 0.128 s of samples are missing" in notes
    assert "F0XYZ: left out: stations.csv does not say where it stands" in notes and "ECHO: left out" in notes
    # whole windows on either side of the gap: one of some ten is lost
    assert 8 <= found.times.size <= 10


def test_a_wave_by_the_sky(tmp_path):
    """70 us more at one receiver: the claimed covariance cannot cover it, whoever transmits; the wider one can."""
    for known in (True, False):
        found = run(kiwi_files.write(tmp_path / str(known), 4, extra={"DELTA": 70e-6}, known=known))
        assert found.sky.uncovered and off(found) > 5 * found.fix.sigma
        assert any("understates the error" in note and "sky wave" in note for note in found.notes())
        assert off(found) < 3 * found.summary()["sigma_horizontal_with_sky_wave_m"]


def test_all_by_the_sky(tmp_path):
    """9.5 MHz, one hop by a layer at 300 km: the program says what to set, and with that it is right."""
    names = ("ALFA", "BRAVO", "CH-3", "DELTA")
    folder = kiwi_files.write(tmp_path, 5, names=names, frequency=9500000, known=False, path=WavePath(300e3))
    wrong = run(folder)
    assert any("--set mirror_km=300" in note for note in wrong.notes()) and off(wrong) > 20e3
    right = run(folder, "mirror_km=300")
    assert off(right) < 4 * right.fix.sigma and not right.sky.uncovered


def test_a_false_clock_is_longer_than_light(tmp_path):
    """All stamps of one receiver 5 ms off: no wave is that late."""
    found = run(kiwi_files.write(tmp_path, 6, edit=lambda n, z, t: (z, t + 5e-3 * (n == "CH-3"))), "half_delay_s=0.01")
    assert any("longer than the ground wave allows" in note for note in found.notes())


def test_tables_and_names(tmp_path):
    """Positions from KiwiSDR's own files or a named table; a name's signs do not count; frequencies apart."""
    folder = kiwi_files.write(tmp_path / "a", 7, seconds=3.0)
    (folder / "stations.csv").unlink()
    with pytest.raises(UserError, match="nothing there says where the receivers stand"):
        read_folder(folder)
    (folder / "gnss_pos").mkdir()
    for name, (latitude, longitude) in kiwi_files.PLACES.items():
        text = f"d.X = struct('coord', [{latitude},{longitude}], 'host', 'x', 'port', 8073);\n"
        (folder / "gnss_pos" / f"{name.replace('-', '_')}.txt").write_text(text)
    data = read_folder(folder)
    assert sorted(data.names) == sorted(name.replace("-", "_") for name in kiwi_files.PLACES) and not data.transmitter
    assert_allclose(data.stations[data.names.index("ALFA")], kiwi_files.place(kiwi_files.PLACES["ALFA"]))
    table = tmp_path / "mine.csv"
    rows = [f"{name.lower()};{a};{b}" for name, (a, b) in kiwi_files.PLACES.items()]
    table.write_text("\n".join(["name;latitude_deg;longitude_deg", *rows]) + "\n")
    assert read_folder(folder, str(table)).names == [name.lower() for name in kiwi_files.PLACES]
    (folder / "20210605T235937Z_198000_ECHO_iq.wav").rename(folder / "20210605T235937Z_77500_ECHO_iq.wav")
    with pytest.raises(UserError, match=r"\(77500, 198000\); one, or say which"):
        read_folder(folder)
    assert len(read_folder(folder, frequency=198e3).names) == 4
    with pytest.raises(UserError, match=r"1 receivers with a recording and a place .* at least 3"):
        read_folder(folder, frequency=77500.0)


@pytest.mark.slow
def test_what_is_claimed_is_what_it_is(tmp_path):
    """NEES of 24 fixes of four receivers, ten times the noise in half of them: in the 99.9 % band of 48 degrees."""
    nees = []
    for seed in range(24):
        names = ("ALFA", "BRAVO", "DELTA", "ECHO")
        folder = kiwi_files.write(tmp_path / str(seed), 100 + seed, names, 4.0, noise=10.0 if seed % 2 else 1.0)
        fix = run(folder).fix
        error = fix.local(fix.estimate[-1])[:2]
        nees.append(error @ np.linalg.solve(fix.horizontal_covariance(), error))
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 48)
    assert low < np.sum(nees) < high, nees
