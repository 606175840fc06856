"""The report of a result: one HTML file with all that it tells, which needs no network."""

from __future__ import annotations

import base64
import json
import shlex
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from quietfix.diagrams.console.tables import Table
from quietfix.diagrams.pages.coast import COAST_NOTE
from quietfix.diagrams.pages.courses import courses
from quietfix.diagrams.pages.curves import curves, estimators, verdicts
from quietfix.diagrams.pages.picture import inline_svg
from quietfix.diagrams.pages.places import last_errors, views
from quietfix.diagrams.pages.scenario import scenario_lines
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise
from quietfix.diagrams.studies.marker import refuse_changed
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.store import read_attributes
from quietfix.diagrams.tables.comparison import comparison_notes, comparison_table
from quietfix.diagrams.tables.summary import summary_notes, summary_table
from quietfix.diagrams.tables.sweep import sweep_legend, sweep_table
from quietfix.diagrams.tables.verification import verification_counts, verification_table

__all__ = ["report_page"]

_LOOK = files("quietfix.diagrams.pages") / "look"
_KINDS = {"comparison.json": "compare", "sweep.json": "sweep", "verification.json": "verify"}
_PARTS = ("curves", "views", "last", "courses", "sweep", "requirements")
_FILE_LIMIT = 1 << 28  # bytes of a JSON file


