import os
import re
import shutil
import stat
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ElementTree

import pytest
from matplotlib import get_data_path
from matplotlib.ft2font import FT2Font

from quietfix.diagrams.assembly.dot import Notes, diagram_dot
from quietfix.diagrams.assembly.drawing import draw, find_graphviz
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from tests.pages.browser import open_browser

SVG = "{http://www.w3.org/2000/svg}"
PAGE = 1200  # points: a side of a page on which a text of 12 points can still be read, at half its size


@pytest.fixture(scope="module")
def made():
    return Study("three_satellite").diagram(trials=2)


@pytest.fixture
def no_dot(monkeypatch, tmp_path):
    """A PATH without dot: graphviz-pure has to be found beside Python."""
    monkeypatch.setenv("PATH", str(tmp_path))


def boxes(text):
    """Text of each node by the names of its blocks."""
    found = {}
    for node, body in re.findall(r"^(n\d+) \[label=(<.*>)\]$", text, re.MULTILINE):
        found[tuple(re.findall(r"<B>(.*?)</B>", body))] = node, body
    return found


def lines_between(text, source, sink):
    """Attributes of the connections between the boxes of two blocks."""
    node = {name: number for names, (number, _) in boxes(text).items() for name in names}
    return re.findall(rf"^{node[source]}:\w+:e -> {node[sink]}:\w+:w(.*)$", text, re.MULTILINE)


def test_names_are_bold_and_classes_small(made):
    text = diagram_dot(made[0])
    (body,) = (body for names, (_, body) in boxes(text).items() if names == ("iekf",))
    assert '<FONT POINT-SIZE="9" COLOR="#606060">KalmanEstimator</FONT>' in body
    assert "quietfix.systems.estimators" not in text


def test_wires_have_their_colours(made):
    diagram, wired = made
    assert wired.dashed == [("iekf", "phase_resolver")]
    text = diagram_dot(diagram, "title & more", wired.notes(20))
    assert lines_between(text, "satellites", "ukf") == [' [color="#b0b0b0"]']
    (first,) = lines_between(text, "satellites", "sensor")
    assert first.startswith(' [color="#b0b0b0", label=')
    (feedback,) = lines_between(text, "iekf", "phase_resolver")
    assert "dashed" in feedback and "#c00000" in feedback
    assert text.count("dashed") == 1 and "title &amp; more" in text
    assert "dashed" not in diagram_dot(diagram) and "three_satellite" in diagram_dot(diagram)


def test_wires_say_how_many_trials_and_numbers_and_in_which_units(made):
    diagram, wired = made

    def said(source, sink, text):
        return re.findall(r">([^<>]+)</FONT>", "".join(lines_between(text, source, sink)))

    text = diagram_dot(diagram, notes=wired.notes(20))
    assert said("sensor", "phase_resolver", text) == ["20 \N{MULTIPLICATION SIGN} 6: s, Hz, rad"]
    assert said("satellites", "sensor", text) == ["1 \N{MULTIPLICATION SIGN} 18: m, m/s"]
    assert said("emitter", "sensor", text) + said("emitter", "assumed_height", text) == [
        "1 \N{MULTIPLICATION SIGN} 6: m, m/s"
    ]
    # what is handed on keeps its units; every signal is told once
    resolved = said("phase_resolver", "ukf", text) + said("phase_resolver", "iekf", text)
    assert resolved == ["20 \N{MULTIPLICATION SIGN} 6: s, Hz, rad"]
    assert said("iekf", "phase_resolver", text) == ["20 \N{MULTIPLICATION SIGN} 6: m, m/s"]
    assert said("sensor", "phase_resolver", diagram_dot(diagram, notes=wired.notes()))[0].startswith("trials ")


def test_what_joins_signals_has_the_units_of_all(tmp_path):
    study = Study("dual_satellite:signal", estimators=["iekf"])
    text = diagram_dot(study.picture, notes=study.probe.notes(20))
    assert ">20 \N{MULTIPLICATION SIGN} 4: rad, s, Hz</FONT>" in text
    assert ">object</FONT>" in text  # samples travel as one


