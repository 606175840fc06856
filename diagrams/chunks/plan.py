"""What an interrupted run was asked for, and whether a later one is asked for the same."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import read_yaml

__all__ = ["Plan", "differences", "even"]

_CHUNK_BYTES = 1e8  # of recorded signals; a log, its stacked copy and the Dataset stand beside each other
_LARGEST_CHUNK = 2000  # trials; wider arrays leave the processor's cache and gain nothing
_NARROW = 100  # trials: below them an epoch costs nearly the same however many there are, so more memory pays
_NARROW_BYTES = 4e8  # of a chunk of so few


@dataclass(frozen=True)
class Plan:
    """What a run is asked for, and how it is cut.

    Attributes
    ----------
    asked : dict
        The attributes of its result, and what else was asked for; numbers and text.
    trials : int
        How many trials, or whatever it is cut along, there are.
    chunk : int
        How many of them are one chunk; the last one may be smaller.
    """

    asked: dict[str, Any]
    trials: int
    chunk: int

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return -(-self.trials // self.chunk)

    def place(self, number: int) -> tuple[int, int]:
        """Return where a chunk begins and where it ends."""
        begin = number * self.chunk
        return begin, min(begin + self.chunk, self.trials)

    def text(self) -> str:
        """Return it as JSON."""
        return json.dumps(asdict(self), indent=1)

    @classmethod
    def read(cls, text: str) -> Plan:
        """Return what `text` wrote.

        Raises
        ------
        ValueError
            If it is something else.
        """
        found = json.loads(text)
        if not isinstance(found, dict) or set(found) != {"asked", "trials", "chunk"}:
            raise ValueError("it is no plan")
        sizes = found["trials"], found["chunk"]
        if not isinstance(found["asked"], dict) or not all(type(size) is int and size > 0 for size in sizes):
            raise ValueError("it is no plan")
        return cls(found["asked"], *sizes)

    def refuse_other(self, other: Plan, option: str = "--resume", words: str = "the run that was interrupted") -> None:
        """Refuse to go on with another run than this one; for the message the option, and what this one is.

        Raises
        ------
        UserError
            Naming the first field that differs, its value here and there.
        """
        mine, its = ({"trials": p.trials, **p.asked, "chunk": p.asked.get("chunk", p.chunk)} for p in (self, other))
        for key, was, now in differences(mine, its):
            raise UserError(f"{option}: {key}: {now} is not allowed; {words} has {was}")


_NONE = object()
_TEXTS = ("scenario", "requirements")  # YAML of which the field is named


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield the names of the fields that differ between what was asked for and what is, and both values.

    Those of a scenario by their dotted keys, and then the scenario as a whole.
    """
    for key in [*before, *(key for key in after if key not in before)]:
        was, now = before.get(key, _NONE), after.get(key, _NONE)
        if was == now:
            continue
        if key.split(": ")[-1] in _TEXTS and isinstance(was, str) and isinstance(now, str):
            yield from _within(key.rpartition("scenario")[0], read_yaml(was), read_yaml(now))
        yield key, _shown(was), _shown(now)


def _within(path: str, was: Any, now: Any) -> Iterator[tuple[str, str, str]]:
    """Yield the same of two scenarios, by dotted keys."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        for key in [*was, *(key for key in now if key not in was)]:
            where = f"{path}{key}" if path[-1:] in ("", " ") else f"{path}.{key}"
            yield from _within(where, was.get(key, _NONE), now.get(key, _NONE))
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for k, pair in enumerate(zip(was, now, strict=True)):
            yield from _within(f"{path}.{k}", *pair)
    elif was is not now and was != now:
        yield path, _shown(was), _shown(now)


def _shown(value: Any) -> str:
    if value is _NONE:
        return "nothing"
    return repr(value) if len(repr(value)) <= 80 else repr(value)[:77] + "..."


def even(count: int, trial_bytes: float, widest: int | None) -> int:
    """Return how many of so many trials to run at once, so that the memory of a chunk is bounded.

    Parameters
    ----------
    count : int
    trial_bytes : float
        What is recorded of a trial.
    widest : int, optional
        The most that a system allows.
    """
    fits = max(_CHUNK_BYTES / trial_bytes, min(_NARROW, _NARROW_BYTES / trial_bytes))
    most = max(1, min(count, widest or _LARGEST_CHUNK, int(fits)))
    # Chunks of equal width: the last one runs full and is cut, which wastes up to a whole chunk.
    return math.ceil(count / math.ceil(count / most))
