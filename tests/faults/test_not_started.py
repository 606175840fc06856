"""A trial that never starts is counted as that, says why, and blanks nobody's column."""

import numpy as np
import pytest
import xarray as xr

from quietfix.diagrams.commands.running import print_summary
from quietfix.diagrams.experiments.compare import compare
from quietfix.diagrams.statistics.metrics import diverged, not_started, summarise
from quietfix.diagrams.studies.starting import why_not_started
from quietfix.diagrams.studies.whole import run_study
from quietfix.diagrams.tables.comparison import comparison_table
from quietfix.systems.linear_algebra import inverses, solve

ONE_PLACE = "satellites=[!Offset {along_km: 0.0, across_km: 69.0}, !Offset {along_km: 40.0}, !Offset {along_km: 40.0}]"


def result(estimate, truth=0.0):
    """Return a result of one estimator from x positions (trial, time), on the ground at the equator."""
    x = np.array(estimate, dtype=float)
    states = np.zeros((1, *x.shape, 3))
    states[0, ..., 0] = 6378137.0 + x
    known = np.zeros((x.shape[1], 3))
    known[:, 0] = 6378137.0 + truth
    return xr.Dataset(
        {
            "estimate": (("estimator", "trial", "time", "state"), np.where(np.isnan(states[..., :1]), np.nan, states)),
            "truth": (("time", "state"), known),
            "platforms": (("time", "platform", "coordinate"), np.arange(x.shape[1] * 12.0).reshape(-1, 2, 6)),
            **{name: (("estimator", "trial", "time"), np.full((1, *x.shape), np.nan)) for name in ("nees", "nis")},
            "nis_dof": (("estimator", "trial", "time"), np.zeros((1, *x.shape))),
        },
        {
            "estimator": ["iekf"],
            "trial": range(x.shape[0]),
            "time": range(x.shape[1]),
            "state": ["x", "y", "z"],
            "measured_rows": ("trial", np.full(x.shape[0], 3), {"rows": 5}),
        },
        {"divergence_m": 100.0, "system": "s", "variant": "", "seed": 0},
    )


def test_who_never_started_is_in_no_rmse_and_who_was_lost_is_in_every_one(capsys):
    nan = np.nan
    dataset = result([[3, 3], [4, 4], [nan, nan]])
    assert not_started(dataset).values.tolist() == [[False, False, True]]
    row = summarise(dataset)["iekf"]
    assert row["not_started"] == 1 and row["diverged"] == 0
    assert row["rmse_position_m"] == pytest.approx([np.sqrt(12.5)] * 2, rel=1e-9)
    assert row["median_position_m"] == pytest.approx([3.5] * 2, rel=1e-9)
    print_summary(dataset, {"iekf": row})
    said = capsys.readouterr().out
    assert "0, 1 not started" in " ".join(said.split())
    assert "1 of 3 trials never started" in said and "at most 3 of 5 rows" in " ".join(said.split())
    lost = summarise(result([[3, 3], [4, nan], [nan, 5]]))["iekf"]  # one lost, one late
    assert lost["not_started"] == 0 and lost["diverged"] == 1 and lost["rmse_position_m"] == [None, None]
    nobody = summarise(result([[nan, nan], [nan, nan]]))["iekf"]
    assert nobody["not_started"] == 2 and nobody["rmse_position_m"] == [None, None]
    assert bool(diverged(dataset).values[0, 2])  # alone, and in a requirement, a trial without an estimate is lost


def test_two_platforms_in_one_place_are_told():
    dataset = run_study("three_satellite", estimators=["iekf", "ekf"], trials=3, set=["duration_s=2", ONE_PLACE])
    rows = summarise(dataset)
    assert [row["not_started"] for row in rows.values()] == [3, 3] and [r["diverged"] for r in rows.values()] == [0, 0]
    (line, _) = why_not_started(dataset, {name: row["not_started"] for name, row in rows.items()})
    reason = "platforms satellite_1 and satellite_2 are in one place"
    assert line == f"iekf: 3 of 3 trials never started and are in no RMSE: {reason}"
    found = compare("three_satellite", estimators=["iekf", "ekf"], trials=3, set=["duration_s=2", ONE_PLACE])
    assert found["estimators"]["iekf"]["not_started"] == 3 and "one place" in found["not_started"][0]
    assert comparison_table(found).columns


def test_a_singular_matrix_affects_no_other():
    rng = np.random.default_rng(1)
    many, right = rng.normal(size=(5, 3, 3)), rng.normal(size=(3, 2))
    expected, solved = np.linalg.inv(many), np.linalg.solve(many, right[None])
    assert np.array_equal(inverses(many), expected) and np.array_equal(solve(many, right[None]), solved)
    many[2, 0] = many[2, 1]
    many[2, 2] = 0
    for found, whole in ((inverses(many), expected), (solve(many, right[None]), solved)):
        assert np.isnan(found[2]).all()
        np.testing.assert_allclose(found[[0, 1, 3, 4]], whole[[0, 1, 3, 4]], rtol=1e-9)  # rounding of the inverse
