"""How an estimator starts: from a given belief, from a port, or from its first measurement."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["CloudStart", "GivenStart", "PortStart", "Start"]

Array = NDArray[np.float64]


class Start(ABC):
    """Makes the first belief of an estimator.

    Attributes
    ----------
    uses_measurement : bool
        True where the belief is made from the measurement of the same instant, which is then not used again.
    inputs : mapping of str to int
        Further input ports that the estimator declares for its start, with their sizes.
    count : int
        Most hypotheses that it gives in a trial; more than one only to an estimator that can tell them apart.
    again : Start or None
        How a trial that is lost can begin again from a measurement alone; None where nothing is known of that. Its
        `inputs` are among those of this start.
    uses : MeasurementModel or None
        The rows that the belief is made of, efficiently: the mean depends on them as :math:`P H^T R^{-1}` says. None
        where that is not so, or no measurement is used.
    noise_input : str or None
        The input that R of all rows comes with, where it comes with the measurement.
    """

    uses_measurement: bool = False
    count: int = 1
    again: Start | None = None
    uses: MeasurementModel | None = None
    noise_input: str | None = None

    @property
    def inputs(self) -> Mapping[str, int]:
        """See the class."""
        return {}

    @abstractmethod
    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return mean (trials, n) and covariance (trials, n, n); NaN in a trial that cannot start yet.

        Parameters
        ----------
        measurement : ndarray, shape (trials, rows)
            Everything that the measurement port carries at this instant.
        platforms : ndarray, shape (1 or trials, p, 6)
            Known platforms.
        inputs : mapping of str to ndarray, shape (trials, size)
            What the ports named by `inputs` carry.
        """

    def covariance_at(self, target: Array, platforms: Array) -> Array | None:
        """Return the covariance of the start at the truth, the prior of a bound; None where a start cannot say it.

        Parameters
        ----------
        target : ndarray, shape (trials or 1, n)
        platforms : ndarray, shape (trials or 1, p, 6)

        Returns
        -------
        ndarray, shape (trials or 1, n, n), or None
        """
        return None


class CloudStart(Start):
    """A start that can also draw from what it knows, where one Gaussian cannot say it."""

    @abstractmethod
    def cloud(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], white: Array
    ) -> tuple[Array, Array]:
        """Return particles (trials, particles, n) and their log weights (trials, particles), up to a constant.

        NaN in a trial that cannot start yet.

        Parameters
        ----------
        measurement, platforms, inputs
            See `Start.begin`.
        white : ndarray, shape (trials, particles, n)
            Standard normal numbers, which the draws are made of.
        """


class GivenStart(Start):
    r"""Start every trial from one belief.

    .. math:: x_0 = \bar x, \qquad P_0 = \bar P

    Parameters
    ----------
    mean : array_like, shape (n,) or (trials, n)
    covariance : array_like, shape (n, n) or (trials, n, n)
    """

    def __init__(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        self._mean = np.array(mean, dtype=float)
        self._covariance = np.array(covariance, dtype=float)
        n = self._mean.shape[-1]
        if self._covariance.shape[-2:] != (n, n):
            raise ValueError(f"start: covariance {self._covariance.shape} does not fit a mean of {n} states")

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        trials, n = measurement.shape[0], self._mean.shape[-1]
        for what, own in (("mean", self._mean.shape[:-1]), ("covariance", self._covariance.shape[:-2])):
            if own not in ((), (1,), (trials,)):
                raise ValueError(f"start: the {what} is for {own[0]} trials, there are {trials}")
        return np.broadcast_to(self._mean, (trials, n)), np.broadcast_to(self._covariance, (trials, n, n))

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `Start.covariance_at`."""
        return self._covariance if self._covariance.ndim == 3 else self._covariance[None]


class PortStart(Start):
    r"""Start from a prior mean that arrives on the port ``initial_estimate``, with a given covariance.

    Connect a block that draws it around the truth (a prior is a measurement made before the run).

    .. math:: x_0 = \bar x_{\mathrm{port}}, \qquad P_0 = \bar P

    Parameters
    ----------
    covariance : array_like, shape (n, n)
    """

    def __init__(self, covariance: ArrayLike) -> None:
        self._covariance = np.array(covariance, dtype=float)

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {"initial_estimate": self._covariance.shape[-1]}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        mean = inputs["initial_estimate"]
        return mean, np.broadcast_to(self._covariance, (mean.shape[0], *self._covariance.shape))

    def covariance_at(self, target: Array, platforms: Array) -> Array:
        """See `Start.covariance_at`."""
        return self._covariance[None]
