"""Satellites that are ahead of their elements, in a system of one's own: simulated, read back, recorded."""

import csv

import numpy as np
import pytest
from scipy.stats import chi2
from typer.testing import CliRunner

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.app import app
from quietfix.diagrams.own.writing import write_measurements
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from quietfix.systems.earth.geodetic import enu_rotation, geodetic_to_ecef
from tests.own.test_own import HERE, study

LATE = HERE / "late_satellite.yaml"
NAME = "ahead_satellite"


@pytest.mark.parametrize("trials", [40, pytest.param(400, marks=pytest.mark.slow)])
def test_consistent_and_at_the_bound(trials):
    """As `test_oscillator`: NEES of nine states at five times, RMSE over bound; the time becomes better known."""
    result = study(LATE.name, trials, estimators=["ukf"])
    last = result.sizes["time"] - 1
    at_five = result.isel(time=[last * k // 5 for k in range(1, 6)]).sel(estimator="ukf")
    error = at_five["estimate"] - at_five["truth"]
    relative = np.sqrt((error.sel(state=["x", "y", "z"]) ** 2).sum("state").mean("trial")) / at_five["bound_position"]
    low, high = (0.93, 1.12) if trials == 400 else (0.75, 1.35)
    assert ((relative > low) & (relative < high)).all(), relative.values
    band = chi2.ppf([0.005, 0.995], 9 * trials) / (9 * trials)
    mean = at_five["nees"].mean("trial") / 9
    assert ((mean > band[0]) & (mean < band[1])).all(), (mean.values, band)
    assert float(np.sqrt((error.sel(state=NAME).isel(time=-1) ** 2).mean())) < 0.5


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"along_track.moon": "{sigma_s: 1}"}, "along_track: moon is not allowed; satellite|along_track.*moon"),
        ({"along_track.satellite.sigma_s": 0}, "along_track.satellite.sigma_s: 0 is not allowed"),
        (
            {"platforms.satellite": "!Geodetic {latitude_deg: 1}"},
            "along_track.satellite: a !Geodetic in frame earth_fixed is not allowed; a satellite",
        ),
        (
            {"sensors.doppler": "!Bearing {every_s: 5, minimum_elevation_deg: 5, elevation_at: target}"},
            r"along_track: satellite is not allowed with sensors.doppler, a !Bearing; !Range, !RangeRate",
        ),
    ],
)
def test_mistakes(changes, said):
    with pytest.raises(UserError, match=said):
        study(LATE.name, 1, changes)


def last(result):
    """Position, its covariance and the time ahead with its sigma, at the end."""
    one = result.isel(trial=0, estimator=0, time=-1)
    k = next(i for i, name in enumerate(one["state"].values) if str(name).startswith("ahead"))
    estimate, covariance = one["estimate"].values, one["covariance"].values
    return estimate[:3], covariance[:3, :3], estimate[k], np.sqrt(covariance[k, k])


def fed(system, table, **changes):
    """The result of a run on a table, and what is said of it."""
    run = Study(str(system), set={"measurements.file": str(table), **changes}, keep="all")
    result = join(list(run.chunks()))
    return result, "\n".join(run.report(result).notes())


def test_a_satellite_that_is_late_in_a_table(tmp_path):
    """One that is 2 s ahead, of a station that is known: found; without the state the program says what is wrong."""
    known = "!Geodetic {latitude_deg: 46, longitude_deg: 14, height_m: 300}"
    start = (
        f"!Given {{at: {known}, sigma_position_m: 10, sigma_velocity_mps: 0.001, sigma_offset_hz: 2000, "
        "sigma_drift_hzps: 2}"
    )
    late = {"along_track.satellite.true_s": 2}
    result, table = study(LATE.name, 1, late, estimators=["iekf"], keep="all"), tmp_path / "measurements.csv"
    write_measurements(result, find(str(LATE)).system.load(), table)
    common = {"start": start, "estimators": "{iekf: !Iekf {}}"}
    result, told = fed(LATE, table, **common, **{"along_track.satellite.sigma_s": "3"})
    _, _, ahead, sigma = last(result)
    assert "cannot cover" not in told and sigma < 0.1 and abs(ahead - 2.0) < 4 * sigma
    arguments = ["run", str(LATE), "--measurements", str(table), "--set", f"start={start}", "--set", "along_track={}"]
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 0, told.output
    assert "the claimed sigmas cannot cover the residuals of iekf" in " ".join(told.output.split())


