"""Units that a table may be in, and how large they are in the SI unit of what is measured."""

from __future__ import annotations

import math

__all__ = ["UNITS", "factor_of"]

_DEGREE = math.pi / 180.0

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "ps": 1e-12},
    "Hz": {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "m": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "nmi": 1852.0},
    "m/s": {"m/s": 1.0, "km/s": 1e3, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "kn": 1852 / 3600},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "km/s^2": 1e3, "mm/s^2": 1e-3},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": _DEGREE, "°": _DEGREE, "cycle": 2 * math.pi},
    "rad/s": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE, "°/s": _DEGREE},
    "dBm": {"dBm": 1.0},
    "dB": {"dB": 1.0},
}
"""By SI unit (and those of powers in decibels) what a table may say, and how many of the SI unit that is.

The nautical mile is 1852 m, the foot 0.3048 m (BIPM, *The International System of Units*, 9th edition, table 8, and the
international yard and pound agreement of 1959).
"""


def factor_of(unit: str, si: str) -> float:
    """Return how many of an SI unit another one is; units that are not in the table are only themselves.

    Raises
    ------
    ValueError
        For one of something else.
    """
    allowed = UNITS.get(si, {si: 1.0})
    if unit not in allowed:
        names = ", ".join(name or repr(name) for name in allowed)
        raise ValueError(f"{unit or 'nothing'} is not allowed; one of {names}")
    return allowed[unit]
