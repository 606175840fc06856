"""What ``quietfix play`` does: open a result or run a few trials, then serve them or write a page."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.whole_file import replaces, written_beside

__all__ = ["play_command"]

_ENDINGS = (".html", ".htm")
_FEW = 5  # trials of a system


def play_command(
    what: str,
    html: Path | None,
    estimators: Sequence[str] | None,
    trial: int | None,
    magnify: float | None,
    asked: Mapping[str, Any],
) -> None:
    """Play a result; see ``quietfix play --help``.

    Raises
    ------
    UserError
        If there is nothing to play, or the page may not be written where it is asked for.
    """
    if magnify is not None and not (math.isfinite(magnify) and magnify > 0):
        raise UserError(f"--magnify: {magnify:g} is not allowed; above 0")
    existed = html is not None and _may_be_written(html)
    dataset = _opened(Path(what), asked) if _is_result(what) else _run(what, estimators, asked)
    from quietfix.diagrams.scenes.scene import scene_of
    from quietfix.diagrams.scenes.stage import staged
    from quietfix.diagrams.scenes.timing import timing_of

    scene = scene_of(dataset, estimators, trial)
    stage, timing = staged(scene, magnify), timing_of(scene.times)
    from quietfix.diagrams.scenes.page import page
    from quietfix.diagrams.scenes.playing import opened, perform

    meshcat = opened()
    perform(stage, meshcat, timing)
    for note in [f"{stage.scale}; {timing.pace:g} s pass in one second", *stage.notes, *scene.notes]:
        say(note)
    if html is None:
        say(f"{meshcat.web_url()} shows {scene.title}, trial {scene.trial}; Ctrl-C ends it")
        while True:
            time.sleep(1)
    text = page(meshcat.StaticHtml(), scene, stage, timing)
    with written_beside(html) as beside:
        beside.write_text(text, encoding="utf-8")
    print(f"{'replaced' if existed else 'wrote'} {html} ({len(text.encode()) / 1e6:.1f} MB)")


def _is_result(what: str) -> bool:
    return Path(what).is_dir()


def _opened(folder: Path, asked: Mapping[str, Any]) -> xr.Dataset:
    from quietfix.diagrams.studies.results import open_result

    for name in asked:
        raise UserError(f"--{name}: it is not allowed with a result, which is played as it is; for a system")
    return open_result(folder)


def _run(system: str, estimators: Sequence[str] | None, asked: Mapping[str, Any]) -> xr.Dataset:
    """Run a few trials of a system, with the estimators that are shown."""
    from quietfix.diagrams.assembly.find import find
    from quietfix.diagrams.studies.whole import run_study

    found = find(system)
    scenario = found.system.resolve(found.variant, asked.get("scenario"), asked.get("set"))
    recorded = found.model(scenario).recorded
    chosen = {"trials": _FEW if recorded is None else min(_FEW, len(recorded.tracks)), **asked}
    return run_study(
        found, estimators=estimators or list(scenario.estimators)[:1], keep="covariance", progress=True, **chosen
    )


def _may_be_written(path: Path) -> bool:
    """Return whether a page of this command is there that is to be replaced; refuse to replace anything else."""
    from quietfix.diagrams.scenes.page import SIGNATURE

    if path.suffix.lower() not in _ENDINGS:
        raise UserError(f"--html: {path} is not allowed; a file name that ends in .html")
    if not path.exists():
        if not path.parent.is_dir():
            raise UserError(f"--html: {path} cannot be written (there is no folder {path.parent})")
        return False
    return replaces(path, SIGNATURE.encode(), "--html", "command")
