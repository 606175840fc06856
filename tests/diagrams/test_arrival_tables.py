"""Recordings of arrival times in other words than LocaRDS', of aircraft that say nothing of themselves: located."""

import csv
import json
import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.locards_data import read_receivers, read_sets
from quietfix.diagrams.recorded.locards import Settings, declare_sets
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.estimates import estimate_columns
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from quietfix.systems.options.iekf import Iekf
from tests.golden.recordings import report_of

PLACES = [(47.3, 8.9, 450), (47.9, 9.9, 600), (48.6, 9.5, 300), (48.5, 8.2, 700), (47.5, 8.1, 500), (48.1, 8.8, 800)]
SIGMA = 20.0  # m, of an arrival


def scene(count=60, seed=1):
    """Rows of messages of as many aircraft, heard by five of six receivers each: number, place, [receiver, ns]."""
    rng = np.random.default_rng(seed)
    stations = geodetic_to_ecef(*(np.array(PLACES).T * [[math.pi / 180], [math.pi / 180], [1.0]]))
    rows = []
    for i in range(count):
        latitude, longitude, height = rng.uniform(47.6, 48.4), rng.uniform(8.4, 9.6), rng.uniform(1e3, 12e3)
        place = geodetic_to_ecef(math.radians(latitude), math.radians(longitude), height)
        heard = rng.permutation(6)[:5]
        ranges = np.linalg.norm(stations[heard] - place, axis=1) + rng.normal(0, SIGMA, 5)
        stamps = [7_000_000_000_000 + 10**9 * i + round(r / SPEED_OF_LIGHT * 1e9) for r in ranges]
        rows.append((i + 1, latitude, longitude, height, [[int(j) + 1, t] for j, t in zip(heard, stamps, strict=True)]))
    return rows


