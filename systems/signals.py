"""Ensemble signals: every wire carries an array (trials, size), flattened in C order on a vector port.

What is too large or too structured for that, such as a block of I/Q samples, travels as one frozen object on an
abstract port.

`EnsembleBlock` is the base of every Quietfix block. It declares such ports, reads them as arrays, keeps the
seed and the first trial as context parameters, and declares cache entries in a way that does not pin the block
in memory (on Drake 1.58 a cache entry whose callables hold the block keeps the whole diagram alive).
"""

from __future__ import annotations

import enum
import re
import warnings
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import MethodType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    InputPort,
    LeafSystem,
    NumericParameterIndex,
    OutputPort,
    System,
    ValueProducer,
)

__all__ = ["Component", "Constant", "Draw", "EnsembleBlock", "components_of", "ensemble", "leaf_systems", "set_draw"]

_ADDRESS = re.compile(r"@[0-9a-f]{16}$")  # the end of the name that Drake gives to what has none
_NOT_SET = [-1.0, -1.0]  # seed and first trial
_NO_SEED = "seed: it was not set; seed 0 and trials from 0 on are drawn. quietfix.systems.signals.set_draw sets it"
_LARGEST_EXACT = 2**53  # seed and first trial travel as doubles


class _Nothing(enum.Enum):
    """Stands for None in a cache entry, which Drake 1.58 does not take; a copy of it is itself."""

    NONE = enum.auto()


_NOTHING = _Nothing.NONE


class Component(NamedTuple):
    """What one number of a signal is: its name and SI unit; ``1`` without a dimension, empty if nobody says it."""

    name: str
    unit: str


class _Named(Protocol):
    names: tuple[str, ...]


def components_of(model: _Named) -> list[Component]:
    """Return names and units of a measurement's rows or a state's components; a user's own model may lack units."""
    units = tuple(getattr(model, "units", ()))
    return [Component(name, units[i] if i < len(units) else "") for i, name in enumerate(model.names)]


@dataclass(frozen=True)
class Draw:
    """Which random numbers a run sees.

    Parameters
    ----------
    seed : int
        Seed of the study, 0 <= seed < 2**53.
    first_trial : int
        Number of the first trial in the batch, 0 <= first_trial < 2**53.
    """

    seed: int = 0
    first_trial: int = 0

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name in ("seed", "first_trial"):
            value = getattr(self, name)
            if not (isinstance(value, int | np.integer) and 0 <= value < _LARGEST_EXACT):
                raise ValueError(f"{name}: {value!r} is not allowed; a whole number from 0 to 2**53 - 1")


def ensemble(flat: ArrayLike, size: int) -> NDArray[np.float64]:
    """Reshape a flat port value to (trials, size)."""
    return np.asarray(flat, dtype=float).reshape(-1, size)


def check_trials(trials: int) -> int:
    """Return `trials` if it is a whole number >= 1, else raise ValueError."""
    if not isinstance(trials, int | np.integer) or trials < 1:
        raise ValueError(f"trials: {trials!r} is not allowed; a whole number >= 1")
    return int(trials)


