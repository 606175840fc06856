"""Tracking Data Messages (CCSDS 503.0-B-2) in keyword = value notation."""

from __future__ import annotations

from collections.abc import Iterator

from quietfix.diagrams.readers.ccsds.tdm import TrackingMessage, TrackingSegment
from quietfix.diagrams.readers.ccsds.tdm_keywords import HEADER, METADATA
from quietfix.diagrams.writers.kvn import comments, message_text
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["tdm_text"]


def tdm_text(message: TrackingMessage) -> str:
    """Return a message as text; `quietfix.diagrams.readers.ccsds.tdm.read_tdm` makes an equal message of it.

    Numbers have as many digits as tell them from every other one, time tags all that theirs have.

    Raises
    ------
    ValueError
        If a time cannot be written in the time system of its segment (UTC before 1972), or a value is no line of text.
    """
    return message_text("TDM", message, HEADER, METADATA, _data)


def _data(segment: TrackingSegment) -> Iterator[str]:
    yield "DATA_START"
    yield from comments(segment.data_comments)
    records, scale = segment.records, segment.metadata["TIME_SYSTEM"]
    columns = records.second.tolist(), records.rest.tolist(), records.value.tolist()
    for row, (name, second, rest, value) in enumerate(zip(records.keywords, *columns, strict=True)):
        yield f"{name} = {from_tai(second, rest, scale)} {records.digits.get(row, repr(value))}"
    yield "DATA_STOP"
