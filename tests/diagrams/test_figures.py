import matplotlib.pyplot as plt
import numpy as np
import pytest

from quietfix.diagrams.figures import study_figures
from quietfix.diagrams.figures.consistency import draw_consistency
from quietfix.diagrams.figures.convergence import draw_convergence
from quietfix.diagrams.figures.errors import draw_error
from quietfix.diagrams.figures.ground import draw_ground
from quietfix.diagrams.figures.particles import draw_particle_health, particle_filters
from quietfix.diagrams.figures.shared.style import looks
from quietfix.diagrams.quantities.frame import EARTH_FIXED
from quietfix.diagrams.statistics.metrics import convergence_time, rmse
from quietfix.diagrams.statistics.state_errors import BOUNDS, errors
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.trajectories.great_circle import straight_line
from tests.diagrams.results import result

ALL = {
    "error_position.png",
    "error_height.png",
    "error_speed.png",
    "error_course.png",
    "percentiles_position.png",
    "nees.png",
    "nis.png",
    "ground.png",
    "convergence.png",
}


def full_result(**keywords):
    """A result with bounds and carriers."""
    data = result(**keywords)
    time = data["time"].values
    curve = 500 / (1 + time / 20)
    for name in BOUNDS:
        scale = 0.8 if name.startswith("bound_truth") else 1.0
        data[name] = (("estimator", "time"), np.array([scale * curve] * (data.sizes["estimator"] - 1) + [2 * curve]))
    starts = geodetic_state(np.radians([1.0, 1.5]), np.radians([2.0, 2.5]), 700e3, np.radians(30.0), 7000.0)
    return data.assign(platforms=(("time", "platform", "coordinate"), straight_line(starts, time[:, None])))


def test_all_figures_are_written_at_1200_pixels(tmp_path):
    written = study_figures(full_result(), tmp_path)
    assert {path.name for path in written} == ALL == {path.name for path in tmp_path.iterdir()}
    for path in written:
        width = int.from_bytes(path.read_bytes()[16:20], "big")
        assert width == 1200
    assert plt.get_fignums() == []


def test_a_result_without_velocity_bounds_carriers_or_nis(tmp_path):
    data = result(trials=1).isel(state=slice(0, 3))
    data["nis"][:] = np.nan
    written = study_figures(data, tmp_path)
    assert {path.name for path in written} == ALL - {"error_speed.png", "error_course.png", "nis.png"}


def test_a_target_at_rest_has_no_course_to_draw(tmp_path):
    data = full_result()
    data["truth"][:, 3:] = 0
    data["truth"][:, :3] = data["truth"][0, :3]
    assert {path.name for path in study_figures(data, tmp_path)} == ALL - {"error_course.png"}


def test_lost_trials_and_trials_with_their_own_truth(tmp_path):
    data = full_result(trials=4)
    data["estimate"][0, 1, 5:] = np.nan
    data["nees"][0, 1, 5:] = np.nan
    data["estimate"][1] = np.nan  # nothing left of this one
    truth = np.broadcast_to(data["truth"].values, (4, *data["truth"].shape)).copy()
    truth[2, 3] = np.nan
    data = data.assign(truth=(("trial", "time", "state"), truth))
    assert {path.name for path in study_figures(data, tmp_path)} == ALL
    data = data.assign(platforms=data["platforms"].expand_dims(trial=4))
    assert draw_ground(data).axes[0].lines
    figure = draw_error(data, "position", rmse(errors(data)["position"]))
    assert any("infinite at" in words for words in legend(figure.axes[0]))


