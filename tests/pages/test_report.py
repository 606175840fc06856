"""The page of a result: its numbers are those of the result, it is whole, and nothing in it can act or call out."""

import json
import re
import shutil
from base64 import b64decode
from types import SimpleNamespace

import numpy as np
import pytest

from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.figures.shared.limits import reach
from quietfix.diagrams.figures.shared.views import error_axes
from quietfix.diagrams.pages.courses import courses, final_errors
from quietfix.diagrams.pages.curves import estimators
from quietfix.diagrams.pages.numbers import rounded, thinned
from quietfix.diagrams.pages.picture import inline_svg
from quietfix.diagrams.pages.places import views
from quietfix.diagrams.pages.report import report_page
from quietfix.diagrams.quantities.frame import FRAMES
from quietfix.diagrams.scale.asked import for_a_page
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.results import open_result
from tests.results.made import damaged, write
from tests.results.made import dataset as made_dataset


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page") / "three"
    asked = [
        "run",
        "three_satellite",
        "--trials",
        "7",
        "--estimator",
        "iekf",
        "--estimator",
        "ukf",
        "--keep",
        "covariance",
    ]
    with pytest.raises(SystemExit) as ended:
        main([*asked, "--set", "duration_s=12", "--out", str(folder)])
    assert ended.value.code == 0
    return folder


@pytest.fixture(scope="module")
def page(result):
    return report_page(result)


def numbers(page):
    return json.loads(re.search(r'id="numbers">(.*?)</script>', page, re.DOTALL)[1])


