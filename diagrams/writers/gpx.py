"""Tracks in the GPS Exchange Format (GPX 1.1, topografix.com/GPX/1/1)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from xml.sax.saxutils import escape

from quietfix.diagrams.readers.gpx import GpxTrack
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["gpx_text"]

_NO_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def gpx_text(tracks: Iterable[GpxTrack], creator: str = "quietfix", dated: bool = True) -> str:
    """Return tracks as text; `quietfix.diagrams.readers.gpx.read_gpx` makes equal ones of it.

    Numbers have as many digits as tell them from every other one. Tracks that are not `dated` have no times.

    Raises
    ------
    ValueError
        For a place that is not on the Earth, a time before 1972, and characters that XML does not have.
    """
    return "\n".join([*_lines(tracks, creator, dated), ""])


def _lines(tracks: Iterable[GpxTrack], creator: str, dated: bool) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    made = _escaped(creator).replace('"', "&quot;")
    yield f'<gpx version="1.1" creator="{made}" xmlns="http://www.topografix.com/GPX/1/1">'
    for track in tracks:
        yield "<trk>"
        if track.name:
            yield f"<name>{_escaped(track.name)}</name>"
        yield from _points(track, dated)
        yield "</trk>"
    yield "</gpx>"


def _points(track: GpxTrack, dated: bool) -> Iterator[str]:
    columns = (track.second, track.rest, track.latitude, track.longitude, track.elevation, track.geoid, track.part)
    before = None
    for second, rest, latitude, longitude, *heights, part in zip(*(one.tolist() for one in columns), strict=True):
        if not (abs(latitude) <= 90 and abs(longitude) <= 180):
            raise ValueError(f"latitude {latitude}, longitude {longitude} is not allowed; -90 to 90 and -180 to 180")
        if part != before:
            if before is not None:
                yield "</trkseg>"
            yield "<trkseg>"
            before = part
        elevation, geoid = (_height(name, one) for name, one in zip(("ele", "geoidheight"), heights, strict=True))
        time = f"<time>{from_tai(second, rest)}Z</time>" if dated else ""
        yield f'<trkpt lat="{latitude!r}" lon="{longitude!r}">{elevation}{time}{geoid}</trkpt>'
    if before is not None:
        yield "</trkseg>"


def _height(name: str, value: float) -> str:
    return "" if math.isnan(value) else f"<{name}>{value!r}</{name}>"


def _escaped(text: str) -> str:
    bad = _NO_XML.search(text)
    if bad:
        raise ValueError(f"{text[:60]!r} is not allowed; {bad[0]!r} is no character of XML")
    return escape(text)
