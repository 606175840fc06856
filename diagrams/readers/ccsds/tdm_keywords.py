"""What may stand in a Tracking Data Message: tables 3-2, 3-3 and 3-5 of CCSDS 503.0-B-2 with its corrigendum 1."""

from __future__ import annotations

import math

__all__ = ["CHOICES", "CORRECTIONS", "DATA", "HEADER", "INTEGERS", "METADATA", "NUMBERS", "PHASES"]

HEADER = ("CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
"""In the order of the standard; the first two are mandatory."""

_INDICES = range(1, 6)

CORRECTIONS = (
    *("CORRECTION_ANGLE_1", "CORRECTION_ANGLE_2", "CORRECTION_DOPPLER", "CORRECTION_MAG", "CORRECTION_RANGE"),
    *("CORRECTION_RCS", "CORRECTION_RECEIVE", "CORRECTION_TRANSMIT"),
    *("CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL"),
)

METADATA = (
    *("TRACK_ID", "DATA_TYPES", "TIME_SYSTEM", "START_TIME", "STOP_TIME"),
    *(f"PARTICIPANT_{n}" for n in _INDICES),
    *("MODE", "PATH", "PATH_1", "PATH_2"),
    *(f"EPHEMERIS_NAME_{n}" for n in _INDICES),
    *("TRANSMIT_BAND", "RECEIVE_BAND", "TURNAROUND_NUMERATOR", "TURNAROUND_DENOMINATOR", "TIMETAG_REF"),
    *("INTEGRATION_INTERVAL", "INTEGRATION_REF", "FREQ_OFFSET", "RANGE_MODE", "RANGE_MODULUS", "RANGE_UNITS"),
    *("ANGLE_TYPE", "REFERENCE_FRAME", "INTERPOLATION", "INTERPOLATION_DEGREE"),
    *("DOPPLER_COUNT_BIAS", "DOPPLER_COUNT_SCALE", "DOPPLER_COUNT_ROLLOVER"),
    *(f"TRANSMIT_DELAY_{n}" for n in _INDICES),
    *(f"RECEIVE_DELAY_{n}" for n in _INDICES),
    *("DATA_QUALITY", *CORRECTIONS, "CORRECTIONS_APPLIED"),
)
"""Keywords of a metadata section in the order of the standard."""

CHOICES = {
    "MODE": ("SEQUENTIAL", "SINGLE_DIFF"),
    "TIMETAG_REF": ("TRANSMIT", "RECEIVE"),
    "INTEGRATION_REF": ("START", "MIDDLE", "END"),
    "RANGE_MODE": ("COHERENT", "CONSTANT", "ONE_WAY"),
    "RANGE_UNITS": ("km", "s", "RU"),
    "ANGLE_TYPE": ("AZEL", "RADEC", "XEYN", "XSYE"),
    "DOPPLER_COUNT_ROLLOVER": ("YES", "NO"),
    "DATA_QUALITY": ("RAW", "VALIDATED", "DEGRADED"),
    "CORRECTIONS_APPLIED": ("YES", "NO"),
}
"""Values of the keywords that have some only."""

NUMBERS = {
    "INTEGRATION_INTERVAL": ("s", math.ulp(0.0)),
    "FREQ_OFFSET": ("Hz", -math.inf),
    "RANGE_MODULUS": ("", 0.0),
    "DOPPLER_COUNT_BIAS": ("Hz", math.ulp(0.0)),
    **{f"TRANSMIT_DELAY_{n}": ("s", 0.0) for n in _INDICES},
    **{f"RECEIVE_DELAY_{n}": ("s", 0.0) for n in _INDICES},
    **{name: ("", -math.inf) for name in CORRECTIONS},
}
"""Units and least values of the keywords that have numbers."""

INTEGERS = ("TURNAROUND_NUMERATOR", "TURNAROUND_DENOMINATOR", "INTERPOLATION_DEGREE", "DOPPLER_COUNT_SCALE")
"""Keywords that have a whole number, 1 or more."""

PHASES = tuple(f"{side}_PHASE_CT_{n}" for side in ("RECEIVE", "TRANSMIT") for n in _INDICES)
"""Keywords whose value is a number of any length."""

_ANY = (-math.inf, math.inf)
_POSITIVE = (math.ulp(0.0), math.inf)
_ANGLE = (-180.0, math.nextafter(360.0, 0.0))

DATA: dict[str, tuple[str, tuple[float, float]]] = {
    "ANGLE_1": ("deg", _ANGLE),
    "ANGLE_2": ("deg", _ANGLE),
    "CARRIER_POWER": ("dBW", _ANY),
    "CLOCK_BIAS": ("s", _ANY),
    "CLOCK_DRIFT": ("s/s", _ANY),
    "DOPPLER_COUNT": ("", (0.0, math.inf)),
    "DOPPLER_INSTANTANEOUS": ("km/s", _ANY),
    "DOPPLER_INTEGRATED": ("km/s", _ANY),
    "DOR": ("s", _ANY),
    "MAG": ("", _ANY),
    "PC_N0": ("dBHz", _ANY),
    "PR_N0": ("dBHz", _ANY),
    "PRESSURE": ("hPa", _POSITIVE),
    "RANGE": ("", _ANY),
    "RCS": ("m**2", _POSITIVE),
    "RECEIVE_FREQ": ("Hz", _ANY),
    **{f"RECEIVE_FREQ_{n}": ("Hz", _ANY) for n in _INDICES},
    "RHUMIDITY": ("%", (0.0, 100.0)),
    "STEC": ("TECU", _POSITIVE),
    "TEMPERATURE": ("K", _POSITIVE),
    **{f"TRANSMIT_FREQ_{n}": ("Hz", _POSITIVE) for n in _INDICES},
    **{f"TRANSMIT_FREQ_RATE_{n}": ("Hz/s", _ANY) for n in _INDICES},
    "TROPO_DRY": ("m", (0.0, math.inf)),
    "TROPO_WET": ("m", (0.0, math.inf)),
    "VLBI_DELAY": ("s", _ANY),
    **{name: ("", _ANY) for name in PHASES},
}
"""Units, least and largest values of the keywords of a data section; RANGE has the unit of RANGE_UNITS."""
