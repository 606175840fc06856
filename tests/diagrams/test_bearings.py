"""Replay of bearings: no fix where the geometry has none, marks where an ellipse cannot be believed, many rows."""

import json
import math

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.bearings_file import Bearings
from quietfix.diagrams.recorded import bearings as module
from quietfix.diagrams.recorded.bearings import Settings, declare_bearings
from quietfix.diagrams.recorded.reports import bearings_report
from quietfix.systems.fixes import von_mises
from quietfix.systems.fixes.bearing_belief import BearingCost, believable, edge, small_sample_coverage
from quietfix.systems.fixes.von_mises import sample, weighted_fix
from tests.golden.recordings import report_of

NAMES = ["ml", "robust", "lines", "iv", "ekf", "mgekf"]


def write(path, place, degrees, sigma=""):
    rows = [f"{i},{x},{y},{b % 360},{sigma}" for i, ((x, y), b) in enumerate(zip(place, degrees, strict=True))]
    path.write_text("\n".join(["time_s,x_m,y_m,bearing_deg,sigma_deg", *rows]) + "\n")
    return path


def towards(place, target, rng, sigma):
    """Compass bearings with noise [deg]."""
    return np.degrees(np.arctan2(*(target - place).T)) + rng.normal(0, sigma, len(place))


def judged(place, degrees, sigma):
    azimuth = np.radians(90.0 - degrees)
    data = Bearings(np.arange(float(len(place))), place, azimuth, np.full(len(place), math.radians(sigma)))
    return report_of("bearings", declare_bearings(data, math.radians(sigma)), Settings())


# --------------------------------------------------------------------------------------------------- no fix


@pytest.mark.parametrize("sigma", ["", 2])
@pytest.mark.parametrize(
    ("place", "degrees"),
    [
        ([(0, 0), (1000, 0), (500, 0)], [330, 30, 2]),  # diverge
        ([(0, 0), (1000, 0)], [350, 10]),  # cross behind both
        ([(0, 0), (1000, 0), (2000, 0), (3000, 0)], [359.98, 0, 0.02, 0.04]),  # parallel, and a little apart
    ],
)
def test_lines_that_do_not_cross_ahead_give_no_fix(place, degrees, sigma, tmp_path, capsys):
    file = write(tmp_path / "f.csv", place, degrees, sigma)
    replay("bearings", file=file, out=tmp_path / "out", progress=False)
    printed = capsys.readouterr().out
    for name in NAMES:
        assert any(line.split()[:3] == [name, "no", "fix"] for line in printed.splitlines()), name
    assert "no fix: the lines diverge" in printed and "e+" not in printed
    assert (tmp_path / "out" / "bearings.png").stat().st_size > 5000
    fixes = json.loads((tmp_path / "out" / "summary.json").read_text())["fixes"]
    assert all(one["x_m"] is None and not one["fix"] and not one["believable"] for one in fixes.values())


@pytest.mark.parametrize("several", [False, True])
def test_an_estimator_hides_no_fix_of_the_same_name(several, tmp_path, capsys):
    """A user's class `Ml`, and `!Ml` under a name of one's own, stand beside the program's own fixes."""
    place, target = np.column_stack([np.linspace(0, 4e3, 12), np.zeros(12)]), np.array([2e3, 4e3])
    file = write(tmp_path / "f.csv", place, towards(place, target, np.random.default_rng(6), 1.0), 1)
    if several:
        head, *rows = file.read_text().split()
        named = [f"{row},{name}" for name in ("a", "b") for row in rows]
        file.write_text("\n".join([f"{head},target", *named]) + "\n")
    settings = {"settings": ["estimators={ml: !Ekf {}, robust: !Ukf {}}"]}
    replay("bearings", file=file, out=tmp_path / "out", progress=False, **settings)
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    fixes = said["targets"]["a"]["fixes"] if several else said["fixes"]
    assert list(fixes) == ["ml", "robust", "ml_estimator", "robust_estimator"]
    assert fixes["ml"]["x_m"] != fixes["ml_estimator"]["x_m"]
    assert "ml_estimator" in capsys.readouterr().out


