"""Gross errors, gates and second minima in the packaged systems."""

from pathlib import Path

import numpy as np
import pytest

from quietfix import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import diverged, summarise
from quietfix.diagrams.statistics.state_errors import errors

OWN = Path(__file__).parents[1] / "own"
GROSS = {"truth.errors.outlier_rate": 0.05}
GATE = {"estimators.iekf.gate.probability": 0.999}


def three(trials, settings, **also):
    return run_study("three_satellite", estimators=["iekf"], trials=trials, set=settings, **also)


def squares(result):
    return errors(result)["position"].values[0] ** 2


def test_gross_errors_behind_a_gate():
    """A quarter of the trials of the slow test, and wider bands: both ends of a ratio of 60 trials move by a tenth."""
    none, gated = three(60, {"duration_s": 60}), three(60, {**GROSS, **GATE, "duration_s": 60})
    ratio = np.sqrt(squares(gated)[:, -1].mean() / squares(none)[:, -1].mean())
    assert 0.8 < ratio < 1.4
    entry = summarise(gated)["iekf"]
    assert entry["diverged"] == entry["lost"] == entry["ever_lost"] == 0
    # six rows, 60 epochs, 5 %, of which 13 % are smaller than 3.3 sigma; phases behind a bad TDOA go with it
    assert 0.8 * 60 * 60 * 6 * 0.05 < entry["rejected_rows"] < 2 * 60 * 60 * 6 * 0.05
    assert entry["restarted_trials"] > 0
    assert "rejected_rows" not in summarise(none)["iekf"]


@pytest.mark.parametrize("per", ["row", "epoch"])
def test_a_wide_prior_is_no_reason_to_refuse(per):
    """800 m of prior, differences of 9 m: within it they curve by 60 m, which no gross error is.

    Row by row `ukf` refuses what the limit of 0.999 asks, and some more where the first update has bent its belief: 51
    rows of about 1400 here. With all rows tested together from the first epoch on, a gated trial ends 2.2 km off.
    """
    gate = f"!Ukf {{gate: {{probability: 0.999, per: {per}}}}}"
    settings = {"duration_s": 20, "estimators.gated": gate}
    result = run_study(str(OWN / "drone.yaml"), estimators=["ukf", "gated"], trials=20, set=settings)
    plain, gated = np.sqrt((errors(result)["position"].values[..., -1] ** 2).mean(axis=-1))
    assert gated < 1.2 * plain
    entry = summarise(result)["gated"]
    assert entry["rejected_rows"] < 100
    assert entry["ever_lost"] == 0


def test_rows_that_share_a_free_bias_are_tested_together():
    """The beacon's bias may go anywhere at every step: only all stations together show one of them to be wrong.

    No row is ever known as well by the belief as it measures, and the gate has to close all the same.
    """
    settings = {"stop_s": 56.0, "sensor.errors.outlier_rate": 0.05}
    settings["estimators.gated"] = "!Ukf {gate: {probability: 0.999, per: epoch}}"
    result = run_study("beacon_rocket", estimators=["ukf", "gated"], trials=4, set=settings)
    entries = summarise(result)
    assert entries["gated"]["rejected_rows"] > 200
    assert np.mean(entries["gated"]["nees_mean"][60:]) < 0.5 * np.mean(entries["ukf"]["nees_mean"][60:])


@pytest.mark.slow
def test_gross_errors_behind_a_gate_at_full_size():
    """1000 trials: the paired 95 % interval of the RMSE's ratio lies below 1.3, NEES within 20 %, nobody is lost."""
    none, gated = three(1000, {}), three(1000, {**GROSS, **GATE})
    before, after = squares(none)[:, -1], squares(gated)[:, -1]
    draws = np.random.default_rng(0).integers(0, 1000, (2000, 1000))
    ratios = np.sqrt(after[draws].mean(axis=1) / before[draws].mean(axis=1))
    assert np.percentile(ratios, 97.5) < 1.3
    for epoch in (50, 100, 150):
        nees = [float(result["nees"].values[0, :, epoch].mean()) for result in (none, gated)]
        assert 0.8 < nees[1] / nees[0] < 1.2
    assert int(diverged(gated).sum()) == 0 and not (gated["lost"].values[..., -1] > 0).any()


def test_a_second_minimum_is_left():
    """Trial 48 of seed 0: 8000 km off without another search; its neighbours are the same to the bit."""
    ranging = {"estimators": ["iekf"], "trials": 3, "first_trial": 47}
    with_, without = (
        run_study("satellite_ranging", **ranging, set={"duration_s": 600, "estimators.iekf.retry": retry})
        for retry in (True, False)
    )
    np.testing.assert_array_equal(diverged(with_).values[0], [False, False, False])
    np.testing.assert_array_equal(diverged(without).values[0], [False, True, False])
    np.testing.assert_array_equal(with_["estimate"].values[:, [0, 2]], without["estimate"].values[:, [0, 2]])


@pytest.mark.slow
def test_no_trial_is_lost_in_a_second_minimum():
    """1500 trials to 600 s, as packaged."""
    result = run_study("satellite_ranging", estimators=["iekf"], trials=1500, set={"duration_s": 600})
    assert int(diverged(result).sum()) == 0
    assert not (result["lost"].values > 0).any()


def test_who_is_lost_says_so():
    """An attitude that is off by 1 deg: 70 km, and every trial of the filter is flagged."""
    result = three(10, {"truth.errors.attitude_roll_deg": 1.0, "duration_s": 60})
    entry = summarise(result)["iekf"]
    assert entry["lost"] == entry["ever_lost"] == 10
    assert summarise(three(10, {"duration_s": 60}))["iekf"]["ever_lost"] == 0


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("estimators.iekf.gate.probability", 1.5, r"estimators\.iekf\.gate\.probability: 1\.5 is not allowed"),
        ("estimators.iekf.gate.per", "column", r"estimators\.iekf\.gate\.per: 'column' is not allowed; one of row"),
        ("estimators.iekf.gate.release_after", 0, r"estimators\.iekf\.gate\.release_after: 0 is not allowed"),
        ("estimators.iekf.robust", "!Cauchy {}", r"estimators\.iekf\.robust: !Cauchy is not known"),
        ("estimators.iekf.robust.threshold", 0, r"estimators\.iekf\.robust\.threshold: 0 is not allowed"),
    ],
)
def test_bad_settings(key, value, message):
    with pytest.raises(UserError, match=message):
        three(1, {key: value})
