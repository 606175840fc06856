"""A bank of filters, one per root of the ranging equation: no prior, decided by likelihood."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.relative_kinematics import RelativeKinematics
from quietfix.systems.documented import count, documented, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.hypothesis_bank import HypothesisBank
from quietfix.systems.estimators.memory import Epoch, Memory
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.hypotheses import mixture
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.fixes.ranged_position import ranging_equation
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Bank", "RootBank", "RootsStart"]

Array = NDArray[np.float64]

_NO_PRIOR = np.diag([1e9**2] * 3 + [1e6**2] * 3)  # wider than any orbit; m and m/s


class RootsStart(Start):
    r"""Position and velocity at every root of the first epoch's ranging equation that can be a satellite; no prior.

    A trial without such a root begins at the next epoch that has one.

    .. math:: f(r_j) = 0, \qquad x_j = (r_O + r_j e,\ v_j), \qquad P_j = k\,G_j\,\mathrm{diag}(\sigma^2)\,G_j^T

    with f the ranging equation (`quietfix.systems.fixes.ranging`), G the derivative of the state by the six rows.

    Parameters
    ----------
    sensor : RelativeKinematics
        The sensor as the estimator believes it to be, all six rows.
    stream : sequence of str
        Names of the rows on the measurement port.
    inflation : float
        Factor of the covariance that follows from the errors of the rows: the ranging equation is not linear over its
        own error.
    minimum_height : float
        Roots lower than this [m], or unbound, are impossible.
    """

    uses_measurement = True
    count = 3

    def __init__(
        self, sensor: MeasurementModel, stream: Sequence[str], inflation: float = 4.0, minimum_height: float = 100e3
    ) -> None:
        self._equation = ranging_equation(sensor)
        assert isinstance(sensor, RelativeKinematics)  # or there would be no equation
        self._observer, self._sigmas = sensor.observer, sensor.sigmas
        self._rows = [list(stream).index(row) for row in sensor.names]  # in the order of `ROWS`, by whatever names
        self._inflation = positive(inflation, "inflation", "")
        self._minimum_height = minimum_height

    def hypotheses(self, measurement: Array, platforms: Array) -> tuple[Array, Array, Array]:
        """Return means (trials, 3, 6), covariances (trials, 3, 6, 6) and weights (trials, 3), 0 where there is none."""
        return self.of_rows(measurement[:, self._rows], platforms)

    def of_rows(self, rows: Array, platforms: Array) -> tuple[Array, Array, Array]:
        """Return the same from the sensor's own six rows (trials, 6)."""
        observer = np.broadcast_to(platforms[:, self._observer], rows.shape)
        ranges, means = self._equation.candidates(rows, observer, self._minimum_height)
        covariances = self._inflation * self._equation.state_covariance(
            ranges, rows[:, None], observer[:, None], self._sigmas
        )
        good = np.isfinite(means).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2))
        return means, covariances, good / np.maximum(good.sum(axis=-1, keepdims=True), 1)

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`: mean and covariance of the mixture."""
        return mixture(*self.hypotheses(measurement, platforms))


class RootBank(HypothesisBank):
    r"""One filter per root of the first epoch, all on the raw rows, weighed by their likelihood.

    The estimate is the mixture until the data have spoken; a root whose probability falls below `least_weight` is
    dropped for good (the static multiple-model estimator: Bar-Shalom, Li and Kirubarajan, *Estimation with Applications
    to Tracking and Navigation*, 2001, section 11.6.2).

    .. math:: w_i \leftarrow \frac{w_i\,p_i(z)}{\sum_j w_j\,p_j(z)}

    Parameters
    ----------
    name, algorithm, model, motion, start, wiring, least_weight
        See `HypothesisBank`.
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: RootsStart,
        wiring: Wiring,
        least_weight: float = 1e-5,
    ) -> None:
        self._roots = start
        super().__init__(name, algorithm, model, motion, start, wiring, least_weight)

    def diagnostics(self) -> Sequence[str]:
        """See `Estimator.diagnostics`."""
        return ()

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array, bool]:
        """See `Estimator.bound_prior`: none, but all of the first epoch."""
        return _NO_PRIOR[None], False

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, NDArray[np.bool_]]:
        """See `Estimator.first`."""
        return self.of_roots(*self._roots.hypotheses(measurement, platforms))

    def of_roots(self, means: Array, covariances: Array, weights: Array) -> tuple[Memory, NDArray[np.bool_]]:
        """Return the memory that begins with these hypotheses, see `RootsStart.hypotheses`, and who has any."""
        integers = np.full((*weights.shape, 1), np.nan)  # no phases: nothing to tell two roots the same
        return self._memory(means, covariances, weights, integers), np.any(weights > 0, axis=-1)


@dataclass(frozen=True)
class Bank(EstimatorOptions):
    """One iterated extended Kalman filter per root of the first epoch, decided by likelihood; needs no prior."""

    inflation: float = number("factor of the covariance that a root starts with", 4.0, above=0)
    least_weight: float = number("a root with less probability than this is dropped", 1e-5, above=0, at_most=0.3)
    max_iterations: int = count("at most so many linearisations per update; 1 is the EKF", 8)
    tolerance: float = number("stop rule ||x_{j+1} - x_j|| <= tolerance, SI units mixed", 1e-2, above=0)
    minimum_height_km: float = number("roots lower than this above the equatorial radius are impossible [km]", 100.0)
    restart: bool = documented("a trial that is lost begins again from the roots of now", True)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block; it makes its own start."""
        roots = RootsStart(model, wiring.stream, self.inflation, 1e3 * self.minimum_height_km)
        algorithm = IteratedExtendedKalman(self.max_iterations, self.tolerance)
        block = RootBank(name, algorithm, model, motion, roots, wiring, self.least_weight)
        block.restart_when_lost(self.restart, f"estimators.{name}.restart")
        return block
