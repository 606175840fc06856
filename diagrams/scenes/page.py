"""Meshcat's static page, with what it shows in words."""

from __future__ import annotations

import json
from html import escape

from quietfix.diagrams.scenes.marks import SIGNATURE
from quietfix.diagrams.scenes.scene import Scene
from quietfix.diagrams.scenes.stage import Stage
from quietfix.diagrams.scenes.timing import Timing

__all__ = ["page"]

_STYLE = """<style>
#legend{position:fixed;left:12px;top:12px;max-width:min(23rem,60vw);padding:.6rem .8rem;background:#fffffff0;color:#222;
font:14px/1.4 system-ui,sans-serif;border:1px solid #bbb;border-radius:6px}
#legend h1{font-size:16px;margin:0 0 .2rem} #legend p{margin:.2rem 0;font-size:12px;color:#444}
#legend i{display:inline-block;width:.7em;height:.7em;border-radius:50%;margin-right:.5em}
#legend summary{cursor:pointer}
</style>"""

_CLOCK = """<script>
(() => {
  const [start, pace] = NUMBERS, clock = document.getElementById("clock");
  const tell = () => {
    clock.textContent = (start + pace * viewer.animator.time).toFixed(pace < 5 ? 2 : 0);
    requestAnimationFrame(tell);
  };
  tell();
})();
</script>"""


def page(html: str, scene: Scene, stage: Stage, timing: Timing) -> str:
    """Return Meshcat's static page with title, legend and clock.

    Parameters
    ----------
    html : str
        What ``Meshcat.StaticHtml`` returned.
    scene, stage, timing
        What it shows.
    """
    title = escape(f"{scene.title}, trial {scene.trial}")
    told = "".join(f"<div>{_dot(colour)}{escape(name)}</div>" for name, colour in stage.legend)
    told += f"<p>{escape(stage.scale)}; {timing.pace:g} s pass in one second</p>"
    notes = [*stage.notes, *scene.notes]
    paragraphs = "".join(f"<p>{escape(note)}</p>" for note in notes)
    legend = (
        f'<div id="legend"><h1>{title}</h1><div>time <b id="clock"></b> s</div>{told}'
        f"<details><summary>notes</summary>{paragraphs}</details></div>"
    )
    clock = _CLOCK.replace("NUMBERS", json.dumps([timing.start, timing.pace]))
    head = f"<head>\n  {SIGNATURE}\n  <meta name=viewport content='width=device-width'>"
    html = html.replace("<head>", head, 1).replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    before, end, after = html.rpartition("</body>")
    return f"{before}{_STYLE}{legend}{clock}{end}{after}"


def _dot(colour: tuple[float, float, float]) -> str:
    return f'<i style="background:rgb({",".join(str(round(255 * part)) for part in colour)})"></i>'
