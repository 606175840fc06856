"""A model's compiled equations: which kernels, with which parameters, make which of its rows."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import address, address_over
from quietfix.systems.kernels.progress import say_slower

__all__ = [
    "Equations",
    "Program",
    "Step",
    "are_own",
    "equations_of",
    "inherited_program",
    "joined",
    "of_kernel",
    "program",
    "step",
]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Kernel = str | Callable[..., Any]

_OTHER_THAN_EQUATIONS = {"names", "units", "nominal", "noise_covariance", "noise_covariance_at", "modified_gain"}
_OTHER_THAN_EQUATIONS |= {
    "platforms_used",
    "represent",
    "only",
    "initial_input",
    "next_input",
    "reported",
    "considered",
}


@dataclass(frozen=True)
class Equations:
    """Rows that kernels make.

    Attributes
    ----------
    kernels : tuple
        One after the other: ``module:function`` of the room `models`, or a function that a user has decorated with
        `quietfix.systems.kernels.calling.kernel`.
    sizes : tuple of int
        Rows of each.
    parameters : tuple of tuple of float
        What each is given.
    chosen : tuple of int
        Which of all these rows are the model's.
    moduli : tuple of float
        Of the model's rows: residuals are wrapped into [-modulus/2, modulus/2); 0 where they are not.
    states, platforms, coordinates : int
        How many states, platforms and coordinates of each platform the kernels read, at least: compiled code does not
        look where an array ends.
    """

    kernels: tuple[Kernel, ...]
    sizes: tuple[int, ...]
    parameters: tuple[tuple[float, ...], ...]
    chosen: tuple[int, ...]
    moduli: tuple[float, ...]
    states: int
    platforms: int
    coordinates: int

    def rows(self, which: Sequence[int]) -> Equations:
        """Return the equations of some of the model's rows."""
        chosen, moduli = tuple(self.chosen[i] for i in which), tuple(self.moduli[i] for i in which)
        return replace(self, chosen=chosen, moduli=moduli)


def of_kernel(
    kernel: Kernel,
    parameters: Sequence[float],
    rows: int,
    *,
    modulus: float | Sequence[float] = 0.0,
    states: int = 0,
    platforms: Sequence[int] = (),
    coordinates: int = 6,
) -> Equations:
    """Return the equations of one kernel's rows.

    It reads so many states, and so many coordinates of the platforms of those numbers; residuals are wrapped by
    `modulus`, one or one of each row.
    """
    needed = max(platforms, default=-1) + 1
    if min(platforms, default=0) < 0:
        raise ValueError(f"platforms: {min(platforms)} is not allowed; numbers >= 0")
    moduli = (float(modulus),) * rows if isinstance(modulus, int | float) else tuple(map(float, modulus))
    return Equations(
        kernels=(getattr(kernel, "__func__", kernel),),  # one that is an attribute of a class comes bound
        sizes=(rows,),
        parameters=(tuple(map(float, parameters)),),
        chosen=tuple(range(rows)),
        moduli=moduli,
        states=states,
        platforms=needed,
        coordinates=coordinates if needed else 0,
    )


def joined(parts: Sequence[Equations | None]) -> Equations | None:
    """Return the rows of several models, one after the other; None where one of them has no kernel."""
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    chosen: list[int] = []
    begin = 0
    for part in known:
        chosen += [begin + row for row in part.chosen]
        begin += sum(part.sizes)
    return Equations(
        tuple(kernel for part in known for kernel in part.kernels),
        tuple(size for part in known for size in part.sizes),
        tuple(given for part in known for given in part.parameters),
        tuple(chosen),
        tuple(modulus for part in known for modulus in part.moduli),
        max(part.states for part in known),
        max(part.platforms for part in known),
        max(part.coordinates for part in known),
    )


@dataclass(frozen=True, eq=False)
class Program:
    """`Equations` as compiled code reads them, for this process alone: they hold addresses.

    Attributes
    ----------
    parts : ndarray of int64, shape (k, 5)
        Address, first row and row behind the last, first parameter and parameter behind the last.
    chosen : ndarray of int64, shape (m,)
    parameters, moduli : ndarray
    rows : int
        Of all kernels together.
    straight : bool
        Whether `chosen` is all of them in their order.
    equations : Equations
        What it was made of.
    """

    parts: Integers
    chosen: Integers
    parameters: Array
    moduli: Array
    rows: int
    straight: bool
    equations: Equations

    @cached_property
    def loops(self) -> Integers:
        """Addresses (k,) of the kernels' loops over particles, compiled when they are first asked for."""
        kernels = zip(self.equations.kernels, self.equations.sizes, strict=True)
        return np.array([address_over(kernel, rows) for kernel, rows in kernels], dtype=np.int64)

    @cached_property
    def looped(self) -> Integers:
        """`parts` with `loops` as the last column, (k, 6)."""
        return np.column_stack([self.parts, self.loops])


