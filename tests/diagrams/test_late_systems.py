"""Late measurements in the packaged systems: at the bound of what has come, phases resolved, others named."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise

LATE = "latency_s={mean: 3, jitter: 2}"
SATELLITES = ["truth.motion=!RandomAcceleration {}", f"truth.{LATE}"]
GATE = "gate: {probability: 0.999, per: row, release_after: 5}"


def ratio(study, name):
    """Return RMSE over bound of the position at the epochs of the result."""
    told = np.array(summarise(study)[name]["rmse_position_m"], dtype=float)
    bound = study["bound_position"].sel(estimator=name)
    return told / bound.reindex(time=study["time"]).values


@pytest.mark.slow
def test_three_satellite_at_the_bound_of_what_has_come():
    """Phases resolved by the filter's own prediction for their time; 400 trials: RMSE good to 3 %, NEES to 0.17."""
    study = run_study("three_satellite", estimators=["iekf"], trials=400, set=["duration_s=60", *SATELLITES])
    told = ratio(study, "iekf")[6:]
    assert np.abs(told - 1).max() < 0.10
    assert abs(study["nees"].mean("trial").values[0, 6:].mean() - 6) < 0.4
    assert not study["dropped_rows"].any()


@pytest.mark.slow
def test_beacon_rocket_at_the_bound_of_what_has_come():
    """Each station's rows come by themselves, out of order; not above the bound by more than 10 %.

    The rocket does not move as the filter believes, and its RMSE is below the bound without latency, too.
    """
    settings = ["stop_s=60", "sensor.latency_s={mean: 0.5, jitter: 0.3}"]
    study = run_study("beacon_rocket", estimators=["ukf"], trials=40, every=20, set=settings)
    assert np.nanmax(ratio(study, "ukf")) < 1.10
    assert abs(np.nanmean(study["nees"].values) / 10 - 0.6) < 0.25  # without latency 0.7


def test_comes_to_the_same_when_all_has_come():
    """Of 3 s without a jitter the estimates of 10 s are those that 7 s had, predicted: phases have the same cycles."""
    common = ["duration_s=12", "truth.motion=!RandomAcceleration {}"]
    plain = run_study("three_satellite", estimators=["iekf"], trials=5, set=common)
    late = run_study("three_satellite", estimators=["iekf"], trials=5, set=[*common, "truth.latency_s.mean=3"])
    before = plain["estimate"].sel(estimator="iekf").values[:, :10]
    now = late["estimate"].sel(estimator="iekf").values[:, 3:]
    moved = np.concatenate([before[..., :3] + 3 * before[..., 3:], before[..., 3:]], axis=-1)
    np.testing.assert_allclose(now, moved, rtol=1e-6, atol=1e-3)


def test_gate_window_smoother_and_cloud_go_back():
    """All of them run beside each other, and end about where the filter does."""
    estimators = [
        f"estimators.gated=!Iekf {{{GATE}}}",
        "estimators.window=!Batch {epochs: 4}",
        "estimators.back=!Smoothed {}",
        "estimators.cloud=!Pf {particles: 300}",
    ]
    names = ["iekf", "gated", "window", "back", "cloud"]
    study = run_study("three_satellite", estimators=names, trials=10, set=["duration_s=12", *SATELLITES, *estimators])
    told = {name: summarise(study)[name]["rmse_position_m"] for name in names}
    assert told["iekf"][0] is None or np.isnan(told["iekf"][0])  # nothing has come yet
    assert told["back"][0] < told["iekf"][-1]
    for name in ("gated", "window", "cloud"):
        assert told[name][-1] == pytest.approx(told["iekf"][-1], rel=0.5)
    assert (study["bound_position"].sel(estimator="back") <= study["bound_position"].sel(estimator="iekf"))[6:].all()


@pytest.mark.parametrize(
    ("system", "settings", "said"),
    [
        (
            "satellite_ranging",
            ["truth.latency_s.mean=20", "duration_s=400"],
            r"^estimators\.ra_look_ahead, ra_paper: it has more .*--estimator ra --estimator bo .*--estimator bank\)",
        ),
        (
            "bearing_crossing",
            ["truth.latency_s.mean=2", "duration_s=20"],
            r"^estimators\.kf_first, way1_first, .*kf_noise_lines: what it takes is made of all .*--estimator ekf",
        ),
        ("three_satellite", ["truth.latency_s.mean=-1"], r"truth\.latency_s\.mean"),
        ("three_satellite", ["truth.latency_s.mean=.nan"], r"truth\.latency_s\.mean"),
        ("three_satellite", ["truth.latency_s.jitter=1"], r"truth\.latency_s\.jitter: 1 is not allowed; at most the"),
        ("beacon_rocket", ["sensor.latency_s={average: 1}"], r"sensor\.latency_s.*average"),
        ("dual_satellite", ["belief.late.times=never"], r"belief\.late\.times"),
        ("dual_satellite", ["belief.late.buffer_s=.inf"], r"belief\.late\.buffer_s"),
    ],
)
def test_in_one_line(system, settings, said):
    with pytest.raises(UserError, match=said) as refused:
        run_study(system, trials=1, set=settings)
    assert "\n" not in str(refused.value)


def test_a_chain_of_baselines_is_resolved_when_it_was_made():
    """Rows of the shorter baselines come with the others; nothing is predicted for them."""
    chain = ["truth.chain_m=[0.045, 0.2, 0.8]", "duration_s=8"]
    plain = run_study("three_satellite", estimators=["iekf"], trials=3, set=chain)
    late = run_study("three_satellite", estimators=["iekf"], trials=3, set=[*chain, "truth.latency_s.mean=2"])
    before, now = (one["estimate"].sel(estimator="iekf").values[..., 3:] for one in (plain, late))
    np.testing.assert_allclose(now[:, 2:], before[:, :-2], rtol=1e-6, atol=1e-6)
