"""What the commands do; apart from `diagrams.command_line` so that ``--help`` needs neither Drake nor xarray."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from diagrams.catalogue import load_scenario, split_name
from diagrams.errors import UserError
from diagrams.results import OutputFolder, open_result, write_summary
from diagrams.tables import Column, Table, number, print_table
from diagrams.terminal import say

__all__ = ["draw_command", "gdop_command", "observe_command", "replay_command", "run_command"]


def run_command(
    system: str | None, asked: Mapping[str, Any], from_: Path | None, out: Path | None, overwrite: bool
) -> None:
    """Run a study, print its table and write its folder; see ``quietfix run --help``."""
    from diagrams.metrics import summarise
    from diagrams.study import Study, join

    began = time.monotonic()
    options = dict(asked)
    if from_ is not None:
        system, options = _from_result(from_, system, options)
    if system is None:
        raise UserError("system: it is missing; a name that `quietfix list` prints, or --from RESULT")
    study = Study(system, **options)
    if out is None:
        parts = list(study.chunks(progress=True))
        dataset = join(parts)
        print_summary(dataset, summarise(dataset))
        return
    with OutputFolder(out, overwrite) as folder:
        try:
            for chunk in study.chunks(progress=True):
                folder.append(chunk)
        except KeyboardInterrupt:
            _say_interrupted(folder, study.request.trials)
            raise
        dataset = open_result(folder.store)
        estimators = summarise(dataset)
        write_summary(folder.partial / "summary.json", dataset, estimators, began)
        _illustrate(dataset, study, folder.partial)
        folder.finish()
    print_summary(open_result(out), estimators)
    print(f"wrote {out}: results.zarr, summary.json, figures, diagram.svg ({time.monotonic() - began:.1f} s)")


def _from_result(path: Path, system: str | None, options: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return system and options of an earlier result; what is asked for now goes first."""
    result = open_result(path)
    attributes = result.attrs
    name = attributes["system"]
    if system is not None and split_name(system)[0] != name:
        raise UserError(f"system: {system} is not that of --from {path}, which is {name}")
    if "scenario" in options:
        raise UserError("--scenario: it cannot be combined with --from; use --set")
    again: dict[str, Any] = {key: int(attributes[key]) for key in ("seed", "first_trial", "trials", "every")}
    again |= {"keep": attributes["keep"], "variant": attributes["variant"] or None}
    again["scenario"] = load_scenario(name, text=attributes["scenario"], settings=options.pop("set", []))
    return name, again | options


def _say_interrupted(folder: OutputFolder, trials: int) -> None:
    if folder.chunks:
        done = open_result(folder.store).sizes["trial"]
        print(f"quietfix: {done} of {trials} trials are kept in {folder.partial}", file=sys.stderr)


def _illustrate(dataset: xr.Dataset, study: Any, folder: Path) -> None:
    from diagrams.drawing import draw
    from diagrams.figures import study_figures

    study_figures(dataset, folder)
    diagram, wired = study.diagram()
    header = f"{study.request.system}: {study.request.trials} trials"
    draw(diagram, folder / "diagram.svg", dashed=wired.dashed, header=header)


def print_summary(dataset: xr.Dataset, estimators: Mapping[str, Any]) -> None:
    """Print a table of a study: one row per estimator."""
    times = dataset["time"].values
    picks = sorted({int(np.argmin(np.abs(times - share * times[-1]))) for share in (1 / 15, 1 / 3, 2 / 3, 1.0)})
    variant = f":{dataset.attrs['variant']}" if dataset.attrs["variant"] else ""
    table = Table(
        f"{dataset.attrs['system']}{variant}, {dataset.sizes['trial']} trials, seed {dataset.attrs['seed']}",
        [
            Column("estimator"),
            *(f"{times[i]:g} s [m]" for i in picks),
            *("median [m]", "bound [m]", "height [m]", "velocity [m/s]", "NEES", "diverged"),
        ],
        caption="RMSE of position at each time; at the end: median and bound (filter's process noise) of position, "
        "RMSE of height and velocity, mean NEES",
    )
    for name, row in estimators.items():
        table.add(
            name if row.get("causal", True) else f"{name} (not causal)",
            *(number(row["rmse_position_m"][i]) for i in picks),
            *(
                number(_last(row, key))
                for key in ("median_position_m", "bound_position_m", "rmse_height_m", "rmse_velocity_mps", "nees_mean")
            ),
            str(row["diverged"]),
        )
    print_table(table)
    if dataset.attrs.get("note"):
        say(dataset.attrs["note"])


def _last(row: Mapping[str, Any], key: str) -> float | None:
    values = row.get(key)
    return values[-1] if values else None


def draw_command(
    system: str,
    estimators: Sequence[str] | None,
    settings: Sequence[str] | None,
    scenario: Path | None,
    out: Path | None,
) -> None:
    """Draw a block diagram; see ``quietfix draw --help``."""
    from diagrams.drawing import draw
    from diagrams.study import Study

    path = out or Path(system.replace(":", "_") + ".svg")
    if path.suffix.lower() not in (".svg", ".png"):
        raise UserError(f"--out: {path} is not allowed; a file name that ends in .svg or .png")
    study = Study(system, scenario=scenario, estimators=estimators, set=settings, trials=1)
    diagram, wired = study.diagram()
    with _Writing(path):
        draw(diagram, path, dashed=wired.dashed, header=system)
    print(f"wrote {path}")


def gdop_command(
    system: str, settings: Sequence[str] | None, scenario: Path | None, out: Path | None, overwrite: bool
) -> None:
    """Map bounds; see ``quietfix gdop --help``."""
    from diagrams.bound_map import map_figures, map_of

    name, variant = split_name(system)
    map_of(name)
    resolved = load_scenario(name, variant, scenario, settings or [])
    with OutputFolder(out or Path("gdop"), overwrite) as folder:
        map_figures(name, resolved, folder.partial)
        folder.finish()


def observe_command(
    system: str,
    estimators: Sequence[str] | None,
    window: float | None,
    settings: Sequence[str] | None,
    scenario: Path | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Say what is observable; see ``quietfix observe --help``."""
    from diagrams.observability import observe, report, write_observability

    found = observe(system, estimators=estimators, window=window, scenario=scenario, set=settings)
    if out is not None:
        from diagrams.figures.observability import observe_figures

        with OutputFolder(out, overwrite) as folder:
            write_observability(folder.partial / "summary.json", found, system)
            observe_figures(found, system, folder.partial)
            folder.finish()
    report(found, system)
    if out is not None:
        print(f"wrote {out}: summary.json, figures")


def replay_command(
    dataset: str,
    data: Path | None,
    out: Path | None,
    overwrite: bool,
    file: list[Path] | None = None,
    settings: list[str] | None = None,
) -> None:
    """Replay recorded measurements; see ``quietfix replay --help``."""
    from diagrams.replay import replay

    if out is None:
        replay(dataset, data=data, file=file, settings=settings or ())
        return
    with OutputFolder(out, overwrite) as folder:
        replay(dataset, data=data, out=folder.partial, file=file, settings=settings or ())
        folder.finish()
    print(f"wrote {out}")


class _Writing:
    """Turn a failure to write into a user's mistake."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Raise a `UserError` for an OSError."""
        if isinstance(error, OSError):
            raise UserError(f"--out: {self._path} cannot be written ({error.strerror or error})") from error
