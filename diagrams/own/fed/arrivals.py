"""Rows of raw arrival times: each message's differences against a station that heard it, whichever stations did.

A row of kind ``toa`` without a reference is what a receiver's counter said when a message came. The rows of one target
and one time are one message, and ``!Toa`` rows are differences against the first of its stations; where that one
heard nothing another one must be the reference. So the sensor becomes a joint one, of as many ``!Toa`` as references
are needed, of which each message has the rows of one: nothing is lost, see `quietfix.diagrams.own.kinds.toa`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.fields.sensors import Joint
from quietfix.diagrams.own.fields.starts import Snapshot
from quietfix.diagrams.own.kinds.kind import MeasurementKind
from quietfix.diagrams.own.kinds.toa import Toa
from quietfix.diagrams.paths.places import Timed
from quietfix.diagrams.readers.measurements import MeasurementTable, Series
from quietfix.diagrams.readers.units import factor_of
from quietfix.diagrams.schema.errors import UserError, choose

__all__ = ["against_references"]

Integers = NDArray[np.int64]

_MOST_ROWS = 500  # of a sensor: its noise covariance has the square of it


@dataclass(frozen=True)
class _Message:
    """The rows of one message in a table, and who heard it."""

    rows: Sequence[int]
    stations: tuple[str, ...]


def against_references(scenario: OwnScenario, table: MeasurementTable) -> tuple[OwnScenario, MeasurementTable]:
    """Return scenario and table with raw arrival times as differences; both as they are where there are none.

    Parameters
    ----------
    scenario : OwnScenario
    table : MeasurementTable

    Raises
    ------
    UserError
        If no ``!Toa`` has a station, one is there twice in a message, or no message was heard by two stations.
    """
    raw = np.array([one.kind == "toa" and not one.reference for one in table.series])[table.which]
    if not raw.any():
        return scenario, table
    able = {name: one for name, one in scenario.sensors.items() if isinstance(one, Toa)}
    if len(able) != 1:
        there = f"{', '.join(able)} are several" if able else "there is none"
        raise UserError(f"sensors: rows of kind toa without a reference are of one !Toa that stands alone; {there}")
    [(name, field)] = able.items()
    stations = field.stations or list(scenario.platforms)
    messages = _messages(table, np.flatnonzero(raw & np.isfinite(table.value)), stations)
    heard = [one for one in messages if len(one.stations) > 1]
    if not heard:
        raise UserError(f"{table.path.name}: no message was heard by two stations (rows of one target and one time)")
    chosen = _references([set(one.stations) for one in heard], stations)
    groups = _groups(heard, chosen, stations)
    size = sum(len(group) - 1 for group in groups.values())
    if size > _MOST_ROWS:
        raise UserError(
            f"sensors.{name}.stations: {len(stations)} that hear so many different messages together are not allowed; "
            f"{size} differences, at most {_MOST_ROWS}; the recording locards takes any number"
        )
    notes = _notes(table, messages, heard)
    return _with_references(scenario, name, groups), _differences(table, raw, heard, chosen, notes)


def _messages(table: MeasurementTable, rows: Integers, stations: Sequence[str]) -> list[_Message]:
    """Return the messages of rows: those of one target and one time."""
    found: dict[tuple[Any, ...], dict[str, int]] = {}
    for row in rows.tolist():
        series = table.series[table.which[row]]
        if series.receiver not in stations:
            try:
                choose("receiver", series.receiver or "''", dict.fromkeys(stations))
            except UserError as error:
                raise table.wrong(row, str(error)) from error
        whole = 0 if table.whole is None else int(table.whole[row])
        group = found.setdefault((series.target, whole, float(table.rest[row])), {})
        if series.receiver in group:
            line = table.lines[group[series.receiver]]
            raise table.wrong(
                row,
                f"toa {series.receiver} is there twice at one time; line {line} has it already (one time a message)",
            )
        group[series.receiver] = row
    return [_Message(list(group.values()), tuple(group)) for group in found.values()]


def _references(heard: Sequence[set[str]], stations: Sequence[str]) -> list[str]:
    """Return few stations of which every message was heard by one: those that most of what is left heard."""
    left, chosen = list(heard), []
    while left:
        best = max(stations, key=lambda one: sum(one in group for group in left))  # of equals the first
        chosen.append(best)
        left = [group for group in left if best not in group]
    return chosen


def _groups(heard: Sequence[_Message], chosen: Sequence[str], stations: Sequence[str]) -> dict[str, list[str]]:
    """Return by reference the stations that hear something with it, itself first."""
    together: dict[str, set[str]] = {one: set() for one in chosen}
    for one in heard:
        together[_reference(one, chosen)].update(one.stations)
    return {one: [one, *(s for s in stations if s in others and s != one)] for one, others in together.items()}


def _reference(message: _Message, chosen: Sequence[str]) -> str:
    return next(one for one in chosen if one in message.stations)


def _with_references(scenario: OwnScenario, name: str, groups: Mapping[str, list[str]]) -> OwnScenario:
    """Return a scenario whose sensor of arrival times has a ``!Toa`` for each reference."""

    def joint(field: Any) -> Joint:
        timed = {one.name: getattr(field, one.name) for one in fields(Timed)}
        kinds: dict[str, MeasurementKind] = {
            f"{name}_{reference}": Toa(stations=group, sigma_ns=field.sigma_ns, light_time=field.light_time)
            for reference, group in groups.items()
        }
        return Joint(**timed, kinds=kinds)

    sensors = {key: joint(one) if key == name else one for key, one in scenario.sensors.items()}
    beliefs = {
        key: joint(one) if key == name and isinstance(one, Toa) else one for key, one in scenario.belief.sensors.items()
    }
    start = scenario.start
    if isinstance(start, Snapshot):
        kinds = [f"{name}_{reference}" for reference in groups]
        start = replace(start, sensors=[k for one in start.sensors for k in (kinds if one == name else [one])])
    return replace(scenario, sensors=sensors, belief=replace(scenario.belief, sensors=beliefs), start=start)


def _differences(
    table: MeasurementTable, raw: NDArray[np.bool_], heard: Sequence[_Message], chosen: Sequence[str], notes: list[str]
) -> MeasurementTable:
    """Return a table with the differences of messages in the place of their arrival times.

    Those of one unit are taken in it: whole nanoseconds stay whole, however large they are.
    """
    numbers: dict[Series, int] = {one: i for i, one in enumerate(table.series)}
    rows, which, values = [], [], []
    for message in heard:
        reference = _reference(message, chosen)
        base = message.rows[message.stations.index(reference)]
        unit = table.series[table.which[base]].unit
        for row in message.rows:
            if row == base:
                continue
            series = table.series[table.which[row]]
            first = table.value[base]
            if series.unit != unit:
                try:
                    first = first * factor_of(unit, "s") / factor_of(series.unit, "s")
                except ValueError as error:
                    raise table.wrong(row, f"unit: {error} for toa") from error
            rows.append(row)
            which.append(numbers.setdefault(series._replace(reference=reference), len(numbers)))
            values.append(table.value[row] - first)
    others = np.flatnonzero(~raw)
    at = np.concatenate([others, np.array(rows, dtype=np.int64)])
    order = np.argsort(at, kind="stable")
    picked = at[order]
    used = np.concatenate([table.which[others], np.array(which, dtype=np.int64)])[order]
    kept, renumbered = np.unique(used, return_inverse=True)
    series = list(numbers)
    return MeasurementTable(
        table.path,
        table.lines[picked],
        None if table.whole is None else table.whole[picked],
        table.rest[picked],
        renumbered.reshape(-1),
        [series[i] for i in kept],
        np.concatenate([table.value[others], np.array(values, dtype=float)])[order],
        np.where(raw, np.sqrt(2.0), 1.0)[picked] * table.sigma[picked],  # of differences of two that are alike
        notes,
    )


def _notes(table: MeasurementTable, messages: Sequence[_Message], heard: Sequence[_Message]) -> list[str]:
    notes, alone = list(table.notes), len(messages) - len(heard)
    if alone:
        notes.append(
            f"{table.path.name}: {alone} of {len(messages)} messages were heard by one station only (rows of one "
            "target and one time are a message); left out."
        )
    mixed = sum(
        len({float(table.sigma[row]) for row in one.rows if np.isfinite(table.sigma[row])}) > 1 for one in heard
    )
    if mixed:
        notes.append(
            f"{table.path.name}: in {mixed} messages the sigmas of stations differ; of a difference that of the "
            "station is taken for both."
        )
    return notes
