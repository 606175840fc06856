"""Some rows of a measurement model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, equations_of
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["ChosenRows", "only"]

Array = NDArray[np.float64]


def only(model: MeasurementModel, names: Sequence[str]) -> MeasurementModel:
    """Return a model of the rows `names` of a model, in its own order; phases stay such as can be resolved."""
    own = getattr(model, "only", None)
    return ChosenRows(model, names) if own is None else cast(MeasurementModel, own(names))


class ChosenRows(MeasurementModel):
    r"""Some rows of a model; errors that are correlated with those of the others stay so among themselves.

    .. math:: h'(x) = E\,h(x), \qquad R' = E R E^T

    with E the rows of the unit matrix that are kept.

    Parameters
    ----------
    model : MeasurementModel
        The whole.
    names : sequence of str
        Which rows, at least one.

    Raises
    ------
    ValueError
        For a row that the model lacks, and for no row at all.
    """

    def __init__(self, model: MeasurementModel, names: Sequence[str]) -> None:
        absent = [name for name in names if name not in model.names]
        if absent or not names:
            raise ValueError(f"rows: {absent or 'none'} is not allowed; of {', '.join(model.names)}")
        self.model = model
        self._rows = np.array([i for i, name in enumerate(model.names) if name in names])
        self.names = tuple(model.names[i] for i in self._rows)
        self.units = tuple(model.units[i] for i in self._rows)

    def equations(self) -> Equations | None:
        """See `MeasurementModel.equations`."""
        whole = equations_of(self.model)
        return None if whole is None else whole.rows(self._rows.tolist())

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return self.model.predict(target, platforms)[..., self._rows]

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.model.jacobian(target, platforms)[..., self._rows, :]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        value, jacobian = self.model.linearize(target, platforms)
        return value[..., self._rows], jacobian[..., self._rows, :]

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.modified_gain`."""
        return self.model.modified_gain(self._whole(measured), target, platforms)[..., self._rows, :]

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.model.noise_covariance()[np.ix_(self._rows, self._rows)]

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.noise_covariance_at`."""
        covariance = self.model.noise_covariance_at(target, platforms)
        return covariance[..., self._rows[:, None], self._rows]

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        return self.model.residual(self._whole(measured), self._whole(predicted))[..., self._rows]

    def represent(self, value: Array) -> Array:
        """See `MeasurementModel.represent`."""
        return self.model.represent(self._whole(value))[..., self._rows]

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """See `MeasurementModel.platforms_used`."""
        return self.model.platforms_used(platforms)[self._rows]

    def _whole(self, value: Array) -> Array:
        """Return values of all rows; those that are not there are missing."""
        whole = np.full((*value.shape[:-1], self.model.size), np.nan)
        whole[..., self._rows] = value
        return whole
