"""The range-decomposed filter: ranging, choice of the root by the orbit plane, and a filter on the position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import predict_extended
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.recovery.surprise import ALARM, surprise
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.orbit_plane import (
    Pattern,
    common_plane,
    normal_of_pattern,
    plane_distance,
    plane_normal,
    plane_pattern,
)
from quietfix.systems.fixes.ranged_position import RangedPosition
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.ranging.plane_search import PlaneSearch
from quietfix.systems.starts.start import Start

__all__ = ["RangeDecomposed"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PREVIEW = 12  # numbers per epoch on the preview port: six rows and the observer's state
_SLOT = _PREVIEW + 1  # in the window, with the time
_WAITING = ("window", "roots")  # how groups begin that are remembered until the plane is known


class _Used(NamedTuple):
    """What became of an epoch: the belief, what is reported, and NIS and rows (trials,) of what was refused too."""

    belief: _Belief
    nis: Array
    dof: Array
    seen: Array
    there: Array


class _Belief(NamedTuple):
    """What one step of the filter moves: mean (trials, 6), covariance, plane, and how many epochs stand for it."""

    mean: Array
    covariance: Array
    normal: Array
    members: Array


class RangeDecomposed(Estimator):
    r"""RA filter of Wu, Xin and Wan, section 4.3.

    Each epoch the ranging equation gives up to three positions :math:`r_O + r_i e`; the one nearest to the known orbit
    plane is the measurement of a Kalman filter, with the covariance that follows from the errors of the six rows. The
    plane comes from clustering the candidates of the first `plane_epochs` epochs and then follows the filter's own
    state.

    Until those epochs are there the estimate is the prior; then all of them are used at once, from the prior of the
    first. Where fewer than half of them agree on a plane, the next ones are waited for; with `by_likelihood`, where it
    is not beyond doubt which root is the true one (`PlaneSearch`), whose own plane is taken where the cluster is
    another's. A filter that is lost, by what its gate refuses too, looks for the plane again: its estimate is then the
    mixture of the roots, and once a root is beyond doubt it goes on from there. While a plane is refused, and until the
    filter has come back, the port ``lost`` says so. With `look_ahead` the epochs
    come on the port ``preview`` when the run begins, and the filter works from the first one on, as in the paper: not
    causal.

    The innovation is that of the raw rows; NIS and its degrees of freedom are those of the position (3, or 0 where no
    root was used).

    Parameters
    ----------
    name, model, motion, start, wiring
        See `Estimator`; the model must be a `RelativeKinematics` of all six rows.
    plane_epochs : int
        Epochs that are clustered, >= 2.
    pattern : {'slopes', 'normal'}
        What is clustered, see `common_plane`.
    track : {'slopes', 'normal'}
        What is averaged to follow the plane.
    look_ahead : bool
        See above.
    covariance_at : {'prediction', 'root'}
        Where the position's covariance is evaluated.
    gate : float or None
        Positions with a larger NIS are not used; None: no gate.
    gate_after : int
        Epochs without gate at the beginning.
    minimum_height : float or None
        Roots below this height [m] or unbound are impossible; None: every root counts.
    by_likelihood : bool
        See above; False: the cluster alone decides, for good.
    """

    def __init__(
        self,
        name: str,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        plane_epochs: int = 20,
        pattern: Pattern = "slopes",
        track: Pattern = "normal",
        look_ahead: bool = False,
        covariance_at: Literal["prediction", "root"] = "prediction",
        gate: float | None = 16.0,
        gate_after: int = 10,
        minimum_height: float | None = 100e3,
        by_likelihood: bool = True,
    ) -> None:
        if not isinstance(model, RelativeKinematics):
            there = f"{', '.join(ROWS)}; there are {', '.join(model.names)}"
            raise ValueError(f"{name}: ranging needs all rows of one sensor: {there}")
        self.position = RangedPosition(model)
        self.equation = self.position.equation
        self.plane_epochs = plane_epochs
        self.look_ahead = look_ahead
        self.causal, self.begins_plainly = not look_ahead, not look_ahead
        self._observer = model.observer
        self._pattern: Pattern = pattern
        self._track: Pattern = track
        self._covariance_at = covariance_at
        self._gate, self._gate_after = gate, gate_after
        self._minimum_height = minimum_height
        self._algorithm = IteratedExtendedKalman(max_iterations=1)
        height = -np.inf if minimum_height is None else minimum_height
        self._search = PlaneSearch(name, model, motion, wiring, height) if by_likelihood else None
        super().__init__(name, model, motion, start, wiring)

    @property
    def bound_model(self) -> RangedPosition:
        """What the filter really measures, for the bound."""
        return self.position

    # ---- memory

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        sizes = {
            "mean": 6,
            "covariance": 36,
            "normal": 3,
            "count": 1,
            "epochs": 1,
            "surprise": 1,
            "again": 1,
            "seen": 2,
        }
        sizes |= {"window": self.plane_epochs * _SLOT, "window_mean": 6, "window_covariance": 36}
        return sizes | dict(self._search.memory_sizes()) if self._search else sizes

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        trials = mean.shape[0]
        memory = {group: np.full((trials, size), np.nan) for group, size in self.memory_sizes().items()}
        memory |= {"mean": np.array(mean), "covariance": np.reshape(covariance, (trials, 36)).copy()}
        memory |= {group: np.zeros((trials, 1)) for group in ("count", "epochs", "surprise", "again")}
        memory["seen"] = np.zeros((trials, 2))
        if self._search:
            self._search.forget(memory, np.arange(trials))
        return memory

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`."""
        return memory["mean"], memory["covariance"].reshape(-1, 6, 6)

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        mean, covariance = predict_extended(*self.moments(memory), self.motion, dt)
        memory = memory | {"mean": mean, "covariance": covariance.reshape(-1, 36)}
        return memory | self._search.predict(memory, dt, epoch) if self._search else memory

    def _declare_ports(self) -> None:
        if self.look_ahead:
            self.declare_input("preview", self.wiring.trials, self.plane_epochs * _PREVIEW)
        super()._declare_ports()

    def _begin(self, context: Context, discrete: DiscreteValues) -> None:
        super()._begin(context, discrete)
        if self.look_ahead:
            ahead = self.read(context, "preview").reshape(-1, self.plane_epochs, _PREVIEW)
            normal, count_ = self._find_plane(ahead)
            if self._search:
                normal, sure = self._search.of_epochs(ahead, self._carriers, self._epoch(context), normal)
                count_ = np.where(sure, float(self.plane_epochs), 0.0)
            for group, value in (("normal", normal), ("count", count_)):
                discrete.get_mutable_value(self._state)[self._places[group]] = value.ravel()

    # ---- the plane

    def _find_plane(self, epochs: Array) -> tuple[Array, Array]:
        """Return the normal and how many epochs stand for it (0: no plane) from (trials, epochs, 12)."""
        _, states = self.equation.candidates(epochs[..., :6], epochs[..., 6:12], self._minimum_height)
        normal, members = common_plane(states, self._pattern)
        found = 2 * members >= self.plane_epochs
        return np.where(found[:, None], normal, np.nan), np.where(found, float(self.plane_epochs), 0.0)

    def _follow(self, normal: Array, count_: Array, state: Array) -> Array:
        """Return the plane with the filter's own one averaged in, step (5) of section 4.3."""
        share = 1 / count_[:, None]
        if self._track == "slopes":
            slopes = -normal[:, :2] / normal[:, 2:]
            moved = normal_of_pattern((1 - share) * slopes + share * plane_pattern(state))
            return moved * np.where(np.einsum("ti,ti->t", moved, normal) < 0, -1.0, 1.0)[:, None]
        new = plane_normal(state)
        new = new * np.where(np.einsum("ti,ti->t", new, normal) < 0, -1.0, 1.0)[:, None]
        moved = (1 - share) * normal + share * new
        return moved / np.linalg.norm(moved, axis=-1, keepdims=True)

    # ---- the update

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        measurement, platforms = observation.value, observation.platforms
        trials = measurement.shape[0]
        observer = np.broadcast_to(platforms[:, self._observer], (trials, 6))
        predicted = self.model.predict(memory["mean"], platforms)
        innovation = self.model.residual(measurement, predicted)
        nis, dof = np.full(trials, np.nan), np.zeros(trials)
        memory = memory | {"seen": np.zeros((trials, 2))}
        decided: Mask = np.asarray(memory["count"][:, 0] > 0)
        everyone = bool(decided.all())
        memory = {g: value if everyone and g.startswith(_WAITING) else value.copy() for g, value in memory.items()}
        if decided.any():
            which = slice(None) if everyone else np.flatnonzero(decided)
            nis[which], dof[which] = self._step(memory, which, measurement[which], observer[which], predicted[which])
        if not everyone:
            waiting = np.flatnonzero(~decided)
            if self._search:
                self._search.update(memory, waiting, observation, epoch)
            rows = self._collect(memory, waiting, measurement, observer, epoch.time)
            if rows.size:
                nis[rows], dof[rows] = self._catch_up(memory, rows)
        memory["epochs"] += 1
        if self._search:
            self._recover(memory, observation, epoch)
        return memory, Innovation(innovation, nis, dof)

    def _recover(self, memory: Memory, observation: Observation, epoch: Epoch) -> None:
        """Look for the plane again where the filter is lost; until it is found the estimate is that of the roots."""
        assert self._search is not None
        lost = np.flatnonzero((memory["surprise"][:, 0] > ALARM) & (memory["count"][:, 0] > 0))
        if lost.size:
            for group, value in (("count", 0.0), ("epochs", 0.0), ("surprise", 0.0), ("again", 1.0)):
                memory[group] = memory[group].copy()
                memory[group][lost] = value
            memory |= {g: value.copy() for g, value in memory.items() if g.startswith(_WAITING)}
            self._search.forget(memory, lost)
            self._search.update(memory, lost, observation, epoch)
        again = np.flatnonzero((memory["again"][:, 0] > 0) & (memory["count"][:, 0] == 0))
        if again.size:
            mean, covariance = self._search.moments(memory, again)
            memory["mean"][again], memory["covariance"][again] = mean, covariance.reshape(-1, 36)

    def _step(
        self, memory: Memory, rows: NDArray[np.intp] | slice, measurement: Array, observer: Array, predicted: Array
    ) -> tuple[Array, Array]:
        """Use one epoch in some trials; write into `memory`, return NIS and degrees of freedom."""
        belief = _Belief(
            memory["mean"][rows],
            memory["covariance"][rows].reshape(-1, 6, 6),
            memory["normal"][rows],
            memory["count"][rows, 0],
        )
        gated = memory["epochs"][rows, 0] >= self._gate_after
        after, nis, dof, seen, there = self._use(belief, measurement, observer, predicted, gated)
        memory["mean"][rows] = after.mean
        memory["covariance"][rows] = after.covariance.reshape(-1, 36)
        memory["normal"][rows] = after.normal
        memory["count"][rows, 0] = after.members
        total = np.ascontiguousarray(memory["surprise"][rows, 0])
        surprise(np.ascontiguousarray(seen), there, total)
        memory["surprise"][rows, 0] = total
        memory["seen"][rows] = np.stack([seen, there], axis=-1)
        return nis, dof

    def evidence(self, memory: Memory, innovation: Innovation) -> tuple[Array, Array]:
        """See `Watching.evidence`: of what the gate has refused, too."""
        return memory["seen"][:, 0], memory["seen"][:, 1]

    def says_lost(self, memory: Memory) -> Mask | None:
        """See `Watching.says_lost`: no plane is beyond doubt after the first window, or the one that was has failed."""
        refused = (memory["epochs"][:, 0] >= self.plane_epochs) | (memory["again"][:, 0] > 0)
        return np.asarray(refused & (memory["count"][:, 0] == 0))

    def _carriers(self, observer: Array) -> Array:
        """Return platforms (trials, p, 6) of which only the observer (trials, 6) is somewhere."""
        platforms = np.zeros((observer.shape[0], self.wiring.platforms, 6))
        platforms[:, self._observer] = observer
        return platforms

    def _use(self, belief: _Belief, measurement: Array, observer: Array, predicted: Array, gated: Mask) -> _Used:
        mean, covariance, normal, count_ = belief
        trials = np.arange(mean.shape[0])
        ranges, states = self.equation.candidates(measurement, observer, self._minimum_height)
        off = plane_distance(states[..., :3], normal)
        chosen = np.argmin(np.where(np.isnan(off), np.inf, off), axis=-1)
        position = states[trials, chosen, :3]
        platforms = self._carriers(observer)
        if self._covariance_at == "prediction":
            noise = self.position.covariance_of(mean, observer, predicted)
        else:
            noise = self.equation.position_covariance(ranges[trials, chosen], measurement, observer, self.model.sigmas)
        usable: Mask = np.all(np.isfinite(position), axis=-1) & np.all(np.isfinite(noise), axis=(-1, -2))
        usable &= np.isfinite(mean).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2))
        here, spread = mean, covariance
        if not usable.all():
            noise = np.where(usable[:, None, None], noise, np.eye(3))
            here = np.where(usable[:, None], mean, 1.0)
            spread = np.where(usable[:, None, None], covariance, np.eye(6))
            position = np.where(usable[:, None], position, np.nan)
        measured = Observation(position, platforms, Whitener(noise))
        result = self._algorithm.update(here, spread, measured, self.position)
        used = usable
        if self._gate is not None:
            with np.errstate(invalid="ignore"):
                used = usable & ~(gated & (result.nis > self._gate))
        mean = np.where(used[:, None], result.mean, mean)
        covariance = np.where(used[:, None, None], result.covariance, covariance)
        count_ = count_ + used
        normal = np.where(used[:, None], self._follow(normal, count_, mean), normal)
        return _Used(
            _Belief(mean, covariance, normal, count_),
            np.where(used, result.nis, np.nan),
            np.where(used, 3.0, 0.0),
            np.where(usable, result.nis, np.nan),
            np.where(usable, 3.0, 0.0),
        )

    # ---- the first epochs

    def _collect(
        self, memory: Memory, rows: NDArray[np.intp], measurement: Array, observer: Array, time: float
    ) -> NDArray[np.intp]:
        """Put an epoch into the windows of some trials; return those that found their first plane with it."""
        slots = memory["epochs"][rows, 0].astype(int) % self.plane_epochs
        fresh = rows[slots == 0]
        memory["window"][fresh] = np.nan
        memory["window_mean"][fresh] = memory["mean"][fresh]
        memory["window_covariance"][fresh] = memory["covariance"][fresh]
        window = memory["window"].reshape(-1, self.plane_epochs, _SLOT)
        entry = np.concatenate([measurement, observer, np.full((measurement.shape[0], 1), time)], axis=-1)
        window[rows, slots] = entry[rows]
        full = rows[slots == self.plane_epochs - 1]
        if full.size == 0:
            return full
        normal, count_ = self._find_plane(window[full, :, :_PREVIEW])
        if self._search:
            normal, sure = self._search.decide(memory, full, normal)
            count_ = np.where(sure, float(self.plane_epochs), 0.0)
        memory["normal"][full], memory["count"][full, 0] = normal, count_
        found = full[count_ > 0]
        again = memory["again"][found, 0] > 0
        if self._search and found.size:
            if again.any():
                mean, covariance = self._search.moments(memory, found[again])
                memory["mean"][found[again]], memory["covariance"][found[again]] = mean, covariance.reshape(-1, 36)
            self._search.forget(memory, found)
        return found[~again]

    def _catch_up(self, memory: Memory, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Filter the epochs of the window, from the belief at the first of them."""
        window = memory["window"].reshape(-1, self.plane_epochs, _SLOT)[rows]
        memory["mean"][rows] = memory["window_mean"][rows]
        memory["covariance"][rows] = memory["window_covariance"][rows]
        last = memory["epochs"][rows].copy()
        nis, dof = np.full(rows.size, np.nan), np.zeros(rows.size)
        times = window[:, :, _PREVIEW]
        for j in range(self.plane_epochs):
            if j > 0:
                self._advance(memory, rows, times[:, j] - times[:, j - 1])
            memory["epochs"][rows] = last - (self.plane_epochs - 1 - j)
            observer = window[:, j, 6:12]
            predicted = self.model.predict(memory["mean"][rows], self._carriers(observer))
            nis, dof = self._step(memory, rows, window[:, j, :6], observer, predicted)
        memory["epochs"][rows] = last
        return nis, dof

    def _advance(self, memory: Memory, rows: NDArray[np.intp], dt: Array) -> None:
        for length in np.unique(dt):  # one, unless trials began at different times
            some = rows[dt == length]
            mean, covariance = predict_extended(
                memory["mean"][some], memory["covariance"][some].reshape(-1, 6, 6), self.motion, float(length)
            )
            memory["mean"][some], memory["covariance"][some] = mean, covariance.reshape(-1, 36)
