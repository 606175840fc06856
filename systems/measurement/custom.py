"""A user's own measurement model, behind the boundary where what it returns is checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from systems.measurement.base import MeasurementModel
from systems.registry import blamed, in_one_line, locate

__all__ = ["CustomMeasurement", "made"]

Array = NDArray[np.float64]

_EPS = float(np.finfo(float).eps)
_NEAR = 1e3  # m; a distance over which a measurement of position is taken to curve
_SPEED_STEP = 1.0  # m/s; measurements are nearly linear in the velocity


def made(path: str, options: Mapping[str, Any]) -> tuple[MeasurementModel, bool]:
    """Return a user's model and whether it has a Jacobian of its own.

    Parameters
    ----------
    path : str
        ``package.module:Class``, a subclass of `MeasurementModel`; ``jacobian`` may be lacking.
    options : mapping of str to object
        Keyword arguments of the class.

    Raises
    ------
    ValueError
        If the class cannot be found, is no such subclass, lacks something else, refuses the options or fails.
    """
    kind = locate(path)
    if not isinstance(kind, type) or not issubclass(kind, MeasurementModel):
        raise ValueError(f"class: {path} is not allowed; a subclass of systems.measurement.base.MeasurementModel")
    lacking = set(kind.__abstractmethods__)
    if lacking - {"jacobian"}:
        raise ValueError(f"class: {path} lacks {', '.join(sorted(lacking - {'jacobian'}))}")
    if lacking:
        kind = type(kind.__name__, (kind,), {"jacobian": _none})
    try:
        return kind(**options), not lacking
    except TypeError as error:
        raise ValueError(f"options: {path} says: {in_one_line(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's class does while it is made, sys.exit too
        raise ValueError(f"class: {blamed(path, error)}") from error


def _none(self: MeasurementModel, target: Array, platforms: Array) -> Array:
    raise NotImplementedError("this model has no Jacobian")


class CustomMeasurement(MeasurementModel):
    r"""A model that somebody else wrote: it sees some of the platforms, and what it returns is checked for its shape.

    Where it has no Jacobian, central differences

    .. math:: \partial h/\partial x_i \approx [h(x + s_i e_i) - h(x - s_i e_i)]/(2 s_i)

    stand in for it. Truncation is about :math:`s^2/(6 d^2)` of a gradient that changes over the distance d, rounding of
    the position p about :math:`\varepsilon|p|/s`; their sum is least at :math:`s = (3\varepsilon|p|d^2)^{1/3}`. With d
    and the least p 1 km that is 0.16 m for Earth-fixed positions and 1 cm in local axes, with errors of 1e-8 of the
    gradient; nearer than 50 m to a platform they pass 1e-6. Steps of velocities are 1 m/s, of other states
    :math:`\varepsilon^{1/3}\max(1, |x|)`. A step depends on the target alone, so that a platform that is missing does
    not change rows that do not use it.

    Parameters
    ----------
    model : MeasurementModel
        What they wrote; it gets the platforms `platforms`, in that order.
    platforms : sequence of int
        Which ones.
    has_jacobian : bool
        False: central differences.
    name : str
        What messages call it.
    path : str
        ``package.module:Class``, for messages.
    refused : type of Exception
        What is raised where it returns something of a wrong shape, or fails.
    """

    def __init__(
        self,
        model: MeasurementModel,
        platforms: Sequence[int],
        has_jacobian: bool = True,
        name: str = "model",
        path: str = "",
        refused: type[Exception] = ValueError,
    ) -> None:
        self.model = model
        self.platforms = list(platforms)
        self.has_jacobian = has_jacobian
        self._name, self._path, self._refused = name, path or type(model).__name__, refused
        self.names, self.units = self._texts("names"), self._texts("units")
        if not self.names or len(set(self.names)) < len(self.names):
            raise self._wrong("names", f"{self.names} is not allowed; at least one, none of them twice")
        if len(self.units) != len(self.names):
            raise self._wrong("units", f"{len(self.units)} are given; one for each of {len(self.names)} rows")
        self._noise = self._checked_noise()

    # ---- the boundary

    def _wrong(self, what: str, words: str) -> Exception:
        return self._refused(f"{self._name}: {self._path}.{what}: {words}")

    def _texts(self, what: str) -> tuple[str, ...]:
        value = getattr(self.model, what, None)
        if isinstance(value, str) or not isinstance(value, Sequence) or not all(isinstance(v, str) for v in value):
            raise self._wrong(what, f"{value!r} is not allowed; a tuple of texts")
        return tuple(value)

    def _asked(self, what: str, *arguments: Any) -> Array:
        """Return what a method of the model gives, as numbers."""
        method: Callable[..., Any] = getattr(self.model, what)
        try:
            value = method(*arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a user's class does, sys.exit too
            raise self._refused(f"{self._name}: {blamed(self._path, error, what)}") from error
        if np.iscomplexobj(value):
            raise self._wrong(what, "complex numbers are not allowed; real ones")
        try:
            return np.asarray(value, dtype=float)
        except (TypeError, ValueError) as error:
            raise self._wrong(what, f"{type(value).__name__} is not allowed; an array of numbers") from error

    def _shaped(self, what: str, arguments: tuple[Array, ...], allowed: Sequence[tuple[int, ...]]) -> Array:
        value = self._asked(what, *arguments)
        if value.shape not in allowed:
            shapes = ", ".join(str(argument.shape) for argument in arguments)
            wanted = " or ".join(str(shape) for shape in dict.fromkeys(allowed))
            raise self._wrong(what, f"an array of shape {value.shape} is not allowed for arguments {shapes}; {wanted}")
        return value

    def _checked_noise(self) -> Array:
        noise = self._shaped("noise_covariance", (), [(self.size, self.size)])
        good = np.isfinite(noise).all() and (np.diag(noise) > 0).all()
        scale = np.sqrt(np.diag(noise)) if good else np.ones(self.size)
        correlation = noise / np.outer(scale, scale)
        if not good or not np.allclose(correlation, correlation.T, rtol=0, atol=1e-9):
            raise self._wrong("noise_covariance", "it must be symmetric and finite, with a diagonal > 0")
        if np.linalg.eigvalsh(correlation)[0] < -1e-9:
            raise self._wrong("noise_covariance", "it must be positive semidefinite")
        return noise

    def _leads(self, target: Array, seen: Array) -> list[tuple[int, ...]]:
        """Return the leading shapes that are right; a model that needs no platform knows nothing of theirs."""
        lead = target.shape[:-1]
        return [np.broadcast_shapes(lead, seen.shape[:-2]), lead]

    # ---- the model

    def _values(self, target: Array, seen: Array) -> Array:
        allowed = [(*lead, self.size) for lead in self._leads(target, seen)]
        return self._shaped("predict", (target, seen), allowed)

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self._values(target, platforms[..., self.platforms, :])

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        seen = platforms[..., self.platforms, :]
        if not self.has_jacobian:
            return self._differences(target, seen)
        n = target.shape[-1]
        allowed = [(*lead, self.size, n) for lead in self._leads(target, seen)]
        return self._shaped("jacobian", (target, seen), allowed)

    def _differences(self, target: Array, seen: Array) -> Array:
        n = target.shape[-1]
        reach = np.maximum(np.abs(target[..., :3]).max(axis=-1), _NEAR)
        step = _EPS ** (1 / 3) * np.maximum(np.abs(target), 1.0)
        step[..., :3] = np.cbrt(3 * _EPS * reach * _NEAR**2)[..., None]
        step[..., 3:6] = _SPEED_STEP
        columns = []
        for i in range(n):
            up, down = target.copy(), target.copy()
            up[..., i] += step[..., i]
            down[..., i] -= step[..., i]
            change = self._residual(self._values(up, seen), self._values(down, seen))
            # not 2 * step: what the rounded states differ by
            columns.append(change / (up[..., i] - down[..., i])[..., None])
        return np.stack(columns, axis=-1)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`; asked for once."""
        return self._noise.copy()

    def _residual(self, measured: Array, predicted: Array) -> Array:
        lead = np.broadcast_shapes(measured.shape, predicted.shape)
        return self._shaped("residual", (measured, predicted), [lead])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self._residual(measured, predicted)

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self._shaped("represent", (value,), [value.shape])

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        seen = len(self.platforms)
        own = self._asked("platforms_used", seen)
        if own.shape != (self.size, seen):
            raise self._wrong("platforms_used", f"an array of shape {own.shape} is not allowed; {(self.size, seen)}")
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.platforms] = own != 0
        return used
