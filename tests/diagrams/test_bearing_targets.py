"""Bearings of several targets in one file, at rest and moving: against least squares, truth, and what was published."""

import csv
import json
import math
import re

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.bearings_file import read_bearings, read_targets
from quietfix.diagrams.recorded.bearings import Settings, declare_targets
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.fixes.moving_bearings import moving_fix, robust_moving_fix
from tests.golden.recordings import report_of

STATIONS = np.array([[0.0, 0.0], [9e3, 1e3], [2e3, 8e3], [-5e3, 6e3]])
SIGMA = 1.5  # deg


def lines(name, time, place, degrees, sigma=""):
    return [f"{t};{b};{name};{y};{sigma};{x}" for t, (x, y), b in zip(time, place, degrees, strict=True)]


def write(path, rows):
    path.write_text("\n".join(["time_s;bearing_deg;target;y_m;sigma_deg;x_m", *rows]) + "\n")
    return path


def compass(place, target):
    return np.degrees(np.arctan2(*(target - place).T))


def residuals(x, elapsed, place, degrees):
    where = x[:2] + (elapsed[:, None] * x[2:] if len(x) == 4 else 0.0)
    return (np.radians(degrees - compass(place, where)) + np.pi) % (2 * np.pi) - np.pi


def reported(targets, **settings):
    chosen = Settings(**settings).completed()
    return report_of("bearings", declare_targets(targets, chosen), chosen)


@pytest.mark.slow
def test_targets_of_one_file_are_least_squares_and_their_ellipses_hold(tmp_path):
    rng = np.random.default_rng(1)
    rows, truth, data = [], {}, {}
    for k in range(60):
        name, target = f"fox {k}", rng.uniform([-2e3, 1e3], [7e3, 6e3])
        degrees = compass(STATIONS, target) + rng.normal(0, SIGMA, 4)  # -180 to 180
        degrees = degrees % 360 if k % 2 else degrees
        degrees = (degrees + 180) % 360 - 180 if k % 2 == 0 else degrees
        truth[name], data[name] = target, degrees
        rows += lines(name, np.full(4, 60.0 * k), STATIONS, degrees)
    rng.shuffle(rows)
    file = write(tmp_path / "all.csv", rows)
    report = reported(read_targets(file))
    # 60 targets of two degrees of freedom: their median tells sigma to a tenth
    assert math.degrees(report.sigma.value) == pytest.approx(SIGMA, rel=0.3) and report.sigma.told
    nees = []
    for name, (fixes, _) in report.located.items():
        start = truth[name] + [300.0, -200.0]
        expected = least_squares(residuals, start, args=(0, STATIONS, data[name]), x_scale=1e3, xtol=1e-14).x
        # von Mises and squares differ by the fourth power of residuals of 1.5 degrees
        np.testing.assert_allclose(fixes["ml"].state, expected, atol=1.0)
        off = fixes["ml"].state - truth[name]
        nees.append(off @ np.linalg.solve(fixes["ml"].covariance, off))
    # 60 ellipses of 95 %: a standard deviation of 3 %
    assert np.mean(np.array(nees) < chi2.ppf(0.95, 2)) > 0.85


def test_what_cannot_be_located_is_said_and_the_others_are(tmp_path, capsys):
    rng = np.random.default_rng(2)
    target = np.array([3e3, 4e3])
    rows = lines("good", [0, 0, 0, 0], STATIONS, compass(STATIONS, target) + rng.normal(0, 1, 4), 1)
    rows += lines("one", [5], STATIONS[:1], [40.0], 1)
    rows += lines("far", [6, 6], STATIONS[:2], [10.0, 10.2], 1)  # parallel as far as a degree tells
    wild = compass(np.tile(STATIONS, (3, 1)), target) + rng.normal(0, 1, 12)
    wild[4] += 90.0
    rows += lines("wild", np.arange(12.0), np.tile(STATIONS, (3, 1)), wild, 1)
    file = write(tmp_path / "b.csv", rows)
    replay("bearings", file=file, out=tmp_path / "out", progress=False)
    printed = capsys.readouterr().out
    assert "no fix of one: has 1 bearing(s); a single one locates nothing" in printed
    assert "no fix of far: the lines diverge, are parallel as far as their sigma tells" in printed
    assert "clockwise from the y axis (grid north)" in printed and "weight to bearing wild/5" in printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())["targets"]
    assert list(summary) == ["good", "one", "far", "wild"] and summary["one"]["fixes"] == {}
    assert not summary["far"]["fixes"]["ml"]["fix"]
    off = [math.dist([summary["wild"]["fixes"][n][k] for k in ("x_m", "y_m")], target) for n in ("robust", "ml")]
    assert off[0] < 150 < off[1]  # sigma is 40 m
    with (tmp_path / "out" / "estimates.csv").open(newline="") as stream:
        told = list(csv.DictReader(stream))
    assert {row["target"] for row in told} == {"good", "wild"} and {"ml", "robust", "ekf"} <= {
        row["estimator"] for row in told
    }
    assert float(told[0]["cov_x_x"]) > 0
    # fixes that stand in the files alone: a line says of which the bearings do not bear out the sigmas
    hidden = [
        name
        for entry in summary.values()
        for name, fix in entry["fixes"].items()
        if name not in ("ml", "robust") and fix["fix"] and not fix["believable"]
    ]
    assert hidden and f"{hidden[0]} of {hidden.count(hidden[0])} targets" in printed


