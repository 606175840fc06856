"""Start from a snapshot fix: least squares on the first measurement alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.fixes.snapshot import snapshot_fix, starts_around
from quietfix.systems.linear_algebra import symmetric
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.starts.start import Start

__all__ = ["SnapshotStart"]

Array = NDArray[np.float64]

_NOISE = "start_noise_covariance"
_RANK = 1e-12  # smallest eigenvalue of the information, scaled to unit diagonal


class SnapshotStart(Start):
    r"""Position and its covariance from `snapshot_fix`, velocity zero with a wide spread.

    The search begins around the platforms, see `starts_around`; nothing else need be known.

    .. math:: x_0 = (\hat p,\ 0), \qquad P_0 = \mathrm{diag}([H^T R^{-1} H]^{-1},\ \sigma_v^2 I)

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
    places : callable
        ``(platforms, height) -> (..., s, 3)``: where the search begins; `starts_around` of Earth-fixed axes,
        `starts_around_level` of local ones.
    as_well, buried
        See `snapshot_fix`.

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
        places: Callable[[Array, Array], Array] = starts_around,
        as_well: float = 0.0,
        buried: Callable[[Array, Array], NDArray[np.bool_]] | None = None,
    ) -> None:
        wanted = [*model.names, *([height] if isinstance(height, str) else [])]
        absent = [row for row in wanted if row not in stream]
        if absent:
            raise ValueError(f"start: rows {absent} are not measured; there are {list(stream)}")
        self._model = self.uses = model
        self._width = len(stream)
        self._rows = [list(stream).index(row) for row in model.names]
        self._height_row = list(stream).index(height) if isinstance(height, str) else None
        self._height = 0.0 if isinstance(height, str) else float(height)
        self._sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        self._noise_port = noise_port
        self.noise_input = _NOISE if noise_port else None
        self._places = places
        self._as_well = as_well
        self._buried = buried

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
        places = self._places(platforms, height)
        rows = measurement[:, self._rows]
        fix = snapshot_fix(rows, platforms, self._model, noise, places, as_well=self._as_well, buried=self._buried)
        found = np.isfinite(fix.cost)
        mean[found, :3], mean[found, 3:] = fix.position[found], 0.0
        covariance[found] = 0.0
        covariance[found, :3, :3] = fix.covariance[found]
        covariance[found, 3:, 3:] = self._sigma_velocity**2 * np.eye(3)
        return mean, covariance

    def covariance_at(self, target: Array, platforms: Array) -> Array | None:
        r"""Return the covariance of the start for a target at `target`, shape (..., 6, 6), with all rows there.

        The position's is the inverse of the rows' information at the truth, :math:`(H^T R^{-1} H)^{-1}`; NaN where they
        do not determine a position. None where R comes with the measurement.
        """
        if self._noise_port:
            return None
        gradient = self._model.jacobian(target, platforms)[..., :3]
        white = np.linalg.solve(np.linalg.cholesky(self._model.noise_covariance()), gradient)
        covariance = np.zeros((*white.shape[:-2], 6, 6))
        covariance[..., :3, :3] = _inverse(np.swapaxes(white, -1, -2) @ white)
        covariance[..., 3:, 3:] = self._sigma_velocity**2 * np.eye(3)
        return covariance


def _inverse(information: Array) -> Array:
    """Return the inverses of (..., 3, 3); NaN of one that is singular."""
    scale = np.sqrt(np.einsum("...ii->...i", information))
    good = np.isfinite(scale).all(axis=-1) & (scale > 0).all(axis=-1)
    scale = np.where(good[..., None], scale, 1.0)
    scaled = information / (scale[..., :, None] * scale[..., None, :])
    scaled = np.where(good[..., None, None], scaled, np.eye(3))
    good = good & (np.linalg.eigvalsh(scaled)[..., 0] > _RANK)
    inverse = np.linalg.inv(np.where(good[..., None, None], scaled, np.eye(3)))
    inverse = inverse / (scale[..., :, None] * scale[..., None, :])
    return np.where(good[..., None, None], symmetric(inverse), np.nan)
