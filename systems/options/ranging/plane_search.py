"""Which root of the ranging equation, and so which orbit plane, is the true one: asked of the likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.systems.clocks import first_ticks
from quietfix.systems.estimators.memory import Epoch, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation, take
from quietfix.systems.filters.recovery.surprise import ALARM, surprise
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.orbit_plane import plane_normal
from quietfix.systems.linear_algebra import quadratic
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.ranging.bank import RootBank, RootsStart

__all__ = ["PlaneSearch"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_SURE = 1 - 1e-3  # probability of the likeliest root from which on it is taken
_APART = float(chi2.isf(1e-6, 2))  # a clustered plane in which the likeliest orbit does not lie is none
_PREFIX = "roots_"
_SURPRISE = "roots_surprise"


class PlaneSearch:
    r"""Filters on the raw rows, one per root, that run beside another estimator until one of them is beyond doubt.

    A cluster of planes says that the candidates of some epochs agree, not that their orbit explains what was measured:
    the roots of a false branch drift slowly, and where they lie close they cluster better than the true ones. A
    `RootBank` weighs each orbit by the likelihood of all rows (Bar-Shalom, Li and Kirubarajan, *Estimation with
    Applications to Tracking and Navigation*, 2001, section 11.6.2). A root is taken when its probability is above
    0.999 and its innovations are as large as they are said to be; where they are not, the true root was not among
    those of the first epoch, and the search begins again from the roots of now.

    Parameters
    ----------
    name : str
        Of the estimator.
    model, motion, wiring
        As the estimator's own.
    minimum_height : float
        See `RootsStart`.
    """

    def __init__(
        self, name: str, model: MeasurementModel, motion: MotionModel, wiring: Wiring, minimum_height: float
    ) -> None:
        start = RootsStart(model, wiring.stream, minimum_height=minimum_height)
        algorithm = IteratedExtendedKalman(max_iterations=8)
        self._bank = RootBank(f"{name}_roots", algorithm, model, motion, start, wiring)
        self._start = start

    def memory_sizes(self) -> Mapping[str, int]:
        """Return what the search remembers: name and numbers per trial."""
        return {**{_PREFIX + group: size for group, size in self._bank.memory_sizes().items()}, _SURPRISE: 1}

    def _own(self, memory: Memory, rows: Index | slice = slice(None)) -> Memory:
        return {group: memory[_PREFIX + group][rows] for group in self._bank.memory_sizes()}

    @staticmethod
    def _put(memory: Memory, rows: Index | slice, own: Memory) -> None:
        for group, value in own.items():
            memory[_PREFIX + group][rows] = value

    @staticmethod
    def living(memory: Memory) -> Mask:
        """Return in which trials (trials,) there is a root at all."""
        return np.asarray(np.any(memory[_PREFIX + "weights"] > 0, axis=-1))

    @staticmethod
    def forget(memory: Memory, rows: Index) -> None:
        """Have no roots in some trials, in place."""
        memory[_PREFIX + "weights"][rows] = 0.0
        memory[_SURPRISE][rows] = 0.0

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """Return the search's part of a memory `dt` seconds later; nothing where there are no roots."""
        if not self.living(memory).any():
            return {}
        own = self._bank.predict(self._own(memory), dt, epoch)
        return {_PREFIX + group: value for group, value in own.items()}

    def update(self, memory: Memory, rows: Index, observation: Observation, epoch: Epoch) -> None:
        """Use an epoch in some trials, in place; `observation` is of all of them."""
        living = self.living(memory)[rows]
        old = rows[living]
        begin = [rows[~living]]
        if old.size:
            own, innovation = self._bank.update(self._own(memory, old), observation.rows(old), epoch)
            total = memory[_SURPRISE][old, 0]
            surprise(np.ascontiguousarray(innovation.nis), np.ascontiguousarray(innovation.nis_dof), total)
            self._put(memory, old, own)
            memory[_SURPRISE][old, 0] = total
            begin.append(old[(total > ALARM) | ~self.living(memory)[old]])
        new = np.sort(np.concatenate(begin))
        if new.size:
            self._begin(memory, new, observation.value[new], take(observation.platforms, new), epoch)

    def _begin(self, memory: Memory, rows: Index, measurement: Array, platforms: Array, epoch: Epoch) -> None:
        """Begin at the roots of an epoch, in the trials that have any."""
        begun, able = self._bank.of_roots(*self._start.of_rows(measurement, platforms))
        self._put(memory, rows[able], {group: value[able] for group, value in begun.items()})
        memory[_SURPRISE][rows[able]] = 0.0

    def moments(self, memory: Memory, rows: Index) -> tuple[Array, Array]:
        """Return mean and covariance of some trials' mixture; NaN without a root."""
        return self._bank.moments(self._own(memory, rows))

    def of_epochs(
        self, epochs: Array, carriers: Callable[[Array], Array], epoch: Epoch, clustered: Array
    ) -> tuple[Array, Mask]:
        """Return what `decide` does, of epochs (trials, k, 12) of rows and observer that are there at once."""
        trials = epochs.shape[0]
        everyone = np.arange(trials)
        memory = {group: np.full((trials, size), np.nan) for group, size in self.memory_sizes().items()}
        self.forget(memory, everyone)
        times = first_ticks(self._bank.wiring.clock, epochs.shape[1])
        whitener = Whitener(self._bank.model.noise_covariance())
        for k in range(epochs.shape[1]):
            if k > 0:
                memory |= self.predict(memory, float(times[k] - times[k - 1]), epoch)
            observed = Observation(epochs[:, k, :6], carriers(epochs[:, k, 6:12]), whitener)
            self.update(memory, everyone, observed, epoch)
        return self.decide(memory, everyone, clustered)

    def decide(self, memory: Memory, rows: Index, clustered: Array) -> tuple[Array, Mask]:
        """Return the plane of the likeliest root of some trials, and whether that is beyond doubt.

        Parameters
        ----------
        memory : dict
        rows : ndarray of int, shape (k,)
            The trials.
        clustered : ndarray, shape (k, 3)
            Normals of clustered planes; NaN where there is none. One in which the likeliest orbit lies is kept.

        Returns
        -------
        normal : ndarray, shape (k, 3)
        sure : ndarray of bool, shape (k,)
        """
        own = self._own(memory, rows)
        k, n = self._bank.hypotheses, own["means"].shape[-1] // self._bank.hypotheses
        mean, covariance = own["means"].reshape(-1, k, n)[:, 0], own["covariances"].reshape(-1, k, n, n)[:, 0]
        sure: Mask = np.asarray((own["weights"][:, 0] >= _SURE) & (memory[_SURPRISE][rows, 0] < 0.5 * ALARM))
        mean = np.where(sure[:, None], mean, 1.0)
        covariance = np.where(sure[:, None, None], covariance, np.eye(n))
        there: Mask = np.asarray(np.isfinite(clustered).all(axis=-1))
        out = np.zeros((rows.size, 2, n))  # how far place and velocity are out of the clustered plane
        out[:, 0, :3] = out[:, 1, 3:6] = np.where(there[:, None], clustered, [0.0, 0.0, 1.0])
        apart = np.einsum("tki,ti->tk", out, mean)
        lies = there & (quadratic(apart, out @ covariance @ np.swapaxes(out, -1, -2))[0] < _APART)
        own_plane = plane_normal(np.where(sure[:, None], mean, [1.0, 0, 0, 0, 1.0, 0]))
        return np.where(sure[:, None], np.where(lies[:, None], clustered, own_plane), np.nan), sure