def test_claimed_sigmas_that_do_not_cover_are_told():
    rng = np.random.default_rng(3)
    rows = []
    for k in range(20):
        degrees = compass(STATIONS, rng.uniform([-2e3, 1e3], [7e3, 6e3])) + rng.normal(0, 3, 4)
        rows.append((f"t{k}", degrees))
    from quietfix.diagrams.readers.bearings_file import Bearings, Target

    for claimed, larger in ((1.0, 3.0), (3.0, None)):
        targets = [
            Target(n, Bearings(np.zeros(4), STATIONS, np.radians(90 - d), np.full(4, math.radians(claimed))), "")
            for n, d in rows
        ]
        report = reported(targets)
        # 20 medians of two degrees of freedom: a standard deviation of a sixth
        assert report.sigma.larger == (None if larger is None else pytest.approx(larger, rel=0.5))
        assert any("cannot cover the residuals" in line for line in report.notes()) == (larger is not None)


def moving_scene(rng, count, kind):
    """Times, observers and truth of a target that moves straight on."""
    time = np.sort(rng.uniform(0, 600, count))
    if kind == "stations":
        place = STATIONS[rng.integers(0, 4, count)]
        truth = np.array([*rng.uniform([0, 2e3], [4e3, 5e3]), *rng.uniform(-8, 8, 2)])
    else:  # an observer that turns twice
        legs = np.array([[10.0, 0], [0, 12], [-10, 4]])
        place = np.cumsum(legs[np.minimum(time // 200, 2).astype(int)] * np.diff(time, prepend=0)[:, None], axis=0)
        truth = np.array([*rng.uniform([1e3, 6e3], [4e3, 9e3]), *rng.uniform(-6, 6, 2)])
    elapsed = time - time[-1]
    return time, place, truth, truth[:2] + elapsed[:, None] * truth[2:]


@pytest.mark.parametrize("kind", ["stations", "observer"])
def test_moving_targets_are_least_squares_and_their_nees_is_4(kind):
    rng = np.random.default_rng(4)
    nees, sigma = [], math.radians(0.5)
    for _ in range(60):
        time, place, truth, path = moving_scene(rng, 60, kind)
        degrees = compass(place, path) + rng.normal(0, 0.5, 60)
        fix = moving_fix(time, place, np.radians(90 - degrees), np.full(60, sigma))
        expected = least_squares(
            residuals, truth, args=(time - time[-1], place, degrees), x_scale=[1e3, 1e3, 1, 1], xtol=1e-15, ftol=1e-15
        )
        # both stop where steps no longer change the cost by 1e-14 of it: 1e-7 of a standard deviation squared
        np.testing.assert_allclose(fix.position, expected.x, rtol=1e-4, atol=0.05)
        np.testing.assert_allclose(fix.covariance, sigma**2 * np.linalg.inv(expected.jac.T @ expected.jac), rtol=1e-2)
        off = fix.position - truth
        nees.append(off @ np.linalg.solve(fix.covariance, off))
    low, high = chi2.ppf([0.0005, 0.9995], 4 * 60) / 60
    assert low < np.mean(nees) < high
    assert np.mean(np.array(nees) < chi2.ppf(0.95, 4)) > 0.85


def test_wild_bearings_do_not_move_the_robust_track():
    rng = np.random.default_rng(5)
    off = []
    for _ in range(12):
        time, place, truth, path = moving_scene(rng, 60, "stations")
        degrees = compass(place, path) + rng.normal(0, 0.5, 60)
        wild = rng.random(60) < 0.1
        degrees[wild] += rng.uniform(40, 180, wild.sum())
        arguments = time, place, np.radians(90 - degrees), np.full(60, math.radians(0.5))
        off.append([np.linalg.norm(f(*arguments).position[:2] - truth[:2]) for f in (moving_fix, robust_moving_fix)])
    all_of_them, robust = np.percentile(off, 90, axis=0)
    # sigma of a coordinate is some 20 m
    assert robust < 80 < all_of_them


def test_moving_targets_of_a_file_and_a_range_that_nobody_tells(tmp_path, capsys):
    rng = np.random.default_rng(6)
    rows, truths = [], {}
    for name in ("car", "boat"):
        time, place, truths[name], path = moving_scene(rng, 40, "stations")
        rows += lines(name, time, place, compass(place, path) + rng.normal(0, 0.5, 40), 0.5)
    time = np.arange(0.0, 400, 10)
    straight = np.column_stack([10 * time, np.zeros(40)])
    path = np.array([2e3, 6e3]) + time[:, None] * [-3.0, 1.0]
    rows += lines("open", time, straight, compass(straight, path) + rng.normal(0, 0.5, 40), 0.5)
    file = write(tmp_path / "m.csv", rows)
    replay("bearings", file=file, out=tmp_path / "out", progress=False, settings=["motion=constant_velocity"])
    printed = capsys.readouterr().out
    assert re.search(r"no fix of open: .*a single observer has to manoeuvre", printed)
    with (tmp_path / "out" / "estimates.csv").open(newline="") as stream:
        told = list(csv.DictReader(stream))
    assert {row["estimator"] for row in told} == {"ml", "robust", "ekf", "mgekf"}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())["targets"]
    for name, truth in truths.items():
        for method in ("ml", "robust", "ekf"):
            mine = [row for row in told if row["target"] == name and row["estimator"] == method]
            found = [float(mine[-1][key]) for key in ("x_m", "y_m", "vx_mps", "vy_mps")]
            names = ("x", "y", "vx", "vy")
            spread = np.array(
                [
                    [float(mine[-1][f"cov_{min(a, b, key=names.index)}_{max(a, b, key=names.index)}"]) for a in names]
                    for b in names
                ]
            )
            off = np.array(found) - truth
            held = off @ np.linalg.solve(spread, off) < chi2.ppf(0.9999, 4)
            # an extended filter that begins with one bearing may be lost, and is told to be
            assert held or (method == "ekf" and not summary[name]["fixes"][method]["believable"]), (name, method)
        assert len([row for row in told if row["target"] == name and row["estimator"] == "ml"]) == 40


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0;400;a;0;1;0", "bearing_deg '400' is not allowed; 0 to 360, clockwise from north, or -180 to 180"),
        ("0;40;;0;1;0", "line 4: target is empty"),
    ],
)
def test_bad_rows_are_named(tmp_path, row, words):
    file = write(tmp_path / "bad.csv", ["0;40;a;0;1;5", "1;50;a;9;1;5", row])
    with pytest.raises(UserError) as caught:
        read_targets(file)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_radians_and_one_target_only(tmp_path):
    file = tmp_path / "r.csv"
    file.write_text(
        "target,time_s,x_m,y_m,bearing_rad,sigma_rad\na,0,0,0,-0.5,0.01\na,1,100,0,1.5,0.02\nb,2,0,0,1,0.01\n"
    )
    first, second = read_targets(file)
    np.testing.assert_allclose(first.bearings.azimuth, np.pi / 2 - np.array([-0.5, 1.5]))
    np.testing.assert_allclose(first.bearings.sigma, [0.01, 0.02])
    assert second.wrong.startswith("has 1 bearing(s)")
    with pytest.raises(UserError, match="2 targets; one"):
        read_bearings(file)


def test_published_fixes_of_an_animal(recorded, tmp_path):
    """Three bearings of 51 times each; what is published are maximum-likelihood fixes by whole metres."""
    folder = recorded("telemetr_bearings")
    towers = [[float(v) for v in line.split(",")[:2]] for line in (folder / "towers.dat").read_text().split()]
    published, rows = {}, []
    for line in (folder / "fixes.dat").read_bytes().decode("latin-1").split("\n"):
        before, _, after = line.partition("\r")
        place = re.match(r" ?(\d{7}) (\d{7}) +(\S+)", after)
        pairs = np.array(before.split()[4:]).astype(int).reshape(-1, 2)
        if place is None or float(place[1]) == 0 or float(place[3]) == 0 or not pairs[:, 1].all():
            continue
        name = f"fix {len(published) + 1}"
        published[name] = [float(place[1]), float(place[2])]
        rows += lines(name, np.zeros(3), np.array([towers[i - 1] for i in pairs[:, 0]]), pairs[:, 1])
        if len(published) == 51:
            break
    report = reported(read_targets(write(tmp_path / "animal.csv", rows)))
    off = [math.dist(report.located[name][0]["ml"].state, place) for name, place in published.items()]
    assert len(off) == 51 and np.median(off) <= 5.0
