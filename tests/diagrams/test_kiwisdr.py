"""A long-wave transmitter from the I/Q samples of three receivers with GPS stamps."""

import json
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.readers.kiwisdr.folder import SOURCE, read_folder
from tests.fitting import check_fits

PAIRS = ((0, 1), (0, 2), (1, 2))


@pytest.fixture(scope="module")
def folder(recorded):
    return recorded("kiwisdr_dcf77")


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("kiwisdr") / "out"


@pytest.fixture(scope="module")
def found(folder, out):
    return replay("kiwisdr", data=folder.parent, out=out, progress=False)


def test_recordings(folder):
    """What the folder's own notes say: stale stamps at the beginning, rates that differ a little."""
    data = read_folder(folder)
    assert data.names == ["HB9ODP", "JO51xl", "pa0rdt"] and data.transmitter == "DCF77"
    assert [one.stale for one in data.recordings] == [2, 1, 1]
    assert_allclose([one.sample_rate for one in data.recordings], [12001.084, 12001.026, 12001.086], atol=1e-3)
    assert max(one.scatter for one in data.recordings) < 0.1e-6


def test_time_differences(found):
    """Within 12 us of the true ones, for all three pairs; the third closes the triangle."""
    medians = {}
    for pair in PAIRS:
        result = found.pairs[pair]
        assert np.count_nonzero(result.good) >= 25
        medians[pair] = np.median(result.tdoa[result.good])
        assert abs(medians[pair] - found.true_difference(pair)) < 12e-6
        # the noise in the windows explains their scatter, and not the rest
        apart = (result.tdoa - medians[pair])[result.good] / result.sigma_tdoa[result.good]
        assert 0.5 < np.sqrt(np.mean(apart**2)) < 2.5
    assert abs(medians[0, 1] + medians[1, 2] - medians[0, 2]) < 3e-6
    # geometry: great circles from Mainflingen, with the refractivity of air at the ground
    assert_allclose([found.true_difference(pair) for pair in PAIRS], [-423.6e-6, 82.1e-6, 505.7e-6], atol=0.1e-6)


def test_fix(found):
    """Within 3 km of the mast; the covariance is far more hopeful, and the program says why."""
    assert found.fix.error < 3e3
    assert found.fix.sigma < 0.5 * found.fix.error
    assert any("understates" in note and "sky wave" in note for note in found.notes())
    check_fits(found.table())
    assert np.linalg.eigvalsh(found.fix.covariance[-1]).min() > 0
    assert 0.2 < found.fix.nis / found.fix.nis_dof < 3.0
    # every window alone, and all of them, agree within what single windows scatter
    apart = found.fix.local(found.singly) - found.fix.local(found.fix.estimate[-1])
    spread = np.nanmedian(np.linalg.norm(apart[:, :2], axis=-1))
    assert spread < 2e3
    assert_allclose(found.fix.local(found.fix.estimate[-1])[2], 0.0, atol=300.0)


def test_what_is_written(found, out):
    summary = json.loads((out / "summary.json").read_text())
    assert summary["fix"]["horizontal_error_m"] == pytest.approx(found.fix.error)
    assert summary["pairs"]["JO51xl - HB9ODP"]["windows"] >= 25
    for figure in ("map.png", "time_differences.png"):
        assert (out / figure).stat().st_size > 10_000
    assert "km from DCF77" in found.notes()[0]


def test_missing_and_broken_data(tmp_path, capsys, monkeypatch):
    """One line, exit status 2, with the ways to name another folder and the public source."""
    monkeypatch.delenv("QUIETFIX_DATA", raising=False)

    def refused():
        with pytest.raises(SystemExit) as stop:
            main(["replay", "kiwisdr", "--data", str(tmp_path)])
        line = capsys.readouterr().err.strip()
        assert stop.value.code == 2 and "\n" not in line
        assert "--data" in line and "QUIETFIX_DATA" in line and "hcab14/TDoA" in line
        return line

    assert "is not a folder" in refused()
    folder = tmp_path / "kiwisdr_dcf77"
    folder.mkdir()
    assert "stations.csv" in refused()
    (folder / "stations.csv").write_text("name,role\na,receiver\n")
    assert "columns name, role are not allowed; name, latitude_deg" in refused()
    rows = "".join(
        f"{name},{role},50.{i},9.0\n"
        for i, (name, role) in enumerate(zip("abcd", ["receiver"] * 3 + ["transmitter"], strict=True))
    )
    (folder / "stations.csv").write_text("name,role,latitude_deg,longitude_deg\n" + rows)
    assert "it holds no recording *.wav; at least 3" in refused()
    for name in "abc":
        (folder / f"20200813T065220Z_77500_{name}_iq.wav").write_bytes(b"RIFF")
    assert "does not begin with RIFF and WAVE" in refused()
    (folder / "stations.csv").write_text("name,role,latitude_deg,longitude_deg\na,receiver,north,9\n")
    assert "must be numbers" in refused()
    shutil.rmtree(folder)


def test_folder_may_be_named_itself(folder):
    assert data_folder(SOURCE, folder) == folder
