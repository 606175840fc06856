"""Figures of recordings: in the manner of all others, and nothing far off sets their axes."""

import numpy as np

from quietfix.diagrams.figures.gdop import _smooth
from quietfix.diagrams.figures.shared.style import COLOURS
from quietfix.diagrams.recorded.reports.bearings_figures import draw_fixes, draw_lines
from quietfix.diagrams.recorded.reports.doptrack_figures import draw_station_error
from tests.diagrams.test_figures import legend

PLACE = np.array([[0.0, 0.0], [9e3, 1e3], [2e3, 8e3]])


def fixes(count, far=None):
    found = {f"fox {k}": (np.array([[1e3 * k, 5e3]]), np.diag([1e4, 4e4])) for k in range(count)}
    return found | ({"far": (np.array([[4e6, -1e6]]), np.diag([1e12, 1e6]))} if far else {})


def test_few_targets_have_colours_and_many_have_names():
    few = draw_fixes(PLACE, fixes(7), "ml").axes[0]
    assert legend(few) == [*(f"fox {k}" for k in range(7)), "observers"]
    assert len({handle.get_color() for handle in few.get_legend().legend_handles}) == 7 + 1 - (COLOURS[6] == "k")
    many = draw_fixes(PLACE, fixes(12), "ml").axes[0]
    assert legend(many) == ["observers"]
    assert sorted(text.get_text() for text in many.texts) == sorted(f"fox {k}" for k in range(12))
    assert "12 targets by ml" in many.get_title()


def test_a_target_far_off_is_counted_and_marked():
    axes = draw_fixes(PLACE, fixes(6, far=True), "ml").axes[0]
    assert "(1 beyond the edge" in axes.get_title()
    assert axes.get_xlim()[1] < 60 and axes.get_ylim()[0] > -60
    marks = [line for line in axes.lines if line.get_marker() == "D"]
    ((x, y),) = (line.get_xydata()[0] for line in marks)
    assert abs(x - axes.get_xlim()[1]) < 1e-9 and axes.get_ylim()[0] < y < 0  # on the right, a little to the south
    near = draw_fixes(PLACE, fixes(6)).axes[0]
    assert "beyond" not in near.get_title() and near.get_xlim()[0] < 0 < 9 < near.get_xlim()[1]
    assert "no fix" in draw_fixes(PLACE, {}).axes[0].get_title()


def test_fixes_of_lines_of_bearing_have_a_colour_each():
    names = ("lines", "iv", "ekf", "ml", "robust")
    found = {name: (np.array([3e3, 4e3 + 100 * i]), name != "iv") for i, name in enumerate(names)}
    found["ekf"] = (np.array([3e7, 4e7]), True)
    axes = draw_lines(PLACE, np.array([0.9, 2.4, -1.2]), np.ones(3), found).axes[0]
    assert {"iv, not to be believed", "ekf: far off", "robust"} <= set(legend(axes))
    colours = [handle.get_color() for handle in axes.get_legend().legend_handles]
    assert len(set(colours)) == len(colours) == 6
    assert axes.get_xlim()[1] < 100


def test_the_error_of_a_station_against_the_passes():
    errors = {"bias": np.array([5e4, 2e4, 1e4]), "bias_drift": np.array([6e4, 1e4, np.inf])}
    figure = draw_station_error(errors, "title")
    (axes,) = figure.axes
    assert figure.get_size_inches()[0] * figure.dpi == 1200 and axes.get_ylabel().endswith("[km]")
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[1, 50], [2, 20], [3, 10]])
    assert legend(axes) == ["bias", "bias_drift\n   infinite at 1 epoch"]


def test_contours_run_through_a_finer_grid_that_keeps_the_points_and_makes_no_peaks():
    x, y = np.linspace(0, 3, 7), np.linspace(0, 2, 5)
    values = np.exp(np.sin(3 * x)[None] + y[:, None] ** 2)
    values[0, 3] = np.nan
    fine_x, fine_y, fine = _smooth(y, x, values)
    assert fine.shape == (fine_y.size, fine_x.size) == (33, 49)
    there = fine[::8, ::8]
    np.testing.assert_allclose(there[np.isfinite(values)], values[np.isfinite(values)])
    assert np.isnan(fine[0, 24]) and np.isnan(there[0, 3])
    # half a step from the point that is not seen the map begins again
    assert np.isfinite(fine[0, 24 + 4]) and np.isnan(fine[0, 24 + 3])
    assert np.nanmax(fine) <= np.nanmax(values) * (1 + 1e-12) and np.nanmin(fine) >= np.nanmin(values) * (1 - 1e-12)
    coarse = np.ones((2, 3))
    assert _smooth(np.arange(2.0), np.arange(3.0), coarse)[2] is coarse
