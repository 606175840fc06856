"""A system of one's own that is fed from a file: what is different from one that is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.own.classes import plants
from quietfix.diagrams.own.declaring.sensing import Measured
from quietfix.diagrams.own.fed.plausible import beyond_light
from quietfix.diagrams.own.fed.played import Played, played, table_of
from quietfix.diagrams.own.fed.report import measured_report
from quietfix.diagrams.own.fed.truth import read_truth
from quietfix.diagrams.own.fields.schema import OwnScenario, Prior
from quietfix.diagrams.own.fields.starts import KnownHeight
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.paths.functions import Path, path_of
from quietfix.diagrams.paths.movers import RandomMotion
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.readers.measurements import MeasurementTable
from quietfix.diagrams.schema.errors import UserError

__all__ = [
    "believed_noise",
    "measured",
    "recorded_of",
    "refuse_simulated",
    "setting_of",
    "table_of_scenario",
    "true_paths",
]


Array = NDArray[np.float64]


def table_of_scenario(scenario: OwnScenario, folder: FilePath) -> MeasurementTable | None:
    """Return the table of measurements of a scenario; None: it is simulated.

    Raises
    ------
    UserError
        As `quietfix.diagrams.readers.measurements.read_measurements`.
    """
    field = scenario.measurements
    if field is None:
        return None
    if not field.file:
        raise UserError("measurements.file: none is given; the path of a file")
    return table_of(folder / field.file, field.two_way)


def setting_of(scenario: OwnScenario, folder: FilePath, table: MeasurementTable | None) -> Setting:
    """Return when and where files are read for: without start_utc the first row of a table with dates is t = 0."""
    setting = Setting(scenario.duration_s, scenario.start_utc, folder, scenario.reference_orbit)
    if setting.began() is None and table is not None and table.whole is not None:
        whole, rest = table.first
        return replace(setting, zero=(whole, rest))
    return setting


def true_paths(scenario: OwnScenario, setting: Setting) -> dict[str, Path]:
    """Return where the targets are by their names, all under the empty one; nothing: nobody knows.

    A target that is drawn, or simulated by a user's own system, says nothing of a recorded one.
    """
    field, constants = scenario.measurements, gravity_constants(scenario.constants)
    assert field is not None
    if field.truth:
        if not field.truth.file:
            raise UserError("measurements.truth.file: none is given; the path of a file")
        return read_truth(setting.folder / field.truth.file, setting, scenario.axes)
    if scenario.target is None or isinstance(scenario.target, RandomMotion | plants.Custom):
        return {}
    return {"": path_of(scenario.target, scenario.axes, setting, constants, "target")}


def measured(
    scenario: OwnScenario,
    setting: Setting,
    table: MeasurementTable,
    kinds: Sequence[Measured],
    places: Places,
    truth: Mapping[str, Path],
    carriers: Path,
) -> Played:
    """Return what was measured in the place of the sensors.

    Raises
    ------
    UserError
        With file and line, or the field of the scenario that means nothing with measurements.
    """
    refuse_simulated(scenario, bool(truth))
    start = None if scenario.start_utc is None else setting.began()
    rows = [row for kind in kinds for row in kind.rows]
    found = played(table, table.seconds(start), rows, believed_noise(kinds), scenario.duration_s)
    resolved = [kind.where for kind in kinds if kind.resolved]
    if found.scaled and resolved:
        raise UserError(
            f"{table.path.name}: column sigma is not allowed with phases that are resolved ({resolved[0]}); sigma_deg"
        )
    paths, unknown = _paths(scenario, found, truth)
    notes = [*beyond_light(found, rows, places.platforms, carriers), *unknown]
    return replace(found, paths=paths, notes=[*found.notes, *notes])


def _paths(scenario: OwnScenario, found: Played, truth: Mapping[str, Path]) -> tuple[list[Path], list[str]]:
    """Return where each target is, and a note on those of which nobody knows it."""
    field = scenario.measurements
    several = len(found.names) > 1
    if field is not None and field.truth is not None and "" in truth and several:
        raise UserError(
            f"measurements.truth: {field.truth.file} has no column target; it is needed, for the table has several: "
            f"{', '.join(found.names[:5])}"
        )
    paths = [truth.get(name, truth.get("", path)) for name, path in zip(found.names, found.paths, strict=True)]
    absent = [name for name in found.names if name not in truth and "" not in truth]
    if isinstance(scenario.start, Prior):
        for name, path in zip(found.names, paths, strict=True):
            if not np.isfinite(path(0.0)).all():
                raise UserError(
                    f"start: !Prior is drawn about the truth at t = 0, and nobody knows where {name} was then; "
                    "!Given or !Snapshot"
                )
    return paths, [f"nobody knows where {', '.join(absent[:5])} was."] if truth and absent else []


def believed_noise(kinds: Sequence[Measured]) -> Array:
    """Return the noise of the stream of measurements as the estimators believe it to be, shape (m, m)."""
    models = [model for kind in kinds for model in (kind.believed, *kind.links)]
    return np.array(block_diag(*(model.noise_covariance() for model in models)))


def refuse_simulated(scenario: OwnScenario, known: bool) -> None:
    """Refuse what is drawn about a truth that nobody knows, or is an error of a simulation.

    Raises
    ------
    UserError
        Naming the field.
    """
    errors = scenario.platform_errors
    for name in ("sigma_position_m", "sigma_velocity_mps"):
        if getattr(errors, name):
            raise UserError(
                f"platform_errors.{name}: {getattr(errors, name):g} is not allowed with measurements; 0, for where the "
                "platforms are is what is known of them"
            )
    start = scenario.start
    if isinstance(start, Prior) and (not known or scenario.oscillator is not None):
        why = "where the target is" if not known else "the oscillator's error"
        raise UserError(
            f"start: !Prior is drawn about the truth, and with measurements nobody knows {why}; !Given, !Snapshot"
        )
    if isinstance(start, KnownHeight) and not known:
        raise UserError(
            "start: !KnownHeight draws a height about the truth, and with measurements nobody knows where the target "
            "is; !Given or !Snapshot"
        )


def recorded_of(fed: Played, known: bool, began: tuple[int, float] | None) -> Recorded:
    """Return what makes a model of it a recording.

    Parameters
    ----------
    fed : Played
    known : bool
        Whether its truth is.
    began : (int, float), optional
        t = 0 as seconds of TAI since 1970, whole and rest.
    """
    several = len(fed.names) > 1
    return Recorded(
        tracks=fed.names,
        clocks=[track.clock for track in fed.tracks] if several else (),
        times=[track.clock.ticks(np.inf) for track in fed.tracks] if several else (),
        report=partial(measured_report, names=fed.names, claimed=fed.claimed, began=began, known=known),
        keeps=["covariance", "innovation", "measurement"],
        bounds=known and not several,
        truth=known,
    )
