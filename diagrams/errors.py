"""Mistakes of the user: one clear line, exit status 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["UserError", "choose"]


class UserError(ValueError):
    """A mistake in what the user asked for; the message names the field, the value and what is allowed."""


def choose(what: str, value: str, allowed: Iterable[str]) -> str:
    """Return `value` if it is among `allowed`, else raise a `UserError` that lists them."""
    names = list(allowed)
    if value in names:
        return value
    near = difflib.get_close_matches(value, names, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    raise UserError(f"{what}: {value} is not known{hint}; there are {', '.join(names) or 'none'}")
