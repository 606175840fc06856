import os
import re
import stat
import sysconfig
import xml.etree.ElementTree as ElementTree

import pytest

from quietfix.diagrams.assembly.drawing import diagram_dot, draw, find_graphviz
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def made():
    return Study("three_satellite").diagram()


@pytest.fixture
def no_dot(monkeypatch, tmp_path):
    """A PATH without dot: graphviz-pure has to be found beside Python."""
    monkeypatch.setenv("PATH", str(tmp_path))


def lines_between(text, source, sink):
    """Attributes of the connections between two blocks."""
    node = {m[2]: m[1] for m in re.finditer(r"^(s\d+) \[.*?<B>(.*?)</B>", text, re.DOTALL | re.MULTILINE)}
    return re.findall(rf"^{node[source]}:\w+:e -> {node[sink]}:\w+:w(.*)$", text, re.MULTILINE)


def test_names_are_bold_and_classes_small(made):
    text = diagram_dot(made[0])
    assert '<B>iekf</B><BR/>\n<FONT POINT-SIZE="9" COLOR="#606060">KalmanEstimator</FONT>' in text
    assert "name=" not in text.replace("fontname=", "") and "quietfix.systems.estimators" not in text


def test_wires_have_their_colours(made):
    diagram, wired = made
    assert wired.dashed == [("iekf", "phase_resolver")]
    text = diagram_dot(diagram, wired.dashed, "title & more")
    assert lines_between(text, "satellites", "ukf") == [' [color="#b0b0b0"]']
    assert lines_between(text, "satellites", "sensor") == [' [color="#b0b0b0"]']
    assert sorted(lines_between(text, "phase_resolver", "iekf")) == [""]
    (feedback,) = lines_between(text, "iekf", "phase_resolver")
    assert "dashed" in feedback and "#c00000" in feedback
    assert text.count("dashed") == 1 and "title &amp; more" in text
    assert "dashed" not in diagram_dot(diagram) and "three_satellite" in diagram_dot(diagram)


def test_blocks_say_their_platforms_and_rows(made):
    diagram, wired = made
    text = diagram_dot(diagram, contents=wired.contents)
    small = '<FONT POINT-SIZE="9" COLOR="#606060">'
    assert f"{small}satellite_0, satellite_1,</FONT><BR/>\n{small}satellite_2</FONT>" in text
    assert f"{small}tdoa_10, tdoa_20, fdoa_10," in text
    many = diagram_dot(diagram, contents={"satellites": [f"<{i}>" for i in range(20)]})
    assert "8 more</FONT>" in many and "&lt;11&gt;" in many and "&lt;12&gt;" not in many


def test_feedback_that_is_not_there_is_refused(made):
    with pytest.raises(ValueError, match="ukf -> phase_resolver"):
        diagram_dot(made[0], [("iekf", "phase_resolver"), ("ukf", "phase_resolver")])


def test_svg_shows_every_block_and_wire(made, tmp_path, no_dot):
    diagram, wired = made
    root = ElementTree.parse(draw(diagram, tmp_path / "d.svg", wired.dashed, "my title")).getroot()
    shown = [element.text for element in root.iter(f"{SVG}text")]
    assert {system.get_name() for system in diagram.GetSystems()} | {"my title"} <= set(shown)
    edges = [g for g in root.iter(f"{SVG}g") if g.get("class") == "edge"]
    assert len(edges) == len(diagram.connection_map())
    paths = [path for g in edges for path in g.iter(f"{SVG}path")]
    assert sum(path.get("stroke-dasharray") is not None for path in paths) == 1
    assert sum(path.get("stroke") == "#b0b0b0" for path in paths) == 3 + len(wired.estimators)


def test_png_is_a_picture_of_readable_size(made, tmp_path, no_dot):
    data = draw(made[0], tmp_path / "d.PNG").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = (int.from_bytes(data[16 + 4 * i : 20 + 4 * i], "big") for i in range(2))
    assert 800 < width < 3000 and 800 < height < 3000


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
