"""The rows that the sensors of a system of one's own measure, as a table of measurements names them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from quietfix.diagrams.own.declaring.sensing import Measured
from quietfix.diagrams.own.fields import kinds
from quietfix.diagrams.paths.places import Places
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.differenced import Differenced

__all__ = ["Row", "rows_of"]

_DIFFERENCES = {kinds.Tdoa: "tdoa", kinds.Toa: "toa", kinds.Fdoa: "fdoa"}
_EACH = {kinds.Range: "range", kinds.RangeRate: "range_rate", kinds.Frequency: "frequency", kinds.Rss: "rss"}


@dataclass(frozen=True)
class Row:
    """A row of the stream of measurements.

    Attributes
    ----------
    name : str
        ``KIND_RECEIVER_REFERENCE``, without what it does not have.
    kind, receiver, reference : str
        As a table names it; empty: it has none.
    unit : str
        SI.
    carrier : float
        What a received frequency is counted from [Hz]; 0 of other rows.
    compass : bool
        Whether it is an azimuth from east to north, which a table may have as a bearing.
    """

    name: str
    kind: str
    receiver: str
    reference: str
    unit: str
    carrier: float = 0.0
    compass: bool = False


def rows_of(measured: Sequence[Measured], places: Places) -> list[Row]:
    """Return the rows of all kinds of measurement, in the order of the stream."""
    found = []
    for one in measured:
        for model in (one.real, *one.links):
            found += [_row(one, model, i, list(places.platforms)) for i in range(model.size)]
    return found


def _row(one: Measured, model: MeasurementModel, i: int, platforms: Sequence[str]) -> Row:
    name, unit, field = model.names[i], model.units[i], one.field
    for type_, kind in _DIFFERENCES.items():
        if isinstance(field, type_):
            assert isinstance(model, Differenced)
            return Row(name, kind, platforms[model.receivers[i]], platforms[model.reference], unit)
    for type_, kind in _EACH.items():
        if isinstance(field, type_):
            carrier = field.carrier_mhz * 1e6 if isinstance(field, kinds.Frequency) else 0.0
            return Row(name, kind, name.removeprefix(f"{kind}_"), "", unit, carrier)
    if isinstance(field, kinds.Bearing | kinds.Phase | kinds.Relative):
        platform = field.platform or platforms[0]
        own, _, link = name.partition(f"_{platform}")  # a shorter baseline has its number behind the platform
        return Row(name, own + link, platform, "", unit, compass=isinstance(field, kinds.Bearing) and own == "azimuth")
    return Row(name, name, "", "", unit)