def legend(axes):
    """What the legend of some axes says."""
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_errors_are_drawn_as_they_are():
    data = full_result(names=("iekf", "ukf", "other"))
    curve = rmse(errors(data)["position"])
    figure = draw_error(data, "position", curve)
    axes = figure.axes[0]
    for i, name in enumerate(("iekf", "ukf", "other")):
        np.testing.assert_array_equal(axes.lines[i].get_ydata(), curve.sel(estimator=name))
        assert axes.lines[i].get_color() == looks(data)[0][name].color
    # two kinds of bound, each once for iekf and ukf, which share it, and once for the other
    bounds = axes.lines[3:]
    assert len(bounds) == 4
    assert [line.get_color() for line in bounds] == [looks(data)[0][name].color for name in ("iekf", "other")] * 2
    np.testing.assert_array_equal(bounds[2].get_ydata(), data["bound_truth_position"].sel(estimator="iekf"))
    assert axes.get_yscale() == "log" and "[m]" in axes.get_ylabel() and "[s]" in axes.get_xlabel()
    assert legend(axes) == [
        *("iekf", "ukf", "other"),
        *("bound, filter's process noise:", "iekf, ukf", "other"),
        *("bound, true motion's process noise:", "iekf, ukf", "other"),
    ]
    entries = axes.get_legend().legend_handles
    assert [entries[i].get_color() for i in (4, 5)] == [bounds[0].get_color(), bounds[1].get_color()]


@pytest.mark.parametrize(("kind", "one"), [("nees", 6.0), ("nis", 1.0)])
def test_consistency_shows_curve_and_band(kind, one):
    data = result(trials=50)
    axes = draw_consistency(data, kind).axes[0]
    assert axes.lines[0].get_ydata()[0] == one
    mean = data[kind].mean("trial") / (5.0 if kind == "nis" else 1.0)
    np.testing.assert_allclose(axes.lines[1].get_ydata(), mean.isel(estimator=0))
    (band,) = axes.collections
    low, high = band.get_paths()[0].vertices[:, 1].min(), band.get_paths()[0].vertices[:, 1].max()
    assert low < one < high and axes.get_yscale() == "linear"
    data[kind][0] *= 1e3
    assert draw_consistency(data, kind).axes[0].get_yscale() == "log"


def test_convergence_bars_are_the_times():
    data = result(trials=50)
    curve = rmse(errors(data)["position"])
    curve[1] = curve[1].isel(time=0)  # does not converge
    axes = draw_convergence(data, curve).axes[0]
    first, second = (list(container) for container in axes.containers)
    expected = [convergence_time(data["time"], curve[0], fraction=f) for f in (0.75, 0.5, 1 / 3)]
    assert [bar.get_height() for bar in first] == expected and expected[0] < expected[2]
    assert [bar.get_height() for bar in second] == [0, 0, 0]
    assert sum(text.get_text() == "not reached" for text in axes.texts) == 3


def test_colours_differ_and_stay():
    names = ("a", "b", "c", "d", "e")
    (shown,) = looks(result(names=names))
    assert len({look.color for look in shown.values()}) == 5
    assert looks(result(names=names[:2])) == [{name: shown[name] for name in names[:2]}]


def test_inertial_states_have_no_ground_track(tmp_path):
    data = result()
    data.attrs["frame"] = "inertial"
    names = {path.name for path in study_figures(data, tmp_path)}
    assert "ground.png" not in names and "error_height.png" not in names and "error_position.png" in names
    assert "orbits.png" in names


def test_tracks_across_the_date_line_stay_together():
    data = full_result()
    time = data["time"].values
    target, west = (geodetic_state(0.1, np.radians(degrees), 0.0, np.radians(90.0), 300.0) for degrees in (-179.9, 179))
    west[3:] *= 20
    data = data.assign(
        truth=(("time", "state"), straight_line(target, time)),
        platforms=(("time", "platform", "coordinate"), straight_line(west[None], time[:, None])),
    )
    axes = draw_ground(data).axes[0]
    longitudes = np.concatenate([line.get_xdata() for line in axes.lines])
    assert np.ptp(longitudes) < 10
    ends = [line.get_xydata()[-1] for line in axes.lines]
    assert min(np.abs(np.subtract(end, axes.texts[0].xy)).max() for end in ends) < 1e-9
    left = axes.get_xlim()[0]
    assert left < -180  # the axis runs on, its numbers do not
    axes.figure.draw_without_rendering()
    shown = [float(text.get_text().replace("\N{MINUS SIGN}", "-")) for text in axes.get_xticklabels()]
    assert 3 <= len(shown) <= 8 and -180 < min(shown) < 0 < max(shown) <= 180


