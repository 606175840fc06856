"""Which satellite was heard: on a recording, and on what an independent model of the Doppler says."""

import json
from datetime import UTC, datetime

import numpy as np
import pytest
from sgp4.api import Satrec

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.identification.prediction import satellite_path, shifts_of
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from tests.identification.doppler import CARRIER, START, STATION, lines_of, range_rates, received

PASS = {"node": 300.0, "anomaly": 110.0}  # 21 degrees high, 600 s long
NUMBERS = {90001: 0.0, 90002: -0.19, 90003: 0.32, 90004: -1.3, 90005: 2.0, 90006: 170.0}  # degrees along the orbit
OBJECTS = {n: lines_of(n, PASS["node"], PASS["anomaly"] + along) for n, along in NUMBERS.items()}
TIMES = np.arange(20.0, 580.0, 1.0)
PLACE = ",".join(map(str, STATION))


def quietfix(capsys, *arguments):
    """Exit status and what is printed."""
    with pytest.raises(SystemExit) as end:
        main(["identify", *map(str, arguments)])
    shown = capsys.readouterr()
    return end.value.code, shown.out + shown.err


def iso(times):
    """Dates in UTC to a microsecond."""
    return [datetime.fromtimestamp(START + t, UTC).isoformat().replace("+00:00", "Z") for t in times]


def write(folder, frequency, times=TIMES, stamps=None, name="heard.csv", head="time,frequency_hz"):
    """A file of frequencies."""
    rows = [f"{t},{f:.4f}" for t, f in zip(stamps or iso(times), frequency, strict=True)]
    path = folder / name
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def elements(folder, numbers=NUMBERS, named=False):
    """A file of two-line elements."""
    path = folder / "all.tle"
    path.write_text("".join(f"OBJECT {n}\n" * named + "\n".join(OBJECTS[n]) + "\n" for n in numbers))
    return path


def told(folder):
    """What identification.json says."""
    return json.loads((folder / "identification.json").read_text())


@pytest.mark.parametrize("ahead", [0.0, 0.7])
def test_range_rates_are_those_of_the_way_of_light(ahead):
    place = geodetic_to_ecef(np.radians(STATION[0]), np.radians(STATION[1]), STATION[2])
    states = satellite_path(Satrec.twoline2rv(*OBJECTS[90001]), START, 0.25, TIMES, ahead)
    expected = range_rates(OBJECTS[90001], TIMES + 0.25, ahead)
    # SGP4's velocity is off the derivative of its positions by 0.02 m/s in such an orbit
    assert np.abs(shifts_of(states, place) - expected).max() < 0.03


def test_fox_1d_is_told_from_its_33_companions(recorded, capsys, tmp_path):
    folder = recorded("fox1d_doppler")
    (file,) = folder.glob("*.csv")
    station = file.with_suffix(".md")
    status, shown = quietfix(
        capsys, file, "--tle", folder / "pslv40_st.tle", "--station", station, "--out", tmp_path / "out"
    )
    found = told(tmp_path / "out")
    assert status == 0
    assert "identified: 43137 2018-004AC" in shown
    assert found["identified"] == "43137"
    assert [one["number"] for one in found["objects"][:2]] == ["43137", "43141"]
    # independent fits with bias and drift: e^9 between the two where elements are exact, e^3.5 under 0.5 s off
    assert 3.5 < -found["objects"][1]["log_likelihood_ratio"] < 9.0
    assert found["carrier_hz"] == 145.88e6
    first, *_, last = found["lines_left_out"]
    assert first[0] == 2
    assert last[1] == 5198
    # what the recording's description says of acquisition and loss: 58 s and 40 s, 10 rows per second
    assert first[1] == pytest.approx(582, abs=60)
    assert last[0] == pytest.approx(4798, abs=60)
    assert "before the signal is held" in shown
    assert "after it is lost" in shown


def test_a_bias_alone_does_not_identify_fox_1d(recorded, capsys):
    folder = recorded("fox1d_doppler")
    (file,) = folder.glob("*.csv")
    common = "--tle", folder / "pslv40_st.tle", "--station", file.with_suffix(".md")
    _, shown = quietfix(capsys, file, *common, "--oscillator", "bias")
    assert "not identified: 43135" in shown
    assert "43137" in shown.split("cannot be told from")[1]


