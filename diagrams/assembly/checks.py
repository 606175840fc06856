"""What a system in Python declares, checked once when its diagram is built: who wrote it is told by name what is wrong.

Numbers are not judged here, only kinds and shapes: where the target is and what a model may make of that is known when
it runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["check_assumed", "check_measurement", "check_model", "check_motion"]

Array = NDArray[np.float64]

_TRIALS = 3
_OURS = ("systems.", "diagrams.")


def check_model(model: Model) -> None:
    """Refuse a declaration whose fields are not what they must be.

    Raises
    ------
    ValueError
        Naming the field, its value and what is allowed.
    """
    for name, least in (("duration", ">"), ("divergence", ">="), ("step", ">"), ("convergence", ">")):
        value = getattr(model, name)
        if value is None and name == "convergence":
            continue
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or value < 0 or (value == 0 and least == ">"):
            raise ValueError(f"Model.{name}: {value!r:.80} is not allowed; a finite number {least} 0")
    if not all(hasattr(model.clock, method) for method in ("declare", "index", "ticks")):
        raise ValueError(f"Model.clock: {model.clock!r:.80} is not allowed; a clock such as Periodic(1.0)")
    if isinstance(model.parts, str) or not isinstance(model.parts, Sequence):
        raise ValueError(f"Model.parts: {model.parts!r:.80} is not allowed; a list of functions of a bus")
    for i, part in enumerate(model.parts):
        if not callable(part):
            raise ValueError(f"Model.parts: {part!r:.80}, number {i}, is not allowed; a function of a bus")
    if not callable(model.assume):
        raise ValueError(f"Model.assume: {model.assume!r:.80} is not allowed; a function of bus, name and options")


def check_assumed(name: str, assumed: Assumed, platforms: int) -> None:
    """Refuse what `assume` returned for an estimator, if it is not what that takes.

    Parameters
    ----------
    name : str
        Of the estimator.
    assumed : Assumed
    platforms : int
        How many platforms it is given.

    Raises
    ------
    ValueError
        Naming the field or the method, what it is, and what is wanted.
    """
    for field, kind in (("model", MeasurementModel), ("motion", MotionModel), ("start", Start)):
        value = getattr(assumed, field)
        if not isinstance(value, kind):
            raise ValueError(
                f"{name}: Assumed.{field}: {type(value).__name__} is not allowed; {kind.__module__}.{kind.__qualname__}"
            )
    check_motion(name, assumed.motion)
    check_measurement(name, assumed.model, platforms, assumed.motion.size)


def check_motion(name: str, motion: MotionModel) -> None:
    """Refuse a user's motion model that gives arrays of a wrong shape or kind; see `check_assumed`."""
    if _ours(motion):
        return
    n, asked = len(_names(name, motion)), _Asked(name, motion)
    state = _state(n)
    asked("propagate", (state, 1.0), [(_TRIALS, n)])
    asked("transition", (state, 1.0), [(_TRIALS, n, n), (n, n)])
    asked("process_noise", (state, 1.0), [(_TRIALS, n, n), (n, n)])


def check_measurement(name: str, model: MeasurementModel, platforms: int, states: int) -> None:
    """Refuse a user's measurement model that gives arrays of a wrong shape or kind; see `check_assumed`."""
    if _ours(model):
        for inner in getattr(model, "models", ()):
            if isinstance(inner, MeasurementModel):
                check_measurement(name, inner, platforms, states)
        return
    m, asked = len(_names(name, model)), _Asked(name, model)
    target, carriers = _state(states), np.zeros((_TRIALS, platforms, 6))
    carriers[..., :3] = 1e3 * np.arange(1, 3 * platforms + 1).reshape(platforms, 3)
    noise = asked("noise_covariance", (), [(m, m)])
    if noise is not None and not (np.isfinite(noise).all() and (np.diagonal(noise) >= 0).all()):
        raise ValueError(
            f"{name}: {_called(model)}.noise_covariance: {noise.tolist()!r:.200} is not allowed; a covariance"
        )
    asked("predict", (target, carriers), [(_TRIALS, m)])
    asked("jacobian", (target, carriers), [(_TRIALS, m, states), (m, states)])
    asked("residual", (np.zeros((_TRIALS, m)), np.zeros((_TRIALS, m))), [(_TRIALS, m)])
    asked("represent", (np.zeros((_TRIALS, m)),), [(_TRIALS, m)])
    asked("platforms_used", (platforms,), [(m, platforms)])


def _ours(thing: Any) -> bool:
    return type(thing).__module__.startswith(_OURS)


def _called(thing: Any) -> str:
    return type(thing).__qualname__


def _names(name: str, thing: Any) -> tuple[str, ...]:
    names = getattr(thing, "names", None)
    if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(one, str) for one in names):
        raise ValueError(f"{name}: {_called(thing)}.names: {names!r:.80} is not allowed; a tuple of texts")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{name}: {_called(thing)}.names: {tuple(names)} is not allowed; at least one, none twice")
    return tuple(names)


def _state(size: int) -> Array:
    """Return states of no special place, shape (trials, size): no component is 0, no two are alike."""
    scale = np.full(size, 0.1)
    scale[:3], scale[3:6] = 1e3, 10.0
    return scale * (1.0 + 0.1 * np.arange(size) + 0.01 * np.arange(_TRIALS)[:, None])


class _Asked:
    """Asks a model's methods, and looks at what they return."""

    def __init__(self, name: str, thing: Any) -> None:
        self._name, self._thing = name, thing

    def __call__(self, what: str, arguments: tuple[Any, ...], allowed: Sequence[tuple[int, ...]]) -> Array | None:
        """Return an array of one of the shapes; None where the method fails at this place."""
        method: Callable[..., Any] = getattr(self._thing, what)
        try:
            with np.errstate(all="ignore"):
                value = method(*arguments)
        except Exception:  # it may be of this place only; what fails in a run is named there, with its line
            return None
        words = f"{self._name}: {_called(self._thing)}.{what}:"
        array = value if isinstance(value, np.ndarray) else np.asarray(value)
        if array.dtype.kind not in "bifu":
            raise ValueError(f"{words} an array of {array.dtype} is not allowed; real numbers")
        if array.shape not in allowed:
            shapes = ", ".join(str(one.shape) for one in arguments if isinstance(one, np.ndarray))
            wanted = " or ".join(str(shape) for shape in dict.fromkeys(allowed))
            given = f" for arguments of {shapes}" if shapes else ""
            raise ValueError(f"{words} an array of shape {array.shape} is not allowed{given}; {wanted}")
        return array