def test_a_room_is_told_in_metres():
    data = full_result()
    data.attrs["frame"] = "local"
    corner = np.zeros((2, data.sizes["time"], 6)) + np.array([[[0.0, 0, 3, 0, 0, 0]], [[40.0, 30, 3, 0, 0, 0]]])
    truth = np.linspace([5.0, 4, 1, 0, 0, 0], [30.0, 25, 1, 0, 0, 0], data.sizes["time"])
    data = data.assign(
        truth=(("time", "state"), truth),
        platforms=(("platform", "time", "coordinate"), corner[: data.sizes.get("platform", 1)]),
    )
    axes = draw_ground(data).axes[0]
    assert axes.get_xlabel() == "east [m]" and axes.get_ylabel() == "north [m]"
    format_x = axes.xaxis.get_major_formatter()
    assert format_x(0.03, 0) == "30" and format_x(-0.005, 0) == "\N{MINUS SIGN}5"


def test_errors_beyond_the_edge_leave_the_log_alone(caplog):
    """matplotlib says so where it overrules limits that were set, and a user reads it above the table."""
    data = full_result()
    data["estimate"][0, 0, -1, :3] += 1e7
    figure = draw_ground(data)
    axes = errors_of(figure)[0]
    assert "beyond the edge" in axes.get_title()
    figure.draw_without_rendering()
    assert caplog.text == ""
    assert axes.get_xlim() == axes.get_ylim()


def errors_of(figure):
    """The axes of a figure of the ground that show where the estimates end."""
    return [axes for axes in figure.axes if axes.get_title().startswith("estimate minus truth")]


def test_small_errors_are_drawn_in_metres():
    small, large = (errors_of(draw_ground(full_result(scale=scale)))[0] for scale in (10.0, 1e5))
    assert small.get_xlabel() == "east [m]" and small.get_ylabel() == "north [m]"
    assert large.get_xlabel() == "east [km]"
    reach = max(np.abs(line.get_xydata()).max() for line in small.lines if len(line.get_xdata()) > 2)
    assert 1 < reach < 100  # sigma 10 m, a sixth of that at the end


def test_health_of_particle_filters():
    """Drawn where a result has it, for those that have it."""
    data = full_result(names=("iekf", "pf"))
    assert particle_filters(data) == []
    with pytest.raises(ValueError, match="keep='measurements'"):
        draw_particle_health(data)
    shape = data.sizes["trial"], data.sizes["time"], 1
    for port, value in (("ancestors", 300.0), ("effective_particles", 6e3), ("recent_evidence", -0.2)):
        data[f"{port}_pf"] = (("trial", "time", f"{port}_pf_row"), np.full(shape, value))
    assert particle_filters(data) == ["pf"]
    figure = draw_particle_health(data)
    assert [axes.get_ylabel() for axes in figure.axes] == ["unique ancestors", "effective particles", "recent evidence"]
    assert [len(axes.get_lines()) for axes in figure.axes] == [1, 1, 2]  # and the threshold of the evidence


def test_platforms_are_named_where_their_tracks_end():
    data = full_result().assign_coords(platform=["east", "west"])
    figure = draw_ground(data)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    labels = {text.get_text(): text for text in axes.texts}
    ends = EARTH_FIXED.ground.places(data["platforms"].values[-1, 0, None, :3], data["truth"].values[0, :3])
    assert {"east", "west"} <= set(labels)
    np.testing.assert_allclose(labels["east"].xy, ends[0], rtol=1e-12)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["platforms", "target"]


def test_a_trial_that_is_lost_does_not_press_the_others_into_a_point():
    data = result(trials=50)
    near = errors_of(draw_ground(data))[0]
    assert "beyond" not in near.get_title()
    data["estimate"][0, 7] += 1e7
    far = errors_of(draw_ground(data))[0]
    assert "(1 beyond the edge" in far.get_title() and far.get_xlim()[1] < 1e3
