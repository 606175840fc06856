"""Who is told that something is being compiled: nobody but the log, unless a program asks."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = [
    "loading_seconds",
    "noting_loading",
    "on_compiling",
    "say_compiled",
    "say_compiling",
    "say_slower",
    "say_uncached",
]

_log = logging.getLogger("quietfix")
_listeners: list[Callable[[str], None]] = []
_said: set[str] = set()
_spent = [0.0]


def on_compiling(listener: Callable[[str], None]) -> None:
    """Have `listener` called with the name of every function that is about to be compiled, and with "" when it is done.

    What is taken from the cache is not told.
    """
    if listener not in _listeners:
        _listeners.append(listener)


def say_compiling(name: str) -> None:
    """Say that the function `name` is compiled now."""
    _log.info("compiling %s", name)
    _told(name)


def say_compiled() -> None:
    """Say that it is done."""
    _told("")


def _told(name: str) -> None:
    for listener in _listeners:
        listener(name)


def say_uncached(reason: str) -> None:
    """Warn once that machine code is not kept for the next run."""
    if "uncached" not in _said:
        _said.add("uncached")
        _log.warning("compiled code is kept in memory only and made again in every run: %s", reason)


def say_slower(model: str, reason: str) -> None:
    """Log once of a user's class what makes it slower than it could be."""
    if (told := f"{model}: {reason}") not in _said:
        _said.add(told)
        _log.info("%s", told)


def loading_seconds() -> float:
    """Return the processor time [s] that compiling, and loading what was compiled, has taken in this process."""
    return _spent[0]


@contextmanager
def noting_loading() -> Iterator[None]:
    """Count the processor time of this thread, spent within, as that of loading; not to be nested."""
    began = time.thread_time()
    try:
        yield
    finally:
        _spent[0] += time.thread_time() - began
