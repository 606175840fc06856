"""Mistakes of the user: one clear line, exit status 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["UserError", "choose", "in_users_words", "one_line", "shown", "texts"]

_LONGEST = 2000  # characters of a message
_BRIEF = 60
_LONGEST_NAME = 100  # characters of a name that is repeated to its user


class UserError(ValueError):
    """A mistake in what the user asked for; the message names the field, the value and what is allowed.

    Attributes
    ----------
    placed : bool
        Whether it also says in which file that is.
    """

    placed = False


def choose(what: str, value: str, allowed: Iterable[str]) -> str:
    """Return `value` if it is among `allowed`, else raise a `UserError` that lists them."""
    names = list(allowed)
    there = f"there are {', '.join(names) or 'none'}"
    if not isinstance(value, str):
        raise UserError(f"{what}: {_brief(value)} is not allowed; text; {there}")
    if value in names:
        return value
    near = difflib.get_close_matches(value, names, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    name = value if len(value) <= _LONGEST_NAME else f"{value[:_LONGEST_NAME]}..."
    raise UserError(f"{what}: {name} is not known{hint}; {there}")


def texts(what: str, values: Any) -> list[str]:
    """Return a list or another iterable of texts as a list, None as an empty one; else raise a `UserError`."""
    if values is None:
        return []
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise UserError(f"{what}: {_brief(values)} is not allowed; a list of texts")
    found = list(values)
    for one in found:
        if not isinstance(one, str):
            raise UserError(f"{what}: {_brief(one)} in it is not allowed; a list of texts")
    return found


@contextmanager
def in_users_words() -> Iterator[None]:
    """Turn a `ValueError`, by which a block or a reader of ours says what is wrong, into a `UserError`."""
    try:
        yield
    except UserError:
        raise
    except ValueError as error:
        raise UserError(str(error)) from error


def shown(path: Path) -> str:
    """Return a path as a user would write it: from the current folder on, where it is in there."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_absolute() and path.is_relative_to(here) else str(path)


def one_line(message: str) -> str:
    """Return a message without line ends and control characters, and a long one without its middle."""
    shown = "".join(c if c.isprintable() else " " if c.isspace() else f"\\x{ord(c):02x}" for c in message)
    if len(shown) <= _LONGEST:
        return shown
    return f"{shown[: _LONGEST // 2]} ... {shown[-_LONGEST // 2 :]}"


def _brief(value: Any) -> str:
    """Return a value of the wrong type on a short line."""
    kind, shown = type(value).__name__, " ".join(repr(value).split())
    return shown if len(shown) <= _BRIEF else f"an object of type {kind}"
