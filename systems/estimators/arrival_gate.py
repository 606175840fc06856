r"""A gate for arrival times: leaves out the one receiver that contradicts the others.

TDOA rows are differences against receiver 0, so one bad receiver i > 0 corrupts one row, and a bad receiver 0 all of
them. Either can be taken out of the same rows. Each receiver's own error has variance :math:`s^2`, so the differences
have

.. math:: R_S = s^2 I + S\,1 1^T, \qquad S = s^2,

and by the formula of Sherman and Morrison

.. math:: R_S^{-1} = \frac{1}{s^2}\left(I - \frac{S}{s^2 + n S}\,1 1^T\right)
          \ \to\ \frac{1}{s^2}\left(I - \frac{1}{n}\,1 1^T\right) \quad (S \to \infty),

which annihilates what all differences have in common: receiver 0's error. What is left is the information of the
differences among receivers 1 to n, whichever of them is the reference. So a receiver i > 0 is left out by a NaN row,
and receiver 0 by a huge S; the estimator takes R from the port.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context
from scipy.stats import chi2

from quietfix.systems.fixes.snapshot import snapshot_fix, starts_around
from quietfix.systems.measurement.base import MeasurementModel, positive
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.signals import EnsembleBlock

__all__ = ["KEPT", "REFUSED", "ArrivalGate", "without_receivers"]

Array = NDArray[np.float64]

KEPT = -1
"""Value of ``excluded`` where all receivers agree, or there is nothing to judge."""
REFUSED = -2
"""Value of ``excluded`` where leaving out one receiver does not help: no row passes."""

_DECISIVE = 6.0  # difference of costs: the best case is e^3 = 20 times as likely as the next
_HUGE = 1e6  # S / s^2: what is left of receiver 0 is a weight of 1e-6 / n^2, and R is still well conditioned


def without_receivers(
    model: MeasurementModel, tdoa: Tdoa, noise: Array | None = None
) -> tuple[NDArray[np.bool_], Array]:
    """Return how rows and R look with all receivers, and with each of them left out.

    Parameters
    ----------
    model : MeasurementModel
        What is measured; `tdoa` is a part of it.
    tdoa : Tdoa
        The differences, correlated through the reference receiver.
    noise : ndarray, shape (..., m, m), optional
        R with all receivers, where it is not the model's.

    Returns
    -------
    dropped : ndarray, shape (1 + receivers, m)
        Rows that go. Entry 0: all receivers are in; entry 1: the reference is out; then those of `tdoa.receivers`.
    noise : ndarray, shape (..., 1 + receivers, m, m)
        R.
    """
    rows = [model.names.index(name) for name in tdoa.names]
    cases = 2 + len(rows)
    dropped = np.zeros((cases, model.size), dtype=bool)
    dropped[np.arange(2, cases), rows] = True
    given = model.noise_covariance() if noise is None else noise
    found = np.repeat(given[..., None, :, :], cases, axis=-3)
    found[..., 1, np.array(rows)[:, None], rows] += _HUGE * given[..., rows[0], rows[0], None, None] / 2
    return dropped, found


class ArrivalGate(EnsembleBlock):
    """Test arrival times for consistency, and leave one receiver out where that restores it.

    Inputs ``measurement``, ``platforms``, with `noise_port` ``noise_covariance`` and, with `feedback`, ``prediction``
    and ``prediction_covariance`` of the estimator behind it. Outputs ``measurement`` and ``noise_covariance``, which
    say together what is left out (see the module), and ``excluded``: the platform left out, or `KEPT`, or `REFUSED`.

    A case (all receivers, or all but one) passes if its least-squares cost is below the chi-square quantile of its
    redundancy. The cases are tried in this order, in each trial by itself:

    1. all receivers, together with the prediction;
    2. all but one, together with the prediction;
    3. all receivers by themselves: they agree with each other, so it is the prediction that is wrong;
    4. all but one, by themselves;
    5. otherwise the measurement is refused: all its rows become NaN.

    Where several cases of 2 or 4 pass, the best is taken if it is 20 times as likely as the next, and none if it is
    not. Without a prediction (not connected, or the estimator has not begun) 1 and 2 fall away. Five arrival times and
    a height have two degrees of freedom then, of which leaving one out takes one: an error is nearly always found, but
    whose it is remains open in a fifth to two fifths of the geometries. The prediction, though it may be `slack` times
    worse than it says, decides most of these.

    The estimator's ``nis_dof`` counts rows; it is one too many where the reference is left out.

    Parameters
    ----------
    model : MeasurementModel
        What is measured: the rows of the port, in their order; it must not depend on the velocity.
    tdoa : Tdoa
        The part of it that is arrival times; correlated.
    trials, platforms : int
        Trials, and number of platforms on the port.
    height : str
        Name of the row that gives the height at which the search for a fix begins.
    false_alarm : float
        Probability that a sound measurement fails the test.
    slack : float
        A prediction is believed to so many times its standard deviation: targets manoeuvre.
    platform_trials : int
        Trials of the platforms' states.
    feedback : int
        Number of states of the estimator whose prediction is fed back; 0: none is.
    name : str
        Name of the block.
    noise_port : bool
        Whether R comes with the measurement; else it is the model's.

    Raises
    ------
    ValueError
        If `tdoa` is not correlated or not part of `model`, or a row or a number is not allowed.
    """

    def __init__(
        self,
        model: MeasurementModel,
        tdoa: Tdoa,
        trials: int,
        platforms: int,
        height: str,
        false_alarm: float = 1e-3,
        slack: float = 3.0,
        platform_trials: int = 1,
        feedback: int = 6,
        name: str = "gate",
        noise_port: bool = False,
    ) -> None:
        super().__init__(name)
        if not tdoa.correlated:
            raise ValueError(f"{name}: arrival times need a TDOA model that is correlated through its reference")
        absent = [row for row in (*tdoa.names, height) if row not in model.names]
        if absent:
            raise ValueError(f"{name}: rows {absent} are not measured; there are {list(model.names)}")
        if not 0 < false_alarm < 1:
            raise ValueError(f"{name}: false_alarm {false_alarm} is not allowed; between 0 and 1")
        self.model, self._tdoa = model, tdoa
        self.trials = trials
        self._noise_port = noise_port
        self._platforms = platforms
        self._states = feedback
        self._slack = positive(slack, f"{name}: slack", "")
        self._height = model.names.index(height)
        self._dropped, self._noise = without_receivers(model, tdoa)
        self._receivers = np.array([KEPT, tdoa.reference, *tdoa.receivers])
        self._limits = np.concatenate([[-np.inf], chi2.isf(false_alarm, np.arange(1, model.size + 1))])

        self.declare_input("measurement", trials, model.size)
        self.declare_input("platforms", platform_trials, 6 * platforms)
        if noise_port:
            self.declare_input("noise_covariance", trials, model.size**2)
        if feedback:
            self.declare_input("prediction", trials, feedback)
            self.declare_input("prediction_covariance", trials, feedback**2)
        inputs = {self.input_port_ticket(self.get_input_port(i).get_index()) for i in range(self.num_input_ports())}
        self._judged = self.declare_cached("judged", ArrivalGate._judge, inputs)
        ticket = {self.cached_ticket(self._judged)}
        rows = model.size
        self.declare_output("measurement", trials, rows, lambda c: self.cached(c, self._judged)[0], ticket)
        self.declare_output("noise_covariance", trials, rows**2, lambda c: self.cached(c, self._judged)[1], ticket)
        left_out = [("excluded", "1")]
        self.declare_output("excluded", trials, 1, lambda c: self.cached(c, self._judged)[2], ticket, left_out)

    def _judge(self, context: Context) -> tuple[Array, Array, Array]:
        measurement, noise = self.read(context, "measurement"), self._cases(context)
        if np.isnan(measurement).all():
            return measurement, noise[:, 0], np.full((self.trials, 1), float(KEPT))
        platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
        case = np.full(self.trials, -1)
        if self._states and np.isfinite(self.read(context, "prediction")).any():
            case = self._with_prediction(context, measurement, platforms, noise)
        if (case < 0).any():
            case = np.where(case < 0, self._alone(measurement, platforms, noise), case)

        silent = np.isnan(measurement).all(axis=-1)
        refused = (case < 0) & ~silent
        case = np.maximum(case, 0)
        gone = self._dropped[case] | refused[:, None]
        excluded = np.where(refused, REFUSED, self._receivers[case])
        chosen = noise[np.arange(self.trials), case]
        return np.where(gone, np.nan, measurement), chosen, excluded[:, None].astype(float)

    def _cases(self, context: Context) -> Array:
        """Return R of every case, shape (trials, 1 + receivers, m, m)."""
        if not self._noise_port:
            return np.broadcast_to(self._noise, (self.trials, *self._noise.shape))
        m = self.model.size
        return without_receivers(
            self.model, self._tdoa, self.read(context, "noise_covariance").reshape(self.trials, m, m)
        )[1]

    def _with_prediction(
        self, context: Context, measurement: Array, platforms: Array, noise: Array
    ) -> NDArray[np.intp]:
        """Return the case that agrees with the prediction; -1 where none does, or there is no prediction."""
        n = self._states
        mean = self.read(context, "prediction")[:, :3]
        covariance = self.read(context, "prediction_covariance").reshape(-1, n, n)[:, :3, :3]
        return self._decide(measurement, platforms, noise, mean[:, None], (mean, self._slack**2 * covariance))

    def _alone(self, measurement: Array, platforms: Array, noise: Array) -> NDArray[np.intp]:
        """Return the case that agrees with itself; -1 where none does."""
        height = measurement[:, self._height]
        starts = starts_around(platforms, np.where(np.isfinite(height), height, 0.0))
        return self._decide(measurement, platforms, noise, starts)

    def _decide(
        self,
        measurement: Array,
        platforms: Array,
        noise: Array,
        starts: Array,
        prior: tuple[Array, Array] | None = None,
    ) -> NDArray[np.intp]:
        """Return 0 where all receivers agree, else the case that clearly explains the rows best, else -1."""
        rows = np.where(self._dropped, np.nan, measurement[:, None, :])
        wide = None if prior is None else (prior[0][:, None], prior[1][:, None])
        fix = snapshot_fix(rows, platforms[:, None], self.model, noise, starts[:, None], wide)
        redundancy = fix.dof.astype(int)
        redundancy[:, 1] -= 1  # its rows are all there, but what they have in common weighs nothing
        with np.errstate(invalid="ignore"):
            passes = fix.cost <= self._limits[np.maximum(redundancy, 0)]
        cost = np.where(passes[:, 1:], fix.cost[:, 1:], np.inf)
        best, second = np.sort(cost, axis=-1)[:, :2].T
        with np.errstate(invalid="ignore"):  # infinity minus infinity: no case passes
            clear = second - best >= _DECISIVE
        return np.where(passes[:, 0], 0, np.where(clear, 1 + np.argmin(cost, axis=-1), -1))
