import json

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams.statistics.consistency import chi_square_band, nees_statistics, nis_statistics
from quietfix.diagrams.statistics.metrics import (
    armse,
    convergence_time,
    diverged,
    median,
    percentile,
    rmse,
    summarise,
)
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_state
from tests.diagrams.results import level_flight, result


def displaced(local=(0.0, 0.0, 0.0), speed=300.0, course=60.0):
    """One trial whose estimate is `local` metres off in east, north, up, with its own speed and course."""
    data = result(names=("only",), trials=1)
    _, truth = level_flight()
    lat, lon, height = ecef_to_geodetic(truth[:, :3])
    place = truth[:, :3] + (np.swapaxes(enu_rotation(lat, lon), -1, -2) @ np.asarray(local))
    lat, lon, height = ecef_to_geodetic(place)
    estimate = geodetic_state(lat, lon, height, np.radians(course), speed)
    return data.assign(estimate=(("estimator", "trial", "time", "state"), estimate[None, None]))


def test_errors_of_known_displacements():
    up = errors(displaced(local=(0, 0, 250.0)))
    np.testing.assert_allclose(up["position"], 250.0, rtol=1e-9)
    # straight up along the ellipsoid's normal: height takes all of it; 1e-6 m is the rounding of Earth radii
    np.testing.assert_allclose(up["height"], 250.0, atol=1e-6)
    east = errors(displaced(local=(1000.0, 0, 0)))
    np.testing.assert_allclose(east["position"], 1000.0, rtol=1e-9)
    # 1 km along the tangent rises by d^2 / 2R = 0.078 m
    np.testing.assert_allclose(east["height"], 0.078, atol=0.002)


def test_speed_and_course_errors_have_signs_and_wrap():
    slow = errors(displaced(speed=290.0, course=50.0)).isel(time=0)
    assert slow["speed"].item() == pytest.approx(-10.0, abs=1e-6)
    assert slow["course"].item() == pytest.approx(-10.0, abs=1e-6)
    # course 350 for 60 true is 70 to the left, not 290 to the right
    assert errors(displaced(course=350.0)).isel(time=0)["course"].item() == pytest.approx(-70.0, abs=1e-6)
    chord = 2 * 300 * np.sin(np.radians(70 / 2))
    assert errors(displaced(course=350.0)).isel(time=0)["velocity"].item() == pytest.approx(chord, rel=1e-6)


def test_course_of_a_target_at_rest_is_undefined():
    data = displaced()
    still = data["truth"].values.copy()
    still[:, 3:] = 0
    found = errors(data.assign(truth=(("time", "state"), still)))
    assert np.isnan(found["course"]).all()
    np.testing.assert_allclose(found["speed"], 300.0, rtol=1e-9)


def test_state_without_velocity_has_position_and_height_only():
    found = errors(result().isel(state=slice(0, 3)))
    assert set(found) == {"position", "height"}


def test_truth_per_trial_equals_shared_truth():
    data = result()
    shared = data["truth"].values
    copied = np.broadcast_to(shared, (data.sizes["trial"], *shared.shape))
    again = errors(data.assign(truth=(("trial", "time", "state"), copied)))
    for name, value in errors(data).items():
        np.testing.assert_array_equal(again[name], value)


def test_rmse_is_that_of_the_definition():
    data = result()
    gap = data["estimate"].values - data["truth"].values
    expected = np.sqrt((gap[..., :3] ** 2).sum(-1).mean(1))
    np.testing.assert_allclose(rmse(errors(data)["position"]), expected, rtol=1e-12)
    lengths = np.linalg.norm(gap[..., :3], axis=-1)
    np.testing.assert_allclose(median(errors(data)["position"]), np.median(lengths, axis=1), rtol=1e-12)
    np.testing.assert_allclose(percentile(errors(data)["position"], 90), np.percentile(lengths, 90, axis=1), rtol=1e-12)


def test_a_lost_trial_makes_rmse_infinite_and_moves_the_median():
    data = result(trials=3)
    data["estimate"][0, 2, 5:] = np.nan
    found = errors(data)
    position = rmse(found["position"]).values
    assert np.isfinite(position[0, :5]).all() and np.isinf(position[0, 5:]).all()
    assert np.isfinite(position[1]).all()
    left = np.sort(found["position"].values[0, :2, 5:], axis=0)
    np.testing.assert_allclose(median(found["position"]).values[0, 5:], left[1])
    data["estimate"][0, 1, 5:] = np.inf
    assert np.isinf(median(errors(data)["position"]).values[0, 5:]).all()


def test_unknown_truth_is_left_out_and_touches_no_other_trial():
    data = result(trials=4)
    copied = np.broadcast_to(data["truth"].values, (4, *data["truth"].shape)).copy()
    copied[1, 7] = np.nan
    copied[:, 9] = np.nan
    found = rmse(errors(data.assign(truth=(("trial", "time", "state"), copied)))["position"])
    without = rmse(errors(data.isel(trial=[0, 2, 3]))["position"])
    np.testing.assert_allclose(found[:, 7], without[:, 7], rtol=1e-14)
    assert np.isnan(found[:, 9]).all()
    others = [k for k in range(data.sizes["time"]) if k not in (7, 9)]
    np.testing.assert_array_equal(found[:, others], rmse(errors(data)["position"])[:, others])


