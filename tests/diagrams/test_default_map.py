"""Maps of systems that offer none of their own: against the bound of a study whose truth starts there."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import build
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.mapping import bound_maps, map_figures
from quietfix.diagrams.figures import gdop
from quietfix.diagrams.library import bearing_crossing, satellite_ranging, three_satellite
from quietfix.diagrams.maps.bounds import map_bounds
from quietfix.diagrams.maps.charts import chart_of
from quietfix.diagrams.maps.default import default_maps, recorded_course
from quietfix.diagrams.parts.movers import Emitter, ModelTarget
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bounds import StudyBounds
from quietfix.systems.earth.geodetic import course_speed, ecef_to_geodetic
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.trajectories.gravity import GravityConstants
from tests.diagrams import flat_plane, named_states
from tests.fitting import check_fits

ORBIT = np.array([7e6, 1e5, 2e5, -100.0, 5e3, 5.5e3])
NAMES = ("x", "y", "z", "vx", "vy", "vz")


def study_bounds(model, options):
    """Return the bounds (estimator, time) that a study of one trial has."""
    times, course, platforms = recorded_course(model)
    wired = build(model, DiagramBuilder(), options, 1)
    bounds = StudyBounds(wired, times)
    bounds.add(course[None], platforms)
    return {
        name: dict(zip(wired.estimators, values[:, -1], strict=True))
        for name, (_, values) in bounds.variables().items()
    }


def starting_at(model, state):
    """Return a model whose truth starts at a state."""

    def moved(part):
        if isinstance(part, ModelTarget):
            return dataclasses.replace(part, mean=state, covariance=np.zeros((state.size, state.size)))
        return dataclasses.replace(part, start=state) if isinstance(part, Emitter) else part

    return dataclasses.replace(model, parts=[moved(part) for part in model.parts])


@pytest.mark.parametrize(
    ("found", "scenario"),
    [
        (named_states.SYSTEM, named_states.Scenario()),
        (flat_plane.SYSTEM, flat_plane.Scenario()),
        (three_satellite.SYSTEM, load_scenario("three_satellite", settings=["duration_s=20"])),
        (bearing_crossing.SYSTEM, load_scenario("bearing_crossing", settings=["duration_s=60"])),
    ],
    ids=["named_states", "flat_plane", "three_satellite", "bearing_crossing"],
)
@pytest.mark.filterwarnings("ignore:estimators")
def test_map_is_the_bound_of_studies_whose_truth_starts_there(found, scenario):
    model = dataclasses.replace(found.declare(scenario), map=None)
    maps = default_maps(model, scenario.estimators, 5)
    names = build(model, DiagramBuilder(), scenario.estimators, 1).truth_names
    course = recorded_course(model)[1]
    chart = chart_of(model.frame, course, names)
    for i, j in ((2, 2), (0, 3)):
        vertical, horizontal = maps[0].plane.values
        start = chart.moved(course, names, 1e3 * np.array([vertical[i], horizontal[j]]))[0]
        expected = study_bounds(starting_at(model, start), scenario.estimators)
        for of in maps:
            values, (name,) = map_bounds(of), of.sets
            for quantity in of.quantities:
                # the same recursion, along a course that is moved here and simulated there
                assert float(values[quantity][0, i, j]) == pytest.approx(expected[f"bound_{quantity}"][name], rel=1e-6)


def test_every_estimator_with_another_state_gets_its_own_map():
    maps = bound_maps(named_states.SYSTEM, named_states.Scenario())
    assert [next(iter(of.sets)) for of in maps] == list(named_states.STATES)
    assert [of.quantities for of in maps] == [("position", "velocity")] * 3 + [("position",)]
    assert maps[2].judged == ("x", "y", "vx", "vy") and "bias 30 m" in maps[2].stated["prior"]
    # one whose start says nothing is left out, and where none is left that is said
    quiet = named_states.Scenario(speechless=True)
    assert [next(iter(of.sets)) for of in bound_maps(named_states.SYSTEM, quiet)] == ["usual", "turned", "still"]
    quiet.estimators = {"biased": quiet.estimators["biased"]}
    with pytest.raises(UserError, match="of no estimator's start can be said"):
        bound_maps(named_states.SYSTEM, quiet)


def test_map_reaches_a_tenth_beyond_the_furthest_platform():
    (of,) = bound_maps(flat_plane.SYSTEM, flat_plane.Scenario())
    # the furthest along an axis is 6 km east of (3, 4) km
    for values, middle in zip(of.plane.values, (4.0, 3.0), strict=True):
        np.testing.assert_allclose(values[[0, 15, -1]], [middle - 6.6, middle, middle + 6.6])
    assert of.truth.shape[0] == of.seen.sum() == 31 * 31


def test_rows_that_a_mask_hides_do_not_count():
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())

    @dataclasses.dataclass(frozen=True)
    class East:
        """Station 1 sees nothing west of x = 0."""

        def visible(self, target, platforms):
            seen = np.ones((*np.broadcast_shapes(target.shape[:-1], platforms.shape[:-2]), platforms.shape[-2]), bool)
            seen[..., 1] = target[..., 0] > 0
            return seen

    parts = [dataclasses.replace(p, mask=East()) if isinstance(p, TargetSensor) else p for p in model.parts]
    options = flat_plane.Scenario().estimators
    (clear,), (masked,) = (default_maps(m, options, 7) for m in (model, dataclasses.replace(model, parts=parts)))
    assert "all rows measured everywhere" in clear.stated["target"] and clear.present is None
    assert "where the sensors see it" in masked.stated["target"]
    worse = map_bounds(masked)["position"].values[0] / map_bounds(clear)["position"].values[0]
    west = clear.plane.values[1] <= 0
    # all three rows need all platforms: the model does not say which it needs
    assert not masked.seen[:, west].any() and masked.seen[:, ~west].all()
    np.testing.assert_allclose(worse[:, ~west], 1.0, rtol=1e-12)


def test_earth_fixed_courses_keep_height_course_speed_and_climb():
    start = np.array([4e6, 3e6, 4.1e6, 100.0, -150.0, 80.0])
    chart = chart_of("earth_fixed", start[None], NAMES)
    to = 1e3 * np.array([[0.0, 0.0], [800.0, -300.0], [-1500.0, 2000.0]])
    moved = chart.moved(start[None], NAMES, to)[:, 0]
    np.testing.assert_allclose(moved[0], start, rtol=1e-12)
    heights = ecef_to_geodetic(moved[:, :3])[2]
    np.testing.assert_allclose(heights, heights[0], atol=1e-6)
    for values in course_speed(moved[:, :3], moved[:, 3:]):
        np.testing.assert_allclose(values, values[0], rtol=1e-9)
    # the ellipsoid's normal is not the radius: 0.2 deg, and 20 km of height
    np.testing.assert_allclose(chart.coordinates(moved[:, :3]), to, atol=0.01 * np.abs(to).max())
    # north is up on the map, east to the right
    assert ecef_to_geodetic(moved[1, :3])[0] > ecef_to_geodetic(start[:3])[0]
    assert ecef_to_geodetic(moved[2, :3])[1] > ecef_to_geodetic(start[:3])[1]


def test_inertial_courses_stay_orbits():
    motion, times = OrbitalMotion(GravityConstants(), False), np.arange(0.0, 600.0, 60.0)

    def flown(state):
        states = [state]
        for dt in np.diff(times):
            states.append(motion.propagate(states[-1], float(dt)))
        return np.array(states)

    course = flown(ORBIT)
    chart = chart_of("inertial", course, NAMES)
    for to in np.array([[0.0, 1e6], [-7e5, 2e6], [0.0, 0.0]]):
        moved = chart.moved(course, NAMES, to)
        # rounding of Runge-Kutta steps in turned axes
        np.testing.assert_allclose(moved, flown(moved[0]), rtol=1e-9, atol=1e-3)
        np.testing.assert_allclose(chart.coordinates(moved[0, :3]), to, atol=1e-3)
    along = chart.moved(course, NAMES, np.array([0.0, 1e6]))[0]
    normal = np.cross(ORBIT[:3], ORBIT[3:])
    # along the orbit: in its plane, ahead (but for the chord of one epoch, which lies in the plane too)
    assert abs(along[:3] @ normal) < 1e-9 * np.linalg.norm(normal) * 7e6 and along[:3] @ ORBIT[3:] > 0


def test_without_its_own_map_an_orbit_is_moved_on_its_shell():
    scenario = load_scenario("satellite_ranging", settings=["duration_s=100"])
    (own,) = bound_maps(satellite_ranging.SYSTEM, scenario)
    assert own.plane.names == ("inclination", "phase")
    model = dataclasses.replace(satellite_ranging.SYSTEM.declare(scenario), map=None)
    maps = default_maps(model, {"iekf": scenario.estimators["iekf"]}, 3)
    assert maps[0].plane.names == ("across", "along") and maps[0].quantities == ("position", "velocity")
    assert np.isfinite(map_bounds(maps[0])["position"]).all()


def test_a_target_without_a_plane_is_refused():
    with pytest.raises(UserError, match="gdop: a target of x, vx cannot be moved about; x, y are needed"):
        chart_of("local", np.zeros((1, 2)), ("x", "vx"))
    with pytest.raises(UserError, match="x, y, z are needed"):
        chart_of("earth_fixed", np.zeros((1, 2)), ("x", "y"))


def test_figures_and_table(tmp_path, capsys, printed_tables):
    (found,) = map_figures(flat_plane.SYSTEM, flat_plane.Scenario(), tmp_path, progress=False)
    assert {path.name for path in tmp_path.iterdir()} == {"gdop_position_iekf.png", "gdop_height_iekf.png"}
    printed = capsys.readouterr().out
    assert "x 1000, y 1000, z 30 m" in printed and "moved about as a whole" in printed
    check_fits(printed_tables[0])
    assert found.attrs["points_label"] == "the scenario's target at the start"


def legend(dataset, tmp_path, monkeypatch):
    """What the legends of a map's figures say."""
    drawn = []
    monkeypatch.setattr(gdop, "save", lambda figure, path: drawn.append(figure) or path)
    gdop.draw_gdop(dataset, tmp_path)
    return [text.get_text() for text in drawn[0].legends[0].get_texts()]


