"""An azimuth that turns at a constant rate."""

from __future__ import annotations

from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration

__all__ = ["AzimuthRate"]


class AzimuthRate(WhiteNoiseAcceleration):
    r"""Azimuth and its rate, :math:`A = [[1, T], [0, 1]]`, equation (11) of Huang.

    doi 10.3969/j.issn.1009-086x.2017.01.020. The paper says nothing of Q; only Q = 0 gives the degradation that it
    reports, and with Q > 0 there is nothing left to restart for.

    Parameters
    ----------
    density : float
        Power spectral density of the azimuth's acceleration [rad^2/s^3], >= 0.
    """

    def __init__(self, density: float = 0.0) -> None:
        super().__init__(density, axes=1)
        self.names = ("azimuth", "azimuth_rate")
        self.units = ("rad", "rad/s")
