"""A user's own object behind a boundary: what its methods return is checked, and who failed is named."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.registry import blamed, in_one_line, object_at

__all__ = ["Checked", "disagreement", "made", "state_steps"]

Array = NDArray[np.float64]

_EPS = float(np.finfo(float).eps)
_NEAR = 1e3  # m; a distance over which a function of position is taken to curve
_SPEED_STEP = 1.0  # m/s; most functions are nearly linear in the velocity
_ROUNDING = 4.0  # of a central difference, in units of eps times the function over the step
_GROUPS = (slice(0, 3), slice(3, 6), slice(6, None))  # columns that are of one unit: position, velocity, the rest


def made(path: str, options: Mapping[str, Any], kind: type, optional: Collection[str] = ()) -> tuple[Any, list[str]]:
    """Return an object of a user's class, and which of the optional methods it lacks.

    Parameters
    ----------
    path : str
        ``package.module:Class``.
    options : mapping of str to object
        Keyword arguments of the class.
    kind : type
        An abstract class that it must be a subclass of.
    optional : collection of str
        Abstract methods that may be lacking; called all the same, they raise NotImplementedError.

    Raises
    ------
    ValueError
        If the class cannot be found, is no such subclass, lacks something else, refuses the options or fails.
    """
    found = object_at(path)
    if not isinstance(found, type) or not issubclass(found, kind):
        raise ValueError(f"class: {path} is not allowed; a subclass of {kind.__module__}.{kind.__qualname__}")
    lacking = sorted(getattr(found, "__abstractmethods__", ()))
    if set(lacking) - set(optional):
        raise ValueError(f"class: {path} lacks {', '.join(name for name in lacking if name not in optional)}")
    if lacking:
        found = type(found.__name__, (found,), {name: _lacking(name) for name in lacking})
    try:
        return found(**options), lacking
    except TypeError as error:
        raise ValueError(f"options: {path} says: {in_one_line(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's class does while it is made, sys.exit too
        raise ValueError(f"class: {blamed(path, error)}") from error


def _lacking(name: str) -> Callable[..., Any]:
    def method(self: Any, *arguments: Any) -> Any:
        raise NotImplementedError(f"this class has no {name}")

    return method


def state_steps(state: Array) -> Array:
    r"""Return steps for central differences in each component of a state (..., n).

    Truncation is about :math:`s^2/(6 d^2)` of a gradient that changes over the distance d, rounding of the position p
    about :math:`\varepsilon|p|/s`; their sum is least at :math:`s = (3\varepsilon|p|d^2)^{1/3}`. With d and the least p
    1 km that is 0.16 m for Earth-fixed positions and 1 cm in local axes, with errors of 1e-8 of the gradient. Steps of
    velocities are 1 m/s, of other states :math:`\varepsilon^{1/3}\max(1, |x|)`.
    """
    reach = np.maximum(np.abs(state[..., :3]).max(axis=-1), _NEAR)
    step = _EPS ** (1 / 3) * np.maximum(np.abs(state), 1.0)
    step[..., :3] = np.cbrt(3 * _EPS * reach * _NEAR**2)[..., None]
    step[..., 3:6] = _SPEED_STEP
    return step


def disagreement(own: Array, differences: Array, values: Array, step: Array, least: Array) -> float:
    """Return how far a derivative is off the central differences, as a share of the gradient.

    Parameters
    ----------
    own, differences : ndarray, shape (..., m, n)
        What is compared.
    values : ndarray, shape (..., m)
        The function itself, whose rounding is in the differences.
    step : ndarray, shape (..., n)
        Steps of the differences.
    least : ndarray, shape (m,)
        Gradients smaller than this count as this.

    Returns
    -------
    float
        The largest over the rows, and over position, velocity and the other states.
    """
    rounding = _ROUNDING * _EPS * np.abs(values)[..., :, None] / step[..., None, :]
    off = np.maximum(np.abs(own - differences) - rounding, 0.0)
    size = np.maximum(np.abs(own), np.abs(differences))
    shares = [
        off[..., group].max(axis=-1) / np.maximum(size[..., group].max(axis=-1), least)
        for group in _GROUPS
        if off[..., group].shape[-1]
    ]
    return float(np.max(shares))


def _locked(argument: Any) -> Any:
    """Return an argument as a user's class may read it: what it writes there would be the truth of everybody."""
    if not isinstance(argument, np.ndarray):
        return argument
    view = argument.view()
    view.flags.writeable = False
    return view


