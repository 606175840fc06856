"""Start from every set of phase integers that the first epoch allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.hypotheses import mixture
from quietfix.systems.fixes.integer_hypotheses import (
    IntegerHypotheses,
    integer_covariance,
    integer_hypotheses,
    integer_slope,
)
from quietfix.systems.fixes.unknown_velocity import with_unknown_velocity
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.start import Start

__all__ = ["HypothesesStart"]

Array = NDArray[np.float64]


class HypothesesStart(Start):
    r"""Positions from the first TDOAs, wrapped phases and an assumed height; velocity zero with a wide spread.

    Where the formation is nearly a line, an error of the assumed height moves the fix across the track by cycles of
    phase, the fix exists left and right of the track or not at all, and no one Gaussian can tell of all that.
    `hypotheses` returns one for each set of integers; `begin` their common mean and covariance.

    .. math:: x_0 = \sum_i w_i x_i, \qquad P_0 = \sum_i w_i\,[P_i + (x_i - x_0)(x_i - x_0)^T]

    Parameters
    ----------
    tdoa : Tdoa
        The TDOA model that the estimator believes in: two receivers and the reference.
    phases : MeasurementModel
        The phases that it believes in, unambiguous.
    stream : sequence of str
        Names of the rows on the measurement port; whole cycles in the phases there do not matter.
    sigma_height, sigma_velocity, sigma_satellite : float
        See `KnownHeightStart`.
    count : int
        Most hypotheses in a trial.
    """

    uses_measurement = True

    def __init__(
        self,
        tdoa: Tdoa,
        phases: MeasurementModel,
        stream: Sequence[str],
        sigma_height: float,
        sigma_velocity: float,
        sigma_satellite: float = 0.0,
        count: int = 24,
    ) -> None:
        if tdoa.size != 2:
            raise ValueError(f"integer hypotheses need two TDOAs, there are {tdoa.size}")
        if count < 1:
            raise ValueError(f"hypotheses: {count} is not allowed; a whole number >= 1")
        absent = [row for row in (*tdoa.names, *phases.names) if row not in stream]
        if absent:
            raise ValueError(f"start: rows {absent} are not measured; there are {list(stream)}")
        self._tdoa, self._phases = tdoa, phases
        self._tdoa_rows = [list(stream).index(row) for row in tdoa.names]
        self._phase_rows = [list(stream).index(row) for row in phases.names]
        self._sigma_height = positive(sigma_height, "sigma_height", "m")
        self._sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        self._sigma_satellite = sigma_satellite
        self.count = count

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {"assumed_height": 1}

    def hypotheses(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> IntegerHypotheses:
        """Return what the first epoch allows; arguments as in `Start.begin`."""
        return integer_hypotheses(
            self._tdoa,
            self._phases,
            measurement[:, self._tdoa_rows],
            measurement[:, self._phase_rows],
            platforms,
            inputs["assumed_height"][:, 0],
            self._sigma_height,
            self.count,
            self._sigma_satellite,
        )

    def states(self, found: IntegerHypotheses, platforms: Array) -> tuple[Array, Array]:
        """Return means (trials, K, 6) and covariances (trials, K, 6, 6) of position and velocity."""
        means = np.concatenate([found.position, 0.0 * found.position], axis=-1)
        return means, self._with_velocity(found.covariance, means, platforms[:, None])

    def _with_velocity(self, covariance: Array, target: Array, platforms: Array) -> Array:
        slope = np.zeros_like(covariance)
        if self._tdoa.light_time:
            slope = integer_slope(
                self._tdoa, self._phases, target, platforms, self._sigma_height, self._sigma_satellite
            )
        return with_unknown_velocity(covariance, slope, self._sigma_velocity)

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`: mean and covariance of the mixture."""
        found = self.hypotheses(measurement, platforms, inputs)
        return mixture(*self.states(found, platforms), found.weight)

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the right hypothesis for a target at `target`, shape (..., 6, 6)."""
        position = integer_covariance(
            self._tdoa, self._phases, target, platforms, self._sigma_height, self._sigma_satellite
        )
        return self._with_velocity(position, target, platforms)