def test_errors_have_the_sizes_that_are_claimed(capsys, tmp_path):
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES, ahead=0.1))
    status, shown = quietfix(
        capsys, file, "--tle", elements(tmp_path), "--station", PLACE, "--carrier-mhz", 437.2, "--out", tmp_path / "out"
    )
    found = told(tmp_path / "out")
    best = found["objects"][0]
    assert status == 0
    assert found["identified"] == "90001"
    assert "90006" not in [one["number"] for one in found["objects"]]
    assert "below the horizon" in shown
    hertz = CARRIER / 299_792_458.0
    assert best["rms_mps"] == pytest.approx(5.0, rel=0.15)
    assert abs(best["ahead_s"] - 0.1) < 4 * best["sigma_ahead_s"] < 0.4
    assert abs(best["bias_hz"][0] + 400 * hertz) < 4 * best["sigma_bias_hz"][0] < 4 * 5 * hertz
    assert abs(best["drift_hzps"][0] + 0.3 * hertz) < 4 * best["sigma_drift_hzps"][0] < 0.05 * hertz
    assert found["lines_left_out"] == []


def test_objects_that_are_too_near_cannot_be_told_apart(capsys, tmp_path):
    near = lines_of(90007, PASS["node"], PASS["anomaly"] + 0.01)  # 0.16 s ahead
    tle = elements(tmp_path)
    tle.write_text(tle.read_text() + "\n".join(near) + "\n")
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES))
    _, shown = quietfix(capsys, file, "--tle", tle, "--station", PLACE)
    assert "not identified: 9000" in shown
    assert "cannot be told from 9000" in shown


def test_an_object_that_is_not_in_the_file_is_not_found(capsys, tmp_path):
    stranger = lines_of(90009, PASS["node"] + 9.0, PASS["anomaly"] + 1.5)
    file = write(tmp_path, CARRIER + received(stranger, TIMES))
    _, shown = quietfix(capsys, file, "--tle", elements(tmp_path), "--station", PLACE)
    assert "not identified: " in shown
    assert "comes nearest" in shown


def test_passes_with_gaps_and_other_forms_of_a_file(capsys, tmp_path):
    kept = (TIMES < 180) | (TIMES > 290)
    times = TIMES[kept]
    frequency = received(OBJECTS[90003], times, drift=-1.0)
    noise = np.random.default_rng(5).uniform(-9e3, 9e3, times.size)
    frequency[:40] = noise[:40]
    frequency[200] += 4000.0
    rows = [f"{i};{f / 1e3:.7f};{START + t:.3f}" for i, (t, f) in enumerate(zip(times, frequency, strict=True))]
    file = tmp_path / "heard.txt"
    file.write_text("\n".join(["n;doppler_khz;unix_s", *rows[::-1]]) + "\n")
    place = tmp_path / "place.yml"
    place.write_text("station:\n  position: {altitude: 520, longitude: 11.6, latitude: 48.1}\n")
    tle = elements(tmp_path, named=True)
    tle.write_text(tle.read_text().replace("\n", "\r\n").replace("OBJECT", "0 OBJECT"))
    _, shown = quietfix(capsys, file, "--tle", tle, "--station", place, "--carrier-mhz", CARRIER / 1e6)
    assert "identified: 90003 OBJECT 90003" in shown
    assert "doppler_khz the offset from the carrier [kHz]" in shown
    assert "before the signal is held" in shown
    assert "1 rows within are left out" in shown


def test_several_passes_have_an_oscillator_each(capsys, tmp_path):
    second = TIMES + 5690.0  # a turn later; the satellite is still up there for a part of it
    up = second[(second > 5750) & (second < 6100)]
    times = np.concatenate([TIMES, up])
    parts = [received(OBJECTS[90002], t, bias=b, seed=k) for k, (t, b) in enumerate([(TIMES, 400.0), (up, -2000.0)])]
    file = write(tmp_path, CARRIER + np.concatenate(parts), times)
    _, shown = quietfix(
        capsys, file, "--tle", elements(tmp_path), "--station", PLACE, "--carrier-mhz", 437.2, "--out", tmp_path / "out"
    )
    found = told(tmp_path / "out")
    assert found["identified"] == "90002", shown
    hertz = CARRIER / 299_792_458.0
    assert np.array(found["objects"][0]["bias_hz"]) / -hertz == pytest.approx([400.0, -2000.0], abs=15.0)


