"""What ``quietfix plot`` does: the figures of a result once more."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

from quietfix.diagrams.commands.results.drawn import draw_diagram
from quietfix.diagrams.commands.results.opened import Opened, opened, reading
from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.terminal import done
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.output import OutputFolder

__all__ = ["plot_command"]


def plot_command(path: Path, out: Path | None, overwrite: bool, trust: bool) -> None:
    """Draw figures again; see ``quietfix plot --help``."""
    result = opened(path, "plot")
    beside = Path(f"{result.folder.name}-figures")
    folder_name = out or (beside if isinstance(result.path, str) else result.folder.with_name(beside.name))
    with OutputFolder(folder_name, overwrite, "plot") as folder:
        with reading(path, "plot"):
            left_out = _sweep(result, folder.work) if result.sweeps else _study(result, folder.work, trust)
        drawn = sorted(one.name for one in folder.work.iterdir())
        if not drawn:
            raise UserError(f"plot: {path} has nothing that can be drawn")
        folder.finish()
    tell(folder=str(folder_name), figures=drawn, left_out=left_out)
    for name, why in left_out.items():
        done(f"{name} left out: {why}")
    done(f"wrote {folder_name}: {', '.join(drawn)}")


def _sweep(result: Opened, folder: Path) -> dict[str, str]:
    from quietfix.diagrams.experiments.sweep import sweep_statistics
    from quietfix.diagrams.figures.shared.style import save
    from quietfix.diagrams.figures.sweep import draw_sweep

    found = sweep_statistics(result.dataset.load())
    save(draw_sweep(found, bool(result.dataset.attrs.get("geometric", 0))), folder / "sweep.png")
    return {}


def _study(result: Opened, folder: Path, trust: bool) -> dict[str, str]:
    from quietfix.diagrams.figures import study_figures

    study_figures(result.dataset, folder)
    left_out = {}
    if (result.folder / "comparison.json").is_file():
        _comparison(result.folder / "comparison.json", folder)
    if (result.folder / "diagram.svg").is_file():
        try:
            _from_the_system(result, folder, trust)
        except UserError as error:  # code that is not trusted, a recording that is not there
            recorded = "tracks" in result.dataset.attrs
            name = "diagram.svg, and what the recording draws of its own," if recorded else "diagram.svg"
            left_out[name] = str(error)
    return left_out


def _comparison(file: Path, folder: Path) -> None:
    from quietfix.diagrams.figures.comparison import draw_comparison
    from quietfix.diagrams.figures.shared.style import save

    try:
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        figure = draw_comparison(found)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"plot: {file} is damaged ({' '.join(str(error).split())})") from error
    save(figure, folder / "comparison.png")


def _from_the_system(result: Opened, folder: Path, trust: bool) -> None:
    """Draw what the result alone does not tell: the diagram, and the figures of a recording."""
    from quietfix.diagrams.studies.rerun import ask_again
    from quietfix.diagrams.studies.study import Study

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a file has changed since: what is drawn is the result
        found, options = ask_again(result.folder, None, {}, trust)
        study = Study(found, **options)
        draw_diagram(study, folder)
        if (report := study.report(result.dataset)) is not None:
            report.draw(folder)
