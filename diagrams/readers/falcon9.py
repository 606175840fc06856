"""The recorded Falcon 9 flight of `beacon_rocket:falcon9`: speed and altitude off the webcast of Iridium NEXT 6."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from quietfix.diagrams.readers.data import Source, data_folder
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.files import Unreadable, read_text
from quietfix.systems.plants.recorded_flight import RecordedFlight
from quietfix.systems.trajectories.planar_flight import PlanarFlight, fit_planar_flight
from quietfix.systems.trajectories.rocket import LaunchSite

__all__ = ["falcon9_flight", "falcon9_plant"]

_TAIL = 5.0  # s of record beyond the end of tracking, so that the last knots are supported
_LARGEST = 1e6  # s, m/s, km
_EVENT_ERROR = 3.0  # s; the list of events gives whole seconds and the webcast's clock lags


_TELEMETRY = Source("falcon9_telemetry", "github.com/shahar603/Telemetry-Data at b245d3b")


@lru_cache(maxsize=4)
def falcon9_flight(folder: Path, flight: str, stop: float, smoothing: float, gap: float, radius: float) -> PlanarFlight:
    """Return the smoothed flight until `stop` [s].

    Raises
    ------
    UserError
        If the files cannot be read, the record ends before `stop` or has a gap.
    """
    record = _read(folder / f"{flight}__stage2_raw.json")
    events = _read(folder / f"{flight}__events.json")
    try:
        times, speed, altitude = (np.array(record[key], dtype=float) for key in ("time", "velocity", "altitude"))
        jumps = [float(events[key]) for key in ("meco", "ses1") if events.get(key) is not None]
        if not times.ndim == 1 or not times.shape == speed.shape == altitude.shape or not times.size:
            raise ValueError
        if not all(np.all(np.abs(numbers) <= _LARGEST) for numbers in (times, speed, altitude, jumps)):
            raise ValueError
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise UserError(
            f"telemetry: {flight} lacks time, velocity or altitude as lists of equally many numbers, at most "
            f"{_LARGEST:g} in size"
        ) from error
    if times[-1] < stop:
        raise UserError(f"stop_s: {stop:g} is not allowed; the record of {flight} ends at {times[-1]:g} s")
    kept = times <= stop + _TAIL
    return fit_planar_flight(
        times[kept], speed[kept], 1e3 * altitude[kept], jumps, radius, smoothing, largest_gap=gap, search=_EVENT_ERROR
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(read_text(path))
    except Unreadable as error:
        raise UserError(f"telemetry: {error}") from error
    except (ValueError, RecursionError) as error:
        raise UserError(f"telemetry: {path} cannot be read ({' '.join(str(error).split())})") from error
    if not isinstance(found, dict):
        raise UserError(f"telemetry: {path} is not a mapping")
    return found


def falcon9_plant(vehicle: Any, site: LaunchSite, stop: float) -> RecordedFlight:
    """Return the flight as a plant; the data folder comes from QUIETFIX_DATA."""
    folder = data_folder(_TELEMETRY)
    flight = falcon9_flight(folder, vehicle.flight, stop, vehicle.smoothing_s, vehicle.largest_gap_s, site.radius)
    return RecordedFlight(flight)
