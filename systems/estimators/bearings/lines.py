"""What locators from bearings share: they are no recursive filters, but find the target anew from what they keep."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import predict_extended
from quietfix.systems.filters.observation import Observation
from quietfix.systems.fixes.bearing_likelihood import BearingHistory
from quietfix.systems.linear_algebra import quadratic
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.bearing_start import BearingStart
from quietfix.systems.starts.start import Start

__all__ = ["BearingLocator", "Lately", "Sighting"]

Array = NDArray[np.float64]
_NO_PRIOR = 1e8  # m; of the range, where none is believed in

_BLOCK = 32  # numbers that NumPy multiplies and adds at a time, four registers of at most eight


@dataclass(frozen=True)
class Sighting:
    """The bearings of one instant.

    Attributes
    ----------
    angles : ndarray, shape (trials, m)
        NaN where one is missing [rad].
    variance : ndarray, shape (trials, m)
        [rad^2]
    place : ndarray, shape (trials, axes)
        Where they were taken [m].
    time : float
        [s]
    """

    angles: Array
    variance: Array
    place: Array
    time: float

    @property
    def there(self) -> NDArray[np.bool_]:
        """Which trials have a bearing, shape (trials,)."""
        return np.any(np.isfinite(self.angles), axis=-1) & np.all(np.isfinite(self.place), axis=-1)


class _Nothing(Start):
    """No belief at all; every trial is ready for its first bearing."""

    def __init__(self, size: int) -> None:
        self._size = size

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`; the numbers are stand-ins."""
        trials = measurement.shape[0]
        return np.zeros((trials, self._size)), np.zeros((trials, self._size, self._size))


