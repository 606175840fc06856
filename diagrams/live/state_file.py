"""What a session knows, in a file: a restart goes on from there as if nothing had been in between."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.live.bench import Moment
from quietfix.diagrams.live.lines import Heard
from quietfix.diagrams.live.session import Session
from quietfix.diagrams.live.track import Done, FollowedTarget, Tick
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.diagrams.schema.scenario import dump
from quietfix.systems.files import Unreadable, read_bytes

__all__ = ["digest_of", "read_state", "restore", "write_state"]

Array = NDArray[np.float64]

_VERSION = 1
_LARGEST = 500_000_000  # bytes


def digest_of(scenario: OwnScenario, estimators: Sequence[str]) -> str:
    """Return what is the same for the same scenario and estimators only."""
    text = dump(scenario, comments=False) + "\n".join(estimators)
    return hashlib.sha256(text.encode()).hexdigest()


def write_state(path: Path, session: Session, digest: str, place: Mapping[str, Any]) -> None:
    """Write the file: all of it or nothing.

    Parameters
    ----------
    path : Path
    session : Session
        Late rows of which are settled.
    digest : str
        See `digest_of`.
    place : mapping
        Where the source of lines goes on.

    Raises
    ------
    UserError
        If it cannot be written.
    """
    said = {
        "quietfix_live": _VERSION,
        "digest": digest,
        "place": dict(place),
        "zero": session.reader.zero,
        "dates": session.reader.dates,
        "scaled": session.scaled,
        "latest": session.latest,
        "held": session.held,
        "first": None if session.first is None else session.first.decode("utf-8", "replace"),
        "lines": session.lines,
        "ticks": session.ticks,
        "begun": session.begun,
        "given_up": session.given_up,
        "left_out": session.refusals.counts,
        "targets": [_track(name, track) for name, track in session.tracks.items()],
    }
    text = json.dumps(_plain(said), allow_nan=False)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise UserError(f"--state: {shown(path)} cannot be written ({error.strerror or error})") from error


def read_state(path: Path, digest: str) -> dict[str, Any] | None:
    """Return what a file says; None if there is none yet.

    Raises
    ------
    UserError
        If it cannot be read, is none of these, or of another system.
    """
    if not path.exists():
        if not path.parent.is_dir():
            raise UserError(f"--state: {shown(path)} cannot be written (there is no such folder)")
        return None
    try:
        said = json.loads(read_bytes(path, _LARGEST))
    except Unreadable as error:
        raise UserError(f"--state: {shown(path)} cannot be read ({error.reason})") from error
    except (ValueError, RecursionError) as error:
        raise UserError(f"--state: {shown(path)} is not allowed; it is no state of quietfix live") from error
    if not isinstance(said, dict) or "quietfix_live" not in said:
        raise UserError(f"--state: {shown(path)} is not allowed; it is no state of quietfix live")
    if said["quietfix_live"] != _VERSION:
        raise UserError(
            f"--state: {shown(path)} is of version {said['quietfix_live']!r:.20}, which is not allowed; {_VERSION}"
        )
    if said.get("digest") != digest:
        raise UserError(
            f"--state: {shown(path)} is not allowed; it is of another scenario or other estimators (remove it to begin "
            "anew)"
        )
    return said


def restore(session: Session, said: Mapping[str, Any], path: Path) -> None:
    """Let a new session go on.

    Raises
    ------
    UserError
        If the file is broken.
    """
    try:
        _restore(session, said)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UserError(f"--state: {shown(path)} is broken ({type(error).__name__}: {error})") from error


def _restore(session: Session, said: Mapping[str, Any]) -> None:
    zero = said["zero"]
    session.reader.zero = None if zero is None else (int(zero[0]), float(zero[1]))
    session.reader.dates, session.latest = said["dates"], float(said["latest"])
    session.first = None if said["first"] is None else said["first"].encode()
    held = said["held"]
    session.held = None if held is None else Heard(held[0], held[1], int(held[2]), float(held[3]), float(held[4]))
    session.lines, session.ticks, session.begun = int(said["lines"]), int(said["ticks"]), int(said["begun"])
    session.given_up = int(said["given_up"])
    session.refusals.counts = {str(kind): int(count) for kind, count in said["left_out"].items()}
    if said["scaled"]:
        session.scale()
    for one in said["targets"]:
        track = session.follow(str(one["target"]), int(one["number"]))
        track.runner.go_back(_moment_of(one["moment"]))
        track.last = one["last"]
        track.pending = [_tick_of(tick) for tick in one["pending"]]
        track.done.extend(Done(_moment_of(done["before"]), _tick_of(done["tick"])) for done in one["done"])


def _track(name: str, track: FollowedTarget) -> dict[str, Any]:
    return {
        "target": name,
        "number": track.runner.number,
        "last": track.last,
        "moment": _moment(track.runner.moment()),
        "pending": [_tick(tick) for tick in track.pending],
        "done": [{"before": _moment(done.before), "tick": _tick(done.tick)} for done in track.done],
    }


def _moment(moment: Moment | None) -> dict[str, Any] | None:
    return None if moment is None else {name: getattr(moment, name) for name in Moment.__dataclass_fields__}


def _moment_of(said: Mapping[str, Any] | None) -> Moment | None:
    if said is None:
        return None
    discrete = [_array(one) for one in said["discrete"]]
    number, continuous = int(said["number"]), _array(said["continuous"])
    return Moment(float(said["time"]), number, _array(said["value"]), _array(said["scale"]), discrete, continuous)


def _tick(tick: Tick) -> dict[str, Any]:
    return {"time": tick.time, "value": tick.value, "scale": tick.scale, "rows": sorted(tick.rows)}


def _tick_of(said: Mapping[str, Any]) -> Tick:
    rows = {int(row) for row in said["rows"]}
    return Tick(float(said["time"]), _array(said["value"]), _array(said["scale"]), rows)


def _plain(value: Any) -> Any:
    """Return what JSON can say: numbers that are none as text."""
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return value


def _array(said: Sequence[Any]) -> Array:
    return np.array([float(one) for one in said])
