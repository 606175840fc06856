"""The recorded flight of a Falcon 9 as truth."""

import shutil

import numpy as np
import pytest

from quietfix.diagrams.readers.falcon9 import falcon9_flight
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study


@pytest.fixture(scope="module")
def telemetry(recorded):
    return recorded("falcon9_telemetry")


def flight(folder, stop=500.0, gap=11.0):
    return falcon9_flight(folder, "Iridium_NEXT_6", stop, 4.0, gap, 6371e3)


def test_the_record_is_smoothed_within_its_rounding(telemetry):
    found = flight(telemetry)
    print("residual", found.residual_speed, "m/s", found.residual_height, "m, events", found.breaks)
    assert found.residual_speed < 0.5  # speed is shown to 1 km/h, 0.08 m/s rms; the rest is the throttle
    assert found.residual_height < 290.0  # altitude is shown to 0.1 km below 100 km, then to 1 km: 289 m rms
    assert found.breaks[1] == pytest.approx(168.0, abs=3.0) and found.breaks[2] == pytest.approx(176.0, abs=3.0)
    down = found.at(500.0)[0][0]
    assert 1000e3 < down < 1300e3
    rise = max(np.linalg.norm(found.at(t)[1]) for t in np.arange(1.0, 500.0, 1.0))
    assert 25.0 < rise < 45.0


def test_gaps_and_ends_are_refused(telemetry, tmp_path):
    with pytest.raises(ValueError, match=r"the gap from 174.8 to 185.26\d* s is not allowed"):
        flight(telemetry, gap=2.0)
    with pytest.raises(UserError, match="the record of Iridium_NEXT_6 ends at"):
        flight(telemetry, stop=9e3)
    copy = tmp_path / "falcon9_telemetry"
    copy.mkdir()
    with pytest.raises(UserError, match="cannot be read"):
        flight(copy)
    shutil.copy(telemetry / "Iridium_NEXT_6__events.json", copy)
    (copy / "Iridium_NEXT_6__stage2_raw.json").write_text("[1, 2]")
    with pytest.raises(UserError, match="not a mapping"):
        flight(copy)


def test_without_data_the_variant_says_where_they_are(monkeypatch):
    monkeypatch.delenv("QUIETFIX_DATA", raising=False)
    with pytest.raises(UserError, match=r"QUIETFIX_DATA.*shahar603"):
        Study("beacon_rocket:falcon9")


def position(data):
    difference = (data["estimate"] - data["truth"]).transpose("estimator", "trial", "time", "state").values[0]
    return data["time"].values, np.sqrt((difference[..., :3] ** 2).sum(axis=-1).mean(axis=0))


def test_the_first_seconds(telemetry, monkeypatch):
    monkeypatch.setenv("QUIETFIX_DATA", str(telemetry.parent))
    time, rms = position(run_study("beacon_rocket:falcon9", trials=2, estimators=["ukf"], set=["stop_s=10"]))
    assert time[-1] == 10.0 and rms[-1] < 1.05 * rms[0]


@pytest.mark.slow
def test_the_recorded_flight_is_tracked(telemetry, monkeypatch):
    """Settled at 120 s: in the first two minutes the flight is low and all range rates change together."""
    monkeypatch.setenv("QUIETFIX_DATA", str(telemetry.parent))
    data = run_study("beacon_rocket:falcon9", trials=20, estimators=["ukf"])
    time, rms = position(data)
    kept = time >= 120.0
    for event in flight(telemetry).breaks[1:3]:
        kept &= np.abs(time - event) > 3.0
    print(
        "RMS position: all",
        np.sqrt((rms[kept] ** 2).mean()),
        "worst epoch",
        rms[kept].max(),
        "at 120 s",
        rms[time >= 120][0],
    )
    assert rms[kept].max() <= 15.0