class BearingLocator(Estimator):
    """Base of crossing locators and batch fits.

    The bearings may be raw or filtered: the measurement port of a locator may be the ``bearing`` port of an
    `AzimuthFilter`, whose ``bearing_covariance`` then is the noise covariance. Until a trial has a fix its estimate is
    the start's belief (the first bearing and an assumed range); where a fix is undefined (parallel lines) it stays
    what it was. NIS is that of the new bearing against the last fix; it means something for raw bearings only,
    because filtered ones are correlated with each other.

    Parameters
    ----------
    name : str
        Name of the block.
    model : Bearing
        Sensor as it is believed.
    motion : MotionModel
        A target at rest, or in straight motion without process noise.
    start : BearingStart
        Belief before there is a fix.
    wiring : Wiring
        What surrounds the block.

    Raises
    ------
    ValueError
        If the model is not one of bearings, the start not one from a bearing, or the target's motion random.
    """

    def __init__(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> None:
        if not isinstance(model, Bearing) or not isinstance(start, BearingStart):
            words = "it locates by bearings in a plane, from a start at the first of them, as in bearing_crossing"
            raise ValueError(f"{name}: {words}; it cannot use {', '.join(model.names)}")
        if np.any(motion.process_noise(np.zeros(motion.size), 1.0)):
            raise ValueError(f"{name}: process noise is not allowed; the target stands or moves straight")
        self.sensor = model
        self.axes = model.size + 1
        self.belief = start
        super().__init__(name, model, motion, _Nothing(motion.size), wiring)

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array, bool]:
        """See `Estimator.bound_prior`: the first bearing, with the start's range only where it counts as a prior."""
        spread = self.belief.sigma_distance if getattr(self, "prior", False) else _NO_PRIOR
        return self.belief.covariance_at(truth, platforms, spread), True

    # ---- what a subclass provides

    @abstractmethod
    def kept_sizes(self) -> Mapping[str, int]:
        """Return what is remembered besides the estimate: name and numbers per trial."""

    @abstractmethod
    def locate(self, kept: Memory, sighting: Sighting, mean: Array, covariance: Array) -> tuple[Memory, Array, Array]:
        """Return what is remembered from now on, and the new mean (trials, n) and covariance; NaN where there is none.

        Parameters
        ----------
        kept : dict of str to ndarray, shape (trials, numbers)
            What is remembered.
        sighting : Sighting
            The bearings of now.
        mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
            Estimate before them.
        """

    # ---- Estimator

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        n = self.motion.size
        return {"mean": n, "covariance": n * n, **self.kept_sizes()}

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`: nothing is known yet."""
        return {group: np.full((mean.shape[0], size), np.nan) for group, size in self.memory_sizes().items()}

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`."""
        n = self.motion.size
        return memory["mean"], memory["covariance"].reshape(-1, n, n)

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        mean, covariance = predict_extended(*self.moments(memory), self.motion, dt)
        return {**memory, "mean": mean, "covariance": covariance.reshape(mean.shape[0], -1)}

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        measurement, platforms = observation.value, observation.platforms
        trials, n = measurement.shape[0], self.motion.size
        variance = np.broadcast_to(np.einsum("...ii->...i", observation.noise_covariance), measurement.shape)
        place = np.broadcast_to(platforms[:, self.sensor.platform, : self.axes], (trials, self.axes))
        sighting = Sighting(measurement, variance, place, epoch.time)
        mean, covariance = self.moments(memory)
        innovation = self._innovation(mean, covariance, observation)

        known = np.all(np.isfinite(mean), axis=-1)
        if not known.all():
            first, spread = self.belief.belief(measurement, platforms)
            mean = np.where(known[:, None], mean, first)
            covariance = np.where(known[:, None, None], covariance, spread)
        kept = {group: memory[group] for group in self.kept_sizes()}
        kept, found, uncertain = self.locate(kept, sighting, mean, covariance)
        good = np.all(np.isfinite(found), axis=-1) & np.all(np.isfinite(uncertain), axis=(-1, -2))
        mean = np.where(good[:, None], found, mean)
        covariance = np.where(good[:, None, None], uncertain, covariance)
        return {"mean": mean, "covariance": covariance.reshape(trials, n * n), **kept}, innovation

    def _innovation(self, mean: Array, covariance: Array, observation: Observation) -> Innovation:
        value, jacobian = self.model.linearize(mean, observation.platforms)
        residual = self.model.residual(observation.value, value)
        spread = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2) + observation.noise_covariance
        there = np.isfinite(residual) & np.isfinite(np.einsum("...ii->...i", spread))
        residual = np.where(there, residual, np.nan)
        nis, dof, _ = quadratic(residual, spread)
        return Innovation(residual, np.where(dof > 0, nis, np.nan), dof)

    def whole(self, position: Array, spread: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
        """Return a full state for a fix in the plane; what it does not tell (height, velocity) stays as believed."""
        mean, covariance = mean.copy(), covariance.copy()
        mean[:, :2] = position
        covariance[:, :2, :] = 0.0
        covariance[:, :, :2] = 0.0
        covariance[:, :2, :2] = spread
        return mean, covariance


class Lately:
    """The last bearings of each trial, as a ring in the estimator's memory.

    Parameters
    ----------
    window : int
        How many are kept.
    angles, axes : int
        Numbers per sighting.
    timed, weighed : bool
        Whether times and variances are kept too.
    """

    def __init__(self, window: int, angles: int, axes: int, timed: bool, weighed: bool) -> None:
        self.window = window
        self._shapes: dict[str, tuple[int, ...]] = {"angles": (angles,), "places": (axes,)}
        if timed:
            self._shapes["times"] = ()
        if weighed:
            self._shapes["variances"] = (angles,)

    def sizes(self) -> dict[str, int]:
        """Return name and numbers per trial."""
        return {**{name: self.window * int(np.prod(tail)) for name, tail in self._shapes.items()}, "count": 1}

    def unpack(self, kept: Memory) -> dict[str, Array]:
        """Return each ring, shape (trials, window, ...), cut where no trial has anything yet.

        In whole blocks: a sum's rounding depends on how it is cut into them, and so must not on who has most.
        """
        most = np.nan_to_num(kept["count"]).max(initial=0.0)
        filled = min(self.window, _BLOCK * math.ceil(most / _BLOCK))
        trials = kept["count"].shape[0]
        return {name: kept[name].reshape(trials, self.window, *tail)[:, :filled] for name, tail in self._shapes.items()}

    def push(self, kept: Memory, sighting: Sighting) -> tuple[Memory, dict[str, Array]]:
        """Return the rings with one more sighting in the trials that have one, and what it drove out (NaN: nothing)."""
        trials = kept["count"].shape[0]
        count = np.nan_to_num(kept["count"][:, 0])
        rows = np.flatnonzero(sighting.there)
        slot = (count[rows] % self.window).astype(int)
        new = {
            "angles": sighting.angles,
            "places": sighting.place,
            "times": np.full(trials, sighting.time),
            "variances": sighting.variance,
        }
        lost, grown = {}, {}
        for name, tail in self._shapes.items():
            ring = kept[name].reshape(trials, self.window, *tail).copy()
            lost[name] = np.full((trials, *tail), np.nan)
            lost[name][rows] = ring[rows, slot]
            ring[rows, slot] = new[name][rows]
            grown[name] = ring.reshape(trials, -1)
        grown["count"] = (count + sighting.there)[:, None]
        return grown, lost

    def history(self, rings: Mapping[str, Array], now: float) -> BearingHistory:
        """Return rings from `unpack`, or one lost sighting with an axis in front, as a `BearingHistory`."""
        ages = np.nan_to_num(now - rings["times"]) if "times" in rings else None
        places = rings["places"]
        if not np.isfinite(places.sum()):  # stand-ins; the angle of such a line is missing too
            places = np.nan_to_num(places)
        return BearingHistory.of(rings["angles"], places, ages)