def report_page(folder: Path) -> str:
    """Return the page of a result.

    Parameters
    ----------
    folder : Path
        What run, replay, compare, sweep or verify wrote.

    Returns
    -------
    str
        HTML; styles, the numbers and the program that draws them are all in it.

    Raises
    ------
    UserError
        If it is no result, or damaged.
    """
    told = {kind: _read(folder / name) for name, kind in _KINDS.items() if (folder / name).is_file()}
    page = _verification(told["verify"]) if "verify" in told else _of_store(folder, told)
    page["data"] = dict.fromkeys(_PARTS) | page["data"]
    page["again"] = [*page["again"], f"quietfix report {shlex.quote(str(folder))}"]
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((_LOOK / "report.html").read_text(encoding="utf-8"))
    # a closing tag in a text must not end the element that the numbers stand in
    data = json.dumps(page["data"], allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return template.render(
        **page,
        json=Markup(data),
        coast_note=COAST_NOTE,
        css=Markup((_LOOK / "report.css").read_text(encoding="utf-8")),
        js=Markup((_LOOK / "report.js").read_text(encoding="utf-8")),
        plotly=Markup(_plotly()),
    )


def _plotly() -> str:
    """Return Plotly's program, compressed: the smallest bundle that draws lines, which a browser reads in no time."""
    return base64.b64encode((_LOOK / "plotly-basic.min.js.gz").read_bytes()).decode("ascii")


def _read(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _FILE_LIMIT:
            raise UserError(f"result: {path} is too large")
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"result: {path} cannot be read ({error})") from error
    if not isinstance(found, dict):
        raise UserError(f"result: {path} is not what this program writes; a JSON object is needed")
    return found


def _of_store(folder: Path, told: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return what the template needs of a result that has trials."""
    refuse_changed(folder, "report")
    dataset = open_result(folder)
    if "system" not in dataset.attrs:
        raise UserError(f"RESULT: {folder} is damaged: its results.zarr names no system")
    attributes = read_attributes(folder / "results.zarr")
    variant = f":{attributes['variant']}" if attributes.get("variant") else ""
    title = f"{attributes['system']}{variant}"
    lines, note = scenario_lines(attributes, str(folder))
    page: dict[str, Any] = {
        "title": title,
        "facts": _facts(attributes, dataset),
        "scenario": lines,
        "scenario_note": note,
        "svg": Markup(svg) if (svg := inline_svg(folder / "diagram.svg")) else None,
        "verdicts": [],
        "notes": [],
        "again": _commands(attributes, folder, "sweep" in told),
        "data": {"estimators": estimators(dataset) if "estimator" in dataset.coords else []},
    }
    try:
        if "sweep" in told:
            return page | _sweep(told["sweep"], page["data"])
        return page | _study(dataset, folder, told.get("compare"), page["data"])
    except (KeyError, TypeError, IndexError, RuntimeError) as error:  # RuntimeError: of what cannot be decompressed
        why = f"no {error.args[0]}" if isinstance(error, KeyError) and error.args else str(error)
        raise UserError(f"RESULT: {folder} is damaged, or of another version ({why})") from error


def _study(dataset: xr.Dataset, folder: Path, compared: dict[str, Any] | None, data: dict[str, Any]) -> dict[str, Any]:
    if not data["estimators"]:
        return {"kind": "run", "table": None, "notes": [], "data": data}
    path = folder / "summary.json"
    summary = _read(path) if path.is_file() else None
    if summary is None:  # results.zarr alone, or an interrupted run
        from quietfix.diagrams.studies.results import times_of

        summary = {
            "estimators": summarise(dataset),
            "trials": dataset.sizes["trial"],
            "time_s": times_of(dataset["time"].values),
        }
    data |= {
        "curves": curves(dataset, summary),
        "views": views(dataset),
        "last": last_errors(dataset),
        "courses": courses(dataset),
    }
    told = {
        "kind": "run",
        "table": _rows(summary_table(dataset, summary["estimators"])),
        "notes": summary_notes(dataset, summary["estimators"]),
        "verdicts": verdicts(dataset, summary),
        "data": data,
    }
    if compared is not None:
        told |= {
            "kind": "compare",
            "table": _rows(comparison_table(compared)),
            "notes": comparison_notes(compared),
        }
    return told


def _sweep(found: dict[str, Any], data: dict[str, Any]) -> dict[str, Any]:
    data["sweep"] = {
        "key": found["key"],
        "values": found["values"],
        "rows": {
            name: {key: row.get(key) for key in ("rmse_position_m", "bound_position_m", "nees_per_state")}
            for name, row in found["estimators"].items()
        },
    }
    return {
        "kind": "sweep",
        "scenario_note": f"At the first point; the others differ in {found['key']} alone.",
        "table": _rows(sweep_table(found)),
        "notes": [sweep_legend(found)],
        "data": data,
    }


def _verification(found: dict[str, Any]) -> dict[str, Any]:
    """Return what the template needs of a verification, which keeps no trials."""
    try:
        styles = {"holds": "green", "fails": "red"}
        rows = found["requirements"]
        return {
            "kind": "verify",
            "title": f"{found['file']}: {found['system']}",
            "facts": [
                ("system", str(found["system"])),
                ("seed", str(found["seed"])),
                ("looks at", ", ".join(map(str, found["looks"])) + " trials"),
                ("Quietfix", str(found["version"])),
            ],
            "scenario": [],
            "scenario_note": "",
            "svg": None,
            "table": _rows(verification_table(found)),
            "verdicts": [
                {
                    "name": one["name"],
                    "words": f"{one['verdict']} after {one['trials']} trials. {one['why'] or ''}",
                    "style": styles.get(one["verdict"], "yellow"),
                }
                for one in rows
            ],
            "notes": [verification_counts(found)],
            "again": [f"quietfix verify {shlex.quote(str(found['file']))} --seed {found['seed']}"],
            "data": {"estimators": [], "requirements": rows},
        }
    except (KeyError, TypeError) as error:
        why = f"no {error.args[0]}" if isinstance(error, KeyError) and error.args else str(error)
        raise UserError(f"RESULT: verification.json is damaged, or of another version ({why})") from error


def _facts(attributes: Mapping[str, Any], dataset: xr.Dataset) -> list[tuple[str, str]]:
    name = "time" if "time" in dataset.coords else "at"  # a sweep has one time for each point
    time = np.asarray(dataset[name].values if name in dataset.variables else [], dtype=float)
    last = float(np.nanmax(time, initial=0.0))
    names = [str(name) for name in dataset["estimator"].values] if "estimator" in dataset.coords else []
    facts = [
        ("trials", str(dataset.sizes.get("trial", attributes.get("trials", "?")))),
        ("estimators", ", ".join(names) or "none"),
        ("until", f"{last:g} s"),
        ("epochs kept", f"one of {every}" if name == "time" and (every := attributes.get("every", 1)) != 1 else ""),
        ("seed", str(attributes.get("seed"))),
        ("frame", str(attributes.get("frame", "")).replace("_", "-")),
        ("Quietfix", str(attributes.get("version"))),
    ]
    return [(key, value) for key, value in facts if value and value != "None"]


def _commands(attributes: Mapping[str, Any], folder: Path, swept: bool) -> list[str]:
    if swept:
        return []
    where = shlex.quote(str(folder))
    trusted = attributes.get("system_source", "packaged") in ("packaged", "yaml", "installed")
    again = f"quietfix run --from {where} --out again{'' if trusted else ' --trust'}"
    return [again, f"{again} --trials 1 --first-trial 7 --keep all"]


def _rows(table: Table) -> dict[str, Any]:
    """Return a table as the template draws it."""
    return {
        "title": table.title,
        "caption": table.caption,
        "headings": [column if isinstance(column, str) else column.heading for column in table.columns],
        "words": [not isinstance(column, str) for column in table.columns],
        "rows": [[(cell.text, cell.style) for cell in row] for row in table.rows],
    }
