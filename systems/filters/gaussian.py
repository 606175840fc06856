"""What a Gaussian filter is: a prediction and an update of (mean, covariance), over trials at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.kernels.equations import are_own
from quietfix.systems.kernels.updating import Update, by_kernel, by_matrix
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["GaussianFilter", "Regression", "WrappingFilter", "predict_extended"]

Array = NDArray[np.float64]


class Regression(NamedTuple):
    r"""A step of the motion as a filter sees it: :math:`x_+ \approx \bar x_+ + A (x - \bar x) + e`.

    Attributes
    ----------
    mean : ndarray, shape (trials, n)
        The mean a step later.
    transition : ndarray, shape (trials, n, n) or (n, n)
        A.
    noise : ndarray, shape (trials, n, n) or (n, n)
        Covariance of e: process noise, and what is not linear.
    """

    mean: Array
    transition: Array
    noise: Array


class GaussianFilter(ABC):
    """A filter whose belief is a mean (trials, n) and a covariance (trials, n, n)."""

    def predict(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
        """Return mean and covariance `dt` seconds later; by default the extended Kalman prediction."""
        return predict_extended(mean, covariance, motion, dt)

    def regress(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> Regression:
        """Return what `predict` takes the step for, for a smoother; by default the motion's derivative at the mean."""
        return Regression(motion.propagate(mean, dt), motion.transition(mean, dt), motion.process_noise(mean, dt))

    def whole_update(self, states: int) -> tuple[Update, Array] | None:
        """Return the compiled update and its settings, for so many states.

        None unless they are all that there is to `update` where the model has equations, and `predict` takes a linear
        motion's matrices.
        """
        return None

    @abstractmethod
    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """Return the posterior given an observation.

        Parameters
        ----------
        mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
            Prior, finite.
        observation : Observation
            What was measured.
        model : MeasurementModel
            What the filter believes of the sensor.
        """


class WrappingFilter(GaussianFilter):
    """A filter that does something before or after another one's update, and predicts as that one does.

    Attributes
    ----------
    algorithm : GaussianFilter
        The other one.
    """

    algorithm: GaussianFilter

    def predict(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
        """See `GaussianFilter.predict`."""
        return self.algorithm.predict(mean, covariance, motion, dt)

    def regress(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> Regression:
        """See `GaussianFilter.regress`."""
        return self.algorithm.regress(mean, covariance, motion, dt)


def predict_extended(mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
    r"""Predict by the motion model and its derivative: :math:`P \leftarrow \Phi P \Phi^T + Q`.

    Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, ch. 5 and 10.
    """
    step = motion.equations(dt) if are_own(type(motion)) else None
    if step is not None:
        return by_kernel(mean, covariance, step, motion.held)
    phi, noise = motion.transition(mean, dt), motion.process_noise(mean, dt)
    if motion.linear and not motion.input_size:
        return by_matrix(mean, covariance, phi, noise)
    return motion.propagate(mean, dt), by_matrix(None, covariance, phi, noise)[1]