def test_a_consistent_filter_is_inside_the_bands_as_often_as_they_say():
    data = result(names=("one",), trials=50, epochs=400, seed=5)
    for found, mean in ((nees_statistics(data), "mean"), (nis_statistics(data), "ratio")):
        inside = (found[mean] > found["lower"]) & (found[mean] < found["upper"])
        # 400 independent epochs at 95 %: standard deviation 1.1 %; 4 of them
        assert 0.906 < float(inside.mean()) < 0.994


def test_bands_sum_the_degrees_of_freedom():
    lower, upper = chi_square_band(600, 100)
    assert lower == pytest.approx(chi2.ppf(0.025, 600) / 100)
    assert upper == pytest.approx(chi2.ppf(0.975, 600) / 100)
    data = result(trials=5)
    data["nis_dof"][:, 3] = 2.0
    data["nis"][:, 4] = np.nan
    data["nis_dof"][:, 4] = 0.0
    found = nis_statistics(data)
    np.testing.assert_allclose(found["upper"], chi2.ppf(0.975, 17) / 17)
    np.testing.assert_allclose(found["dof_mean"], 17 / 4)
    np.testing.assert_allclose(found["ratio"], data["nis"].isel(trial=slice(0, 4)).sum("trial") / 17)
    data["nis"][:] = np.nan
    data["nis_dof"][:] = 0.0
    assert np.isnan(nis_statistics(data)["ratio"]).all() and (nis_statistics(data)["dof_mean"] == 0).all()


def test_armse_is_the_mean_over_time():
    assert armse([1.0, 2.0, np.nan, 3.0]) == 2.0
    assert armse([1.0, np.inf]) == np.inf
    assert np.isnan(armse([np.nan]))


def test_convergence_time():
    time = np.arange(6.0)
    assert convergence_time(time, [10, 6, 4, 6, 5, 2]) == 4.0  # below half at 2, but not to stay
    assert convergence_time(time, [10, 9, 8, 7, 6, 5.1]) != convergence_time(time, [10, 9, 8, 7, 6, 5.0])
    assert np.isnan(convergence_time(time, [10, 9, 8, 7, 6, 5.1]))
    assert convergence_time(time, [10, 9, 8, 7, 6, 5.1], threshold=20) == 0.0
    assert convergence_time(time, [10, 9, 8, 7, 6, 5.1], fraction=0.75) == 3.0
    assert np.isnan(convergence_time(time, [10, 4, 4, 4, 4, np.inf]))
    assert convergence_time(time, [10, 4, np.nan, 4, 4, np.nan]) == 1.0
    assert np.isnan(convergence_time(time, [np.inf] * 6))


def test_divergence_is_judged_at_the_last_epoch():
    data = result(trials=4, divergence=5e3)
    data["estimate"][0, 0, 3] += 1e6  # recovered
    data["estimate"][0, 1, -1, 0] += 6e3
    data["estimate"][1, 2, -1] = np.nan
    np.testing.assert_array_equal(diverged(data), [[False, True, False, False], [False, False, True, False]])
    assert diverged(data, limit=1e9).sum() == 1


def test_summary_is_json_and_says_null_where_nothing_is_defined():
    data = result(trials=4)
    data["estimate"][0, 0, -1] = np.nan
    data["nis"][:, :, 0] = np.nan
    data["nis_dof"][:, :, 0] = 0.0
    data["bound_position"] = (("estimator", "time"), np.full((2, data.sizes["time"]), 7.0))
    summary = json.loads(json.dumps(summarise(data), allow_nan=False))
    assert set(summary) == {"iekf", "ukf"}
    one = summary["iekf"]
    expected = {
        "rmse_position_m",
        "median_position_m",
        "rmse_velocity_mps",
        "nees_mean",
        "nis_mean",
        "nis_dof_mean",
        "rmse_height_m",
        "rmse_speed_mps",
        "rmse_course_deg",
        "bound_position_m",
        "bound_height_m",
        "bound_velocity_mps",
        "bound_truth_position_m",
        "bound_truth_height_m",
        "bound_truth_velocity_mps",
        "bound_speed_mps",
        "bound_course_deg",
        "bound_truth_speed_mps",
        "bound_truth_course_deg",
        "causal",
        "diverged",
        "lost",
        "ever_lost",
        "not_started",
        "armse_position_m",
        "convergence_time_s",
    }
    assert set(one) == expected
    lists = {name: value for name, value in one.items() if isinstance(value, list)}
    assert all(len(value) == data.sizes["time"] for value in lists.values())
    assert one["rmse_position_m"][-1] is None and one["rmse_position_m"][0] > 0
    assert one["median_position_m"][-1] > 0
    assert one["nis_mean"][0] is None and one["nis_dof_mean"][0] == 0.0
    assert one["bound_position_m"] == [7.0] * data.sizes["time"]
    assert one["bound_height_m"] == [None] * data.sizes["time"]
    assert one["diverged"] == 1 and summary["ukf"]["diverged"] == 0
    assert one["armse_position_m"] is None and summary["ukf"]["armse_position_m"] > 0
    assert one["convergence_time_s"] is None and summary["ukf"]["convergence_time_s"] > 0
    np.testing.assert_allclose(summary["ukf"]["rmse_height_m"], rmse(errors(data)["height"])[1])
