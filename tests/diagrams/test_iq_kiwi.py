"""KiwiSDR recordings as I/Q recordings: by their stamps, and by their names."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.iq.any_file import read_iq
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.time_scales import from_tai, posix_to_tai
from tests.diagrams.iq_site import ecef
from tests.systems.test_kiwi import RATE, START, kiwi_file

LIGHT = 299_792_458.0
BAND = ["notch_hz=20", "low_hz=-400", "high_hz=400", "half_delay_us=3000", "half_frequency_hz=2"]


def test_dates_follow_from_name_and_stamps(tmp_path):
    """The week is that of the name, the second that of the stamps; GPS is 18 s ahead of UTC in 2020, 12000 Hz."""
    n = np.arange(512 * 40)
    path = tmp_path / "20200813T065220Z_77500_here_iq.wav"
    kiwi_file(path, np.rint(3000 * np.exp(2j * np.pi * 200.0 * n / RATE)), stale=0)
    (one,) = read_iq(path)
    assert (one.name, one.sample_rate, one.segments[0].frequency) == ("here", 12000.0, 77500.0)
    # 370358.25 s of the week of Sunday 2020-08-09 are Thursday 06:52:38.25 GPS; the first sample is less than one on
    assert from_tai(posix_to_tai(one.start[0]), 0.0) == "2020-08-13T06:52:20"
    assert 0.25 <= one.start[1] < 0.25 + 1 / 12000
    t = np.arange(one.segments[0].samples.size) / 12000 + one.start[1] - START % 1
    inner = slice(50, -50)
    assert_allclose(one.segments[0].samples[inner], 3000 * np.exp(2j * np.pi * 200.0 * t)[inner], atol=3)
    plain = tmp_path / "heard.wav"
    plain.write_bytes(path.read_bytes())
    (other,) = read_iq(plain)
    assert other.segments[0].frequency == 0.0 and "does not say when" in other.notes[-1]
    assert_allclose(other.start[1], one.start[1])
    wrong = tmp_path / "20201340T065220Z_77500_here_iq.wav"
    wrong.write_bytes(path.read_bytes())
    with pytest.raises(UserError, match="20201340T065220Z in its name is not allowed"):
        read_iq(wrong)


@pytest.mark.slow
def test_dcf77(recorded, tmp_path):
    """Time differences within 10 us of straight lines (scatter and sky wave), and a place within 3 km of the mast."""
    folder = recorded("kiwisdr_dcf77")
    lines = (folder / "stations.csv").read_text().splitlines()[1:]
    places = {name: (float(a), float(b), 300.0) for name, _, a, b in (line.split(",") for line in lines)}
    mast = ecef(places.pop("DCF77"))
    table = tmp_path / "platforms.csv"
    rows = [f"{name},{a},{b},{c}" for name, (a, b, c) in places.items()]
    table.write_text("\n".join(["name,latitude_deg,longitude_deg,height_m", *rows]) + "\n")
    settings = ["integration_s=1", "position.height_m=100", "position.sigma_height_m=200", *BAND]
    report = replay("iq", file=sorted(folder.glob("*_iq.wav")), platforms=table, settings=settings, progress=False)
    away = {name: np.linalg.norm(ecef(place) - mast) for name, place in places.items()}
    for pair in report.pairs:
        assert pair.good.all()
        assert abs(np.median(pair.tdoa) - (away[pair.auxiliary] - away[pair.main]) / LIGHT) < 10e-6
    last = report.located.report.result.isel(estimator=0, trial=0, time=-1)
    assert np.linalg.norm(last["estimate"].values[:3] - mast) < 3e3
    assert any("follow the ground and the ionosphere" in line for line in report.notes())