def test_estimators_that_are_wired_alike_share_a_box(made):
    diagram, wired = made
    found = boxes(diagram_dot(diagram, notes=wired.notes()))
    assert ("ekf", "ukf", "iekf_tdoa_fdoa_phase", "iekf_tdoa_phase") in found and ("iekf",) in found
    alone = boxes(diagram_dot(diagram))
    assert {names for names in alone} == {(block.get_name(),) for block in diagram.GetSystems()}


def test_ports_that_lead_nowhere_are_folded(made):
    diagram, wired = made
    body = boxes(diagram_dot(diagram, notes=wired.notes()))[("iekf",)][1]
    assert body.count("PORT=") == 4  # three in, the prediction out
    assert "gives too: estimate,</FONT>" in body and "5 more</FONT>" in body


def test_blocks_say_their_platforms_and_rows(made):
    diagram, wired = made
    text = diagram_dot(diagram, notes=wired.notes())
    assert ">satellite_0, satellite_1,</FONT>" in text and ">satellite_2</FONT>" in text
    assert ">tdoa_10, tdoa_20, fdoa_10,</FONT>" in text
    many = diagram_dot(diagram, notes=Notes(contents={"satellites": [f"<{i}>" for i in range(20)]}))
    assert "8 more</FONT>" in many and "&lt;11&gt;" in many and "&lt;12&gt;" not in many


def test_feedback_that_is_not_there_is_refused(made):
    with pytest.raises(ValueError, match="ukf -> phase_resolver"):
        diagram_dot(made[0], notes=Notes(dashed=[("iekf", "phase_resolver"), ("ukf", "phase_resolver")]))


def test_svg_shows_every_block_and_wire(made, tmp_path, no_dot):
    diagram, wired = made
    root = ElementTree.parse(draw(diagram, tmp_path / "d.svg", "my title", wired.notes(20))).getroot()
    shown = [element.text for element in root.iter(f"{SVG}text")]
    assert {system.get_name() for system in diagram.GetSystems()} | {"my title"} <= set(shown)
    edges = [g for g in root.iter(f"{SVG}g") if g.get("class") == "edge"]
    # three of the four that share a box have their three wires with it
    assert len(edges) == len(diagram.connection_map()) - 9
    paths = [path for g in edges for path in g.iter(f"{SVG}path")]
    assert sum(path.get("stroke-dasharray") is not None for path in paths) == 1
    assert sum(path.get("stroke") == "#b0b0b0" for path in paths) == 3 + 2


DRAW = """
import sys
from quietfix.diagrams.assembly.drawing import draw
from quietfix.diagrams.studies.study import Study
study = Study(sys.argv[1])
if len(sys.argv) > 3:
    study.diagram(), Study("bearing_crossing").diagram()  # Drake counts the blocks of a process
draw(Study(sys.argv[1]).picture, sys.argv[2], "the same", study.probe.notes(7))
"""


def test_the_same_bytes_in_every_process(tmp_path):
    for number, more in enumerate(([], ["others first"])):
        command = [sys.executable, "-c", DRAW, "three_satellite", str(tmp_path / f"{number}.svg"), *more]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONHASHSEED": str(number + 1)}, timeout=300)
    first, second = ((tmp_path / f"{number}.svg").read_bytes() for number in range(2))
    assert first == second and b"sensor" in first


@pytest.fixture(scope="module", params=["three_satellite", "bearing_crossing", "satellite_ranging"])
def drawn(request, tmp_path_factory):
    """A drawing of a packaged system."""
    study = Study(request.param)
    path = tmp_path_factory.mktemp("drawn") / "d.svg"
    return draw(study.picture, path, request.param, study.probe.notes(100))


def box_of(polygon):
    """Left, top, right and bottom of a polygon."""
    points = [tuple(map(float, point.split(","))) for point in polygon.get("points").split()]
    return min(x for x, _ in points), min(y for _, y in points), max(x for x, _ in points), max(y for _, y in points)


def outlines(root):
    """The outer box of every node, and its texts."""
    for node in (g for g in root.iter(f"{SVG}g") if g.get("class") == "node"):
        every = [
            box_of(shape) for shape in [*node.iter(f"{SVG}polygon"), *node.iter(f"{SVG}path")] if shape.get("points")
        ]
        yield every, list(node.iter(f"{SVG}text"))


