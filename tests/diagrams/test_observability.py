"""`quietfix observe` on the packaged systems."""

import json

import numpy as np
import pytest

from diagrams.errors import UserError
from diagrams.marker import MARKER
from diagrams.observability import direction_axes, observe, prior_scale, share_words
from tests.diagrams.test_command_line import in_process


def test_the_height_is_what_the_satellites_know_last_and_more_rows_know_it_sooner():
    all_six, without_b, without_fdoa = observe("three_satellite")
    assert all_six.estimators == ["iekf", "ekf", "ukf"]
    assert [len(one.rows) for one in (all_six, without_b, without_fdoa)] == [6, 5, 3]
    assert all_six.observable_from < without_b.observable_from < without_fdoa.observable_from < 150
    for one in (all_six, without_b, without_fdoa):
        names, shares = zip(*one.weakest().items(), strict=True)
        # two time differences leave the line towards the satellites: 45 deg above the horizon at the start
        assert names[0] == "height" and shares[0] == pytest.approx(0.5, abs=0.05)
        assert "along the line of sight" in one.weakest_words() and "observable: all 6" in one.verdict()
        assert (np.diff(one.spectrum.sigma[2:], axis=0) < 0).all()


def test_time_differences_alone_leave_two_directions_of_three_at_one_epoch():
    settings = ["estimators.iekf.measurements=[tdoa]"]
    (one,) = observe("three_satellite", estimators=["iekf"], window=0.0, set=settings)
    assert one.rows == ["tdoa_10", "tdoa_20"] and one.times.size == 1
    assert one.spectrum.rank.tolist() == [2] and np.isinf(one.spectrum.condition[0])
    shares = one.unknown()
    assert sum(value for name, value in shares.items() if "velocity" in name) == pytest.approx(3.0)
    assert sum(shares.values()) == pytest.approx(4.0) and shares["height"] > 0.4
    assert one.verdict().startswith("unobservable within 0 s: rank 2 of 6; 4 directions")


def test_bearings_cannot_range_a_moving_target_before_the_observer_turns():
    slow = ["period_s=5"]
    (straight,) = observe("bearing_crossing:manoeuvre", estimators=["ekf"], window=100.0, set=slow)
    assert straight.spectrum.rank[-1] == 3 and np.isnan(straight.observable_from)
    assert "unobservable within 100 s: rank 3 of 4" in straight.verdict()
    # the scale of the picture: range, and velocity relative to the observer, here mostly across the line of sight
    assert share_words(straight.weakest()).startswith("velocity in cross-range 9")
    (whole,) = observe("bearing_crossing:manoeuvre", estimators=["ekf"], set=slow)
    assert 480 < whole.observable_from < 900
    # from the turn on, at 500 s less half the turn
    assert (whole.spectrum.rank[2:94] == 3).all() and (whole.spectrum.rank[100:] == 4).all()


def test_a_target_at_rest_is_crossed_by_the_second_bearing():
    (one,) = observe("bearing_crossing", estimators=["ekf"], window=100.0)
    assert one.components == ["range", "cross-range"]
    assert one.spectrum.rank[:2].tolist() == [1, 2]
    assert next(iter(one.weakest())) == "range"


def test_a_rockets_bias_and_states_of_another_size():
    (one,) = observe("beacon_rocket:experiment_1", window=0.2, set=["stop_s=60"])
    assert one.estimators == ["ukf", "iekf"] and one.components[-1] == "bias"
    # 8 rows for 10 states, of which acceleration enters none
    assert one.spectrum.rank[0] == 7 and one.spectrum.rank[-1] == 10
    assert {name for name, share in one.unknown(0).items() if share > 0.999} == {
        f"acceleration {axis}" for axis in ("down-range", "up at the site", "across")
    }
    with pytest.raises(UserError, match=r"estimator: ukf_unaugmented has a state of its own.*ukf"):
        observe("beacon_rocket:experiment_1", estimators=["ukf_unaugmented"], window=0.2, set=["stop_s=60"])


def test_rates_tell_the_range_of_a_satellite_sooner_than_angles():
    found = {one.estimators[-1]: one for one in observe("satellite_ranging", window=1000.0)}
    assert found["bank"].spectrum.rank[0] == 6 and found["bo"].spectrum.rank[0] == 2
    assert found["bank"].observable_from < found["bcr"].observable_from < found["bo"].observable_from
    assert next(iter(found["bo"].weakest())) == "range"


def test_axes_are_orthonormal():
    rng = np.random.default_rng(0)
    state = np.concatenate([[6.4e6, 1e5, 2e5], rng.standard_normal(3) * 100])
    carrier = np.concatenate([[7e6, 0, 0], rng.standard_normal(3)])
    for frame, axes in (("earth_fixed", 3), ("inertial", 3), ("local", 3), ("launch", 3), ("local", 2)):
        part = state if axes == 3 else state[[0, 1, 3, 4]]
        names, rotation = direction_axes(part, carrier, frame, axes)
        assert len(names) == axes
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(axes), atol=1e-12)
    still = direction_axes(state[:3], carrier, "earth_fixed")
    assert still[0] == ["up", "to the north", "to the east"]
    # north is where the axis of the Earth is, east is where it turns to
    assert still[1][1][2] > 0.99 and still[1][2] @ np.cross([0, 0, 1], state[:3]) > 0


def test_the_scale_is_the_narrowest_priors_widest_direction():
    names = ("x", "y", "vx", "vy", "bias")
    turned = np.array([[0.6, -0.8], [0.8, 0.6]])
    prior = np.zeros((5, 5))
    prior[:2, :2] = turned @ np.diag([30.0**2, 2.0**2]) @ turned.T
    prior[2:4, 2:4] = 25.0 * np.eye(2)
    prior[4, 4] = 9.0
    np.testing.assert_allclose(prior_scale(names, [prior, 1e12 * np.eye(5)]), [30, 30, 5, 5, 3])


def test_command_writes_table_words_json_and_figures(capsys, tmp_path):
    folder = tmp_path / "found"
    status, out, err = in_process(
        capsys, "observe", "three_satellite", "--window", "40", "--estimator", "iekf", "--out", str(folder)
    )
    assert status == 0, err
    assert "better than" in out and "iekf: observable: all 6 directions" in out and "4.21e+03 m" in out
    assert {path.name for path in folder.iterdir()} == {MARKER, "summary.json", "observability_iekf.png"}
    summary = json.loads((folder / "summary.json").read_text())
    one = summary["sets"][0]
    assert summary["system"] == "three_satellite" and summary["variant"] is None
    assert len(summary["time_s"]) == len(one["rank"]) == len(one["sigma"]) == 41
    assert one["rank"][0] == 5 and one["sigma"][0][-1] is None and one["condition"][0] is None
    assert one["observable_from_s"] == 27.0
    assert sum(one["weakest"][-1]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["observe", "three_satellite", "--window", "151"], "window: 151 is not allowed; 0 to 150 s"),
        (["observe", "three_satellite", "--window", "-1"], "window: -1 is not allowed"),
        (["observe", "three_satellite", "--window", "nan"], "window: nan is not allowed"),
        (["observe", "three_satellite", "--window", "long"], "--window"),
        (["observe", "three_satellite", "--estimator", "kalmann"], "estimator: kalmann is not"),
        (["observe", "three_satelite"], "system: three_satelite"),
        (["observe", "three_satellite", "--set", "truth.speed=1"], "speed"),
    ],
)
def test_mistakes_are_one_line_and_status_2(capsys, arguments, message):
    status, out, err = in_process(capsys, *arguments)
    assert status == 2 and out == ""
    assert message in err and err.count("\n") == 1