FOX = """
frame: earth_fixed
start_utc: 2018-01-13T16:11:06.862011Z
duration_s: 600
platforms:
  fox1d: !Tle
    line_1: {lines[0]}
    line_2: {lines[1]}
along_track:
  fox1d: {{sigma_s: 0.3}}
target: !Geodetic {{latitude_deg: 37.229976, longitude_deg: -80.439627, height_m: 610}}
oscillator: {{carrier_mhz: 145.88, drift_hzps: 0}}
sensors:
  doppler: !Frequency {{sigma_hz: 20, carrier_mhz: 145.88}}
  ground: !Altitude {{sigma_m: 50}}
belief:
  motion: !WhiteNoiseAcceleration {{density_m2ps3: 1.0e-12}}
start: !Given
  at: !Geodetic {{latitude_deg: {at[0]}, longitude_deg: {at[1]}, height_m: 600}}
  sigma_position_m: {spread}
  sigma_velocity_mps: 1.0e-4
  sigma_offset_hz: 2000
  sigma_drift_hzps: 5
estimators:
  iekf: !Iekf {{}}
"""
STATION = (37.229976, -80.439627)


def fox(folder, data, at, spread, sigma):
    """A system and a table of a recorded pass: what a user makes of a receiver's file, a row every two seconds."""
    lines = (data / "pslv40_st.tle").read_text().splitlines()
    elements = [next(line.strip() for line in lines if line.startswith(f"{k} 43137")) for k in (1, 2)]
    (folder / "fox.yaml").write_text(FOX.format(lines=elements, at=at, spread=spread))
    (file,) = data.glob("*.csv")
    with file.open() as stream:
        heard = list(csv.DictReader(stream))[600:4780:20]  # between acquisition and loss
    rows = [f"{one['timestamp']},received_frequency,fox1d,{one['measured_freq']},Hz,{sigma}" for one in heard]
    rows += [f"{heard[0]['timestamp']},altitude,,610,m,50"]
    table = folder / "heard.csv"
    table.write_text("\n".join(["time,kind,receiver,value,unit,sigma", *rows]) + "\n")
    return folder / "fox.yaml", table


def test_fox_1d_at_a_known_station(recorded, tmp_path):
    """The elements are half a day old: within their usual error along the track, and residuals 20 Hz do not cover."""
    result, told = fed(*fox(tmp_path, recorded("fox1d_doppler"), STATION, 10, 20))
    _, _, ahead, sigma = last(result)
    # drift and time are nearly one direction in one pass: the prior's 0.3 s becomes 0.2 s
    assert sigma < 0.25 and abs(ahead) < 4 * sigma
    assert "the claimed sigmas cannot cover the residuals of iekf (frequency_fox1d:" in told


def test_where_fox_1d_was_heard(recorded, tmp_path):
    """From 18 km off, with a sigma that covers what is left: the 99 % ellipse on the ground holds the station."""
    result, told = fed(*fox(tmp_path, recorded("fox1d_doppler"), (37.35, -80.3), 20000, 60))
    assert "cannot cover" not in told
    position, covariance, _, _ = last(result)
    latitude, longitude = np.radians(STATION)
    turn = enu_rotation(latitude, longitude)[:2]
    error, spread = turn @ (position - geodetic_to_ecef(latitude, longitude, 610.0)), turn @ covariance @ turn.T
    assert error @ np.linalg.solve(spread, error) < chi2.ppf(0.99, 2)
    assert np.sqrt(np.trace(spread)) < 20e3


@pytest.mark.slow
def test_two_passes_of_an_oscillator_that_was_switched_off(tmp_path):
    """Two revolutions, with other errors of oscillator and orbit in each: the pause alone tells them apart."""
    rows = {}
    for offset, late, first, end in ((900, 0.4, 0, 3000), (-700, -0.3, 3000, 7000)):
        drawn = {"oscillator.offset_hz": offset, "oscillator.sigma_offset_hz": 0, "oscillator.sigma_drift_hzps": 0}
        drawn |= {"along_track.satellite.true_s": late, "duration_s": 7000}
        drawn |= {"sensors.doppler.every_s": 20, "sensors.ground.every_s": 7000}
        result, one = study(LATE.name, 1, drawn, estimators=["iekf"], keep="all"), tmp_path / "one.csv"
        write_measurements(result, find(str(LATE)).system.load(settings=["duration_s=7000"]), one)
        with one.open() as stream:
            mine = [row for row in csv.DictReader(stream) if row["value"] and first <= float(row["time_s"]) < end]
        rows |= {(row["time_s"], row["kind"]): row for row in mine}
    table = tmp_path / "both.csv"
    with table.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(next(iter(rows.values()))))
        writer.writeheader()
        writer.writerows(rows.values())
    place = "!Geodetic {latitude_deg: 46.02, longitude_deg: 13.98, height_m: 300}"
    start = f"!Given {{at: {place}, sigma_position_m: 4000, sigma_velocity_mps: 1.0e-4, sigma_offset_hz: 2000}}"
    common = {"start": start, "estimators": "{iekf: !Iekf {}}", "duration_s": "7000"}
    result, told = fed(LATE, table, **common, **{"oscillator.pause_s": "600"})
    position, covariance, ahead, sigma = last(result)
    error = position - geodetic_to_ecef(np.radians(46.0), np.radians(14.0), 300.0)
    assert "cannot cover" not in told
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 3) and abs(ahead + 0.3) < 4 * sigma
    _, told = fed(LATE, table, **common)
    assert "cannot cover" in told
