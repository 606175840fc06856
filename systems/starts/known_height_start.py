"""Start from a known-height TDOA fix."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.atmosphere.delayed import Delayed
from quietfix.systems.fixes.known_height import Method, known_height_covariance, position_per_velocity, wave_front_fix
from quietfix.systems.fixes.unknown_velocity import with_unknown_velocity
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.start import Start

__all__ = ["KnownHeightStart"]

Array = NDArray[np.float64]


class KnownHeightStart(Start):
    r"""Position from the first TDOAs and an assumed height, velocity zero with a wide spread.

    With the light time of the TDOA model, in which a delay depends on the velocity a little (0.35 ns at 400 m/s and
    80 km baselines in low orbit), position and velocity are correlated.

    Section 2.1 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. The assumed height comes on the port
    ``assumed_height``: connect a constant, or a block that draws it.

    .. math:: x_0 = (\hat p(\tau_{10}, \tau_{20}, h),\ 0), \qquad P_0 = \mathrm{diag}(P_1,\ \sigma_v^2 I)

    with :math:`\hat p` and :math:`P_1` as in `quietfix.systems.fixes.known_height`.

    Parameters
    ----------
    tdoa : Tdoa
        The TDOA model that the estimator believes in: two receivers and the reference.
    stream : sequence of str
        Names of the rows on the measurement port.
    sigma_height : float
        Standard deviation of the assumed height [m].
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].
    sigma_satellite : float
        Standard deviation of a satellite's position per axis [m].
    method : {'auto', 'closed_form', 'newton'}
        See `known_height_fix`.
    air : Delayed, optional
        The same TDOA model with what the atmosphere adds: it is taken off for the place of a first fix.
    """

    uses_measurement = True

    def __init__(
        self,
        tdoa: Tdoa,
        stream: Sequence[str],
        sigma_height: float,
        sigma_velocity: float,
        sigma_satellite: float = 0.0,
        method: Method = "auto",
        air: Delayed | None = None,
    ) -> None:
        if tdoa.size != 2:
            raise ValueError(f"a known-height fix needs two TDOAs, there are {tdoa.size}")
        absent = [row for row in tdoa.names if row not in stream]
        if absent:
            raise ValueError(f"start: rows {absent} are not measured; there are {list(stream)}")
        self.tdoa = self.uses = tdoa
        self._rows = [list(stream).index(row) for row in tdoa.names]
        self._order = [tdoa.reference, *tdoa.receivers]
        self.sigma_height = positive(sigma_height, "sigma_height", "m")
        self.sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        if not (math.isfinite(sigma_satellite) and sigma_satellite >= 0):
            raise ValueError(f"sigma_satellite: {sigma_satellite} is not allowed; it must be a finite number >= 0 m")
        self.sigma_satellite = float(sigma_satellite)
        self._method: Method = method
        self._air = air

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {"assumed_height": 1}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        height = inputs["assumed_height"][:, 0]
        delays = measurement[:, self._rows]
        position = wave_front_fix(self.tdoa, delays, platforms, height, self._method)
        if self._air is not None:
            still = np.concatenate([position, np.zeros_like(position)], axis=-1)
            delays = delays - self._air.excess(still, platforms)
            position = wave_front_fix(self.tdoa, delays, platforms, height, self._method)
        mean = np.concatenate([position, np.where(np.isfinite(position), 0.0, np.nan)], axis=-1)
        return mean, self.covariance_at(mean, platforms)

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the start for a target at `target`, shape (..., 6, 6)."""
        position = known_height_covariance(
            target,
            platforms[..., self._order, :],
            self.tdoa.sigma,
            self.sigma_height,
            self.sigma_satellite,
            self.tdoa.correlated,
        )
        slope = position_per_velocity(self.tdoa, target, platforms)
        return with_unknown_velocity(position, slope, self.sigma_velocity)