def test_a_target_that_is_only_a_direction_gives_no_fix():
    place, target = np.array([[0.0, 0], [50, 0], [100, 0]]), np.array([2e3, 50e3])
    result = judged(place, towards(place, target, np.random.default_rng(1), 0.0) + np.array([1.0, 0, -1.0]), 2.0)
    # the lines cross, but 0.1 degrees of parallax are no more than a 20th of sigma
    assert not any(fix.there for fix in result.fixes.values())
    exact = judged(place, towards(place, target, np.random.default_rng(1), 0.0), 0.001)
    np.testing.assert_allclose(exact.fixes["ml"].position, target, rtol=1e-3)
    assert exact.fixes["ml"].there


# ------------------------------------------------------------------------------------------------------ cost


def test_cost_is_the_von_mises_likelihood_and_infinity_its_limit():
    rng = np.random.default_rng(2)
    place, azimuth, kappa = rng.normal(0, 1e3, (7, 2)), rng.uniform(-3, 3, 7), rng.uniform(1, 50, 7)
    cost = BearingCost(place, azimuth, kappa)
    points = rng.normal(0, 5e3, (40, 2))
    plain = [2 * kappa @ (1 - np.cos(azimuth - np.arctan2(*(x - place).T[::-1]))) for x in points]
    np.testing.assert_allclose(cost(points), plain, rtol=1e-12)
    circle = np.linspace(0, 2 * np.pi, 3601)
    far = cost(1e12 * np.stack([np.cos(circle), np.sin(circle)], axis=-1))
    # a step of 0.1 degrees misses the minimum by kappa * (5e-4)^2 of some 100
    assert far.min() == pytest.approx(cost.endless, rel=1e-5)


def test_edge_and_small_samples():
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    off = edge(np.array([5.0, 6.0]), covariance) - [5.0, 6.0]
    np.testing.assert_allclose(np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off.T).T), chi2.ppf(0.999, 2))
    # a mean of two from 6 numbers, sigma from the residuals: two parameters, as many degrees of freedom less
    rng = np.random.default_rng(3)
    x = rng.normal(0, 1, (200_000, 6))
    rest = (x[:, 2:] ** 2).sum(axis=1) / 6
    held = np.mean((x[:, :2] ** 2).sum(axis=1) / rest < chi2.ppf(0.999, 2))
    assert small_sample_coverage(6) == pytest.approx(held, abs=0.003)  # three standard deviations
    assert small_sample_coverage(2) == 0.0


# ------------------------------------------------------------------------------------------------------ marks


def test_an_ellipse_that_the_bearings_do_not_bear_out_is_not_believed():
    rng = np.random.default_rng(4)
    place, target = np.column_stack([np.linspace(-5e3, 5e3, 40), np.zeros(40)]), np.array([1e3, 9e3])
    azimuth = np.radians(90 - towards(place, target, rng, 1.0))
    cost = BearingCost(place, azimuth, np.full(40, math.radians(1.0) ** -2))
    best = weighted_fix(place, azimuth, cost.kappa)
    offset = best - place
    g = np.stack([-offset[:, 1], offset[:, 0]], axis=-1) / np.einsum("ki,ki->k", offset, offset)[:, None]
    covariance = np.linalg.inv(cost.kappa[0] * g.T @ g)
    along = np.linalg.cholesky(covariance)[:, 0]
    assert believable(best, covariance, cost, best) and believable(best + 0.5 * along, covariance, cost, best)
    assert not believable(best + 3 * along, covariance, cost, best)  # leaves out what lies on the other side
    assert not believable(best + 9 * along, covariance, cost, best)  # does not hold the middle
    assert not believable(best, 0.1 * covariance, cost, best)
    assert not believable(best, np.full((2, 2), np.nan), cost, best)
    narrow = BearingCost(place, azimuth, 4 * cost.kappa)  # half the sigma
    assert not believable(best, covariance / 4, narrow, best)


