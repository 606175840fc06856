"""The azimuth filtered by a linear Kalman filter, all at once or in pieces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.direct_azimuth import DirectAzimuth
from quietfix.systems.documented import choice, number
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.measurement.base import positive
from quietfix.systems.motion.azimuth_rate import AzimuthRate
from quietfix.systems.starts.start import Start

__all__ = ["AzimuthFilter", "AzimuthFilterOptions", "AzimuthStart"]

Array = NDArray[np.float64]

_SLACK = 1e-9  # of a piece: the sample at its end belongs to the next one


class AzimuthStart(Start):
    r"""Azimuth = the first bearing, rate zero, P = diag(sigma^2, sigma_rate^2).

    .. math:: x_0 = (z_0,\ 0), \qquad P_0 = \mathrm{diag}(\sigma^2,\ \sigma_{\dot\theta}^2)

    Parameters
    ----------
    stream : sequence of str
        Names of the rows on the measurement port.
    sigma : float
        Standard deviation of a bearing [rad].
    sigma_rate : float
        Standard deviation of the rate [rad/s]; the paper's p11, which it does not give, and on which its
        comparison of the two ways depends.
    """

    uses_measurement = True

    def __init__(self, stream: Sequence[str], sigma: float, sigma_rate: float) -> None:
        self.variance = np.array([positive(sigma, "sigma_bearing", "rad"), positive(sigma_rate, "sigma_rate", "rad/s")])
        self.variance **= 2
        self._row = list(stream).index("azimuth")

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        mean = np.zeros((measurement.shape[0], 2))
        mean[:, 0] = measurement[:, self._row]
        mean[~np.isfinite(mean[:, 0])] = np.nan
        return mean, np.broadcast_to(np.diag(self.variance), (mean.shape[0], 2, 2))


class AzimuthFilter(KalmanEstimator):
    r"""Linear Kalman filter [azimuth, rate]; with a piece length it is restarted again and again.

    Equations (6) to (12) and figure 2 of Huang, doi 10.3969/j.issn.1009-086x.2017.01.020. At the first bearing of every
    piece "way 1" starts anew: azimuth = bearing, rate = 0, P = diag(sigma^2, p11). "Way 2" keeps the rate. Both set
    P: with the old variance of the rate, "way 2" would not follow at all.

    The ports are those of every estimator, with the azimuth and its rate as the state (the azimuth runs on past pi).
    Besides, ``bearing`` (trials, 2) and ``bearing_covariance`` (trials, 4) are the same, but NaN where nothing was
    measured: what a locator takes for a measurement.

    .. math:: x = (\theta, \dot\theta), \qquad z = \theta + w, \qquad P(\text{start of a piece}) =
              \mathrm{diag}(\sigma^2, \sigma_{\dot\theta}^2)

    Parameters
    ----------
    name : str
        Name of the block.
    sigma : float
        Standard deviation of a bearing [rad].
    sigma_rate : float
        Standard deviation of the rate at a start [rad/s].
    density : float
        Process noise, see `AzimuthRate` [rad^2/s^3].
    piece : float
        Length of a piece [s]; infinite: one piece.
    keep_rate : bool
        False: way 1, True: way 2.
    wiring : Wiring
        What surrounds the block.
    """

    def __init__(
        self,
        name: str,
        sigma: float,
        sigma_rate: float,
        density: float,
        piece: float,
        keep_rate: bool,
        wiring: Wiring,
    ) -> None:
        if not piece > 0:
            raise ValueError(f"{name}: a piece of {piece} s is not allowed; it must be > 0 s")
        self.piece = piece
        self.keep_rate = keep_rate
        start = AzimuthStart(wiring.stream, sigma, sigma_rate)
        self._fresh = start.variance
        super().__init__(name, IteratedExtendedKalman(1), DirectAzimuth(sigma), AzimuthRate(density), start, wiring)
        after = {self.posterior_ticket, self.input_ticket("measurement")}
        self.declare_output("bearing", wiring.trials, 2, lambda c: self._where_measured(c, 0), after)
        self.declare_output("bearing_covariance", wiring.trials, 4, lambda c: self._where_measured(c, 1), after)

    def _where_measured(self, context: object, which: int) -> Array:
        value = self.posterior_moments(context)[which]
        measured = self.read(context, "measurement")[:, self._rows]
        return np.where(np.isfinite(measured), value.reshape(value.shape[0], -1), np.nan)

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`; ``piece`` is the number of the piece that a trial is in."""
        return {**super().memory_sizes(), "piece": 1}

    def _piece_at(self, time: float) -> float:
        return math.floor(time / self.piece + _SLACK) if math.isfinite(self.piece) else 0.0

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        piece = np.full((mean.shape[0], 1), self._piece_at(epoch.time))
        return {**super().begin(mean, covariance, epoch), "piece": piece}

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        return {**super().predict(memory, dt, epoch), "piece": memory["piece"]}

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`; the innovation is against the old piece."""
        posterior, innovation = super().update(memory, observation, epoch)
        piece, measured = self._piece_at(epoch.time), observation.value[:, 0]
        restart = (memory["piece"][:, 0] < piece) & np.isfinite(measured)
        if not restart.any():
            return {**posterior, "piece": memory["piece"]}, innovation
        prior = memory["mean"]
        fresh = np.empty_like(prior)
        fresh[:, 0] = prior[:, 0] + wrap(measured - prior[:, 0])
        fresh[:, 1] = prior[:, 1] if self.keep_rate else 0.0
        variance = np.array(np.broadcast_to(self._fresh, prior.shape))
        variance[:, 0] = observation.noise_covariance[..., 0, 0]
        spread = (variance[:, :, None] * np.eye(2)).reshape(prior.shape[0], 4)
        return {
            "mean": np.where(restart[:, None], fresh, posterior["mean"]),
            "covariance": np.where(restart[:, None], spread, posterior["covariance"]),
            "piece": np.where(restart[:, None], piece, memory["piece"]),
        }, innovation


@dataclass
class AzimuthFilterOptions:
    """Options of an azimuth filter."""

    sigma_rate_degps: float = number("standard deviation of the rate at a start, where it is 0 [deg/s]", 0.05, above=0)
    process_noise_deg2ps3: float = number("power spectral density of the rate's change [deg^2/s^3]", 0.0, at_least=0)
    piece_s: float | None = number("length of a piece [s]; null: one piece, never restarted", None, above=0)
    restart: str = choice(
        "at the end of a piece: all is way 1, keep_rate is way 2 of the paper", "all", ("all", "keep_rate")
    )

    def make(self, name: str, sigma: float, wiring: Wiring) -> AzimuthFilter:
        """Return the block for bearings with standard deviation `sigma` [rad]."""
        degree = math.radians(1)
        return AzimuthFilter(
            name,
            sigma,
            self.sigma_rate_degps * degree,
            self.process_noise_deg2ps3 * degree**2,
            math.inf if self.piece_s is None else self.piece_s,
            self.restart == "keep_rate",
            wiring,
        )
