"""Where to search the cross-ambiguity function: from a track's prediction, or from a direction and a height."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.angles.direction import BodyDirection
from quietfix.systems.earth.geodetic import up
from quietfix.systems.fixes.ray_height import ray_at_height
from quietfix.systems.linear_algebra import inverses
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.signals import EnsembleBlock

__all__ = ["SearchWindow", "delay_doppler_spread", "direction_belief"]

Array = NDArray[np.float64]

_RATIO = 1.5  # factor between two sizes of window


def delay_doppler_spread(
    model: MeasurementModel, mean: Array, covariance: Array, platforms: Array
) -> tuple[Array, Array]:
    """Return what a belief says about TDOA and FDOA, to first order.

    Parameters
    ----------
    model : MeasurementModel
        Its rows are the TDOA [s] and the FDOA [Hz].
    mean, covariance : ndarray, shape (..., 6) and (..., 6, 6)
        Belief about position [m] and velocity [m/s].
    platforms : ndarray, shape (..., p, 6)
        The platforms.

    Returns
    -------
    centre, sigma : ndarray, shape (..., 2)
        Predicted values, and standard deviations with the measurement's own noise.
    """
    centre, jacobian = model.linearize(mean, platforms)
    variance = np.einsum("...ij,...jk,...ik->...i", jacobian[..., :6], covariance, jacobian[..., :6])
    own = np.diagonal(model.noise_covariance())
    return centre, np.sqrt(np.maximum(variance, 0.0) + own)


def direction_belief(
    measured: Array, platforms: Array, model: BodyDirection, height: float, sigma_height: float, sigma_velocity: float
) -> tuple[Array, Array]:
    """Return the belief that a direction and a height leave, to first order; nothing is known of the velocity.

    Parameters
    ----------
    measured : ndarray, shape (..., 2)
        The direction.
    platforms : ndarray, shape (..., p, 6)
        The platforms.
    model : BodyDirection
        What was measured, and how well.
    height, sigma_height : float
        Of the target above the ellipsoid, and its standard deviation [m].
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].

    Returns
    -------
    mean, covariance : ndarray, shape (..., 6) and (..., 6, 6)
        NaN where the direction does not come down to the height.
    """
    origin = np.broadcast_to(platforms[..., model.platform, :3], (*measured.shape[:-1], 3))
    place = ray_at_height(origin, model.unit_vector(measured, platforms), np.full(measured.shape[:-1], height))
    mean = np.concatenate([place, np.zeros_like(place)], axis=-1)
    covariance = np.full((*mean.shape, 6), np.nan)
    able = np.isfinite(place).all(axis=-1)
    if able.any():
        able_platforms = np.broadcast_to(platforms, (*measured.shape[:-1], *platforms.shape[-2:]))[able]
        rows = np.concatenate(
            [model.jacobian(mean[able], able_platforms)[..., :3], up(place[able])[..., None, :]], axis=-2
        )
        noise = np.zeros((3, 3))
        noise[:2, :2], noise[2, 2] = model.noise_covariance(), sigma_height**2
        inverse = inverses(rows)
        full = np.zeros((int(able.sum()), 6, 6))
        full[:, :3, :3] = inverse @ noise @ np.swapaxes(inverse, -1, -2)
        full[:, 3:, 3:] = sigma_velocity**2 * np.eye(3)
        covariance[able] = full
    return mean, covariance


class SearchWindow(EnsembleBlock):
    r"""Say where the peak of the cross-ambiguity function is to be sought.

    Inputs ``direction`` (2), ``platforms`` and, with `feedback`, an estimator's ``prediction`` (6) and
    ``prediction_covariance`` (36). Output ``window`` (4): centre of the TDOA [s] and of the FDOA [Hz], and the
    half-widths.

    The window is the predicted value plus and minus so many standard deviations; where there is no prediction, or
    none yet, that of a target at rest where the direction reaches a height. Its half-widths are rounded up to a few
    sizes, powers of 1.5 times the least, so that trials can be worked on together. NaN where nothing is known.

    .. math:: h(x^-) \pm k\,\sqrt{\mathrm{diag}(H P^- H^T + R)}

    Parameters
    ----------
    direction : BodyDirection
        The direction as it is believed to be measured.
    delay, doppler : Tdoa, Fdoa
        The differences, of two receivers, as they are believed to be.
    trials, platforms : int
        Trials, and number of platforms on the port.
    least_half_delay, least_half_frequency : float
        Smallest half-widths [s], [Hz], > 0: some cells of the function.
    sigmas : float
        Half-width in standard deviations, > 0.
    height, sigma_height : float
        Assumed height of the target and its standard deviation [m].
    sigma_velocity : float
        Standard deviation of the target's velocity per axis [m/s].
    largest_half_delay, largest_half_frequency : float
        Largest half-widths [s], [Hz]: the baseline in light time, or less than half of an ambiguity.
    feedback : bool
        Whether there is a prediction.
    platform_trials : int
        Trials of the platforms' states.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        direction: BodyDirection,
        delay: Tdoa,
        doppler: Fdoa,
        trials: int,
        platforms: int,
        least_half_delay: float,
        least_half_frequency: float,
        sigmas: float = 5.0,
        height: float = 10e3,
        sigma_height: float = 3e3,
        sigma_velocity: float = 200.0,
        largest_half_delay: float = math.inf,
        largest_half_frequency: float = math.inf,
        feedback: bool = True,
        platform_trials: int = 1,
        name: str = "search_window",
    ) -> None:
        super().__init__(name)
        self._direction, self._differences = direction, Stack([delay, doppler])
        if self._differences.size != 2:
            raise ValueError(f"{name}: {list(self._differences.names)} are not allowed; one TDOA and one FDOA")
        self._least = np.array(
            [
                positive(least_half_delay, "least_half_delay", "s"),
                positive(least_half_frequency, "least_half_frequency", "Hz"),
            ]
        )
        self._largest = np.array([largest_half_delay, largest_half_frequency])
        if not np.all(self._largest >= self._least):
            raise ValueError(
                f"largest half-widths of the window: {largest_half_delay} s, {largest_half_frequency} Hz are not "
                f"allowed; at least the smallest, {least_half_delay} s, {least_half_frequency} Hz"
            )
        self._sigmas = positive(sigmas, "sigmas", "")
        self._height, self._sigma_height = height, positive(sigma_height, "sigma_height", "m")
        self._sigma_velocity = positive(sigma_velocity, "sigma_velocity", "m/s")
        self._trials, self._platforms, self._feedback = trials, platforms, feedback
        self.declare_input("direction", trials, 2)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        ports = ["direction", "platforms"]
        if feedback:
            self.declare_input("prediction", trials, 6)
            self.declare_input("prediction_covariance", trials, 36)
            ports += ["prediction", "prediction_covariance"]
        self.declare_output("window", trials, 4, self._window, {self.input_ticket(port) for port in ports})

    def _window(self, context: Context) -> Array:
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        platforms = np.broadcast_to(platforms, (self._trials, self._platforms, 6))
        mean, covariance = np.full((self._trials, 6), np.nan), np.full((self._trials, 6, 6), np.nan)
        if self._feedback:
            mean = self.read(context, "prediction").copy()
            covariance = self.read(context, "prediction_covariance").reshape(-1, 6, 6).copy()
        lost = ~(np.isfinite(mean).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2)))
        if lost.any():
            mean[lost], covariance[lost] = direction_belief(
                self.read(context, "direction")[lost],
                platforms[lost],
                self._direction,
                self._height,
                self._sigma_height,
                self._sigma_velocity,
            )
        centre, sigma = delay_doppler_spread(self._differences, mean, covariance, platforms)
        return np.concatenate([centre, self._half_width(sigma)], axis=-1)

    def _half_width(self, sigma: Array) -> Array:
        wanted = np.maximum(self._sigmas * np.where(np.isfinite(sigma), sigma, 0.0) / self._least, 1.0)
        steps = np.ceil(np.log(wanted) / math.log(_RATIO) - 1e-9)
        return np.minimum(self._least * _RATIO**steps, self._largest)
