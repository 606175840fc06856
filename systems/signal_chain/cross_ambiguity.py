"""The cross-ambiguity block: from I/Q samples of two receivers to TDOA and FDOA."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.ambiguity.differences import Differences, Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.clocks import Clock
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.signals import EnsembleBlock, check_trials

__all__ = ["QUALITY", "Aim", "CrossAmbiguitySensor"]

Array = NDArray[np.float64]

QUALITY = ("peak_to_noise", "confidence", "right_cell", "coherence", "flag", "stein_tdoa", "stein_fdoa")
"""What the port ``quality`` carries: see `Differences`; the last two are variances."""


@dataclass(frozen=True, eq=False)
class Aim:
    """A window about what the estimator expects.

    Parameters
    ----------
    model : MeasurementModel
        What the estimator believes; its first rows ``tdoa...`` and ``fdoa...`` are the centre.
    platforms : int
        Platforms on the port ``platforms``.
    state : int
        Size of the estimator's state.
    half_delay, half_frequency : float
        Half-widths [s], [Hz]: of the window, or the least ones if there are `sigmas`.
    sigmas : float
        So many standard deviations of the prediction are half of the window, which then differs from trial to trial;
        0: the half-widths are fixed, and there is no port ``prediction_covariance``.
    platform_trials : int
        1 where all trials share the platforms.

    Raises
    ------
    ValueError
        If the model has no such rows, or a number is out of its range.
    """

    model: MeasurementModel
    platforms: int
    state: int
    half_delay: float
    half_frequency: float
    sigmas: float = 0.0
    platform_trials: int = 1

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name in ("half_delay", "half_frequency", "sigmas"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"aim {name}: {value} is not allowed; finite and >= 0")
        _ = self.rows

    @property
    def rows(self) -> list[int]:
        """Rows of TDOA and FDOA in the model."""
        found = []
        for kind in ("tdoa", "fdoa"):
            rows = [i for i, name in enumerate(self.model.names) if name.startswith(kind)]
            if not rows:
                raise ValueError(f"aim model: rows {list(self.model.names)} are not allowed; one {kind} at least")
            found.append(rows[0])
        return found

    def window(self, state: Array, covariance: Array | None, platforms: Array, blind: Window) -> Window:
        """Return the window; where the state is NaN, `blind`.

        Parameters
        ----------
        state : ndarray, shape (trials, n)
            Prediction.
        covariance : ndarray, shape (trials, n, n), optional
            Its covariance; needed for `sigmas`.
        platforms : ndarray, shape (trials or 1, p, 6)
            Platforms.
        blind : Window
            For trials without a prediction.
        """
        known = np.asarray(np.isfinite(state).all(axis=-1))
        value, jacobian = self.model.linearize(state, platforms)
        half = np.broadcast_to([self.half_delay, self.half_frequency], (state.shape[0], 2))
        if covariance is not None:
            h = jacobian[..., self.rows, :]
            variance = np.einsum("nij,njk,nik->ni", h, covariance, h)
            half = np.maximum(half, self.sigmas * np.sqrt(np.maximum(variance, 0.0)))
            known = known & np.isfinite(half).all(axis=1)
        aimed = np.concatenate([value[:, self.rows], half], axis=-1)
        known &= np.isfinite(aimed).all(axis=-1)
        fallback = np.stack(blind.over(state.shape[0]), axis=-1)
        return Window(*np.where(known[:, None], aimed, fallback).T)


class CrossAmbiguitySensor(EnsembleBlock):
    r"""Compare what two receivers heard.

    Inputs ``main`` and ``auxiliary`` (each an `IqBlock`); with an `Aim` also ``prediction``, ``platforms`` and perhaps
    ``prediction_covariance``; without a window ``window`` (trials, 4), the fields of a `Window`, where a trial with a
    NaN has no measurement. Outputs ``measurement`` (trials, 2), TDOA [s] and FDOA [Hz] at the middle of the main
    receiver's block; ``noise_covariance`` (trials, 4), 2 x 2; ``quality`` (trials, 7), see `QUALITY`. All are NaN
    between the ticks of the clock; `IqBlock` ports are not read there.

    A measurement depends on the prediction through the place of the window only. An estimator's prediction does not
    feed through, so that it may come from the estimator that the measurement goes to.

    .. math:: (\hat\tau, \hat f) = \arg\max |A(\tau, f)|, \qquad
              A(\tau, f) = \sum_n \bar x_n\,y_n(\tau)\,e^{-2\pi j f t_n}

    Stein, *Algorithms for ambiguity function processing*, IEEE Trans. ASSP-29 (1981) 588.

    Parameters
    ----------
    function : CrossAmbiguity
        How blocks are compared.
    window : Window or None
        Where the peak is sought; with an `Aim`, for trials that have no prediction yet. None: it comes on the port
        ``window``.
    clock : Clock
        When there are blocks to be compared.
    trials : int
        Trials of the measurement.
    aim : Aim, optional
        A window about the estimator's prediction.
    keep_flagged : bool
        Pass on estimates that are flagged as well; otherwise they are NaN, and only ``quality`` tells of them.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        function: CrossAmbiguity,
        window: Window | None,
        clock: Clock,
        trials: int,
        aim: Aim | None = None,
        keep_flagged: bool = False,
        name: str = "cross_ambiguity",
    ) -> None:
        super().__init__(name)
        self.function = function
        self.clock = clock
        self.trials = check_trials(trials)
        self.keep_flagged = keep_flagged
        self._blind = None if window is None else Window(*window.over(self.trials))
        self._aim = aim
        if aim is not None and window is None:
            raise ValueError(f"{name}: an aim needs a window for trials without a prediction")
        inputs = ["main", "auxiliary"]
        for port in inputs:
            self.declare_abstract_input(port, IqBlock)
        if window is None:
            self.declare_input("window", trials, 4)
            inputs.append("window")
        if aim is not None:
            if aim.platform_trials not in (1, trials):
                raise ValueError(f"{name}: platforms have {aim.platform_trials} trials; 1 or {trials} are allowed")
            self.declare_input("prediction", trials, aim.state)
            self.declare_input("platforms", aim.platform_trials, 6 * aim.platforms)
            inputs += ["prediction", "platforms"]
            if aim.sigmas > 0:
                self.declare_input("prediction_covariance", trials, aim.state**2)
                inputs.append("prediction_covariance")
        tickets = {self.time_ticket(), *(self.input_ticket(port) for port in inputs)}
        self._found = self.declare_cached("differences", CrossAmbiguitySensor._compare, tickets)
        after = {self.cached_ticket(self._found)}
        rows = (("tdoa", "s"), ("fdoa", "Hz"))
        self.declare_output("measurement", self.trials, 2, self._measurement, after, rows)
        square = [(f"{one}_{other}", f"{unit} {per}") for one, unit in rows for other, per in rows]
        self.declare_output("noise_covariance", self.trials, 4, self._noise_covariance, after, square)
        units = {"stein_tdoa": "s", "stein_fdoa": "Hz"}
        named = [(name, units.get(name, "1")) for name in QUALITY]
        self.declare_output("quality", self.trials, len(QUALITY), self._quality, after, named)

    def window(self, context: Context) -> Window:
        """Return where the peak is sought now."""
        aim = self._aim
        if self._blind is None:
            given = self.read(context, "window")
            known = np.asarray(np.isfinite(given).all(axis=-1))
            return Window(*np.where(known[:, None], given, [np.nan, np.nan, 0.0, 0.0]).T)
        if aim is None:
            return self._blind
        state = self.read(context, "prediction")
        covariance = None
        if aim.sigmas > 0:
            covariance = self.read(context, "prediction_covariance").reshape(self.trials, aim.state, aim.state)
        platforms = self.read(context, "platforms").reshape(-1, aim.platforms, 6)
        return aim.window(state, covariance, platforms, self._blind)

    def _compare(self, context: Context) -> Differences | None:
        if self.clock.index(context.get_time()) is None:
            return None
        blocks = []
        for port in ("main", "auxiliary"):
            block = self.read_abstract(context, port)
            if block.trials not in (1, self.trials):
                raise ValueError(f"{self.get_name()}: {port} has {block.trials} trials; 1 or {self.trials} are allowed")
            blocks.append(block)
        return self.function(blocks[0], blocks[1], self.window(context))

    def _passed(self, found: Differences) -> NDArray[np.bool_]:
        passed: NDArray[np.bool_] = np.array(found.flag) == 0
        return passed | self.keep_flagged

    def _measurement(self, context: Context) -> Array:
        found = self.cached(context, self._found)
        if found is None:
            return np.full((self.trials, 2), np.nan)
        both = np.stack([found.delay, found.frequency], axis=-1)
        return np.where(self._passed(found)[:, None], both, np.nan)

    def _noise_covariance(self, context: Context) -> Array:
        found = self.cached(context, self._found)
        covariance = np.full((self.trials, 2, 2), np.nan)
        if found is not None:
            passed = self._passed(found)[:, None, None]
            covariance = np.where(passed, found.variance[:, :, None] * np.eye(2), np.nan)
        return covariance

    def _quality(self, context: Context) -> Array:
        found = self.cached(context, self._found)
        if found is None:
            return np.full((self.trials, len(QUALITY)), np.nan)
        columns = (found.peak, found.confidence, found.right_cell, found.coherence, found.flag)
        return np.concatenate([np.stack(columns, axis=-1), found.stein], axis=-1)
