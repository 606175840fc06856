"""What arrives, and what an estimator that goes back takes in the place of a measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Observation
from quietfix.systems.starts.start import Start

__all__ = ["Arrived", "Clearing", "FedStart"]

Array = NDArray[np.float64]


class Clearing(Protocol):
    """Makes of what was measured, and what was known before, what an estimator takes: phases without their cycles.

    Attributes
    ----------
    stream : sequence of str
        Names of the rows that come out.
    """

    stream: Sequence[str]

    def cleared(self, stream: Array, prediction: Array, platforms: Array) -> tuple[Array, Array]:
        """Return rows (trials, len(stream)) of an instant, and what was added to some.

        Parameters
        ----------
        stream : ndarray, shape (trials, rows)
            All that was measured.
        prediction : ndarray, shape (trials, n)
            The state then; NaN in a trial that has not begun.
        platforms : ndarray, shape (1 or trials, p, 6)
        """


@dataclass(frozen=True, slots=True)
class Arrived(Observation):
    """What arrives at one instant.

    `value` is (trials, ages, rows of the stream), made at `made` (trials, ages) [s], with the noise covariances `noise`
    (trials, ages, rows, rows) where they come with it; `inputs` are what else there is now.
    """

    made: Array
    noise: Array | None
    inputs: Mapping[str, Array]


class FedStart(Start):
    """A start whose ports are also those of what arrives."""

    def __init__(self, start: Start, ports: Mapping[str, int]) -> None:
        self._start, self._ports = start, ports
        self.uses_measurement, self.count = start.uses_measurement, start.count
        self.noise_input = start.noise_input

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {**self._start.inputs, **self._ports}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        return self._start.begin(measurement, platforms, inputs)

    def covariance_at(self, target: Array, platforms: Array) -> Array | None:
        """See `Start.covariance_at`."""
        return self._start.covariance_at(target, platforms)
