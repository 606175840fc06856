"""`quietfix observe` on the packaged systems."""

import json

import numpy as np
import pytest
from scipy.linalg import eigh

from quietfix.diagrams.experiments.observability import observe, prior_root, share_words
from quietfix.diagrams.quantities.frame import FRAMES
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER
from tests.diagrams.flat_plane import POSITION, STATIONS, SYSTEM, Ranges3, Scenario
from tests.diagrams.test_command_line import in_process


def test_the_height_is_what_the_satellites_know_last_and_more_rows_know_it_sooner():
    all_six, without_b, without_fdoa = observe("three_satellite")
    assert all_six.estimators == ["iekf", "ekf", "ukf"]
    assert [len(one.rows) for one in (all_six, without_b, without_fdoa)] == [6, 5, 3]
    assert all_six.observable_from < without_b.observable_from < without_fdoa.observable_from < 150
    for one in (all_six, without_b, without_fdoa):
        names, shares = zip(*one.weakest().items(), strict=True)
        # two time differences leave the line towards the satellites, 45 deg above the horizon at the start: in terms
        # of what the start knows of each, height and the way along the course weigh the same
        assert names[:2] == ("height", "position along the course") and shares[0] == pytest.approx(shares[1], abs=0.02)
        assert "along the line of sight" in one.weakest_words() and "observable: all 6" in one.verdict()
        assert (np.diff(one.spectrum.sigma[2:], axis=0) < 0).all()


def test_time_differences_alone_leave_two_directions_of_three_at_one_epoch():
    settings = ["estimators.iekf.measurements=[tdoa]"]
    (one,) = observe("three_satellite", estimators=["iekf"], window=0.0, set=settings)
    assert one.rows == ["tdoa_10", "tdoa_20"] and one.times.size == 1
    assert one.spectrum.rank.tolist() == [2] and np.isinf(one.spectrum.condition[0])
    shares = one.unknown()
    assert sum(value for name, value in shares.items() if "velocity" in name) == pytest.approx(3.0)
    # the start is made from these two, so that it knows them just as well
    assert sum(shares.values()) == pytest.approx(6.0)
    assert one.spectrum.left[0] == pytest.approx([0.5, 0.5, 1, 1, 1, 1], abs=1e-3)
    assert one.verdict().startswith("unobservable within 0 s: rank 2 of 6; 6 directions")
    assert "they tell nothing of" in one.verdict() and one.remaining()["height"] > 0.99


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
    # the range is what the start does not know; once it is found, the cross-range of the first bearing has gained least
    late = int(np.argmax(one.spectrum.known == 2))
    assert next(iter(one.weakest(late - 1))) == "range" and next(iter(one.weakest())) == "cross-range"


def test_a_rockets_bias_and_states_of_another_size():
    one, _ = observe("beacon_rocket:experiment_1", window=0.2, set=["stop_s=60"])
    assert one.estimators == ["ukf", "iekf"] and one.components[-1] == "bias"
    # 8 rows for 10 states, of which acceleration enters none
    assert one.spectrum.rank[0] == 7 and one.spectrum.rank[-1] == 10
    assert {name for name, share in one.unknown(0).items() if share > 0.999} == {
        f"acceleration {axis}" for axis in ("down-range", "up at the site", "across")
    }
    (other,) = observe("beacon_rocket:experiment_1", estimators=["ukf_unaugmented"], window=0.2, set=["stop_s=60"])
    assert other.components == one.components[:-1] and other.spectrum.rank[-1] == 9
    # what it takes as known it does not have to find out
    assert all(left <= one.remaining()[name] + 1e-12 for name, left in other.remaining().items())
    assert other.remaining()["position across"] < one.remaining()["position across"]


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
        names, rotation, _ = FRAMES[frame].directions(state[:axes], state[3 : 3 + axes], carrier)
        assert len(names) == axes
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(axes), atol=1e-12)
    still = FRAMES["earth_fixed"].directions(state[:3], np.zeros(3), carrier)
    assert still[0] == ["up", "to the north", "to the east"]
    # north is where the axis of the Earth is, east is where it turns to
    assert still[1][1][2] > 0.99 and still[1][2] @ np.cross([0, 0, 1], state[:3]) > 0


