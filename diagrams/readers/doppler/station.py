"""Where a receiving station is: three numbers, or a file beside a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from quietfix.diagrams.readers.rows import broken
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.yaml_text import BadYaml, load_yaml
from quietfix.systems.files import Unreadable, read_bytes

__all__ = ["carrier_of", "read_station"]

_NAMES = (
    ("latitude_deg", "latitude", "lat", "gs_lat", "site_lat"),
    ("longitude_deg", "longitude", "lon", "lng", "gs_lon", "site_lon"),
    ("height_m", "height", "altitude_m", "altitude", "alt", "elevation", "gs_alt", "site_alt"),
)
_CARRIERS = ("rx_center_freq", "carrier_hz", "center_freq", "frequency_hz")
_LIMITS = (90.0, 360.0, 1e5)
_WORDS = "LATITUDE,LONGITUDE,HEIGHT [deg, deg, m], or a YAML or JSON file with latitude, longitude and height"
_LARGEST = 1_000_000  # bytes
_DEEP = 8


def read_station(given: str) -> tuple[float, float, float]:
    """Return latitude and longitude [deg] and height above the ellipsoid [m].

    Parameters
    ----------
    given : str
        ``LATITUDE,LONGITUDE,HEIGHT``, or the path of a YAML or JSON file that has them anywhere, as ``latitude_deg``,
        ``latitude``, ``lat`` or ``gs_lat`` and so on.

    Raises
    ------
    UserError
        If it is neither.
    """
    parts = given.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) == 3:
        return _checked(numbers, "--station")
    if numbers or (len(parts) > 1 and not Path(given).exists()):
        raise UserError(f"--station: {given[:80]} is not allowed; {_WORDS}")
    path = Path(given)
    place = _place(_loaded(path))
    if place is None:
        raise broken(path, None, f"it names no place; {_WORDS}")
    return _checked(place, str(path))


def carrier_of(given: str) -> float | None:
    """Return the frequency [Hz] that a station's file says it was tuned to; None: it says none, or it is no file."""
    path = Path(given)
    if not path.is_file():
        return None
    data = _loaded(path)
    for name in _CARRIERS:
        value = data.get(name) if isinstance(data, Mapping) else None
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and value > 0:
            return float(value)
    return None


def _loaded(path: Path) -> Any:
    try:
        return load_yaml(read_bytes(path, _LARGEST).decode())
    except Unreadable as error:
        raise broken(path, None, f"it cannot be read ({error.reason})") from error
    except UnicodeDecodeError as error:
        raise broken(path, None, "bytes that are no text are not allowed; UTF-8") from error
    except BadYaml as error:
        raise broken(path, error.line, f"it {error}") from error


def _place(data: Any, depth: int = 0) -> list[Any] | None:
    """Return the first latitude, longitude and height that stand together."""
    if not isinstance(data, Mapping) or depth > _DEEP:
        return None
    lower = {str(key).lower(): value for key, value in data.items()}
    found = [next((lower[name] for name in names if name in lower), None) for names in _NAMES]
    if found[0] is not None and found[1] is not None:
        return [*found[:2], 0.0 if found[2] is None else found[2]]
    return next((place for value in data.values() if (place := _place(value, depth + 1)) is not None), None)


def _checked(numbers: list[Any], where: str) -> tuple[float, float, float]:
    checked = []
    for value, names, most in zip(numbers, _NAMES, _LIMITS, strict=True):
        try:
            number = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not abs(number) <= most:
            raise UserError(f"{where}: {names[1]} {str(value)[:40]} is not allowed; a number, at most {most:g} in size")
        checked.append(number)
    return checked[0], checked[1], checked[2]
