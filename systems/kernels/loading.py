"""Compiled functions by their names, loaded when they are first used."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

__all__ = ["address", "address_over", "entry", "ready"]


@cache
def ready(name: str) -> Any:
    """Return the compiled function ``module:function`` of this room, compiled or taken from the cache.

    numba is imported here and nowhere earlier: ``quietfix --help`` must not wait for it.
    """
    module, _, function = name.partition(":")
    compiling = importlib.import_module("quietfix.systems.kernels.compiling")
    return compiling.load(getattr(importlib.import_module(f"quietfix.systems.kernels.{module}"), function))


@cache
def entry(name: str) -> int:
    """Return the address of a compiled function, ``module:function`` of this room, in this process."""
    function = ready(name)
    found: int = importlib.import_module("quietfix.systems.kernels.calling").entry(function)
    return found


@cache
def address(kernel: Any) -> int:
    """Return the address of a kernel: ``module:function`` of the room `models`, or a user's function."""
    calling = importlib.import_module("quietfix.systems.kernels.calling")
    found: int = calling.address_of(calling.known(kernel))
    return found


def address_over(kernel: Any, rows: int) -> int:
    """Return the address of a kernel's loop over states; see `quietfix.systems.kernels.particles.loops`."""
    found: int = importlib.import_module("quietfix.systems.kernels.particles.loops").address_over(kernel, rows)
    return found
