"""A scene as CZML, for Cesium and what else reads it: true to scale, on a globe, with a clock."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from czml3 import Document, Packet
from czml3 import enums as choices
from czml3 import properties as p
from czml3.types import (
    Cartesian3Value,
    ReferenceListValue,
    RgbafValue,
    TimeInterval,
    TimeIntervalCollection,
    UnitQuaternionValue,
)
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from quietfix.diagrams.scenes.globe import Globe
from quietfix.diagrams.scenes.ground import blocked
from quietfix.diagrams.scenes.marks import CZML_SIGNATURE
from quietfix.diagrams.scenes.scene import Estimated, Scene, Track
from quietfix.diagrams.scenes.stage import COLOURS, PLATFORM, SIGHT, TARGET, Colour

__all__ = ["EPOCH", "czml_of"]

Array = NDArray[np.float64]

EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
"""t = 0 of a result without a date."""
_DEGREE = 5
_THIN = 1e-3  # of the longest semi-axis: how thin an ellipsoid is drawn at least
_STILL = 1e-3  # m: what never leaves such a place has no samples
_PLAYED = 60.0  # s in which all is shown


def czml_of(scene: Scene, globe: Globe, began: datetime | None) -> str:
    """Return a scene as a CZML document.

    Positions are sampled at the epochs, in Earth-fixed axes [m]; semi-axes of ellipsoids [m] and their orientation
    too. What has no finite place at an epoch is not available around it.

    Parameters
    ----------
    scene : Scene
    globe : Globe
        Where it is.
    began : datetime, optional
        t = 0, in UTC; `EPOCH` if nobody knows.
    """
    clock = _Clock(scene.times, began or EPOCH)
    notes = [
        *scene.notes,
        *filter(None, [globe.note]),
        *([] if began else [f"no date is known: t = 0 is {EPOCH:%Y-%m-%dT%H:%M:%SZ}"]),
    ]
    packets: list[Packet | None] = [
        Packet(
            id="document",
            name=f"{scene.title}, trial {scene.trial}",
            version="1.0",
            description="; ".join([CZML_SIGNATURE, *notes]),
            clock=clock.packet(),
        )
    ]
    target = globe.placed(scene.target.places)
    for track in scene.platforms:
        packets.append(_track(track, globe.placed(track.places), clock, PLATFORM))
    packets.append(_track(scene.target, target, clock, TARGET))
    for number, one in enumerate(scene.estimates):
        packets += _estimate(one, scene, globe, clock, COLOURS[number % len(COLOURS)])
    for track in scene.platforms:
        packets.append(_sight(track, globe.placed(track.places), target, clock))
    return str(Document(packets=[packet for packet in packets if packet is not None]).dumps())


class _Clock:
    """Seconds of the result as CZML has them."""

    def __init__(self, times: Array, began: datetime) -> None:
        self.times, self.epoch = times, began

    def packet(self) -> p.Clock:
        start, stop = self.at(self.times[0]), self.at(self.times[-1])
        length = float(self.times[-1] - self.times[0])
        return p.Clock(
            currentTime=start,
            interval=TimeInterval(start=start, end=stop),
            multiplier=max(1.0, float(np.ceil(length / _PLAYED))),
            range=choices.ClockRanges.LOOP_STOP,
            step=choices.ClockSteps.SYSTEM_CLOCK_MULTIPLIER,
        )

    def at(self, seconds: float) -> datetime:
        return self.epoch + timedelta(seconds=float(seconds))

    def sampled(self, values: Array, known: NDArray[np.bool_]) -> list[float]:
        """Return (time, values) of the epochs that are known, in a row."""
        rows = np.concatenate([self.times[:, None], values], axis=1)[known]
        return [float(number) for number in rows.ravel()]

    def spans(self, known: NDArray[np.bool_]) -> TimeIntervalCollection:
        """Return the intervals within which all epochs are known."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
        pairs = zip(edges[::2], edges[1::2] - 1, strict=True)
        spans = [TimeInterval(start=self.at(self.times[a]), end=self.at(self.times[b])) for a, b in pairs]
        return TimeIntervalCollection(values=spans)


def _known(places: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(places).all(axis=-1))


def _position(places: Array, clock: _Clock, smooth: bool) -> p.Position:
    known = _known(places)
    degree = min(_DEGREE if smooth else 1, int(known.sum()) - 1)
    if degree < 1 or float(np.ptp(places[known], axis=0).max()) < _STILL:
        return p.Position(cartesian=Cartesian3Value(values=[float(x) for x in places[known][0]]))
    return p.Position(
        epoch=clock.epoch,
        cartesian=Cartesian3Value(values=clock.sampled(places, known)),
        interpolationAlgorithm=choices.InterpolationAlgorithms.LAGRANGE
        if degree > 1
        else choices.InterpolationAlgorithms.LINEAR,
        interpolationDegree=degree,
        referenceFrame="FIXED",
    )