def dejavu(text):
    """Width of a text in the widest font that stands for Helvetica."""
    bold = "-Bold" if text.get("font-weight") == "bold" else ""
    font = FT2Font(f"{get_data_path()}/fonts/ttf/DejaVuSans{bold}.ttf")
    font.set_size(float(text.get("font-size")), 72)
    font.set_text(text.text)
    return font.get_width_height()[0] / 64


def test_text_stays_in_its_cell_in_a_wide_font_too(drawn):
    texts = 0
    for every, shown in outlines(ElementTree.parse(drawn).getroot()):
        for text in shown:
            x, y = float(text.get("x")), float(text.get("y"))
            around = [box for box in every if box[0] <= x <= box[2] and box[1] <= y <= box[3]]
            assert around, text.text
            left, top, right, bottom = min(around, key=lambda box: (box[2] - box[0]) * (box[3] - box[1]))
            assert text.get("text-anchor") == "start" and left < x and x + dejavu(text) < right, text.text
            assert y - float(text.get("font-size")) > top - 2 and y < bottom
            texts += 1
    assert texts > 20


def test_text_stays_in_its_box_in_a_browser(drawn):
    with open_browser("--window-size=1600,1200") as browser:
        browser.get(drawn.as_uri())
        outside = browser.execute_script(
            """
            const found = [];
            let count = 0;
            for (const node of document.querySelectorAll("g.node")) {
                const boxes = [...node.querySelectorAll("polygon")].map((one) => one.getBBox());
                for (const text of node.querySelectorAll("text")) {
                    const box = text.getBBox();
                    count += 1;
                    const holds = (other) => other.x <= box.x && box.x + box.width <= other.x + other.width
                        && other.y <= box.y + 2 && box.y + box.height <= other.y + other.height + 2;
                    if (!boxes.some(holds)) found.push(text.textContent);
                }
            }
            return [count, found];
            """
        )
    assert outside[0] > 20 and outside[1] == []


@pytest.mark.skipif(shutil.which("rsvg-convert") is None, reason="no rsvg-convert on the PATH (Debian: librsvg2-bin)")
def test_another_renderer_takes_it(drawn, tmp_path):
    subprocess.run(["rsvg-convert", drawn, "-o", tmp_path / "d.png"], check=True)
    assert (tmp_path / "d.png").read_bytes()[:4] == b"\x89PNG"


def test_it_fits_a_page(drawn):
    _, _, width, height = map(float, ElementTree.parse(drawn).getroot().get("viewBox").split())
    assert width < PAGE * 1.2 and height < PAGE


def test_png_is_a_picture_of_readable_size(made, tmp_path, no_dot):
    data = draw(made[0], tmp_path / "d.PNG", notes=made[1].notes()).read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(data[16 + 4 * i : 20 + 4 * i], "big") for i in range(2))
    assert 800 < width < 3000 and 400 < height < 3000


def test_endings_are_checked(made, tmp_path):
    with pytest.raises(UserError, match=r"diagram\.pdf.*\.svg or \.png"):
        draw(made[0], tmp_path / "diagram.pdf")
    assert not list(tmp_path.iterdir())


def fake_dot(folder, script):
    program = folder / "dot"
    program.write_text("#!/bin/sh\n" + script)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)


@pytest.mark.skipif(os.name == "nt", reason="the stand-in for dot is a shell script")
def test_dot_on_the_path_goes_first(made, tmp_path, no_dot):
    assert find_graphviz().endswith("graphviz-pure")
    fake_dot(tmp_path, 'echo "drawn by dot" > diagram.out\n')
    assert draw(made[0], tmp_path / "d.svg").read_text() == "drawn by dot\n"


@pytest.mark.skipif(os.name == "nt", reason="the stand-in for dot is a shell script")
def test_a_dot_that_fails_is_reported_and_leaves_nothing(made, tmp_path, no_dot):
    fake_dot(tmp_path, "echo out of ink >&2\nexit 3\n")
    with pytest.raises(UserError, match="out of ink"):
        draw(made[0], tmp_path / "d.svg")
    assert not (tmp_path / "d.svg").exists()


def test_without_any_graphviz(made, tmp_path, no_dot, monkeypatch):
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
    with pytest.raises(UserError, match="graphviz-pure"):
        draw(made[0], tmp_path / "d.svg")
