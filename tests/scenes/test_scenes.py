"""Scenes in space: their numbers are those of the result, and the stage keeps shapes."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.scenes.ellipsoids import ellipsoids
from quietfix.diagrams.scenes.ground import blocked, earth
from quietfix.diagrams.scenes.scene import scene_of
from quietfix.diagrams.scenes.stage import SIZE, staged, step_below
from quietfix.diagrams.scenes.timing import timing_of
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.whole import run_study
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from tests.results.made import damaged

PLACE = list(POSITION)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene") / "three"
    asked = ["run", "three_satellite", "--trials", "4", "--estimator", "iekf", "--estimator", "ukf"]
    with pytest.raises(SystemExit) as ended:
        main([*asked, "--keep", "covariance", "--set", "duration_s=12", "--out", str(folder)])
    assert ended.value.code == 0
    return folder


@pytest.fixture(scope="module")
def dataset(result):
    return open_result(result).load()


def moving(stage, path):
    return next(thing for thing in stage.moving if thing.path == path)


def status(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code, capsys.readouterr()


def test_a_scene_has_the_numbers_of_the_result(dataset):
    scene = scene_of(dataset, ["ukf"], trial=2)
    truth = dataset["truth"].sel(state=PLACE).values
    assert np.array_equal(scene.target.places, truth) and scene.known
    assert np.array_equal(scene.times, dataset["time"].values)
    (one,) = scene.estimates
    estimate = dataset["estimate"].sel(estimator="ukf", state=PLACE).transpose("trial", "time", "state").values
    assert np.array_equal(one.errors, estimate[2] - truth)
    assert one.cloud_trials == (0, 1, 3) and np.array_equal(one.cloud, estimate[[0, 1, 3]] - truth)
    for track in scene.platforms:
        place = dataset["platforms"].sel(platform=track.name, coordinate=PLACE).transpose("time", "coordinate").values
        assert np.array_equal(track.places, place) and track.kind == "platform"
    covariance = dataset["covariance"].sel(estimator="ukf", trial=2, state=PLACE, state_=PLACE).values
    made = one.axes @ (one.lengths[..., None] ** 2 * one.axes.swapaxes(1, 2)) / chi2.ppf(0.99, 3)
    # an eigendecomposition put together again, to rounding of its largest entry
    assert np.abs(made - covariance).max() < 1e-9 * np.abs(covariance).max()


def test_the_stage_keeps_lengths_and_angles(dataset):
    scene = scene_of(dataset)
    stage = staged(scene, magnify=3.0)
    places = np.stack([track.places for track in (*scene.platforms, scene.target)])
    put = stage.placed(places)
    assert np.linalg.norm(put, axis=-1).max() == pytest.approx(SIZE)
    apart = np.linalg.norm(places[0] - places[3], axis=-1)
    # rounding of places of 7e6 m, relative to distances of 5e5 m
    assert np.linalg.norm(put[0] - put[3], axis=-1) * stage.unit == pytest.approx(apart, rel=1e-12)
    error = moving(stage, "estimates/iekf/mark").places - stage.placed(scene.target.places)
    length = np.linalg.norm(scene.estimates[0].errors, axis=-1)
    assert np.linalg.norm(error, axis=-1) * stage.unit == pytest.approx(3 * length, rel=1e-6)
    # the upward axis of the stage is that of the target: satellites are above it
    assert (put[:3, :, 2] > 0).all()


def test_no_two_estimators_have_one_colour(dataset):
    scene = scene_of(dataset, ["iekf", "ukf"])
    assert len({colour for _, colour in staged(scene).legend}) == len(staged(scene).legend)
    with pytest.raises(UserError, match="--estimator: 6 of them are not allowed; at most 5"):
        staged(dataclasses.replace(scene, estimates=scene.estimates * 3))


def test_lines_of_sight_end_at_the_target(dataset):
    scene = scene_of(dataset)
    stage = staged(scene)
    for track in scene.platforms:
        line = moving(stage, f"lines_of_sight/{track.name}")
        assert np.allclose(line.turns @ line.turns.swapaxes(1, 2), np.eye(3)), "a rotation"
        end = line.places + line.turns[..., 2] * line.sizes[:, 2:]
        assert end == pytest.approx(stage.placed(scene.target.places), abs=1e-9)


def test_the_earth_is_in_the_way():
    target, overhead, behind = np.array([6378137.0, 0, 0]), np.array([7e6, 0, 0]), np.array([-7e6, 0, 0])
    assert not blocked(overhead, target) and blocked(behind, target)
    horizon = np.array([6378137.0 - 1e3, 2e6, 0])  # a kilometre below the level plane of the target: still in sight
    assert not blocked(horizon, target) and blocked(horizon - [2e5, 0, 0], target)


def test_triangles_are_on_the_ellipsoid():
    around = np.array([4e6, 2e6, 4.5e6])
    mesh = earth(around)
    assert np.abs(ecef_to_geodetic(mesh.vertices)[2]).max() < 1e-6
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=-1).sum() / 2
    assert area == pytest.approx(5.1007e14, rel=3e-3), "area of WGS-84, closed; chords lie a little below it"
    assert ((normal * a).sum(axis=-1) > 0).all(), "all faces look outwards"


def test_axes_of_ellipsoids_do_not_jump():
    """Two variances that cross exchange their order in an eigendecomposition; the axes stay."""
    growing = np.linspace(1, 4, 31)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    diagonal = np.stack([growing, growing[::-1] + 0.01, 0 * growing + 9], axis=-1)
    axes, lengths = ellipsoids(turn @ (diagonal[:, :, None] * turn.T))
    steps = np.einsum("kij,kij->kj", axes[1:], axes[:-1])
    assert steps[1:] == pytest.approx(1.0) and np.linalg.det(axes) == pytest.approx(1.0)
    assert np.abs(np.diff(lengths, axis=0)).max() < 0.3
    bad = np.stack([np.eye(2), np.full((2, 2), np.nan), -np.eye(2)])
    axes, lengths = ellipsoids(bad)
    assert lengths[0] == pytest.approx([chi2.ppf(0.99, 2) ** 0.5] * 2 + [0]) and np.isnan(lengths[1:]).all()


def test_what_is_not_there_is_said(dataset):
    lost = dataset.copy(deep=True)
    lost["estimate"][:, 0, 3:] = np.nan
    scene = scene_of(lost.drop_vars("covariance"))
    assert any("no ellipsoids" in note for note in scene.notes)
    assert any("iekf has no estimate to show at 10 of 13 epochs" in note for note in scene.notes)
    mark = moving(staged(scene), "estimates/iekf/mark")
    assert np.isnan(mark.places[3:]).all() and np.isfinite(mark.places[:3]).all()
    unknown = scene_of(dataset.assign(truth=dataset["truth"] * np.nan), trial=1)
    assert not unknown.known and not unknown.estimates[0].cloud.size
    assert np.array_equal(unknown.target.places, dataset["estimate"].sel(estimator="iekf", trial=1, state=PLACE))


@pytest.mark.parametrize(
    ("system", "changes", "frame"),
    [
        ("beacon_rocket", ["stop_s=50.5"], "launch"),
        ("bearing_crossing", ["duration_s=20"], "local"),
        ("satellite_ranging", ["duration_s=200"], "inertial"),
    ],
)
def test_other_frames_have_their_own_ground(system, changes, frame):
    dataset = run_study(system, trials=2, set=changes, keep="covariance")
    scene = scene_of(dataset)
    stage = staged(scene)
    assert scene.frame.name == frame and (stage.earth is not None) == (frame == "inertial") == (stage.turns is not None)
    height = {"launch": 1, "local": 2}.get(frame)
    if height is not None:
        (net,) = stage.nets
        assert np.abs(net.starts[:, height]).max() < 1e-9
        up = np.eye(3)[height]
        assert stage.axes @ up == pytest.approx([0, 0, 1])
    assert np.linalg.det(stage.axes) == pytest.approx(1.0)


def test_times_of_a_recording():
    timing = timing_of(np.arange(50.0, 60.01, 0.05))
    assert timing.start == 50 and timing.pace == 1 and timing.frames_per_second == pytest.approx(20)
    frames = np.floor(np.array(timing.seconds) * timing.frames_per_second)
    assert np.array_equal(frames, np.arange(201)), "one frame an epoch"
    assert timing_of(np.linspace(0, 5000, 101)).pace == 200
    assert timing_of(np.array([3.0])).seconds == [0.0]
    assert [step_below(v) for v in (0.3, 1.0, 4.9, 700.0)] == pytest.approx([0.2, 1.0, 2.0, 500.0])


def test_a_page_is_whole_and_replaces_only_its_own(result, tmp_path, capsys):
    page = tmp_path / "p.html"
    code, said = status(["play", result, "--html", page, "--trial", 1], capsys)
    assert code == 0 and f"wrote {page}" in said.out and "Ctrl-C" not in said.out
    text = page.read_text()
    assert "three_satellite, trial 1" in text and text.rstrip().endswith("</html>")
    code, said = status(["play", "three_satellite", "--trials", 2, "--set", "duration_s=3", "--out", page], capsys)
    assert code == 0 and "replaced" in said.out
    page.write_text("mine")
    code, said = status(["play", result, "--html", page], capsys)
    assert code == 2 and "no page of this command" in said.err and page.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["p.html"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["RESULT", "--html", "a.txt"], "--html: a.txt is not allowed; a file name that ends in .html"),
        (["RESULT", "--html", "no/a.html"], "--html: no/a.html cannot be written"),
        (["RESULT", "--html", "a.html", "--trial", "9"], "--trial: 9 is not in the result; it has 0 to 3"),
        (["RESULT", "--html", "a.html", "--estimator", "ekf"], "--estimator: ekf is not known"),
        (["RESULT", "--html", "a.html", "--magnify", "0"], "--magnify: 0 is not allowed; above 0"),
        (["RESULT", "--html", "a.html", "--trials", "9"], "--trials: it is not allowed with a result"),
        ([".", "--html", "a.html"], "is not a result"),
        (["nothing", "--html", "a.html"], "nothing"),
    ],
)
def test_bad_input_is_one_line(arguments, said, result, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, found = status(["play", *(str(result) if a == "RESULT" else a for a in arguments)], capsys)
    assert code == 2 and said in found.err and found.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("marked", [True, False])
def test_a_damaged_array_is_one_line(marked, result, tmp_path, capsys):
    copy = damaged(result, tmp_path / "copy", marked)
    code, found = status(["play", copy, "--html", tmp_path / "a.html"], capsys)
    assert code == 2 and found.err.count("\n") == 1 and str(copy) in found.err
    assert ("estimate/c" in found.err) == marked and not (tmp_path / "a.html").exists()
