"""Rows of measurements that are handed over by hand, tick by tick: a program that hears them runs the diagram."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, NumericParameterIndex

from quietfix.systems.signals import EnsembleBlock

__all__ = ["HandedRows"]

Array = NDArray[np.float64]


class HandedRows(EnsembleBlock):
    r"""A block whose ports carry what its context was handed last.

    Ports ``measurement`` (1, rows), ``state`` (1, 6), and, if it is scaled, ``noise_covariance``: with D the diagonal
    matrix of the scales of a tick :math:`D R D`, as `quietfix.systems.sensors.played_rows.PlayedRows` has it. All are
    NaN, and R as it is, until something is handed over. It is a parameter of the context: what depends on it is made
    again.

    Parameters
    ----------
    noise_covariance : ndarray, shape (rows, rows)
        R, where no scale says anything else.
    scaled : bool
        Whether R comes with the measurement.
    name : str
        Name of the block.
    """

    def __init__(self, noise_covariance: Array, scaled: bool, name: str = "recorded") -> None:
        super().__init__(name)
        self._noise = np.array(noise_covariance, dtype=float)
        size = len(self._noise)
        self._indices: dict[str, int] = {}
        self._port("measurement", np.full(size, np.nan))
        self._port("state", np.full(6, np.nan))
        if scaled:
            self._port("noise_covariance", self._noise.reshape(-1))

    def _port(self, name: str, initial: Array) -> None:
        index = self._indices[name] = self.DeclareNumericParameter(BasicVector(initial))
        tickets: set[Any] = {self.numeric_parameter_ticket(NumericParameterIndex(index))}

        def value(context: Context) -> Array:
            return np.asarray(context.get_numeric_parameter(index).value())

        self.declare_output(name, 1, initial.size, value, tickets)

    def hand(self, context: Context, value: Array, scale: Array | None, state: Array) -> None:
        """Hand over a tick.

        Parameters
        ----------
        context : Context
            Of this block.
        value : ndarray, shape (rows,)
            SI units; NaN where a row is missing.
        scale : ndarray, shape (rows,), or None
            Standard deviation of each over that of R; None: as R says.
        state : ndarray, shape (6,)
            Where the target is, NaN if nobody knows.
        """
        self._set(context, "measurement", value)
        self._set(context, "state", state)
        if "noise_covariance" in self._indices:
            noise = self._noise if scale is None else scale[:, None] * self._noise * scale
            self._set(context, "noise_covariance", noise.reshape(-1))

    def _set(self, context: Context, name: str, value: Array) -> None:
        context.get_mutable_numeric_parameter(self._indices[name]).SetFromVector(value)
