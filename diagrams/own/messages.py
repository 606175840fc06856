"""What was measured, as a Tracking Data Message."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from quietfix.diagrams.own.declaring.sensing import placed_sensors
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.system import places_of
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.readers.measurements import read_measurements
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.tdm import tdm_text
from quietfix.diagrams.writers.tdm_table import message_of_table

__all__ = ["write_message"]


def write_message(measurements: Path, scenario: OwnScenario, path: Path) -> list[str]:
    """Write a table of measurements of a scenario with a date as a Tracking Data Message.

    Times are to the nanosecond, values in the message's units, sigmas are not in it.

    Returns
    -------
    list of str
        What the message does not have.

    Raises
    ------
    UserError
        If the scenario has no date, or the message could say nothing.
    """
    zero = Setting(scenario.duration_s, scenario.start_utc, measurements.parent).began()
    if zero is None:
        raise UserError("start_utc: null is not allowed for a Tracking Data Message; such as 2026-03-01T12:00:00Z")
    sensors = placed_sensors(scenario, places_of(scenario))
    rows = [row for one in sensors for kind in one.kinds for row in kind.rows]
    carriers = {row.receiver: row.carrier for row in rows if row.carrier}
    header = {"CREATION_DATE": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S"), "ORIGINATOR": "QUIETFIX"}
    message, notes = message_of_table(read_measurements(measurements), zero, header, carriers)
    path.write_text(tdm_text(message), encoding="utf-8", newline="\n")
    return notes
