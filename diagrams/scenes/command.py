"""What ``quietfix play`` does: open a result or run a few trials, then serve them or write a page."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.scenes.marks import CZML_SIGNATURE, SIGNATURE
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.whole_file import replaces, written_beside

if TYPE_CHECKING:
    from quietfix.diagrams.scenes.scene import Scene

__all__ = ["Written", "play_command"]

_FEW = 5  # trials of a system
_PAGE, _CZML = (".html", ".htm"), (".czml", ".json")
_SIGNATURES = {"html": SIGNATURE.encode(), "czml": CZML_SIGNATURE.encode()}


@dataclass(frozen=True)
class Written:
    """What is written in place of being served; see ``quietfix play --help``."""

    html: Path | None = None
    czml: Path | None = None
    origin: str | None = None


def play_command(
    what: str,
    written: Written,
    estimators: Sequence[str] | None,
    trial: int | None,
    magnify: float | None,
    asked: Mapping[str, Any],
) -> Callable[[], None] | None:
    """Play a result, and return what waits for the end where it is served; see ``quietfix play --help``.

    Raises
    ------
    UserError
        If there is nothing to play, or a file may not be written where it is asked for.
    """
    if magnify is not None and not (math.isfinite(magnify) and magnify > 0):
        raise UserError(f"--magnify: {magnify:g} is not allowed; above 0")
    existed = _may_be_written(written)
    dataset = _opened(Path(what), asked) if _is_result(what) else _run(what, estimators, asked, written)
    from quietfix.diagrams.scenes.scene import scene_of

    try:
        scene = scene_of(dataset, estimators, trial)
    except RuntimeError as error:  # of what cannot be decompressed
        raise UserError(f"play: {what} cannot be read ({' '.join(str(error).split())})") from error
    tell(title=scene.title, trial=scene.trial)
    told: list[dict[str, Any]] = []
    if written.czml is not None:
        text = _as_czml(scene, dataset, written)
        for note in () if written.html else scene.notes:
            say(note)
        told.append(_write(written.czml, text, existed["czml"]))
        tell(written=told)
        if written.html is None:
            return None
    from quietfix.diagrams.scenes.page import page
    from quietfix.diagrams.scenes.playing import opened, perform
    from quietfix.diagrams.scenes.stage import staged
    from quietfix.diagrams.scenes.timing import timing_of

    stage, timing, meshcat = staged(scene, magnify), timing_of(scene.times), opened()
    perform(stage, meshcat, timing)
    for note in [f"{stage.scale}; {timing.pace:g} s pass in one second", *stage.notes, *scene.notes]:
        say(note)
    tell(magnified=stage.magnified, pace=timing.pace)
    if written.html is None:
        tell(url=meshcat.web_url())
        done(f"{meshcat.web_url()} shows {scene.title}, trial {scene.trial}; Ctrl-C ends it")
        return partial(_wait, meshcat)
    told.append(_write(written.html, page(meshcat.StaticHtml(), scene, stage, timing), existed["html"]))
    tell(written=told)
    return None


def _wait(served: object) -> None:
    """Wait until Ctrl-C; what is served lives as long as this."""
    sys.stdout.flush()
    while served is not None:
        time.sleep(1)


def _write(path: Path, text: str, existed: bool) -> dict[str, Any]:
    """Write a file, and return what is told of it."""
    with written_beside(path) as beside:
        beside.write_text(text, encoding="utf-8")
    size = len(text.encode())
    done(f"{'replaced' if existed else 'wrote'} {path} ({size / 1e6:.1f} MB)")
    return {"file": str(path), "size_bytes": size, "replaced": existed}


def _as_czml(scene: Scene, dataset: xr.Dataset, written: Written) -> str:
    from quietfix.diagrams.scenes.czml import czml_of
    from quietfix.diagrams.scenes.globe import globe_of
    from quietfix.diagrams.schema.yaml_text import load_yaml

    scenario = load_yaml(str(dataset.attrs.get("scenario", ""))) or {}
    began = scenario.get("start_utc")
    date = None if began is None else datetime.fromisoformat(str(began))
    if date is not None and date.tzinfo is None:
        date = date.replace(tzinfo=UTC)
    globe = globe_of(scene, written.origin, scenario)
    if globe.note:
        say(globe.note)
    return czml_of(scene, globe, date)


def _is_result(what: str) -> bool:
    return Path(what).is_dir()


def _opened(folder: Path, asked: Mapping[str, Any]) -> xr.Dataset:
    from quietfix.diagrams.studies.marker import refuse_changed
    from quietfix.diagrams.studies.results import open_result

    for name in asked:
        raise UserError(f"--{name}: it is not allowed with a result, which is played as it is; for a system")
    refuse_changed(folder.parent if folder.suffix == ".zarr" else folder, "play", folder)
    return open_result(folder)


def _run(system: str, estimators: Sequence[str] | None, asked: Mapping[str, Any], written: Written) -> xr.Dataset:
    """Run a few trials of a system, with the estimators that are shown."""
    from quietfix.diagrams.assembly.find import find
    from quietfix.diagrams.quantities.frame import as_frame
    from quietfix.diagrams.scenes.globe import check_origin
    from quietfix.diagrams.studies.whole import run_study

    found = find(system)
    scenario = found.system.resolve(found.variant, asked.get("scenario"), asked.get("set"))
    model = found.model(scenario)
    recorded = model.recorded
    if written.czml is not None:  # before anything is run
        check_origin(as_frame(model.frame), written.origin)
    chosen = {"trials": _FEW if recorded is None else min(_FEW, len(recorded.tracks)), **asked}
    return run_study(
        found, estimators=estimators or list(scenario.estimators)[:1], keep="covariance", progress=True, **chosen
    )


def _may_be_written(written: Written) -> dict[str, bool]:
    """Return by option whether a file of this command is there that is to be replaced; refuse to replace others."""
    if written.origin is not None and written.czml is None:
        raise UserError(f"--origin: {written.origin} is not allowed without --czml")
    if written.czml is not None and find_spec("czml3") is None:
        raise UserError("--czml: it needs czml3, which is not installed; pip install 'quietfix[view]'")
    found = {}
    for name, path, endings in (("html", written.html, _PAGE), ("czml", written.czml, _CZML)):
        if path is None:
            continue
        if path.suffix.lower() not in endings:
            raise UserError(f"--{name}: {path} is not allowed; a file name that ends in {endings[0]}")
        if not path.exists() and not path.parent.is_dir():
            raise UserError(f"--{name}: {path} cannot be written (there is no folder {path.parent})")
        found[name] = replaces(path, _SIGNATURES[name], f"--{name}", "command")
    return found
