"""Figures of one, seven, twelve estimators, some of which are lost: who is who, and where axes end."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb

from quietfix.diagrams.figures.consistency import draw_consistency
from quietfix.diagrams.figures.convergence import draw_convergence
from quietfix.diagrams.figures.errors import draw_error, draw_percentiles
from quietfix.diagrams.figures.ground import draw_ground
from quietfix.diagrams.figures.orbits import draw_orbits
from quietfix.diagrams.figures.shared.curves import never_started
from quietfix.diagrams.figures.shared.limits import curve_span, reach
from quietfix.diagrams.figures.shared.style import COLOURS, OTHERS, groups
from quietfix.diagrams.figures.sweep import draw_sweep
from quietfix.diagrams.statistics.tally import Ensemble
from tests.diagrams.test_figures import errors_of, full_result, legend

LINEAR = np.array([[0.31399, 0.63951, 0.04650], [0.15537, 0.75789, 0.08670], [0.01775, 0.10944, 0.87257]])
"""From linear red, green and blue to the cones of the eye; Machado, Oliveira and Fernandes (2009), as Daltonlens has
it."""
BLIND = {
    "protanopia": np.array([[0, 1.05118294, -0.05116099], [0, 1, 0], [0, 0, 1]]),
    "deuteranopia": np.array([[1, 0, 0], [0.9513092, 0, 0.04866992], [0, 0, 1]]),
}
"""What the eye sees without one kind of cones; Vienot, Brettel and Mollon (1999)."""


def many(count, trials=20):
    """A result of so many estimators, one of which is lost in all trials, one has lost a trial, one never began two."""
    data = full_result(names=tuple(f"estimator_{i}" for i in range(count)), trials=trials)
    if count > 2:
        data["estimate"][-1] += 1e9
        data["estimate"][0, 1, 5:] = np.nan
        data["estimate"][1, 2:4] = np.nan
    return data


def drawn(count):
    """Every figure that tells estimators apart by their colours."""
    data = many(count)
    known = Ensemble(data)
    told = never_started(data, known.sums["not_started"])
    yield draw_error(data, "position", known.rmse("position"), told)
    yield draw_percentiles(data, known.median_of_started, known.ninety_of_started, told)
    yield draw_consistency(data, "nees")
    yield draw_convergence(data, known.rmse("position"), told)
    yield draw_ground(data)
    yield draw_orbits(data.assign_attrs(frame="inertial"))
    yield draw_sweep(swept(count))


def swept(count):
    """What a sweep of so many estimators found."""
    entries = [{"value": 10.0 + i, "low": 9.0 + i, "high": 11.0 + i} for i in range(3)]
    row = {"rmse_position_m": entries, "efficiency": entries, "nees_per_state": entries, "nees_band": [None] * 3}
    return {
        "estimators": {f"estimator_{i}": row for i in range(count)},
        **{"values": [1.0, 2.0, 3.0], "key": "a.b", "system": "s", "variant": None, "time_s": [1.0] * 3},
        **{"trials": 5, "seed": 0, "confidence": 0.95},
    }


def colours_of(axes):
    """Colour of every estimator in the legend of some axes."""
    handles = axes.get_legend().legend_handles
    return {
        words.partition("\n")[0]: to_hex(handle.get_facecolor() if hasattr(handle, "get_width") else handle.get_color())
        for words, handle in zip(legend(axes), handles, strict=True)
        if words.startswith("estimator_") and "," not in words.partition("\n")[0]
    }


@pytest.mark.parametrize("count", [1, 7, 8, 22])
def test_no_two_estimators_of_axes_share_a_colour_and_none_is_left_out(count):
    for figure in drawn(count):
        legends = [axes for axes in figure.axes if axes.get_legend() and colours_of(axes)]
        if not legends:  # one group around the truth has its legend beside the figure
            (only,) = figure.legends
            assert len(only.get_texts()) == count
            assert len({to_hex(handle.get_color()) for handle in only.legend_handles}) == count
            continue
        named = [name for axes in legends for name in colours_of(axes)]
        assert sorted(named) == sorted(f"estimator_{i}" for i in range(count))
        for axes in legends:
            found = colours_of(axes)
            assert len(set(found.values())) == len(found) <= len(COLOURS)
            assert to_hex(OTHERS) not in found.values()


@pytest.mark.parametrize("count", [1, 12])
def test_all_that_is_written_lies_on_the_figure_and_legends_hide_no_curve(count):
    for figure in drawn(count):
        figure.draw_without_rendering()
        width, height = figure.get_size_inches() * figure.dpi
        boxes = [axes.get_tightbbox() for axes in figure.axes] + [one.get_window_extent() for one in figure.legends]
        for box in boxes:
            assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1 and box.y1 <= height + 1
        for axes in figure.axes:
            if axes.get_legend() is not None:
                inside, box = axes.get_window_extent(), axes.get_legend().get_window_extent()
                assert box.x0 >= inside.x1 or box.y1 <= inside.y0 or box.y0 >= inside.y1


def test_groups_are_alike_in_size_and_in_order():
    names = [str(i) for i in range(16)]
    assert [len(group) for group in groups(names)] == [6, 5, 5]
    assert [name for group in groups(names) for name in group] == names
    assert groups(names[:7]) == [names[:7]] and [len(group) for group in groups(names[:8])] == [4, 4]
    assert groups([]) == [[]]


def test_the_colours_are_told_apart_by_those_who_see_two_kinds_of_colours():
    def seen(colour, loss):
        rgb = np.array(to_rgb(colour))
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        back = np.linalg.inv(LINEAR) @ loss @ LINEAR @ linear
        return np.clip(back, 0, 1) ** (1 / 2.2)

    for loss in BLIND.values():
        apart = [np.linalg.norm(seen(a, loss) - seen(b, loss)) for a, b in combinations(COLOURS, 2)]
        # two of them with the same loss of a red and a green that are as light would be 0 apart
        assert min(apart) > 0.12


def test_who_is_lost_does_not_set_the_axes_but_is_counted_and_marked():
    data = many(12)
    known = Ensemble(data)
    told = never_started(data, known.sums["not_started"])
    figure = draw_error(data, "position", known.rmse("position"), told)
    assert all(axes.get_ylim()[1] < 1e6 for axes in figure.axes)
    first, second = (legend(axes) for axes in figure.axes)
    assert first[0] == "estimator_0\n   infinite at 16 epochs" and first[1] == "estimator_1\n   2 of 20 never started"
    assert next(words for words in second if "above" in words).startswith(
        "estimator_11\n   above at 21 epochs, up to 1"
    )
    marked = {line.get_color() for axes in figure.axes for line in axes.lines if line.get_label() == "_beyond"}
    assert marked == {COLOURS[0], COLOURS[5]}
    # of those that began the errors are finite
    curve = known.rmse("position").sel(estimator="estimator_1")
    assert np.isfinite(curve).all() and 200 < float(curve[-1]) < 1000


def test_spans():
    flat = np.full(100, 10.0)
    assert (curve_span([flat]).low, curve_span([flat]).high) == (None, None)
    begun = flat.copy()
    begun[:5] = 1e6
    assert curve_span([begun]).high == 100.0  # the start is over
    assert curve_span([flat, flat, flat * 1e5]).high == 100.0
    assert curve_span([flat, flat * 500]).high is None  # both are wanted
    assert curve_span([np.full(3, np.nan), np.zeros(2)]).high is None
    low = flat.copy()
    low[0] = 1e-9
    span = curve_span([low])
    assert span.low == 1.0 and span.told(low) == ["below at 1 epoch"]


def test_clouds_that_are_far_off_do_not_set_the_axes_either():
    near, far = np.ones((20, 2)), np.full((20, 2), 1e4)
    edge, beyond = reach(np.stack([near, near, far]))
    assert edge == 3.0 and beyond == 20
    assert reach(np.stack([near, 5 * near])) == (None, 0)
    gone = np.stack([near, np.full((20, 2), np.nan)])
    assert reach(gone) == (None, 0) and reach(np.full((2, 3, 2), np.nan)) == (None, 0)


def test_heights_stand_beside_the_map_and_dots_beyond_the_edge_are_marked():
    data = many(12)
    figure = draw_ground(data)
    assert [axes.get_title() for axes in figure.axes[:2]] == [
        "tracks from above, from the dot on",
        "tracks from the side, from the dot on",
    ]
    assert figure.axes[1].get_ylabel() == "height [km]"
    level, upright = errors_of(figure)[-2:]
    assert upright.get_ylabel().startswith("up [") and "20 beyond the edge" in level.get_title()
    edge = level.get_xlim()[1]
    (marks,) = (line for line in level.lines if line.get_label() == "_beyond")
    assert np.abs(np.abs(marks.get_xydata()).max(axis=-1) - edge).max() < 1e-9 * edge and edge < 10
    first = legend(errors_of(figure)[1])
    assert first[:2] == [
        "estimator_0\n   1 of 20 without an estimate",
        "estimator_1\n   2 of 20 without an estimate",
    ]


def test_a_rocket_is_seen_from_the_side():
    data = full_result()
    data.attrs["frame"] = "launch"
    level, side = draw_ground(data).axes[:2]
    assert level.get_ylabel() == "across Z [km]" and side.get_ylabel() == "up [km]"
    truth = data["truth"].values / 1e3
    drawn = next(line for line in side.lines if line.get_label() == "target").get_xydata()
    np.testing.assert_allclose(drawn[:, 1], truth[:, 1])


def test_orbits_are_seen_in_the_plane_of_the_target():
    time = np.linspace(0.0, 1.0, 21)
    place = 7e6 * np.stack([np.cos(time), np.sin(time), 0 * time], axis=-1)
    tilt = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
    data = full_result().assign_attrs(frame="inertial")
    data["truth"][:, :3] = place @ tilt.T
    data["estimate"][:, :, :, :3] = place @ tilt.T
    data["estimate"][0, :, -1, :3] += 500.0 * tilt @ [-np.sin(1.0), np.cos(1.0), 0.0]  # ahead of it
    plane, side, along, _ = draw_orbits(data).axes
    flat, edge = (next(one for one in axes.lines if one.get_label() == "target") for axes in (plane, side))
    np.testing.assert_allclose(np.linalg.norm(flat.get_xydata(), axis=-1), 7e3)
    assert np.abs(edge.get_xydata()[:, 1]).max() < 1e-6
    dots = next(line for line in along.lines if line.get_label() == "iekf").get_xydata()
    # the last two epochs say where ahead is: half a step, 0.025, of turning off
    np.testing.assert_allclose(dots, np.broadcast_to([500.0, 0.0], dots.shape), atol=1e-6)
    assert along.get_xlabel() == "along the target's orbit [m]"


def test_a_sweep_counts_and_marks_what_it_does_not_show():
    found = swept(3)
    names = list(found["estimators"])
    lost = [{"value": 1e9, "low": 1e9, "high": 2e9}] * 3
    gone = [*found["estimators"][names[1]]["rmse_position_m"][:2], {"value": None, "low": None, "high": None}]
    for name, entries in zip(names[1:], (gone, lost), strict=True):
        found["estimators"][name] = {**found["estimators"][name], "rmse_position_m": entries}
    top = draw_sweep(found).axes[0]
    assert top.get_ylim()[1] < 1e4
    first, second, third = legend(top)[:3]
    assert first == names[0] and second.endswith("\n   infinite or unknown at 1 value")
    assert third.endswith("\n   above at 3 values, up to 1e+09")
    marks = [line for line in top.lines if line.get_label() == "_beyond"]
    assert {line.get_color() for line in marks} == {COLOURS[2]}