def test_the_prior_is_the_narrowest_and_none_is_singular():
    names = ("x", "y", "bias")
    turned = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    prior = turned @ np.diag([30.0**2, 2.0**2, 9.0]) @ turned.T
    root = prior_root(names, [1e12 * np.eye(3), prior])
    np.testing.assert_allclose(root @ root.T, prior, rtol=1e-12, atol=1e-12)
    with pytest.raises(UserError, match="start: sigma of bias is 0"):
        prior_root(names, [np.diag([1.0, 1.0, 0.0])])
    with pytest.raises(UserError, match="start: its covariance of x, y, bias is singular"):
        prior_root(names, [np.ones((3, 3))])


def test_a_height_that_is_known_to_30_m_is_not_observed_by_ranges_along_the_ground():
    """Stations on a plane, an emitter 20 m above it whose place is known to 1 km.

    Ranges tell its height to half a kilometre: better than the place is known before, a hundredth of what the height
    is.
    """
    (one,) = observe(SYSTEM, scenario=Scenario(height_m=20.0))
    assert one.components == ["range", "cross-range", "height"]
    np.testing.assert_allclose(one.prior_sigma, [1e3, 1e3, 30.0], rtol=1e-12)
    assert one.spectrum.rank[-1] == 3 and one.spectrum.known[-1] == 2 and np.isnan(one.observable_from)
    # 11 epochs of three ranges of 10 m, at 20 m below 4.1 to 9.9 km: the formula is that of one unknown
    slopes = 20.0 / np.linalg.norm(np.array([*POSITION, 20.0]) - STATIONS[0, :, :3], axis=-1)
    alone = 10.0 / np.sqrt(11 * np.square(slopes).sum())
    assert one.spectrum.sigma[-1, -1] > alone / 30 > 10
    assert one.remaining()["height"] == pytest.approx(1.0, abs=0.01)
    assert one.weakest_words() == "height 100 %"
    assert one.verdict() == (
        "weakly observable within 10 s: rank 3, but 1 of 3 directions no better known than the prior: height 100 %; "
        "they tell nothing of height"
    )
    summary = one.summary()
    assert summary["variance_left"][-1][2] > 0.99 > 0.01 > max(summary["variance_left"][-1][:2])


def test_a_height_in_the_plane_of_the_stations_has_no_information_at_all():
    (one,) = observe(SYSTEM, scenario=Scenario(height_m=0.0))
    assert one.spectrum.rank[-1] == 2 and one.spectrum.left[-1, -1] == 1.0
    assert "unobservable within 10 s: rank 2 of 3; 1 direction" in one.verdict()
    assert "they tell nothing of height" in one.verdict()


@pytest.mark.parametrize("correlation", [0.0, 0.95, -0.95])
def test_directions_are_the_generalised_eigenvectors_of_information_and_prior(correlation):
    """Against SciPy's solver and the plain sums: the variances of directions and of components, and the posterior."""
    prior = np.diag([1e6, 1e6, 900.0])
    prior[0, 2] = prior[2, 0] = correlation * 3e4
    (one,) = observe(SYSTEM, scenario=Scenario(height_m=90.0, prior=prior))
    model = Ranges3()
    rows = model.jacobian(np.array([*POSITION, 90.0]), STATIONS[0])
    information = 11 * rows.T @ rows / 10.0**2
    values = eigh(information, np.linalg.inv(prior), eigvals_only=True)[::-1]
    # eigenvalues from 2e5 to 0.007: SciPy squares, so that the least has eight digits
    np.testing.assert_allclose(one.spectrum.sigma[-1] ** -2, values, rtol=1e-7)
    posterior = np.linalg.inv(np.linalg.inv(prior) + information)
    height = one.components.index("height")
    assert one.spectrum.remaining(one.root)[-1, height] == pytest.approx(posterior[2, 2] / prior[2, 2], rel=1e-7)
    # every direction whole: a component's variance is shared out among them
    np.testing.assert_allclose(one.spectrum.shares(one.root)[-1].sum(axis=0), 1.0, rtol=1e-12)


def test_command_writes_table_words_json_and_figures(capsys, tmp_path):
    folder = tmp_path / "found"
    status, out, err = in_process(
        capsys, "observe", "three_satellite", "--window", "40", "--estimator", "iekf", "--out", str(folder)
    )
    assert status == 0, err
    assert "better than" in out and "iekf: observable: all 6 directions" in out and "height 3000 m" in out
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
