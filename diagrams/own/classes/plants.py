"""A user's own block as the target: any Drake system with a vector output."""

from __future__ import annotations

import inspect
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort, PortDataType, System

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Part
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import documented, number, text
from quietfix.systems.integration import LONGEST_STEP, simulator_of
from quietfix.systems.plants.checked_truth import CheckedTruth
from quietfix.systems.registry import blamed, in_one_line, object_at
from quietfix.systems.signals import Draw, set_draw

__all__ = ["Custom", "add_plant", "played"]

Array = NDArray[np.float64]

_NAME = "plant"
_MADE: weakref.WeakSet[Any] = weakref.WeakSet()  # a block is of one diagram


@dataclass
class Custom:
    """A target of one's own: a Drake system with a vector output, such as a LeafSystem with continuous states.

    Its first six numbers are position [m] and velocity [m/s] in the axes of the frame. A class, or a function, that has
    the parameter ``trials`` is told how many, and puts out all of them, one after the other; else one target is that of
    all trials. An input port gets the signal of its name, such as ``platforms``. Drake shows at t what a discrete state
    is before the update at t, so that updates with offset 0 make it what it is at t.
    """

    class_: str = text("where the class is: package.module:Class, beside this file, say")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)
    port: str = text("its output port; empty: the first one")
    step_s: float = number("longest step of the integration of its continuous states [s]", LONGEST_STEP, above=0)


def add_plant(field: Custom, bus: Bus, name: str, where: str = "target") -> CheckedTruth:
    """Put a new block of the user's on a bus, and behind it, as block `name`, its state (trials, 6), checked.

    Raises
    ------
    UserError
        Naming class, and what is wrong with it.
    """
    plant, trials = _made(field, bus.trials, where)
    plant.set_name(_NAME)
    try:
        bus.add(plant)
    except ValueError as error:
        raise UserError(f"{where}: {field.class_}: {error}") from error
    port = _port(plant, field, where)
    if port.size() % trials or port.size() // trials < 6:
        each = "" if trials == 1 else f" for each of {trials} trials"
        raise UserError(
            f"{where}: {field.class_}: output {port.get_name()} of {port.size()} numbers is not allowed; position and "
            f"velocity are six{each}"
        )
    bus.publish(**{_NAME: port})
    return bus.add(CheckedTruth(f"{where}: {field.class_}", trials, port.size() // trials, name))


def _made(field: Custom, trials: int, where: str) -> tuple[Any, int]:
    """Return a new block and how many trials are on its port."""
    try:
        kind = object_at(field.class_)
    except ValueError as error:
        raise UserError(f"{where}.{error}") from error
    if not callable(kind):
        raise UserError(f"{where}.class: {field.class_} is not allowed; what makes a Drake system")
    told = {"trials": trials} if _takes_trials(kind) else {}
    try:
        plant = kind(**field.options, **told)
    except TypeError as error:
        raise UserError(f"{where}.options: {field.class_} says: {in_one_line(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's class does while it is made, sys.exit too
        raise UserError(f"{where}.class: {blamed(field.class_, error)}") from error
    if not isinstance(plant, System):
        raise UserError(f"{where}.class: {field.class_} made {type(plant).__name__}; a Drake system is needed")
    if plant in _MADE:
        raise UserError(f"{where}.class: {field.class_} made the same block twice; each diagram needs a new one")
    _MADE.add(plant)
    return plant, trials if told else 1


def _takes_trials(kind: Callable[..., Any]) -> bool:
    try:
        return "trials" in inspect.signature(kind).parameters
    except (TypeError, ValueError):  # some of those that are written in C++
        return False


def _port(plant: Any, field: Custom, where: str) -> OutputPort:
    ports = [plant.get_output_port(i) for i in range(plant.num_output_ports())]
    vectors = {port.get_name(): port for port in ports if port.get_data_type() == PortDataType.kVectorValued}
    if field.port and field.port not in vectors:
        raise UserError(f"{where}.port: {field.port} is not known; there are {', '.join(vectors) or 'none'}")
    if not vectors:
        raise UserError(f"{where}.class: {field.class_} has no vector output; one is needed")
    return vectors[field.port] if field.port else next(iter(vectors.values()))


def played(field: Custom, platforms: Part, where: str = "target") -> Callable[[float], Array]:
    """Return the state (6,) of trial 0 as a function of time [s]: the block is run as far as it is asked for.

    Parameters
    ----------
    field : Custom
    platforms : Part
        Puts ``platforms`` on a bus.
    where : str
        Name of the field, for messages.
    """
    bus = Bus(DiagramBuilder(), 1)
    platforms(bus)
    truth = add_plant(field, bus, "truth", where)
    diagram = bus.builder.Build()
    running: list[Any] = []

    def at(time: float) -> Array:
        if not running or running[0].get_context().get_time() > time:
            context = diagram.CreateDefaultContext()
            set_draw(diagram, context, Draw())
            running[:] = [simulator_of(diagram, context, field.step_s)]
            running[0].Initialize()
        try:
            running[0].AdvanceTo(time)
            own = truth.GetMyContextFromRoot(running[0].get_context())
            state: Array = truth.GetOutputPort("state").Eval(own).reshape(-1, 6)[0]
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a user's class does
            running.clear()
            words = str(error) if _ours(error) else f"{where}: {blamed(field.class_, error)}"
            raise UserError(words) from error
        return state

    at(0.0)
    return at


def _ours(error: BaseException) -> bool:
    return isinstance(error, ValueError) and str(error).endswith("that is not finite")
