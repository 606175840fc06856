"""Sensors whose measurements come late: at the bound of what has come, a wrong belief, a buffer too short, mistakes."""

from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise
from quietfix.diagrams.statistics.posterior_bound import bound_steps
from quietfix.diagrams.studies.starting import why_not_started
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration

CROSSING = (Path(__file__).parent / "crossing.yaml").as_posix()


@pytest.fixture(scope="module")
def study():
    return run_study(CROSSING, trials=400, set=["duration_s=60"])


def ratio(study, name):
    """Return RMSE over bound of the position at every epoch."""
    return np.array(summarise(study)[name]["rmse_position_m"]) / study["bound_position"].sel(estimator=name).values


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_at_the_bound_of_what_has_come(study, name):
    """Bearings 3 s, and 1 to 5 s, late, of 400 trials: within 10 % of the bound for those times, and consistent.

    The mean square of 400 trials is good to some 5 %, its root to 3 %; their NEES to 6 sqrt(2 / 6 / 400) = 0.17.
    """
    assert np.abs(ratio(study, name) - 1).max() < 0.10
    nees = study["nees"].sel(estimator=name).mean("trial").values
    assert abs(nees.mean() - 6) < 0.4 and abs(nees[-1] - 6) < 0.7
    assert "dropped_rows" in study.coords and not study["dropped_rows"].any()


def test_a_wrong_belief_is_to_be_seen(study):
    """Taken for measurements of the instant at which they come: an aircraft of 182 m/s is 3 s behind itself."""
    naive = run_study(CROSSING, trials=60, set=["duration_s=60", "belief.late.times=arrival"])
    behind = np.array(summarise(naive)["ekf"]["rmse_position_m"])
    assert 450 < behind[-1] < 700  # 3 s at 182 m/s are 547 m
    assert behind[-1] > 5 * summarise(study)["ekf"]["rmse_position_m"][-1]
    assert naive["nees"].sel(estimator="ekf").mean("trial").values[-1] > 100
    np.testing.assert_array_equal(naive["bound_position"].sizes["time"], study["bound_position"].sizes["time"])


def test_a_buffer_too_short_is_said():
    """What comes later is left out, counted by trial, and told below the table."""
    short = run_study(CROSSING, trials=5, estimators=["ekf"], set=["duration_s=20", "belief.late.buffer_s=1"])
    dropped = short["dropped_rows"].sel(estimator="ekf").values
    # west: azimuth and elevation of 0 .. 17 s; east is later than 1 s nearly always
    assert (dropped >= 2 * 18).all()
    (said,) = why_not_started(short, {"ekf": 0})
    assert said == f"ekf: {dropped.sum()} rows came later than its buffer reaches, and are left out"


def test_trials_and_chunks(study):
    """The latency of a trial is its own, whatever runs beside it."""
    other = run_study(CROSSING, trials=3, first_trial=7, set=["duration_s=60"], chunk=2)
    same = study.sel(trial=other["trial"])
    for what in ("estimate", "nees", "nis"):
        np.testing.assert_array_equal(other[what].values, same[what].values, err_msg=what)


def test_without_latency_nothing_changes():
    """A mean of 0 puts no block into the diagram."""
    options = ["duration_s=10", "sensors.west.latency_s.mean=0", "sensors.east.latency_s={mean: 0, jitter: 0}"]
    found = run_study(CROSSING, trials=2, set=options)
    assert "dropped_rows" not in found.coords


def test_the_bound_counts_what_has_come():
    """Epoch by epoch the same as the plain recursion over the rows that have come by then."""
    rng = np.random.default_rng(2)
    model, motion = Bearing(0.01, 0.01), WhiteNoiseAcceleration(0.5)
    times = np.arange(12.0)
    truth = np.array([4e3, 9e3, 2e3, 150.0, -40.0, 5.0])
    truth = (truth + np.outer(times, [*truth[3:], 0, 0, 0]))[None]
    platforms = np.zeros((1, 12, 1, 6))
    platforms[..., 0] = 300.0 * times[:, None]
    prior = np.diag([1e6] * 3 + [2500.0] * 3)
    present = rng.uniform(size=(5, 12, 2)) < 0.8
    arrival = np.ceil(times[:, None] + rng.uniform(0, 4, size=(5, 12, 2)))
    arrival = np.where(arrival > 11, np.inf, arrival)
    steps = bound_steps(truth, platforms, times, model, motion, prior, False, present, None, arrival)
    for k, found in enumerate(steps):
        come = present & (arrival <= k)
        *_, expected = bound_steps(
            truth[:, : k + 1], platforms[:, : k + 1], times[: k + 1], model, motion, prior, False, come[:, : k + 1]
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (["sensors.east.latency_s.jitter=4"], r"sensors\.east\.latency_s\.jitter: 4 is not allowed; at most the mean"),
        (["sensors.ship.latency_s.jitter=1"], r"sensors\.ship\.latency_s\.jitter: 1 is not allowed"),
        (["sensors.east.latency_s.mean=-1"], r"sensors\.east\.latency_s\.mean"),
        (["sensors.east.latency_s=3"], r"sensors\.east\.latency_s"),
        (["belief.late.times=later"], r"belief\.late\.times"),
        (["belief.late.buffer_s=-1"], r"belief\.late\.buffer_s"),
    ],
)
def test_refused(sets, said):
    with pytest.raises(UserError, match=said):
        run_study(CROSSING, trials=2, set=["duration_s=5", *sets])


def test_what_comes_after_the_end_is_told():
    """A latency longer than the run: the estimates would be the prior drifting, without a word."""
    settings = ["duration_s=6", "sensors.west.latency_s={mean: 100}", "sensors.east.latency_s={mean: 1}"]
    with pytest.warns(
        UserWarning, match="^azimuth_west, elevation_west: measured, but all of it comes after the end at 6 s$"
    ):
        run_study(CROSSING, trials=2, set=settings, estimators=["ekf"])