def test_seconds_need_a_start(capsys, tmp_path):
    stamps = [f"{t:.1f}" for t in TIMES]
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES), stamps=stamps)
    common = file, "--tle", elements(tmp_path), "--station", PLACE
    status, shown = quietfix(capsys, *common)
    assert status == 2
    assert "--start" in shown
    _, shown = quietfix(capsys, *common, "--start", "2020-03-01T23:00:00+01:00")
    assert "identified: 90001" in shown


MISTAKES = {
    "--station 1,2": "--station: 1,2 is not allowed; LATITUDE,LONGITUDE,HEIGHT",
    "--object nobody": "--object: nobody is not known",
    "--height-m 3": "--height-m: it is not allowed with --station",
    "--station 91,2,3": "latitude 91",
    "--station nowhere.yml": "nowhere.yml: it cannot be read",
    "--carrier-mhz -3": "--carrier-mhz: -3",
    "--carrier-mhz 100": "is not allowed with a carrier of 100 MHz",
    "--time-sigma 0": "--time-sigma: 0",
    "--oscillator wild": "--oscillator: wild",
    "--time-column when": "columns time, frequency_hz are not allowed",
    "--tle heard.csv": "it holds no two-line elements",
    "--start x": "--start: 'x'",
    "--start 2020-03-01T00:00:00Z": "not allowed with --start",
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told_in_one_line(mistake, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES))
    elements(tmp_path)
    asked = {"--tle": "all.tle", "--station": PLACE} | dict([mistake.split()])
    status, shown = quietfix(capsys, "heard.csv", *[word for pair in asked.items() for word in pair])
    assert status == 2
    assert MISTAKES[mistake] in shown
    assert len(shown.splitlines()) == 1


def test_a_wrong_check_sum_costs_one_object(capsys, tmp_path):
    tle = elements(tmp_path)
    text = tle.read_text().splitlines()
    text[3] = text[3][:-1] + str((int(text[3][-1]) + 1) % 10)
    tle.write_text("\n".join(text[:-1]))
    file = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES))
    _, shown = quietfix(capsys, file, "--tle", tle, "--station", PLACE)
    assert "2 elements cannot be and are left out, first all.tle:4: checksum" in shown
    assert "identified: 90001" in shown


def test_a_file_cut_anywhere_is_no_traceback(capsys, tmp_path):
    whole = write(tmp_path, CARRIER + received(OBJECTS[90001], TIMES[::20]), TIMES[::20]).read_bytes()
    tle = elements(tmp_path, [90001, 90002])
    for length in range(0, len(whole), 97):
        file = tmp_path / "cut.csv"
        file.write_bytes(whole[:length])
        status, shown = quietfix(capsys, file, "--tle", tle, "--station", PLACE)
        assert status in (0, 2), shown
        assert status == 0 or len(shown.splitlines()) == 1


def test_names_may_stand_behind_a_number_sign(capsys, recorded, tmp_path):
    folder = recorded("doptrack_delfic3")
    about = folder / "Delfi-C3_32789_202004072055.yml"
    lines = [line.split(": ", 1)[1] for line in about.read_text().splitlines() if "line1" in line or "line2" in line]
    tle = tmp_path / "delfi.tle"
    tle.write_text("\n".join([*lines, *OBJECTS[90001], *OBJECTS[90003]]) + "\n")
    epoch = next(line.split(": ", 1)[1] for line in about.read_text().splitlines() if "epoch" in line)
    common = "--tle", tle, "--station", about, "--carrier-mhz", 145.868, "--start", epoch.replace(" ", "T") + "Z"
    _, shown = quietfix(capsys, about.with_suffix(".csv"), *common)
    assert "identified: 32789" in shown
