"""Time differences of arrival."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.geometry.refractivity import mean_refractivity
from quietfix.systems.geometry.wave_path import WavePath
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.differenced import Differenced
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["GroundTdoa", "Tdoa"]

Array = NDArray[np.float64]


class Tdoa(Differenced):
    r"""Time difference of arrival against a reference receiver.

    .. math:: \tau_{i0} = (r_i - r_0)/c, \qquad
              \partial\tau_{i0}/\partial p = (u_i - u_0)/c

    with u the unit vector from receiver to target; rows 1 and 2 of eq. (8) of Xu, Su and Wang,
    doi 10.20079/j.issn.1001-893x.220609005.

    Parameters
    ----------
    sigma : float
        Standard deviation of one difference [s].
    receivers, reference, correlated, light_time, earth_rate, constants
        See `Differenced`. Light time changes the difference by up to 5 ns at 100 km baselines in low orbit.
    """

    def __init__(
        self,
        sigma: float,
        receivers: Sequence[int] = (1, 2),
        reference: int = 0,
        correlated: bool = False,
        light_time: bool = False,
        earth_rate: float = EARTH_RATE,
        constants: GravityConstants | None = None,
    ) -> None:
        sigma = positive(sigma, "sigma_tdoa", "s")
        super().__init__("tdoa", "s", sigma, receivers, reference, correlated, light_time, earth_rate, constants)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        parameters = [self.reference, *self.receivers]
        if self.light_time:
            return of_kernel(
                "waves:wave_tdoa",
                [*self._wave_parameters(), *parameters],
                self.size,
                states=6,
                platforms=[self.reference, *self.receivers],
            )
        return of_kernel("sight:tdoa", parameters, self.size, states=3, platforms=[self.reference, *self.receivers])


class GroundTdoa(Tdoa):
    r"""Time difference of arrival of a wave that goes along the ground, or over it by the ionosphere.

    Rows and names are those of `Tdoa`; target and receivers are taken to be on the ground.

    .. math:: \tau_{i0} = [L(d_i) - L(d_0)]/c

    with d the straight distance to the receiver and L as in `quietfix.systems.geometry.wave_path`.

    Parameters
    ----------
    sigma, receivers, reference
        See `Tdoa`.
    path : WavePath
        How long the way is over a straight distance.
    """

    def __init__(
        self, sigma: float, receivers: Sequence[int] = (1, 2), reference: int = 0, path: WavePath | None = None
    ) -> None:
        super().__init__(sigma, receivers, reference)
        self.path = path or WavePath()

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        seen = [self.reference, *self.receivers]
        parameters = [self.path.mirror, 1 + float(mean_refractivity(0.0, 0.0)), *seen]
        return of_kernel("sight:ground_tdoa", parameters, self.size, states=3, platforms=seen)