def status(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code, capsys.readouterr()


def test_its_numbers_are_those_of_the_result(result, page):
    told, summary = numbers(page), json.loads((result / "summary.json").read_text())
    position = told["curves"]["quantities"][0]
    for name, row in summary["estimators"].items():
        # six significant digits are written
        np.testing.assert_allclose(position["rmse"][name], row["rmse_position_m"], rtol=1e-5)
        np.testing.assert_allclose(position["bound"][name], row["bound_position_m"], rtol=1e-5)
        np.testing.assert_allclose(told["curves"]["nees"][name]["mean"], np.array(row["nees_mean"]) / 6, rtol=1e-5)


def test_single_trials_are_those_of_the_result(result):
    dataset = open_result(result).load()
    found = courses(dataset)
    assert found["trials"] == list(range(7))
    raw = np.frombuffer(b64decode(found["data"]), "<f4")
    values = raw.reshape(2, 7, 13, len(found["columns"]))
    size = np.linalg.norm(values[..., :3], axis=-1)
    # single precision
    np.testing.assert_allclose(size, errors(dataset)["position"].transpose("estimator", "trial", "time"), rtol=1e-5)
    covariance = dataset["covariance"].transpose("estimator", "trial", "time", ...).values[..., :3, :3]
    here = [found["columns"].index(name) for name in ("c00", "c11", "c22")]
    # the trace does not depend on the axes
    np.testing.assert_allclose(values[..., here].sum(axis=-1), np.trace(covariance, axis1=-2, axis2=-1), rtol=1e-5)
    last = final_errors(dataset)
    assert found["picks"]["iekf"]["worst"] == int(last[0].argmax())
    assert found["picks"]["iekf"]["best"] == int(last[0].argmin())


@pytest.mark.parametrize("name", FRAMES)
def test_axes_of_errors_are_perpendicular(name):
    _, rotation = error_axes(FRAMES[name], 3)
    turned = rotation(np.array([[4.2e6, 1.1e6, 4.6e6], [6.4e6, 1e3, -2e5]]))
    np.testing.assert_allclose(turned @ np.swapaxes(turned, -1, -2), np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-12)


def test_it_is_whole_and_small(page):
    assert len(page.encode()) < 5e6
    outside = re.sub(r'<script type="application/octet-stream".*?</script>', "", page, flags=re.DOTALL)
    loads = re.findall(r"""(?:src|href)=["'](?!#|data:)[^"']*|@import|url\(""", outside)
    assert loads == []
    assert "default-src 'none'" in page


def test_what_comes_from_elsewhere_cannot_act(result, tmp_path):
    svg = (result / "diagram.svg").read_text()
    bad = svg.replace(
        "<g id=", '<script>alert(1)</script><a href="http://x"><text>y</text></a><g onclick="alert(2)" id=', 1
    )
    path = tmp_path / "diagram.svg"
    path.write_text(bad)
    clean = inline_svg(path)
    assert clean is not None and "alert" not in clean and "http://x" not in clean
    path.write_text(svg.replace("<!-- a block", '<!DOCTYPE svg [<!ENTITY a "b">]><!-- a block'))
    assert inline_svg(path) is None
    path.write_text("no drawing")
    assert inline_svg(path) is None


@pytest.mark.filterwarnings("ignore:.*does not have a Zarr V3 specification")
def test_a_name_cannot_end_the_numbers(result, tmp_path):
    dataset = open_result(result).load()
    names = ["</script><b>", "ukf"]
    renamed = dataset.assign_coords(estimator=names)
    copy = tmp_path / "copy"
    copy.mkdir()
    renamed.drop_encoding().to_zarr(copy / "results.zarr", zarr_format=3, consolidated=False)
    page = report_page(copy)  # no summary.json: it is worked out
    assert "</script><b>" not in page
    assert numbers(page)["estimators"][0]["name"] == "</script><b>"


def test_the_command_replaces_its_own_pages_alone(result, tmp_path, capsys):
    page = tmp_path / "p.html"
    code, said = status(["report", result, "--out", page], capsys)
    assert code == 0 and said.out.startswith("wrote")
    code, said = status(["report", result, "--out", page], capsys)
    assert code == 0 and said.out.startswith("replaced")
    other = tmp_path / "mine.html"
    other.write_text("mine")
    code, said = status(["report", result, "--out", other], capsys)
    assert code == 2 and "no page of this program" in said.err and other.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.html", "p.html"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "RESULT: nothing is not a result"),
        ([".", "--out", "a.txt"], "--out: a.txt is not allowed"),
        (["."], "is not a result"),
    ],
)
def test_bad_input_is_one_line(arguments, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, found = status(["report", *arguments], capsys)
    assert code == 2 and said in found.err and found.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_result_is_one_line(result, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(result, copy)
    (copy / "summary.json").write_text('{"estimators": {"iekf": {}}}')
    code, found = status(["report", copy, "--out", tmp_path / "a.html"], capsys)
    assert code == 2 and "damaged" in found.err and found.err.count("\n") == 1


def test_lost_and_missing_numbers(result):
    dataset = open_result(result).load().copy(deep=True)
    dataset["estimate"][0, 2, 5:] = np.nan
    dataset["truth"][3] = np.nan
    found = courses(dataset)
    assert found["picks"]["iekf"]["worst"] == 2 and found["final"][0][2] is None
    assert views(dataset)[0]["title"] == "from above"
    assert courses(dataset.assign(truth=dataset["truth"] * np.nan)) is None


def test_small_numbers():
    assert rounded([1.23456789, np.nan, np.inf]) == [1.23457, None, None]
    assert list(thinned(10, 3)) == [0, 4, 9] and list(thinned(2, 5)) == [0, 1]
    assert reach(np.ones((10, 2))) == (None, 0)
    edge, beyond = reach([*np.ones((20, 2)), [1000.0, 0.0]])
    assert edge == pytest.approx(3.0) and beyond == 1


def test_a_run_writes_its_page_beside_its_folder(tmp_path, capsys):
    asked = ["run", "three_satellite", "--trials", 2, "--estimator", "iekf", "--set", "duration_s=3", "--report"]
    code, said = status(asked, capsys)
    assert code == 2 and said.err.startswith("quietfix: --report: it needs --out DIR")
    (tmp_path / "a.html").write_text("mine")
    code, said = status([*asked, "--out", tmp_path / "a"], capsys)
    assert code == 2 and "no page of this program" in said.err and not (tmp_path / "a").exists()
    code, said = status([*asked, "--out", tmp_path / "b"], capsys)
    assert code == 0 and "b.html" in said.out and numbers((tmp_path / "b.html").read_text())["curves"]
    assert numbers((tmp_path / "b.html").read_text())["courses"]["covariance"]  # ellipses, without asking for them
    code, said = status([*asked, "--keep", "estimates", "--out", tmp_path / "c"], capsys)
    page = (tmp_path / "c.html").read_text()
    assert code == 0 and not numbers(page)["courses"]["covariance"] and "run with --keep covariance" in page


def test_covariances_of_a_large_study_are_left_out(capsys):
    made = []

    def make(keep):
        made.append(keep)
        return SimpleNamespace(trial_bytes=2e5, request=SimpleNamespace(trials=10_000), recorded=None)

    for_a_page(make)
    assert made == ["covariance", "estimates"]
    assert "the result would take 2.0 GB" in capsys.readouterr().out


@pytest.mark.slow
def test_a_page_of_many_estimators_and_trials_is_small(tmp_path):
    """Twelve estimators, 10,000 trials: the page has what fits."""
    names = [f"filter_{i}" for i in range(12)]
    dataset = made_dataset(names=tuple(names), trials=10_000)
    write(tmp_path / "large", dataset, chunk=5000)
    page = report_page(tmp_path / "large")
    assert len(page.encode()) < 5e6
    told = numbers(page)
    assert len(told["curves"]["quantities"][0]["rmse"]) == 12
    assert told["courses"]["left_out"] > 0 and len(told["courses"]["trials"]) > 30


def test_no_two_of_many_estimators_look_alike():
    names = [f"filter_{i}" for i in range(30)]
    found = estimators(made_dataset(names=tuple(names), trials=2))
    assert [one["name"] for one in found] == names
    for what in ("dash", "symbol"):
        assert len({(one["color"], one[what]) for one in found}) == len(names), what
    assert "dot" not in {one["dash"] for one in found}  # bounds are dotted


@pytest.mark.parametrize("marked", [True, False])
def test_a_damaged_array_is_one_line(marked, result, tmp_path, capsys):
    copy = damaged(result, tmp_path / "copy", marked)
    code, found = status(["report", copy, "--out", tmp_path / "a.html"], capsys)
    assert code == 2 and found.err.count("\n") == 1 and str(copy) in found.err
    assert ("estimate/c" in found.err) == marked and not (tmp_path / "a.html").exists()