class Checked:
    """An object that somebody else wrote, asked through checks.

    Parameters
    ----------
    thing : object
        What they wrote.
    name : str
        What messages call it.
    path : str
        ``package.module:Class``, for messages; by default the name of its class.
    refused : type of Exception
        What is raised where it returns something wrong, or fails.
    """

    def __init__(self, thing: Any, name: str, path: str = "", refused: type[Exception] = ValueError) -> None:
        self.thing, self.name = thing, name
        self.path, self.refused = path or type(thing).__name__, refused

    def wrong(self, what: str, words: str) -> Exception:
        """Return the error that says what is wrong with an attribute or a method."""
        return self.refused(f"{self.name}: {self.path}.{what}: {words}")

    def texts(self, what: str) -> tuple[str, ...]:
        """Return an attribute that must be a tuple of texts."""
        value = getattr(self.thing, what, None)
        if isinstance(value, str) or not isinstance(value, Sequence) or not all(isinstance(v, str) for v in value):
            raise self.wrong(what, f"{value!r} is not allowed; a tuple of texts")
        return tuple(value)

    def names(self, things: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return its ``names`` and ``units``, one unit for each; `things`: what they are, for messages."""
        names, units = self.texts("names"), self.texts("units")
        if not names or len(set(names)) < len(names):
            raise self.wrong("names", f"{names} is not allowed; at least one, none of them twice")
        if len(units) != len(names):
            raise self.wrong("units", f"{len(units)} are given; one for each of {len(names)} {things}")
        return names, units

    def asked(self, what: str, *arguments: Any) -> Array:
        """Return what a method gives, as numbers."""
        method: Callable[..., Any] = getattr(self.thing, what)
        try:
            value = method(*map(_locked, arguments))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a user's class does, sys.exit too
            raise self.refused(f"{self.name}: {blamed(self.path, error, what)}") from error
        if np.iscomplexobj(value):
            raise self.wrong(what, "complex numbers are not allowed; real ones")
        try:
            given = np.asarray(value, dtype=float)
            return given if given.flags.writeable else given.copy()
        except (TypeError, ValueError) as error:
            raise self.wrong(what, f"{type(value).__name__} is not allowed; an array of numbers") from error

    def same_again(self, what: str, first: Array, second: Array) -> None:
        """Refuse a method of which two calls with the same arguments give different numbers."""
        if not np.array_equal(first, second, equal_nan=True):
            raise self.wrong(what, "two calls with the same arguments give different numbers; noise is added elsewhere")

    def shaped(self, what: str, arguments: tuple[Any, ...], allowed: Sequence[tuple[int, ...]]) -> Array:
        """Return what a method gives, which must have one of the shapes."""
        value = self.asked(what, *arguments)
        if value.shape not in allowed:
            shapes = ", ".join(str(argument.shape) for argument in arguments if isinstance(argument, np.ndarray))
            wanted = " or ".join(str(shape) for shape in dict.fromkeys(allowed))
            raise self.wrong(what, f"an array of shape {value.shape} is not allowed for arguments {shapes}; {wanted}")
        return value

    def covariance(
        self, what: str, arguments: tuple[Any, ...], shapes: Sequence[tuple[int, ...]], least: bool
    ) -> Array:
        """Return a covariance, checked; `least`: whether its diagonal must be above 0, instead of at least 0."""
        value = self.shaped(what, arguments, shapes)
        diagonal = np.diagonal(value, axis1=-2, axis2=-1)
        good = np.isfinite(value).all() and ((diagonal > 0) if least else (diagonal >= 0)).all()
        words = f"it must be symmetric and finite, with a diagonal {'>' if least else '>='} 0"
        if not good:
            raise self.wrong(what, words)
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        correlation = value / (scale[..., :, None] * scale[..., None, :])
        if not np.allclose(correlation, np.swapaxes(correlation, -1, -2), rtol=0, atol=1e-9):
            raise self.wrong(what, words)
        if np.linalg.eigvalsh(correlation).min() < -1e-9:
            raise self.wrong(what, "it must be positive semidefinite")
        return value