class EnsembleBlock(LeafSystem):
    """A LeafSystem whose ports carry ensembles.

    Parameters
    ----------
    name : str
        Name of the block: shown in the diagram and, with the names of the diagrams it is in, part of the key of its
        random numbers (see `noise_name`).
    """

    def __init__(self, name: str) -> None:
        super().__init__()
        if not name:
            raise ValueError("a block needs a name: its random numbers depend on it")
        self.set_name(name)
        self._inputs: dict[str, tuple[int, tuple[int, int]]] = {}  # index of the port, (trials, size)
        self._outputs: dict[str, tuple[int, int]] = {}
        self._components: dict[str, tuple[Component, ...]] = {}
        self._kinds: dict[str, type] = {}
        self._draw_index: int | None = None

    def declare_input(self, name: str, trials: int, size: int) -> InputPort:
        """Declare an input port that carries (trials, size)."""
        port = self.DeclareVectorInputPort(name, check_trials(trials) * size)
        self._inputs[name] = (int(port.get_index()), (trials, size))
        return port

    def declare_output(
        self,
        name: str,
        trials: int,
        size: int,
        calc: Callable[[Context], NDArray[np.float64]],
        tickets: Iterable[Any],
        components: Iterable[tuple[str, str]] | None = None,
    ) -> OutputPort:
        """Declare an output port that carries what ``calc(context)`` returns, shape (trials, size) or flat.

        `components`: name and SI unit of each of the `size` numbers, where they have names.
        """
        self._outputs[name] = (check_trials(trials), size)
        if components is not None:
            self._components[name] = tuple(Component(*one) for one in components)
        count = trials * size

        def write(context: Context, output: BasicVector) -> None:
            values = calc(context)
            if values.size != count:
                shape = tuple(values.shape)
                raise ValueError(f"{self.get_name()}: {name} has the shape {shape}; ({trials}, {size}) is expected")
            output.SetFromVector(values if values.ndim == 1 else values.ravel())

        return self.DeclareVectorOutputPort(name, count, write, prerequisites_of_calc=set(tickets))

    def declare_abstract_input(self, name: str, kind: type) -> InputPort:
        """Declare an input port that carries one object of type `kind`; read it with `read_abstract`."""
        self._kinds[name] = kind
        return self.DeclareAbstractInputPort(name, AbstractValue.Make(()))

    def declare_abstract_output(self, name: str, calc: Callable[[Context], Any], tickets: Iterable[Any]) -> OutputPort:
        """Declare an output port that carries the object that ``calc(context)`` returns.

        Drake copies what is on a port with `copy.deepcopy`, whenever a context is cloned: the object should be frozen
        and its own deep copy, as an `IqBlock` is.

        A bound method is held weakly: unlike a vector port's, Drake 1.58 never lets go of an abstract port's callables.
        """
        bound = weakref.WeakMethod(calc) if isinstance(calc, MethodType) else None
        plain = None if isinstance(calc, MethodType) else calc

        def write(context: Context, output: AbstractValue) -> None:
            now = plain if bound is None else bound()
            output.set_value(now(context) if now is not None else ())

        return self.DeclareAbstractOutputPort(
            name, lambda: AbstractValue.Make(()), write, prerequisites_of_calc=set(tickets)
        )

    def declare_cached(self, name: str, calc: Callable[[Any, Context], Any], tickets: Iterable[Any]) -> Any:
        """Declare a cache entry and return its index; read it with `cached`.

        Parameters
        ----------
        name : str
            Name of the entry.
        calc : callable
            ``calc(block, context) -> value``: a plain function or an unbound method, never a bound one. The value may
            be None.
        tickets : iterable of DependencyTicket
            What the value depends on.
        """
        me = weakref.ref(self)

        def refill(context: Context, value: AbstractValue) -> None:
            result = calc(me(), context)
            value.set_value(_NOTHING if result is None else result)

        return self.DeclareCacheEntry(
            name,
            ValueProducer(allocate=lambda: AbstractValue.Make(()), calc=refill),
            set(tickets),
        ).cache_index()

    def cached(self, context: Context, index: Any) -> Any:
        """Return the up-to-date value of a cache entry made by `declare_cached`."""
        value = self.get_cache_entry(index).EvalAbstract(context).get_value()
        return None if value is _NOTHING else value

    def cached_ticket(self, index: Any) -> Any:
        """Return the ticket of a cache entry made by `declare_cached`."""
        return self.cache_entry_ticket(index)

    def read(self, context: Context, name: str, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
        """Return the value of input port `name` as an array (trials, size), or of another `shape` of as many."""
        return self.read_flat(context, name).reshape(shape or self._inputs[name][1])

    def read_flat(self, context: Context, name: str) -> NDArray[np.float64]:
        """Return the value of input port `name` as it comes, one number after the other."""
        index = self._inputs[name][0]
        # by its index and not by way of the port: a fifth of what a small block costs is looking up its ports
        value = self.EvalVectorInput(context, index)
        if value is None:  # not connected: the port says so
            return np.asarray(self.get_input_port(index).Eval(context))
        return value.CopyToVector()

    def read_abstract(self, context: Context, name: str) -> Any:
        """Return the object on input port `name`.

        Raises
        ------
        ValueError
            If it is not of the type that was declared: Drake connects any abstract port to any other.
        """
        value, kind = self.GetInputPort(name).Eval(context), self._kinds[name]
        if not isinstance(value, kind):
            raise ValueError(
                f"{self.get_name()}: input {name} carries {type(value).__name__}; {kind.__name__} is needed"
            )
        return value

    def output_size(self, name: str) -> tuple[int, int]:
        """Return (trials, size) of output port `name`."""
        return self._outputs[name]

    def components(self, name: str) -> tuple[Component, ...]:
        """Return what the numbers on output port `name` are; nothing, where nobody has said it."""
        return self._components.get(name, ())

    def output_names(self) -> list[str]:
        """Return the names of the output ports."""
        return list(self._outputs)

    def input_ticket(self, name: str) -> Any:
        """Return the dependency ticket of input port `name`."""
        return self.input_port_ticket(self.GetInputPort(name).get_index())

    def noise_name(self) -> str:
        """Return what keys the block's random numbers: its path below the root diagram, ``INNER::NAME``.

        In a diagram without inner ones that is the block's own name. Drake lets no two blocks have the same path, so
        that two inner diagrams of the same make draw different numbers.

        Raises
        ------
        ValueError
            If an inner diagram has no name: Drake then makes one from its address, another in every process.
        """
        path = self.GetSystemPathname().split("::")[2:]  # it begins with "::ROOT"
        if any(_ADDRESS.search(part) for part in path[:-1]):
            raise ValueError(
                f"{self.get_name()}: a diagram around it has no name, and its random numbers depend on that; "
                "call set_name(...) on the inner diagram before it is added"
            )
        return "::".join(path) or self.get_name()

    def declare_draw(self) -> Any:
        """Declare the context parameter that holds seed and first trial; return its ticket."""
        self._draw_index = self.DeclareNumericParameter(BasicVector(_NOT_SET))
        return self.numeric_parameter_ticket(NumericParameterIndex(self._draw_index))

    def draw(self, context: Context) -> Draw:
        """Return seed and first trial of this run; where nobody has set them, warn, and return seed 0."""
        seed, first_trial = context.get_numeric_parameter(self._draw_index).value().tolist()
        if seed < 0:
            warnings.warn(_NO_SEED, RuntimeWarning, stacklevel=1)  # one place, so that it is said once
            return Draw()
        return Draw(int(seed), int(first_trial))

    def set_draw(self, context: Context, draw: Draw) -> None:
        """Write seed and first trial into this block's `context`; a block without noise ignores it."""
        if self._draw_index is not None:
            context.get_mutable_numeric_parameter(self._draw_index).SetFromVector([draw.seed, draw.first_trial])


class Constant(EnsembleBlock):
    """A block whose port ``state`` is the same at all times.

    Parameters
    ----------
    name : str
        Name of the block.
    value : array_like, shape (size,) or (trials, size)
        What the port carries.
    """

    def __init__(self, name: str, value: ArrayLike) -> None:
        super().__init__(name)
        array = np.atleast_2d(np.array(value, dtype=float))
        self.declare_output("state", array.shape[0], array.shape[1], lambda context: array, {self.nothing_ticket()})


def leaf_systems(system: System) -> list[System]:
    """Return all leaves of a diagram, or the system itself."""
    if not isinstance(system, Diagram):
        return [system]
    return [leaf for part in system.GetSystems() for leaf in leaf_systems(part)]


def set_draw(diagram: System, context: Context, draw: Draw) -> None:
    """Write seed and first trial into every block of `diagram` that draws random numbers."""
    for block in leaf_systems(diagram):
        if isinstance(block, EnsembleBlock):
            block.set_draw(block.GetMyMutableContextFromRoot(context), draw)
