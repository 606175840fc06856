"""A scene in a real browser: no error, no request, and at any time things are where the result has them."""

import json

import numpy as np
import pytest

from quietfix.diagrams.scenes.page import page
from quietfix.diagrams.scenes.playing import opened, perform
from quietfix.diagrams.scenes.scene import scene_of
from quietfix.diagrams.scenes.stage import staged
from quietfix.diagrams.scenes.timing import timing_of
from quietfix.diagrams.studies.whole import run_study
from tests.pages.browser import open_browser, until

pytestmark = pytest.mark.slow

_SHOWN = """
viewer.animator.pause(); viewer.animator.time = arguments[0]; viewer.animator.seek(arguments[0]);
const at = (...path) => viewer.scene_tree.find(["drake", ...path]).object;
const mark = at("targets", "target", "mark"), body = at("estimates", "iekf", "ellipsoid", "shape");
return [mark.position.toArray(), body.scale.toArray(), document.getElementById("clock").textContent];
"""


def test_a_scene_in_a_browser(tmp_path):
    driver = open_browser("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    try:
        dataset = run_study("three_satellite", trials=2, estimators=["iekf"], set=["duration_s=12"], keep="covariance")
        scene = scene_of(dataset)
        stage, timing, meshcat = staged(scene), timing_of(scene.times), opened()
        perform(stage, meshcat, timing)
        (tmp_path / "scene.html").write_text(page(meshcat.StaticHtml(), scene, stage, timing))
        driver.get(f"file://{tmp_path / 'scene.html'}")
        until(lambda: driver.execute_script("return viewer.animator.actions.length"))
        shown = {thing.path: thing for thing in stage.moving}
        for k in (2, 9):
            # the very frame: recordings have whole ones
            at = np.floor(timing.seconds[k] * timing.frames_per_second) / timing.frames_per_second
            place, scale, _ = driver.execute_script(_SHOWN, float(at))
            # a browser keeps poses in single precision
            assert place == pytest.approx(shown["targets/target/mark"].places[k], abs=1e-5)
            assert scale == pytest.approx(shown["estimates/iekf/ellipsoid"].sizes[k], rel=1e-5)
        until(lambda: driver.execute_script('return document.getElementById("clock").textContent') == "9.00")
        told = [json.loads(entry["message"])["message"] for entry in driver.get_log("performance")]
        asked = [m["params"]["request"]["url"] for m in told if m["method"] == "Network.requestWillBeSent"]
        assert [url for url in asked if not url.startswith(("data:", "file:", "blob:"))] == []
        assert [entry for entry in driver.get_log("browser") if entry["level"] == "SEVERE"] == []
    finally:
        driver.quit()