def usual(folder, rows, altitude=True, reported=True):
    folder.mkdir()
    with (folder / "sensors.csv").open("w") as file:
        file.write("serial,latitude,longitude,height\n")
        file.writelines(f"{i},{la},{lo},{h}\n" for i, (la, lo, h) in enumerate(PLACES, 1))
    with (folder / "set_1.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["aircraft", "latitude", "longitude", "baroAltitude", "geoAltitude", "measurements"])
        for number, latitude, longitude, height, heard in rows:
            said = [latitude, longitude] if reported else ["", ""]
            low = height if altitude else ""
            heard = [[i, t, 9] for i, t in heard]
            writer.writerow([number, *said, low, height if reported else "", json.dumps(heard)])
    return folder


def others(folder, rows):
    """The same in other words: order, delimiter, names of files and columns, texts as identifiers."""
    folder.mkdir()
    with (folder / "stations.txt").open("w") as file:
        file.write("# where they stand\nLon\tStation ID\tAltitude_m\tLat\n")
        file.writelines(f"{lo}\trx-{i}\t{h}\t{la}\n" for i, (la, lo, h) in enumerate(PLACES, 1))
    with (folder / "monday.csv").open("w", newline="") as file:
        file.write("arrivals;baro_altitude;ICAO24;remark\n")
        for number, _, _, height, heard in rows:
            heard = [[f"rx-{i}", t, 9] for i, t in heard]
            file.write(f"{json.dumps(heard)};{height};a{number:03d};x\n")
    return folder


def estimates(folder, settings=None):
    """Columns of the estimates with the gate, as they are written."""
    settings = settings or Settings()
    report = report_of("locards", declare_sets(read_sets(folder), settings), settings)
    columns = estimate_columns(report.result)
    chosen = [i for i, name in enumerate(columns["estimator"]) if name == "iekf"]
    return {name: [column[i] for i in chosen] for name, column in columns.items()}


def places(told):
    latitude, longitude, height = (np.array(told[key]) for key in ("latitude_deg", "longitude_deg", "height_m"))
    return geodetic_to_ecef(np.radians(latitude), np.radians(longitude), height)


def by_hand(stations, heard, height, sigma_height):
    """Least squares of one message, written out: place and time of emission from arrivals and a height [m]."""
    index, stamps = np.array([i - 1 for i, _ in heard]), np.array([t for _, t in heard])
    delay = (stamps - stamps[0]) * 1e-9 * SPEED_OF_LIGHT
    middle = ecef_to_geodetic(stations[index].mean(axis=0))

    def residuals(x):
        off = np.linalg.norm(1e3 * x[:3] - stations[index], axis=1) - delay - 1e3 * x[3]
        return np.append(off / SIGMA, (ecef_to_geodetic(1e3 * x[:3])[2] - height) / sigma_height)

    # without a height there are two minima, one of them often below the ground
    levels = (height,) if sigma_height < 1e3 else (-6e3, 500.0, height, 12e3)
    starts = [np.append(geodetic_to_ecef(middle[0], middle[1], level) / 1e3, 100.0) for level in levels]
    found = [least_squares(residuals, start, x_scale="jac", xtol=1e-14, ftol=1e-14) for start in starts]
    return 1e3 * min(found, key=lambda one: one.cost).x[:3]


@pytest.mark.slow
def test_other_words_give_the_same_tracks_and_files(tmp_path, capsys):
    rows = scene(6)
    first = estimates(usual(tmp_path / "locards_mlat", rows))
    replay("locards", data=others(tmp_path / "other", rows), out=tmp_path / "out", progress=False)
    printed = capsys.readouterr().out
    assert "6 of 6 messages report no position" in printed and "RMSE" not in printed
    with (tmp_path / "out" / "estimates.csv").open(newline="") as file:
        second = [row for row in csv.DictReader(file) if row["estimator"] == "iekf"]
    assert first["target"][:2] == ["set_1/1", "set_1/2"]
    assert [row["target"] for row in second][:2] == ["monday/a001", "monday/a002"]
    for name in ("time_s", "latitude_deg", "longitude_deg", "height_m", "cov_east_east", "cov_east_north"):
        assert [float(row[name]) for row in second] == first[name], name
    features = json.loads((tmp_path / "out" / "estimates.geojson").read_text())["features"]
    assert {one["properties"]["kind"] for one in features} == {"estimate", "ellipse"}
    assert "time_s" in features[0]["properties"] and (tmp_path / "out" / "estimates.gpx").stat().st_size > 1000
    assert (tmp_path / "out" / "estimates.parquet").stat().st_size > 1000


@pytest.mark.parametrize(("altitude", "least"), [(True, 1.0), (False, 0.95)])
def test_fixes_are_least_squares_and_their_covariance_holds(tmp_path, altitude, least):
    rows = scene(120, 2)
    folder = usual(tmp_path / "locards_mlat", rows, altitude=altitude, reported=False)
    # sigma is that of a difference; air is left out on both sides
    settings = Settings(
        air=False, sigma_tdoa_m=math.sqrt(2) * SIGMA, without_gate=["iekf"], estimators={"iekf": Iekf()}
    )
    told = estimates(folder, settings)
    stations = np.array([one.position for one in read_receivers(folder / "sensors.csv").values()])
    nees = []
    for k, (x, (_, latitude, longitude, height, heard)) in enumerate(zip(places(told), rows, strict=True)):
        if not np.isfinite(x).all():
            continue
        assumed = (height, 150.0) if altitude else (6500.0, 3750.0)
        turn = enu_rotation(math.radians(latitude), math.radians(longitude))
        # the fix stops within 1e-4 of a standard deviation, and heights that are hardly measured have 4 km of it
        if k % 8 == 0:
            np.testing.assert_allclose(turn[:2] @ (x - by_hand(stations, heard, *assumed)), 0.0, atol=1.0)
        off = turn[:2] @ (x - geodetic_to_ecef(math.radians(latitude), math.radians(longitude), height))
        east, cross, north = (told[f"cov_{name}"][k] for name in ("east_east", "east_north", "north_north"))
        nees.append(off @ np.linalg.solve([[east, cross], [cross, north]], off))
    assert len(nees) >= least * len(rows)
    # 120 ellipses of 95 %: a standard deviation of 2 %
    assert 0.88 <= np.mean(np.array(nees) < chi2.ppf(0.95, 2)) <= 1.0
    low, high = chi2.ppf([0.0005, 0.9995], 240) / 240
    assert altitude is False or low < np.mean(nees) / 2 < high


def test_what_is_missing_is_said_or_refused(tmp_path):
    rows = scene(3)
    folder = others(tmp_path / "other", rows)
    table = folder / "stations.txt"
    table.write_text(table.read_text().replace("\t300\t", "\t\t"))
    [data] = read_sets(folder)
    heard = {i for *_, heard in rows for i, _ in heard}
    assert 3 in heard and data.notes == [
        "stations.txt says no height of rx-3: taken for that of the others in the middle"
    ]
    assert read_receivers(table)["rx-3"].height == 600.0
    table.write_text(table.read_text().replace("rx-2", "rx-22"))
    with pytest.raises(
        UserError, match=r"monday.csv line \d: measurements: receiver rx-2 has no place in stations.txt"
    ):
        read_sets(folder)
    (folder / "more.csv").write_text("id,lat,lon\n1,2,3\n")
    with pytest.raises(UserError, match=r"more.csv, stations.txt all say where receivers are; one of them, or sensors"):
        read_sets(folder)


def test_an_altitude_that_is_assumed_is_one_fact_however_many_messages_there_are(tmp_path):
    rows = [(7, *row[1:]) for row in scene(5)]
    folder = usual(tmp_path / "locards_mlat", rows, altitude=False)
    model = declare_sets(read_sets(folder), Settings())
    noise = model.parts[0].tracks[0].noise_covariance[:, 0, -1, -1]
    np.testing.assert_allclose(np.sum(1 / noise), 2 / 3750.0**2)
    assert np.argmin(noise) == 0
