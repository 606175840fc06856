"""From I/Q recordings of ground receivers to the place of an emitter, with the covariance that it has."""

import csv
import json
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.commands.running import run_command
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import enu_rotation
from tests.diagrams.iq_site import EMITTER, HEIGHT, RECEIVERS, Clock, ecef, record, table

SETTINGS = ["integration_s=0.05", *HEIGHT]
run = partial(replay, "iq", progress=False)


def estimate(report):
    """East and north errors [m] of the last estimate, and their covariance."""
    found = report.located.report
    last = found.result.isel(estimator=0, trial=0, time=-1)
    turn = enu_rotation(*np.radians(EMITTER[:2]))[:2]
    error = turn @ (last["estimate"].values[:3] - ecef(EMITTER))
    return error, turn @ last["covariance"].values[:3, :3] @ turn.T


def test_a_position_with_its_files(tmp_path, capsys):
    """Within the 99.9 % ellipse, in the usual files; what was measured can be read back and gives the same."""
    paths = record(tmp_path, 1, located=False)
    out = tmp_path / "out"
    report = run(file=paths, out=out, settings=SETTINGS, platforms=table(tmp_path), write_measurements=True)
    error, covariance = estimate(report)
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 2)
    assert np.sqrt(np.linalg.eigvalsh(covariance)[-1]) < 3.0
    shown = " ".join(capsys.readouterr().out.split())
    assert "position: estimates at the end" in shown and "its height was taken to be 500 m" in shown
    features = json.loads((out / "estimates.geojson").read_text())["features"]
    assert any(one["geometry"]["type"] == "Polygon" for one in features)
    rows = list(csv.DictReader((out / "measurements.csv").open()))
    assert {(row["kind"], row["unit"]) for row in rows} == {("tdoa", "s"), ("fdoa", "Hz")}
    assert len(rows) == 2 * 3 * 9 and rows[0]["reference"] == "alpha" and rows[0]["time"].endswith("Z")
    again = run_command(str(out / "fix" / "fix.yaml"), {}, None, tmp_path / "again", False, progress=False)
    assert again is not None
    assert (out / "estimates.csv").read_bytes() == (tmp_path / "again" / "estimates.csv").read_bytes()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["position"]["estimates"][0]["updates"] == 1


def test_any_reference(tmp_path):
    """By the recordings' own places; differences against another receiver give the same place."""
    paths = record(tmp_path, 2)
    one, _ = estimate(run(file=paths, settings=SETTINGS))
    report = run(file=paths, settings=[*SETTINGS, "reference=charlie"])
    other, covariance = estimate(report)
    assert {pair.main for pair in report.pairs} == {"charlie"}
    assert_allclose(other, one, atol=2 * np.sqrt(covariance.max()))


def test_two_receivers_give_a_hyperbola(tmp_path, capsys):
    """No place, and why, in one line; the tables are written."""
    paths = record(tmp_path, 3)[:2]
    report = run(file=paths, out=tmp_path / "out", settings=SETTINGS)
    assert report.located.report is None
    assert "no fix: a time difference of two receivers that stand is one hyperbola" in capsys.readouterr().out
    assert (tmp_path / "out" / "measurements.csv").read_text().count("\n") == 1 + 2 * 9
    assert not (tmp_path / "out" / "fix").exists()


def test_three_receivers_need_a_height(tmp_path):
    paths = record(tmp_path, 4)[:3]
    error, covariance = estimate(run(file=paths, settings=SETTINGS))
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 2)
    without = run(file=paths, settings=[*SETTINGS, "position.sigma_height_m=null"])
    assert without.located.notes[-1].startswith("no fix: 2 time difference(s) do not determine a place")


def test_what_is_not_known_of_the_height_is_told(tmp_path):
    """Three receivers on the ground tell nothing of it: its sigma stays what is assumed, to 5 %."""
    report = run(file=record(tmp_path, 4)[:3], settings=["integration_s=0.05"])
    assert_allclose(report.located.report.told[0].sigma["sigma_up_m"], 1000.0, rtol=0.05)


def test_where_nobody_knows(tmp_path):
    """A table of others is refused; one that lacks a receiver leaves it out, and without the reference is no fix."""
    paths = record(tmp_path, 5, located=False)
    assert run(file=paths, settings=SETTINGS).located is None
    with pytest.raises(UserError, match="none of the receivers alpha, bravo, charlie, delta is in it, only north"):
        run(file=paths, settings=SETTINGS, platforms=table(tmp_path, {"north": (1, 2, 3)}))
    some = {name: place for name, place in RECEIVERS.items() if name != "delta"}
    notes = run(file=paths, settings=SETTINGS, platforms=table(tmp_path, some)).located.notes
    assert "position: nobody knows where delta stands: left out" in notes
    some.pop("alpha")
    notes = run(file=paths, settings=SETTINGS, platforms=table(tmp_path, some)).located.notes
    assert notes == ["no fix: nobody knows where the reference alpha stands"]
    named = ["receivers=[alpha, north, charlie, delta]"]
    with pytest.raises(UserError, match="receivers: 1 names are not allowed for 4 recordings"):
        run(file=paths, settings=["receivers=[a]"])
    report = run(file=paths, settings=[*SETTINGS, *named], platforms=table(tmp_path, {"north": (1, 2, 3)}))
    assert report.located.notes[-1] == "no fix: nobody knows where the reference alpha stands"


NOMINAL = {}
RATES = {"bravo": Clock(rate=202e3), "delta": Clock(rate=198.5e3)}
GAP = {"charlie": Clock(gap=(0.12, 0.21))}
REAL = {"bravo": Clock(kind="rf32_le", rate=400e3), "delta": Clock(kind="ci16_le", begin=0.0123456)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("clocks", "snr_db"), [(NOMINAL, 10.0), (NOMINAL, -5.0), (RATES, 10.0), (GAP, 10.0), (REAL, 10.0)]
)
def test_the_covariance_is_honest(tmp_path, clocks, snr_db):
    """20 seeds: mean normalised squared error in its 99.8 % band, none beyond the 99.99 % ellipse."""
    squared = []
    for seed in range(20):
        paths = record(tmp_path, 100 + seed, snr_db, seconds=0.35, clocks=clocks)
        error, covariance = estimate(run(file=paths, settings=SETTINGS))
        squared.append(error @ np.linalg.solve(covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 2 * len(squared)) / len(squared)
    print(np.mean(squared), np.max(squared))
    assert low < np.mean(squared) < high
    assert max(squared) < chi2.ppf(0.9999, 2)


def test_platforms_that_are_not_known_then(tmp_path, capsys):
    """A track that ends before the recordings: no fix, and why; what was measured is written all the same."""
    paths = record(tmp_path, 6, located=False)
    lines = [f"{name},2026-03-01T11:59:{s}Z,{a},{b},{c}" for name, (a, b, c) in RECEIVERS.items() for s in (10, 50)]
    platforms = tmp_path / "platforms.csv"
    platforms.write_text("\n".join(["name,time,latitude_deg,longitude_deg,height_m", *lines]) + "\n")
    run(file=paths, settings=SETTINGS, platforms=platforms, out=tmp_path / "out")
    assert "no fix: platforms.alpha.file: platforms.csv" in capsys.readouterr().out
    assert (tmp_path / "out" / "measurements.csv").exists() and not (tmp_path / "out" / "fix").exists()
