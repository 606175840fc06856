"""Frequency differences of arrival."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE, SPEED_OF_LIGHT
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.differenced import Differenced
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["Fdoa"]

Array = NDArray[np.float64]


class Fdoa(Differenced):
    r"""Difference of received frequencies against a reference receiver.

    .. math:: f_i - f_0 = -(\dot r_i - \dot r_0)/\lambda

    Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005, print the other sign in eq. (8) (the range-rate
    difference); `paper_sign` gives theirs.

    Parameters
    ----------
    sigma : float
        Standard deviation of one difference [Hz].
    carrier : float
        Carrier frequency [Hz].
    paper_sign : bool
        Flip the sign.
    receivers, reference, correlated, light_time, earth_rate, constants
        See `Differenced`. With light time the classical Doppler factors :math:`(c - n_i u_i)/(c - n_i v_e)` of one
        wave front are differenced, n from emitter to receiver in inertial axes, velocities those of emission and of
        each receiver's own reception.
    """

    def __init__(
        self,
        sigma: float,
        carrier: float,
        receivers: Sequence[int] = (1, 2),
        reference: int = 0,
        correlated: bool = False,
        paper_sign: bool = False,
        light_time: bool = False,
        earth_rate: float = EARTH_RATE,
        constants: GravityConstants | None = None,
    ) -> None:
        sigma = positive(sigma, "sigma_fdoa", "Hz")
        super().__init__("fdoa", "Hz", sigma, receivers, reference, correlated, light_time, earth_rate, constants)
        self.carrier = positive(carrier, "carrier", "Hz")
        self._doppler = self.carrier * (-1.0 if paper_sign else 1.0)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        scale = self._doppler if self.light_time else -self._doppler / SPEED_OF_LIGHT
        parameters = [scale, self.reference, *self.receivers]
        if self.light_time:
            return of_kernel(
                "waves:wave_fdoa",
                [*self._wave_parameters(), *parameters],
                self.size,
                states=6,
                platforms=[self.reference, *self.receivers],
            )
        return of_kernel("sight:fdoa", parameters, self.size, states=6, platforms=[self.reference, *self.receivers])