_programs: dict[int, tuple[weakref.ref[Any], Program | None]] = {}
_inherited: dict[int, tuple[weakref.ref[Any], Program]] = {}


def program(model: Any) -> Program | None:
    """Return the program of a model's equations, made when it is first asked for; None without own ones (`are_own`)."""
    key = id(model)
    known = _programs.get(key)
    if known is not None and known[0]() is model:
        return known[1]
    made = None if equations_of(model) is None else inherited_program(model)
    if made is None:
        _tell_of_users(model)
    _programs[key] = weakref.ref(model, lambda _: _programs.pop(key, None)), made
    return made


def _tell_of_users(model: Any) -> None:
    """Log which classes of a user's, in a model without equations, have none."""
    for part in getattr(model, "models", (model,)):
        kind = type(getattr(part, "model", part))  # what stands behind a boundary, or under an atmosphere
        if not kind.__module__.startswith("quietfix.") and equations_of(part) is None:
            differences = "" if getattr(part, "has_jacobian", True) else " and its derivatives are central differences"
            say_slower(f"{kind.__module__}:{kind.__qualname__}", f"no equations: it is asked in NumPy{differences}")


def inherited_program(model: Any) -> Program:
    """Return the program of a model that has equations, though its class may say something else by another method."""
    key = id(model)
    known = _inherited.get(key)
    if known is not None and known[0]() is model:
        return known[1]
    made = _made(model.equations())
    _inherited[key] = weakref.ref(model, lambda _: _inherited.pop(key, None)), made
    return made


def equations_of(model: Any) -> Equations | None:
    """Return a measurement model's ``equations()``, or None where it has none, or not its own (`are_own`)."""
    return model.equations() if are_own(model.__class__) else None


@lru_cache(maxsize=1024)
def are_own(kind: Any) -> bool:
    """Return whether the ``equations`` of a class are its own.

    One that overrides another method by which the class that it inherits them from says what it measures, or how it
    moves, has none: what it says itself holds.
    """
    order = kind.__mro__
    place = next(i for i, base in enumerate(order) if "equations" in vars(base))
    inherited = set(dir(order[place])) - _OTHER_THAN_EQUATIONS
    return not any(name in inherited and not name.startswith("__") for base in order[:place] for name in vars(base))


@dataclass(frozen=True, eq=False)
class Step:
    """A motion's compiled equations for a step of one length; for this process alone.

    Attributes
    ----------
    parts : ndarray of int64, shape (1 or 2, 5)
        As in `Program`: the kernel that writes the next state and the transition and, where the noise depends on the
        state, the one that writes Q in the place of a derivative.
    parameters : ndarray
    noise : ndarray, shape (1, n, n)
        Q, where it has no kernel.
    kernel : Kernel
        The first one.
    """

    parts: Integers
    parameters: Array
    noise: Array
    kernel: Kernel

    def loop(self, states: int) -> int:
        """Return the address of the first kernel's loop over particles; see `Program.loops`."""
        return address_over(self.kernel, states)


def step(kernels: Sequence[Kernel], parameters: Sequence[Sequence[float]], noise: Array) -> Step:
    """Return a motion's step of one kernel, or two; see `Step`."""
    made = _made(Equations(tuple(kernels), (0,) * len(kernels), tuple(map(tuple, parameters)), (), (), 0, 0, 0))
    return Step(made.parts, made.parameters, np.array(noise, dtype=float)[None], kernels[0])


def _made(equations: Equations) -> Program:
    ends, stops = np.cumsum(equations.sizes), np.cumsum([len(given) for given in equations.parameters])
    each = zip(equations.kernels, equations.sizes, equations.parameters, ends, stops, strict=True)
    parts = [(address(kernel), end - size, end, stop - len(given), stop) for kernel, size, given, end, stop in each]
    return Program(
        np.array(parts, dtype=np.int64).reshape(-1, 5),
        np.array(equations.chosen, dtype=np.int64),
        np.array([number for given in equations.parameters for number in given], dtype=float),
        np.array(equations.moduli, dtype=float),
        sum(equations.sizes),
        equations.chosen == tuple(range(sum(equations.sizes))),
        equations,
    )
