"""Measurements of several sensors as one, with one noise covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import Component, EnsembleBlock

__all__ = ["JoinedMeasurements", "JoinedPart"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JoinedPart:
    """What one sensor contributes.

    Parameters
    ----------
    rows : int
        Number of its rows.
    noise_covariance : array_like, shape (rows, rows), optional
        Of its errors; None where it comes on a port.
    components : sequence of Component
        Names and SI units of its rows; empty: nobody says them.
    """

    rows: int
    noise_covariance: ArrayLike | None = None
    components: Sequence[Component] = ()


class JoinedMeasurements(EnsembleBlock):
    r"""Put the rows of several sensors, whose errors are independent, side by side.

    Inputs: a port NAME for the measurement of each part, and ``NAME_noise_covariance`` where its covariance varies.
    Outputs ``measurement`` and ``noise_covariance``, rows in the order of the parts.

    .. math:: z = [z_1;\ z_2;\ ...], \qquad R = \mathrm{blockdiag}(R_1, R_2, ...)

    Parameters
    ----------
    parts : mapping of str to JoinedPart
        By the name of the port.
    trials : int
        Trials of the measurements.
    name : str
        Name of the block.
    """

    def __init__(self, parts: Mapping[str, JoinedPart], trials: int, name: str = "measurements") -> None:
        super().__init__(name)
        if not parts:
            raise ValueError(f"{name}: no measurement is given; at least one is needed")
        self._parts, self._trials = dict(parts), trials
        self._fixed: dict[str, Array] = {}
        size = sum(part.rows for part in parts.values())
        measured, noisy = [], []
        for port, part in parts.items():
            self.declare_input(port, trials, part.rows)
            measured.append(self.input_ticket(port))
            if part.noise_covariance is None:
                self.declare_input(f"{port}_noise_covariance", trials, part.rows**2)
                noisy.append(self.input_ticket(f"{port}_noise_covariance"))
                continue
            fixed = np.array(part.noise_covariance, dtype=float)
            if fixed.shape != (part.rows, part.rows):
                raise ValueError(f"{port} noise_covariance: shape {fixed.shape} is not allowed; {(part.rows,) * 2}")
            self._fixed[port] = fixed
        rows = [row for part in parts.values() for row in part.components]
        named = rows if len(rows) == size else None
        square = named and [Component(f"{a.name}_{b.name}", f"{a.unit} {b.unit}") for a in named for b in named]
        self.declare_output("measurement", trials, size, self._measurement, measured, named)
        self.declare_output("noise_covariance", trials, size**2, self._noise, noisy or [self.nothing_ticket()], square)

    def _measurement(self, context: Context) -> Array:
        return np.concatenate([self.read(context, port) for port in self._parts], axis=-1)

    def _noise(self, context: Context) -> Array:
        size = sum(part.rows for part in self._parts.values())
        out = np.zeros((self._trials, size, size))
        first = 0
        for port, part in self._parts.items():
            end = first + part.rows
            own = self._fixed.get(port)
            if own is None:
                own = self.read(context, f"{port}_noise_covariance").reshape(-1, part.rows, part.rows)
            out[:, first:end, first:end] = own
            first = end
        return out