def test_names_stand_beside_places_and_hide_no_other(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(gdop, "save", lambda figure, path: drawn.append(figure) or path)
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())
    (of,) = default_maps(model, flat_plane.Scenario().estimators, points=7)
    middle = np.array([of.plane.values[0][3], of.plane.values[1][3]])
    step = 0.02 * np.ptp(of.plane.values[0])  # some 15 pixels: labels at one side of each would lie on each other
    spots = middle + step * np.array([[0, 0], [0, 1], [1, 0], [1, 1], [0, 0]])
    names = ("alpha", "bravo", "charlie", "delta", "echo")
    changed = dataclasses.replace(of, track=spots[None], track_labels=("platforms",) * 5, track_names=names)
    gdop.draw_gdop(map_bounds(changed), tmp_path)
    figure = drawn[0]
    figure.draw_without_rendering()
    axes = figure.axes[0]
    labels = [text for text in axes.texts if set(text.get_text().split(", ")) <= set(names)]
    assert sorted(text.get_text() for text in labels) == ["alpha, echo", "bravo", "charlie", "delta"]
    boxes = [text.get_window_extent() for text in labels]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    dots = axes.transData.transform(spots[:, ::-1])
    assert not any(box.contains(*dot) for box in boxes for dot in dots)


def test_legend_of_a_map_speaks_of_what_is_on_it(tmp_path, monkeypatch):
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())
    (of,) = default_maps(model, flat_plane.Scenario().estimators, points=7)
    target = "the scenario's target at the start"
    start = np.array([of.plane.values[0][3], of.plane.values[1][3]])
    places = np.tile(start, (5, 2, 1))  # two curves of five steps
    labels = {"track_labels": ("platforms",) * 2}

    def said(track):
        changed = dataclasses.replace(of, track=track, **labels)
        return legend(map_bounds(changed, progress=False), tmp_path, monkeypatch)

    assert said(places) == ["platforms", target]
    moving = places + np.linspace(0, 1e-3, 5)[:, None, None]
    assert said(moving) == ["platforms", "at half time", target]
    assert said(places + 1e6) == [target]


def test_a_map_without_a_contour_says_how_large_the_bound_is(tmp_path, monkeypatch):
    model = flat_plane.SYSTEM.declare(flat_plane.Scenario())
    (of,) = default_maps(model, flat_plane.Scenario().estimators, points=7)
    dataset, drawn = map_bounds(of, progress=False), []
    monkeypatch.setattr(gdop, "save", lambda figure, path: drawn.append(figure) or path)

    def headline(least, most):
        drawn.clear()
        shape = dataset["position"].shape
        dataset["position"][:] = np.linspace(least, most, dataset["position"].size).reshape(shape)
        gdop.draw_gdop(dataset, tmp_path)
        return drawn[0].axes[0].get_title().splitlines()[0]

    assert headline(24.1, 24.2).endswith(", 24.1 to 24.2 m everywhere")
    assert "everywhere" not in headline(15, 40)
