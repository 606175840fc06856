"""A user's own measurement model, behind the boundary where what it returns is checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.checked import Checked, disagreement, state_steps
from quietfix.systems.checked import made as made_checked
from quietfix.systems.kernels.equations import Equations, equations_of, program
from quietfix.systems.kernels.evaluating import linearized
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.registry import blamed, in_one_line

__all__ = ["CustomMeasurement", "made"]

Array = NDArray[np.float64]

_CLOSE = 1e-3  # of a gradient; what is nearer costs no estimator anything
_SAME = 1e-3  # sigmas, of what a kernel gives
_NO_GRADIENT = 1e-6  # sigmas per metre or m/s


def made(path: str, options: Mapping[str, Any]) -> tuple[MeasurementModel, bool]:
    """Return a user's model and whether it has a Jacobian of its own; see `quietfix.systems.checked.made`."""
    model, lacking = made_checked(path, options, MeasurementModel, ["jacobian"])
    assert isinstance(model, MeasurementModel)
    return model, not lacking


class CustomMeasurement(MeasurementModel):
    r"""A model that somebody else wrote: it sees some of the platforms, and what it returns is checked for its shape.

    Where it has no Jacobian, central differences

    .. math:: \partial h/\partial x_i \approx [h(x + s_i e_i) - h(x - s_i e_i)]/(2 s_i)

    stand in for it, with the steps of `quietfix.systems.checked.state_steps`; nearer than 50 m to a platform their
    errors pass 1e-6 of the gradient. A step depends on the target alone, so that a platform that is missing does not
    change rows that do not use it.

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
        self._checked = Checked(model, name, path, refused)
        self.names, self.units = self._checked.names("rows")
        self._noise = self._checked.covariance("noise_covariance", (), [(self.size, self.size)], least=True)

    def _leads(self, target: Array, seen: Array) -> list[tuple[int, ...]]:
        """Return the leading shapes that are right; a model that needs no platform knows nothing of theirs."""
        lead = target.shape[:-1]
        return [np.broadcast_shapes(lead, seen.shape[:-2]), lead]

    def check(self, target: Array, platforms: Array) -> None:
        """Ask everything once, of states (..., n) and (..., p, 6): what it gives there must be finite.

        Raises
        ------
        Exception
            Of the kind `refused`, naming class and method.
        """
        answers = {"predict": self.predict(target, platforms), "jacobian": self.jacobian(target, platforms)}
        for what, value in answers.items():
            if not np.isfinite(value).all():
                begin = target.reshape(-1, target.shape[-1])[0].tolist()
                raise self._checked.wrong(what, f"a number that is not finite, for a target at {begin}")
        self._check_kernel(target, platforms, answers["predict"], answers["jacobian"])
        self._checked.same_again("predict", answers["predict"], self.predict(target, platforms))

    def _check_kernel(self, target: Array, platforms: Array, predicted: Array, jacobian: Array) -> None:
        """Hold compiled equations, where the class has them, against what its methods give."""
        if self.equations() is None:
            return
        try:
            compiled = program(self)
            assert compiled is not None
            value, slope = linearized(compiled, target, platforms)
        except (TypeError, ValueError) as error:
            raise self._checked.wrong("equations", in_one_line(error)) from error
        off = float(np.max(np.abs(value - predicted) / self.sigmas))
        if not off <= _SAME:
            raise self._checked.wrong("equations", f"its kernel is {off:.2g} sigmas off what predict gives")
        off = disagreement(slope, jacobian, value, state_steps(target), _NO_GRADIENT * self.sigmas)
        if not off <= _CLOSE:
            raise self._checked.wrong(
                "equations", f"its kernel's derivatives are {off:.2g} of the gradient off jacobian"
            )

    def doubt(self, target: Array, platforms: Array) -> str:
        """Return in words that the class's own Jacobian is not the derivative of its `predict` there; else nothing."""
        if not self.has_jacobian:
            return ""
        seen = platforms[..., self.platforms, :]
        off = disagreement(
            self.jacobian(target, platforms),
            self._differences(target, seen),
            self._values(target, seen),
            state_steps(target),
            _NO_GRADIENT * self.sigmas,
        )
        if off <= _CLOSE:
            return ""
        return f"{self._checked.name}: {self._checked.path}.jacobian is {off:.2g} of the gradient off that of predict."

    # ---- the model

    def _values(self, target: Array, seen: Array) -> Array:
        allowed = [(*lead, self.size) for lead in self._leads(target, seen)]
        return self._checked.shaped("predict", (target, seen), allowed)

    def equations(self) -> Equations | None:
        """See `MeasurementModel.equations`: those of the user's class, where it sees the first platforms in order."""
        in_order = self.platforms == list(range(len(self.platforms)))
        if not (in_order and self.has_jacobian):
            return None
        try:
            found: Any = equations_of(self.model)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a user's method does, sys.exit too
            named = f"{self._checked.name}: {blamed(self._checked.path, error, 'equations')}"
            raise self._checked.refused(named) from error
        if found is not None and not isinstance(found, Equations):
            raise self._checked.wrong("equations", f"{found!r:.80} is not allowed; what of_kernel returns, or None")
        if found is not None and len(found.chosen) != self.size:
            raise self._checked.wrong("equations", f"{len(found.chosen)} rows are not allowed; {self.size}, its names")
        return found

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
        return self._checked.shaped("jacobian", (target, seen), allowed)

    def _differences(self, target: Array, seen: Array) -> Array:
        n = target.shape[-1]
        step = state_steps(target)
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
        return self._checked.shaped("residual", (measured, predicted), [lead])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self._residual(measured, predicted)

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self._checked.shaped("represent", (value,), [value.shape])

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        seen = len(self.platforms)
        own = self._checked.asked("platforms_used", seen)
        if own.shape != (self.size, seen):
            raise self._checked.wrong(
                "platforms_used", f"an array of shape {own.shape} is not allowed; {(self.size, seen)}"
            )
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.platforms] = own != 0
        return used
