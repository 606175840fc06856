"""Start from a snapshot fix: least squares on the first measurement alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from systems.estimators.start import Start
from systems.fixes.snapshot import snapshot_fix, starts_around
from systems.measurement.base import MeasurementModel, positive

__all__ = ["SnapshotStart"]

Array = NDArray[np.float64]

_NOISE = "start_noise_covariance"


class SnapshotStart(Start):
    """Position and its covariance from `snapshot_fix`, velocity zero with a wide spread.

    The search begins around the platforms, see `starts_around`; nothing else need be known.

    Parameters
    ----------
    model : MeasurementModel
        What the estimator believes of the rows that make the fix; they must not depend on the velocity.
    stream : sequence of str
        Names of the rows on the measurement port.
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].
    height : str or float
        Height at which the search begins: the name of a row that measures it, or a value [m].
    noise_port : bool
        True where R comes with the measurement: the estimator then gets a port ``start_noise_covariance``, which
        is to be connected to the same output as its ``noise_covariance``.

    Raises
    ------
    ValueError
        If a row is not measured, or `sigma_velocity` is not positive.
    """

    uses_measurement = True

    def __init__(
        self,
        model: MeasurementModel,
        stream: Sequence[str],
        sigma_velocity: float,
        height: str | float = 0.0,
        noise_port: bool = False,
    ) -> None:
        wanted = [*model.names, *([height] if isinstance(height, str) else [])]
        absent = [row for row in wanted if row not in stream]
        if absent:
            raise ValueError(f"start: rows {absent} are not measured; there are {list(stream)}")
        self._model = model
        self._width = len(stream)
        self._rows = [list(stream).index(row) for row in model.names]
        self._height_row = list(stream).index(height) if isinstance(height, str) else None
        self._height = 0.0 if isinstance(height, str) else float(height)
        self._sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        self._noise_port = noise_port

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {_NOISE: self._width**2} if self._noise_port else {}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        trials = measurement.shape[0]
        mean = np.full((trials, 6), np.nan)
        covariance = np.full((trials, 6, 6), np.nan)
        if np.isnan(measurement[:, self._rows]).all():
            return mean, covariance
        noise = self._model.noise_covariance()
        if self._noise_port:
            noise = inputs[_NOISE].reshape(trials, self._width, self._width)
            noise = noise[:, self._rows][:, :, self._rows]
        height = np.full(trials, self._height)
        if self._height_row is not None:
            height = measurement[:, self._height_row]
            height = np.where(np.isfinite(height), height, 0.0)
        fix = snapshot_fix(measurement[:, self._rows], platforms, self._model, noise, starts_around(platforms, height))
        found = np.isfinite(fix.cost)
        mean[found, :3], mean[found, 3:] = fix.position[found], 0.0
        covariance[found] = 0.0
        covariance[found, :3, :3] = fix.covariance[found]
        covariance[found, 3:, 3:] = self._sigma_velocity**2 * np.eye(3)
        return mean, covariance