def test_the_filter_that_is_lost_is_marked_and_the_fits_are_not(tmp_path, capsys):
    """The EKF begins at a range of 10 km: of a target at 1 to 2.5 km it linearises where that is not."""
    rng = np.random.default_rng(5)
    place, lost, marked = np.column_stack([np.linspace(0, 10e3, 20), np.zeros(20)]), 0, 0
    for near, far, files in ((1e3, 2.5e3, 5), (8e3, 15e3, 4)):
        for _ in range(files):
            target = np.array([rng.uniform(0, 10e3), rng.uniform(near, far)])
            degrees = towards(place, target, rng, 2.0)
            fixes = judged(place, degrees, 2.0).fixes
            off = target - fixes["ekf"].position
            outside = off @ np.linalg.solve(fixes["ekf"].covariance, off) > chi2.ppf(0.999, 2)
            lost += outside
            marked += outside and not fixes["ekf"].believable
            assert fixes["ml"].believable and fixes["iv"].believable
            assert outside or far < 3e3 or fixes["ekf"].believable
            if outside:
                write(tmp_path / "lost.csv", place, degrees, 2)
    assert lost >= 2 and marked == lost
    replay("bearings", file=tmp_path / "lost.csv", progress=False)
    printed = capsys.readouterr().out
    assert "ekf *" in printed and "ml *" not in printed and "\n* do not believe its sigmas" in printed


def test_few_bearings_are_told(tmp_path, capsys):
    place = np.array([[0.0, 0], [4e3, 0], [0, 4e3]])
    for count, words in ((2, "2 bearings tell nothing of their sigma"), (3, "3 bearings tell little of their sigma")):
        degrees = towards(place[:count], np.array([5e3, 6e3]), np.random.default_rng(6), 1.0)
        replay("bearings", file=write(tmp_path / "f.csv", place[:count], degrees), progress=False)
        assert words + ", which all methods take from the residuals" in capsys.readouterr().out


# ------------------------------------------------------------------------------------------------- many rows


def test_a_sample_takes_one_of_each_stretch():
    rows = sample(10_000, 100)
    np.testing.assert_array_equal(rows // 100, np.arange(100))
    assert len(np.unique(rows % 3)) == 3 and np.array_equal(sample(50, 100), np.arange(50))
    np.testing.assert_array_equal(rows, sample(10_000, 100))


def test_what_is_thinned_is_told_and_ml_takes_all(tmp_path, capsys, monkeypatch):
    for one in (module, bearings_report):
        monkeypatch.setattr(one, "MOST", 60)
    monkeypatch.setattr(bearings_report, "_TOLD", 1)
    monkeypatch.setattr(von_mises, "_MOST", 100)
    stations = np.array([[0.0, 0], [10e3, 0], [0, 10e3]])
    place = stations[np.arange(2000) % 3]
    degrees = towards(place, np.array([8e3, 9e3]), np.random.default_rng(7), 2.0)
    file = write(tmp_path / "f.csv", place, degrees, 2)
    result = replay("bearings", file=file, out=tmp_path / "out", progress=False)
    printed = capsys.readouterr().out
    assert "took 60 of the 2000 bearings" in printed and "these are the 1 worst of" in printed
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["bearings_in_blocks"] == 60
    all_of_them = von_mises.weighted_fix(place, np.radians(90 - degrees), np.ones(2000), [np.array([8e3, 9e3])])
    np.testing.assert_allclose(result.fixes["ml"].position, all_of_them, rtol=1e-6)
    # 2000 instead of 60 bearings: sigma is smaller by their root
    ratio = np.sqrt(np.trace(result.fixes["iv"].covariance) / np.trace(result.fixes["ml"].covariance))
    assert ratio == pytest.approx(math.sqrt(2000 / 60), rel=0.2)


@pytest.mark.slow
def test_a_hundred_thousand_rows_end(tmp_path):
    place = np.array([[0.0, 0], [10e3, 0], [0, 10e3]])[np.arange(100_000) % 3]
    degrees = towards(place, np.array([20e3, 30e3]), np.random.default_rng(8), 2.0)
    result = replay("bearings", file=write(tmp_path / "f.csv", place, degrees), out=tmp_path / "out", progress=False)
    # sigma is 10 and 15 m
    np.testing.assert_allclose(result.fixes["ml"].position, [20e3, 30e3], atol=60)
