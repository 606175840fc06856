"""Tables of measurements as Tracking Data Messages."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.tdm import TrackingMessage
from quietfix.diagrams.readers.ccsds.tdm_observations import Link, Observations, message_of
from quietfix.diagrams.readers.measurements import MeasurementTable, Series
from quietfix.diagrams.readers.units import factor_of

__all__ = ["message_of_table"]

Array = NDArray[np.float64]

_DEGREE = np.pi / 180.0
_KINDS: dict[str, tuple[str, str, str, float]] = {
    "range": ("range", "m", "km", 1e3),
    "range_rate": ("range_rate", "m/s", "km/s", 1e3),
    "received_frequency": ("frequency", "Hz", "Hz", 1.0),
    "frequency": ("frequency", "Hz", "Hz", 1.0),
    "bearing": ("azimuth", "rad", "deg", _DEGREE),
    "azimuth": ("azimuth", "rad", "deg", _DEGREE),
    "elevation": ("elevation", "rad", "deg", _DEGREE),
    "tdoa": ("tdoa", "s", "s", 1.0),
    "fdoa": ("fdoa", "Hz", "Hz", 1.0),
}
"""By kind of a table that of a message, the SI unit, the message's unit, and how many SI units that is."""


def message_of_table(
    table: MeasurementTable,
    began: tuple[int, float] | None,
    header: Mapping[str, str],
    carriers: Mapping[str, float] | None = None,
) -> tuple[TrackingMessage, list[str]]:
    """Return a message that says what a table says, and notes on what it does not have.

    Parameters
    ----------
    table : MeasurementTable
        Rows without a value are left out, and so are kinds that a message does not have, and all sigmas.
    began : tuple of int and float, optional
        t = 0 as seconds of TAI since 1970, whole and rest; not needed of a table with dates.
    header : dict of str to str
        CREATION_DATE and ORIGINATOR.
    carriers : dict of str to float, optional
        What the received frequencies of kind ``frequency`` are counted from, by receiver [Hz]. Those of others are left
        out.

    Raises
    ------
    UserError
        If nothing is left, and as `message_of`.
    ValueError
        For a table without dates, if `began` is missing.
    """
    if table.whole is None and began is None:
        raise ValueError("began: None is not allowed for a table with time_s")
    links: dict[Link, int] = {}
    which = np.full(len(table.series), -1, dtype=np.int64)
    for i, series in enumerate(table.series):
        link = _link(series, carriers or {})
        if link is not None:
            which[i] = links.setdefault(link, len(links))
    value = _values(table, carriers or {})
    kept = np.flatnonzero((which[table.which] >= 0) & np.isfinite(value))
    second, rest = _moments(table, began)
    order = kept[np.lexsort((rest[kept], second[kept]))]
    found = Observations(
        tuple(links), which[table.which[order]], second[order], rest[order], value[order], {}, np.zeros(order.size, int)
    )
    left = dict.fromkeys(one.kind for one, number in zip(table.series, which, strict=True) if number < 0)
    notes = [f"a Tracking Data Message has no {', '.join(left)}; left out."] if left else []
    return message_of(found, header), notes


def _link(series: Series, carriers: Mapping[str, float]) -> Link | None:
    """Return what a series is in a message; None: nothing."""
    if series.kind not in _KINDS or (series.kind == "frequency" and series.receiver not in carriers):
        return None
    kind, _, unit, _ = _KINDS[series.kind]
    target = series.target or "TARGET"
    if target in (series.receiver, series.reference):
        target = f"TARGET {target}"
    other = (target, series.reference) if series.reference else ()
    return Link(kind, (target, series.receiver), other, unit)


def _values(table: MeasurementTable, carriers: Mapping[str, float]) -> Array:
    """Return values in the units of a message; azimuths clockwise from north, 0 to 360 degrees."""
    factor, offset = np.ones(len(table.series)), np.zeros(len(table.series))
    turned = np.zeros(len(table.series), dtype=bool)
    for i, series in enumerate(table.series):
        if series.kind in _KINDS:
            _, si, unit, size = _KINDS[series.kind]
            factor[i] = 1.0 if series.unit == unit else factor_of(series.unit, si) / size
            offset[i] = carriers.get(series.receiver, 0.0) if series.kind == "frequency" else 0.0
            turned[i] = series.kind == "azimuth"
    value = table.value * factor[table.which] + offset[table.which]
    value = np.where(turned[table.which], 90.0 - value, value)
    angle = np.array([one.kind in ("azimuth", "bearing") for one in table.series])[table.which]
    around = np.mod(value, 360.0)
    return np.where(angle, np.where(around >= 360.0, 0.0, around), value)


def _moments(table: MeasurementTable, began: tuple[int, float] | None) -> tuple[NDArray[np.int64], Array]:
    """Return seconds of TAI since 1970 and rests; of times in seconds to the nanosecond."""
    if table.whole is not None:
        return table.whole, table.rest
    assert began is not None
    whole = np.floor(table.rest)
    rest = np.round(began[1] + (table.rest - whole), 9)
    carried = np.floor(rest)
    return began[0] + (whole + carried).astype(np.int64), np.round(rest - carried, 9)
