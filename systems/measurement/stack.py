"""Several measurement models read together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from quietfix.systems.geometry.lines_of_sight import LineOfSight, line_of_sight
from quietfix.systems.kernels.equations import Equations, equations_of, joined, program
from quietfix.systems.kernels.evaluating import linearized, values
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.sighted import SightedModel

__all__ = ["Stack"]

Array = NDArray[np.float64]


class Stack(MeasurementModel):
    r"""The rows of several models, one after the other; their noises are independent of each other.

    Models that look along the same lines of sight share them.

    .. math:: h(x) = [h_1(x);\ h_2(x);\ ...], \qquad R = \mathrm{blockdiag}(R_1, R_2, ...)

    Parameters
    ----------
    models : sequence of MeasurementModel
        What is read together; no two rows may have the same name: where they would, `names` of a model is set first.
    """

    def __init__(self, models: Sequence[MeasurementModel]) -> None:
        if not models:
            raise ValueError("a stack needs at least one measurement model")
        self.models = list(models)
        self.names = tuple(name for model in models for name in model.names)
        self.units = tuple(unit for model in models for unit in model.units)
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"measurement rows: {list(self.names)} has a name twice; set `names` of a model")
        ends = accumulate((model.size for model in models), initial=0)
        self._slices = [slice(a, b) for a, b in pairwise(ends)]
        parts = zip(self._slices, self.models, strict=True)
        self._wrapping = [
            (rows, model) for rows, model in parts if type(model).residual is not MeasurementModel.residual
        ]

    def _sight(self, target: Array, platforms: Array) -> LineOfSight | None:
        shared = any(isinstance(model, SightedModel) and model.shares_sight for model in self.models)
        return line_of_sight(target, platforms) if shared else None

    def _join_values(self, values: list[Array], target: Array) -> Array:
        """Join measurements; a cloud that is stored by components stays so, which takes a third of the time."""
        by_components = target.ndim > 2 and target.strides[-1] > target.strides[-2]
        if by_components and all(value.ndim == target.ndim for value in values):
            return np.moveaxis(np.concatenate([np.moveaxis(value, -1, 0) for value in values]), 0, -1)
        return self._join(values, 1)

    def _join(self, arrays: list[Array], trailing: int) -> Array:
        shapes = [array.shape[: array.ndim - trailing] for array in arrays]
        if all(shape == shapes[0] for shape in shapes):
            return np.concatenate(arrays, axis=-trailing)
        leading = np.broadcast_shapes(*shapes)  # a row that needs no platform knows nothing of their trials
        joined = np.empty((*leading, self.size, *arrays[0].shape[arrays[0].ndim - trailing + 1 :]))
        for rows, array in zip(self._slices, arrays, strict=True):
            joined[(..., rows) + (slice(None),) * (trailing - 1)] = array
        return joined

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        compiled = program(self)
        if compiled is not None:
            return values(compiled, target, platforms)
        sight = self._sight(target, platforms)
        parts = [
            model.predict_from(sight, platforms)
            if sight is not None and isinstance(model, SightedModel) and model.shares_sight
            else model.predict(target, platforms)
            for model in self.models
        ]
        return self._join_values(parts, target)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        compiled = program(self)
        if compiled is not None:
            return linearized(compiled, target, platforms)
        sight, size = self._sight(target, platforms), target.shape[-1]
        parts = [
            model.linearize_from(sight, platforms, size)
            if sight is not None and isinstance(model, SightedModel) and model.shares_sight
            else model.linearize(target, platforms)
            for model in self.models
        ]
        return self._join([value for value, _ in parts], 1), self._join([row for _, row in parts], 2)

    def equations(self) -> Equations | None:
        """See `MeasurementModel.equations`; None where one of the models has none."""
        return joined([equations_of(model) for model in self.models])

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.modified_gain`."""
        parts = zip(self._slices, self.models, strict=True)
        return self._join([model.modified_gain(measured[..., rows], target, platforms) for rows, model in parts], 2)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return block_diag(*(model.noise_covariance() for model in self.models))

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        difference = measured - predicted
        for rows, model in self._wrapping:
            difference[..., rows] = model.residual(measured[..., rows], predicted[..., rows])
        return difference

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        parts = zip(self._slices, self.models, strict=True)
        return np.concatenate([model.represent(value[..., rows]) for rows, model in parts], axis=-1)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        return np.concatenate([model.platforms_used(platforms) for model in self.models])
