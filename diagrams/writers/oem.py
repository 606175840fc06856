"""Orbit Ephemeris Messages (CCSDS 502.0-B-3) in keyword = value notation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from quietfix.diagrams.readers.ccsds.oem import EphemerisMessage, EphemerisSegment
from quietfix.diagrams.readers.ccsds.oem_covariance import Covariance
from quietfix.diagrams.readers.ccsds.oem_keywords import HEADER, METADATA
from quietfix.diagrams.writers.kvn import comments, message_text
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["oem_text"]


def oem_text(message: EphemerisMessage) -> str:
    """Return a message as text; `quietfix.diagrams.readers.ccsds.oem.read_oem` makes an equal message of it.

    Raises
    ------
    ValueError
        If an epoch cannot be written in the time system of its segment (UTC before 1972), or a value is no line of
        text.
    """
    return message_text("OEM", message, HEADER, METADATA, _data)


def _data(segment: EphemerisSegment) -> Iterator[str]:
    yield from comments(segment.data_comments)
    scale = segment.metadata["TIME_SYSTEM"]
    columns = segment.second.tolist(), segment.rest.tolist(), segment.states.tolist(), segment.accelerations.tolist()
    for second, rest, state, acceleration in zip(*columns, strict=True):
        numbers = [*state, *acceleration] if np.isfinite(acceleration).all() else state
        yield " ".join([from_tai(second, rest, scale), *map(repr, numbers)])
    if segment.covariances:
        yield "COVARIANCE_START"
        for one in segment.covariances:
            yield from _covariance(one, scale)
        yield "COVARIANCE_STOP"


def _covariance(one: Covariance, scale: str) -> Iterator[str]:
    yield f"EPOCH = {from_tai(one.second, one.rest, scale)}"
    if one.frame:
        yield f"COV_REF_FRAME = {one.frame}"
    for i, row in enumerate(one.matrix.tolist(), 1):
        yield " ".join(map(repr, row[:i]))
