"""What goes wrong with the numbers of a sensor: offsets, gross errors, missing rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.noise import normal, uniform
from quietfix.systems.signals import Draw, EnsembleBlock

__all__ = ["ReadingError"]

Array = NDArray[np.float64]


class ReadingError(EnsembleBlock):
    r"""Impair a measurement; put it behind the sensor.

    Input and output ``measurement``. Every row of every trial and tick is impaired independently; with the same seed a
    larger rate impairs the same rows and more.

    .. math:: z' = z + b + B w + o\,k\,\mathrm{diag}(\sigma)\,g, \qquad w, g \sim N(0, I)

    with o = 1 in a share `outlier_rate` of the rows and 0 in the others, k the scale of gross errors.

    Parameters
    ----------
    model : MeasurementModel
        The sensor's, for the size of the gross errors and for wrapping.
    clock : Clock
        The sensor's.
    trials : int
        Trials of the measurement.
    bias : array_like, shape (m,), optional
        Added to the rows in every trial, in their units.
    bias_root : array_like, shape (m, k), optional
        ``bias_root @ w``, w standard normal, is added to the rows: constant through a run, drawn per trial.
    outlier_rate : float
        Share of the rows with a gross error, 0 to 1.
    outlier_scale : float
        Standard deviation of a gross error over that of the row's noise, > 0.
    drop_out_rate : float
        Share of the rows that are missing (NaN), 0 to 1.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        model: MeasurementModel,
        clock: Clock,
        trials: int,
        bias: ArrayLike | None = None,
        bias_root: ArrayLike | None = None,
        outlier_rate: float = 0.0,
        outlier_scale: float = 20.0,
        drop_out_rate: float = 0.0,
        name: str = "reading_error",
    ) -> None:
        super().__init__(name)
        size = model.size
        self._bias = np.zeros(size) if bias is None else np.array(bias, dtype=float)
        self._root = np.zeros((size, 0)) if bias_root is None else np.array(bias_root, dtype=float)
        if self._bias.shape != (size,) or self._root.ndim != 2 or self._root.shape[0] != size:
            raise ValueError(f"{name}: biases {self._bias.shape}, {self._root.shape} do not fit {size} rows")
        for what, rate in (("outlier", outlier_rate), ("drop_out", drop_out_rate)):
            if not 0 <= rate <= 1:
                raise ValueError(f"{name}: {what}_rate {rate} is not allowed; 0 to 1")
        if not (math.isfinite(outlier_scale) and outlier_scale > 0):
            raise ValueError(f"{name}: outlier_scale {outlier_scale} is not allowed; it must be > 0")
        self.model, self.clock, self.trials = model, clock, trials
        self._outlier_rate, self._drop_out_rate = outlier_rate, drop_out_rate
        self._gross = outlier_scale * model.sigmas
        self.declare_input("measurement", trials, size)
        tickets = {self.input_ticket("measurement"), self.time_ticket(), self.declare_draw()}
        self.declare_output("measurement", trials, size, self._calc, tickets)

    def _calc(self, context: Context) -> Array:
        measured = self.read(context, "measurement")
        tick = self.clock.index(context.get_time())
        return measured if tick is None else self.impair(measured, self.draw(context), tick)

    def impair(self, measured: Array, draw: Draw, tick: int) -> Array:
        """Return the impaired measurement (trials, m) of one tick."""
        size, name = self.model.size, self.noise_name()
        who = (draw.first_trial, self.trials)
        impaired = measured + self._bias
        if self._root.shape[1]:
            white = normal(draw.seed, f"{name}:bias", *who, 0, self._root.shape[1])
            impaired = impaired + np.einsum("ij,...j->...i", self._root, white)
        if self._outlier_rate:
            struck = uniform(draw.seed, f"{name}:outlier", *who, tick, size) < self._outlier_rate
            impaired = impaired + np.where(
                struck, self._gross * normal(draw.seed, f"{name}:gross", *who, tick, size), 0.0
            )
        impaired = self.model.represent(impaired)
        if self._drop_out_rate:
            gone = uniform(draw.seed, f"{name}:drop_out", *who, tick, size) < self._drop_out_rate
            impaired = np.where(gone, np.nan, impaired)
        return impaired