def _colour(colour: Colour, opacity: float = 1.0) -> p.Color:
    return p.Color(rgbaf=RgbafValue(values=[*colour, opacity]))


def _material(colour: Colour, opacity: float = 1.0) -> p.Material:
    return p.Material(solidColor=p.SolidColorMaterial(color=_colour(colour, opacity)))


def _line(colour: Colour) -> p.PolylineMaterial:
    return p.PolylineMaterial(solidColor=p.SolidColorMaterial(color=_colour(colour)))


def _track(track: Track, places: Array, clock: _Clock, colour: Colour) -> Packet | None:
    known = _known(places)
    if not known.any():
        return None
    still = float(np.ptp(places[known], axis=0).max()) < _STILL
    return Packet(
        id=_id(track.kind, track.name),
        name=track.name,
        availability=clock.spans(known),
        position=_position(places, clock, True),
        point=p.Point(pixelSize=9, color=_colour(colour), outlineColor=_colour((1.0, 1.0, 1.0)), outlineWidth=1),
        path=None if still else p.Path(material=_line(colour), width=2, resolution=60),
        label=p.Label(text=track.name, font="13px sans-serif", scale=1.0, fillColor=_colour(colour)),
    )


def _estimate(one: Estimated, scene: Scene, globe: Globe, clock: _Clock, colour: Colour) -> list[Packet | None]:
    """Return what an estimator says: of the shown trial with its ellipsoid, and dots of the others."""
    places = globe.placed(scene.target.places + one.errors)
    known = _known(places)
    if not known.any():
        return []
    found: list[Packet | None] = [
        Packet(
            id=_id("estimate", one.name),
            name=f"{one.name}, trial {scene.trial}",
            availability=clock.spans(known),
            position=_position(places, clock, False),
            point=p.Point(pixelSize=7, color=_colour(colour)),
            path=p.Path(material=_line(colour), width=1, resolution=60),
        )
    ]
    if one.axes is not None and one.lengths is not None:
        found.append(_ellipsoid(one, places, globe, clock, colour))
    for number, errors in zip(one.cloud_trials, one.cloud, strict=True):
        dots = globe.placed(scene.target.places + errors)
        if (there := _known(dots)).any():
            found.append(
                Packet(
                    id=_id("other", f"{one.name}/{number}"),
                    name=f"{one.name}, trial {number}",
                    availability=clock.spans(there),
                    position=_position(dots, clock, False),
                    point=p.Point(pixelSize=3, color=_colour(colour, 0.5)),
                )
            )
    return found


def _ellipsoid(one: Estimated, places: Array, globe: Globe, clock: _Clock, colour: Colour) -> Packet | None:
    assert one.axes is not None and one.lengths is not None
    known = _known(places) & _known(one.lengths)
    if not known.any():
        return None
    sizes = np.maximum(one.lengths, np.maximum(_THIN * one.lengths.max(axis=-1, keepdims=True), 1e-3))
    turns = Rotation.from_matrix(globe.turned(one.axes)).as_quat()
    flips = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=-1) < 0, -1.0, 1.0))  # the short way round
    turns[1:] *= flips[:, None]
    several = int(known.sum()) > 1
    radii, rotation = (
        clock.sampled(values, known) if several else [float(x) for x in values[known][0]] for values in (sizes, turns)
    )
    sampled: dict[str, Any] = {"epoch": clock.epoch} if several else {}
    return Packet(
        id=_id("ellipsoid", one.name),
        name=f"{one.name}: ellipsoid",
        availability=clock.spans(known),
        position=_position(np.where(known[:, None], places, np.nan), clock, False),
        orientation=p.Orientation(unitQuaternion=UnitQuaternionValue(values=rotation), **sampled),
        ellipsoid=p.Ellipsoid(
            radii=p.EllipsoidRadii(cartesian=Cartesian3Value(values=radii), **sampled),
            material=_material(colour, 0.3),
            outline=True,
            outlineColor=_colour(colour),
        ),
    )


def _sight(track: Track, places: Array, target: Array, clock: _Clock) -> Packet | None:
    """Return the line from a platform to the target, where the Earth is not between them."""
    known = _known(places) & _known(target)
    seen = known & ~blocked(np.where(known[:, None], places, 1.0), np.where(known[:, None], target, 1.0))
    if not seen.any():
        return None
    ends = [f"{_id(track.kind, track.name)}#position", f"{_id('target', 'target')}#position"]
    return Packet(
        id=_id("sight", track.name),
        name=f"line of sight, {track.name}",
        availability=clock.spans(seen),
        polyline=p.Polyline(
            positions=p.PositionList(references=ReferenceListValue(values=ends)),
            arcType=p.ArcType(arcType=choices.ArcTypes.NONE),
            width=1,
            material=_line(SIGHT),
        ),
    )


def _id(kind: str, name: str) -> str:
    """Return the identifier of a packet; ``#`` parts an identifier from a property of it in a reference."""
    return f"{kind}/{name}".replace("#", "_")
