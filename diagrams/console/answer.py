"""What a command answers as JSON: one object on standard output in place of tables and sentences."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any

__all__ = ["answering", "asked_for_json", "note", "plain", "tell"]

_answers: list[dict[str, Any]] = []
"""That which is being collected, the innermost last; empty where tables are printed."""


@contextmanager
def answering(wanted: bool) -> Iterator[None]:
    """Have a command print one JSON object, once it is done, and nothing else on standard output.

    What the command tells (`tell`) is in it; sentences that it says are under ``notes``, tables are not printed.
    Whatever else prints, such as a class of the user's, a worker, a library, goes to standard error meanwhile.
    If the command fails, nothing is printed.

    Parameters
    ----------
    wanted : bool
        Without it the command prints as ever.
    """
    if not wanted:
        yield
        return
    answer: dict[str, Any] = {}
    _answers.append(answer)
    try:
        with redirect_stdout(sys.stderr), _descriptor_turned():
            yield
    finally:
        _answers.remove(answer)
    if "notes" in answer:
        answer["notes"] = answer.pop("notes")  # below the numbers
    print(json.dumps(plain(answer), indent=1, allow_nan=False))


@contextmanager
def _descriptor_turned() -> Iterator[None]:
    """Let what processes and libraries without `sys.stdout` print go to standard error, too."""
    sys.stdout.flush()
    kept = None
    with suppress(OSError):  # one of them is closed
        kept = os.dup(1)
        os.dup2(2, 1)
    try:
        yield
    finally:
        if kept is not None:
            os.dup2(kept, 1)
            os.close(kept)


def asked_for_json() -> bool:
    """Return whether a JSON object is being collected."""
    return bool(_answers)


def tell(**fields: Any) -> None:
    """Put fields into the JSON object, where one is collected; units stand in their names (``_m``, ``_s``)."""
    if _answers:
        _answers[-1].update(fields)


def note(sentence: str) -> None:
    """Put a sentence into the ``notes`` of the JSON object that is being collected."""
    _answers[-1].setdefault("notes", []).append(sentence)


def plain(value: Any) -> Any:
    """Return a value as JSON has it: numbers of NumPy as Python's, null for NaN and the infinities."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # without NumPy, which `--help` has no time for
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)
