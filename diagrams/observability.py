"""What the measurements of a run say of the state at its start, in words: `quietfix observe`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from diagrams.bounds import alike, rows_present
from diagrams.catalogue import split_name
from diagrams.errors import UserError
from diagrams.states import POSITION, shared
from diagrams.study import Study
from diagrams.system import Wired
from systems.estimators.base import Estimator
from systems.frames import up
from systems.observability import Spectrum, information_roots, spectrum
from systems.recorder import record
from systems.signals import Draw, set_draw

__all__ = [
    "Observability",
    "direction_axes",
    "observe",
    "prior_scale",
    "report",
    "share_words",
    "write_observability",
]

Array = NDArray[np.float64]

_KINDS = {"x": "position", "y": "position", "z": "position"}
_KINDS |= {"v" + axis: "velocity" for axis in "xyz"} | {"a" + axis: "acceleration" for axis in "xyz"}
_LABELS = {
    "position up": "height",
    "velocity up": "vertical velocity",
    "position in range": "range",
    "velocity in range": "range rate",
    "position in cross-range": "cross-range",
}
_AT_REST = 1e-6  # m/s; slower has no course
_SMALL = 0.05  # shares below it are not worth a word
_IN_SIGHT = 0.9  # cosine squared from which a direction counts as the line of sight


@dataclass(frozen=True, eq=False)
class Observability:
    """What one set of measurements says of the state at the start of a run.

    Attributes
    ----------
    estimators : list of str
        Those that use just these rows and this motion.
    rows : list of str
        Rows of the measurement.
    times : ndarray, shape (time,)
        Epochs of the window [s].
    components : list of str
        Directions that the state is told in: up, along the course ..., and what is no vector by its name.
    scale : ndarray, shape (n,)
        What each is counted in: the prior's largest standard deviation in that block of the state, SI units.
    units : list of str
        Their units.
    spectrum : Spectrum
        Over the epochs, directions in `components`.
    sight : ndarray, shape (n,)
        The line of sight from the first carrier at the first epoch, in the position's components, else 0.
    """

    estimators: list[str]
    rows: list[str]
    times: Array
    components: list[str]
    scale: Array
    units: list[str]
    spectrum: Spectrum
    sight: Array

    @property
    def observable_from(self) -> float:
        """When the last direction is known better than the prior, seconds after the first epoch; NaN: never."""
        whole = self.spectrum.known == len(self.components)
        return float(self.times[np.argmax(whole)] - self.times[0]) if whole[-1] else math.nan

    def weakest(self, epoch: int = -1) -> dict[str, float]:
        """Return the share of each component in the direction that is known worst, largest first."""
        return _sorted(self.components, self.spectrum.directions[epoch, -1] ** 2)

    def unknown(self, epoch: int = -1) -> dict[str, float]:
        """Return the share of each component that the measurements do not know better than the prior, largest first."""
        return _sorted(self.components, self.spectrum.unknown()[epoch])

    def weakest_words(self, epoch: int = -1) -> str:
        """Return the worst direction in words."""
        words = share_words(self.weakest(epoch))
        place = self.spectrum.directions[epoch, -1] * (self.sight != 0)
        length = float(place @ place)
        if "range" not in self.components and length > _SMALL:
            along = float(place @ self.sight) ** 2 / length
            if along > _IN_SIGHT:
                words += f" (position: along the line of sight, {100 * along:.0f} %)"
        return words

    def verdict(self) -> str:
        """Return in one or two sentences what is observable, and from when on."""
        n, last = len(self.components), self.spectrum
        span = f"{self.times[-1] - self.times[0]:g} s"
        rank, known = int(last.rank[-1]), int(last.known[-1])
        if known == n:
            held = np.flatnonzero(last.known < n)
            worst = "" if held.size == 0 else f"; last to be known: {self.weakest_words(int(held[-1]))}"
            when = f"{self.observable_from:g} s after the first epoch"
            return f"observable: all {n} directions are known better than the prior from {when} on{worst}"
        if rank < n:
            return (
                f"unobservable within {span}: rank {rank} of {n}; {n - known} directions no better known than the "
                f"prior: {share_words(self.unknown())}"
            )
        return (
            f"weakly observable within {span}: rank {n}, but {n - known} of {n} directions no better known than "
            f"the prior: {share_words(self.unknown())}"
        )

    def summary(self) -> dict[str, Any]:
        """Return what goes into ``summary.json``; null where a number is infinite or undefined."""
        s = self.spectrum
        return {
            "estimators": self.estimators,
            "rows": self.rows,
            "components": self.components,
            "scale": [float(value) for value in self.scale],
            "units": self.units,
            "rank": s.rank.tolist(),
            "known": s.known.tolist(),
            "condition": _plain(s.condition),
            "sigma": [_plain(row) for row in s.sigma],
            "weakest": [_plain(row) for row in s.directions[:, -1] ** 2],
            "unknown": [_plain(row) for row in s.unknown()],
            "observable_from_s": _plain([self.observable_from])[0],
            "verdict": self.verdict(),
        }


def _sorted(names: Sequence[str], shares: Array) -> dict[str, float]:
    return {names[i]: float(shares[i]) for i in np.argsort(-shares, kind="stable")}


def _plain(values: Any) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def share_words(shares: Mapping[str, float]) -> str:
    """Return components and their shares in words, without those below 5 %."""
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items() if share >= _SMALL)


# ------------------------------------------------------------------------------------------------ directions


def direction_axes(state: Array, carrier: Array, frame: str, axes: int = 3) -> tuple[list[str], Array]:
    """Return the directions that positions and velocities are told in.

    Parameters
    ----------
    state : ndarray, shape (n,)
        Of the target: position, and velocity if it has one.
    carrier : ndarray, shape (6,)
        Of the first carrier.
    frame : {'earth_fixed', 'local', 'inertial', 'launch'}
        See `Wired`.
    axes : int
        Number of space dimensions.

    Returns
    -------
    names : list of str
        ``up``, ``along the course``, ``across the course`` (north and east of a target at rest) on the Earth; ``in
        range``, ``in cross-range``, ``in elevation`` from the carrier in local axes; ``in range``, ``along the track``,
        ``across the track`` in inertial ones; ``down-range``, ``up at the site``, ``across`` at a launch.
    rotation : ndarray, shape (axes, axes)
        Their unit vectors as rows.
    """
    place = state[:axes]
    velocity = state[axes : 2 * axes] if state.size >= 2 * axes else np.zeros(axes)
    if frame == "launch":
        return ["down-range", "up at the site", "across"], np.eye(3)
    if frame == "earth_fixed":
        normal = up(place)
        level = velocity - normal * (normal @ velocity)
        moving = np.linalg.norm(level) > _AT_REST
        ahead = level if moving else np.array([0.0, 0.0, 1.0]) - normal * normal[2]
        ahead /= np.linalg.norm(ahead)
        names = ["along the course", "across the course"] if moving else ["to the north", "to the east"]
        return ["up", *names], np.stack([normal, ahead, np.cross(ahead, normal)])
    sight = place - carrier[:axes]
    sight = sight / np.linalg.norm(sight)
    if axes == 2:
        return ["in range", "in cross-range"], np.stack([sight, [-sight[1], sight[0]]])
    if frame == "local":
        side = np.cross([0.0, 0.0, 1.0], sight)
        side = side / np.linalg.norm(side)
        return ["in range", "in cross-range", "in elevation"], np.stack([sight, side, np.cross(sight, side)])
    ahead = velocity - sight * (sight @ velocity)
    ahead /= np.linalg.norm(ahead)
    return ["in range", "along the track", "across the track"], np.stack([sight, ahead, np.cross(sight, ahead)])


def _components(names: Sequence[str], words: Sequence[str], rotation: Array) -> tuple[list[str], Array]:
    """Return what the state's components are called after turning, and the turning (n, n): rows are components."""
    labels, turned = list(names), np.eye(len(names))
    for kind in dict.fromkeys(_KINDS.values()):
        block = [i for i, name in enumerate(names) if _KINDS.get(name) == kind]
        if len(block) != len(words):
            continue
        turned[np.ix_(block, block)] = rotation
        for i, word in zip(block, words, strict=True):
            labels[i] = _LABELS.get(f"{kind} {word}", f"{kind} {word}")
    return labels, turned


def prior_scale(names: Sequence[str], covariances: Sequence[Array]) -> Array:
    """Return what each component is counted in: the largest standard deviation of its block, of the narrowest prior.

    Position, velocity and acceleration are blocks, so that the axes they are written in do not matter; every other
    component is one by itself.

    Parameters
    ----------
    names : sequence of str
        Components of the state.
    covariances : sequence of ndarray, shape (n, n)
        Priors; an estimator that starts without one has a huge covariance, and another's then counts.
    """
    scale = np.empty(len(names))
    for name in dict.fromkeys(_KINDS.get(name, name) for name in names):
        block = [i for i, other in enumerate(names) if _KINDS.get(other, other) == name]
        widest = [np.linalg.eigvalsh(p[np.ix_(block, block)])[-1] for p in covariances]
        scale[block] = math.sqrt(min(widest))
    return scale


# -------------------------------------------------------------------------------------------------- of a run


def _studied(system: str, estimators: Sequence[str] | None, **options: Any) -> tuple[Study, list[str]]:
    """Return a study of all of a scenario's estimators and those asked for, and the names of the latter."""
    whole = Study(system, trials=1, **options)
    if not estimators:
        return whole, whole.request.estimators
    chosen = Study(system, estimators=estimators, trials=1, **options).request.estimators
    known = whole.request.estimators
    added = [name for name in estimators if name not in known]
    return (Study(system, estimators=[*known, *added], trials=1, **options) if added else whole), chosen


def observe(
    system: str,
    *,
    estimators: Sequence[str] | None = None,
    window: float | None = None,
    variant: str | None = None,
    scenario: Any = None,
    set: Sequence[str] | Mapping[str, Any] | None = None,
    seed: int = 0,
) -> list[Observability]:
    """Return what the measurements of a run say of the state at its start, and when.

    Parameters
    ----------
    system : str
        ``SYSTEM`` or ``SYSTEM:VARIANT``.
    estimators : sequence of str, optional
        Whose measurements and motion; by default all of the scenario, each set of rows once.
    window : float, optional
        Length from the first epoch on [s]; by default the whole run.
    variant, scenario, set, seed
        See `diagrams.run_study`; the truth is that of trial 0.

    Returns
    -------
    list of Observability
        One per set of rows and motion model.

    Raises
    ------
    UserError
        For a window outside the run, an unknown estimator, or one whose state is not the truth's.
    """
    study, chosen = _studied(system, estimators, variant=variant, scenario=scenario, set=set, seed=seed)
    wired = study.wire(1)[0]
    ticks = wired.clock.ticks(wired.duration)
    times = _window(ticks, window)
    truth, platforms, present = _course(study, wired, times)
    size = truth.shape[-1]
    usable = {name: block for name, block in wired.estimators.items() if block.motion.size == size}
    lacking = [name for name in chosen if name not in usable]
    if estimators and lacking:
        raise UserError(f"estimator: {lacking[0]} has a state of its own, not the truth's; one of {', '.join(usable)}")
    groups: list[tuple[list[str], Estimator]] = []
    for name in (name for name in chosen if name in usable):
        block = usable[name]
        for members, first in groups:
            if alike((block.bound_model, block.motion), (first.bound_model, first.motion)):
                members.append(name)
                break
        else:
            groups.append(([name], block))
    if not groups:
        raise UserError(f"{system}: no estimator's state is the truth's, so that nothing can be said of it")
    priors = [
        prior[0] for b in usable.values() if (prior := b.bound_prior(truth[:, 0], platforms[:, 0])[0]) is not None
    ]
    scale = prior_scale(next(iter(usable.values())).motion.names, priors)
    return [_one(members, block, wired, times, truth, platforms, present, scale) for members, block in groups]


def _window(ticks: Array, window: float | None) -> Array:
    span = float(ticks[-1] - ticks[0])
    if window is None:
        return ticks
    if not (math.isfinite(window) and 0 <= window <= span * (1 + 1e-9)):
        raise UserError(f"window: {window:g} is not allowed; 0 to {span:g} s, the length of the run")
    return ticks[ticks - ticks[0] <= window * (1 + 1e-9)]


def _course(study: Study, wired: Wired, times: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Run a diagram until the last of `times`; return truth (1, time, n), platforms (1, time, p, 6), rows measured."""
    builder, request = DiagramBuilder(), study.request
    # one estimator is enough of a diagram; the truth does not depend on which
    alone = study.system.wire(builder, request.scenario, request.estimators[:1], 1)
    ports = {"truth": alone.truth, "platforms": alone.platforms, "sensed": alone.sensed or alone.measurement}
    recorder = record(builder, ports, alone.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(request.seed, 0))
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(float(times[-1]))
    signals = {name: np.swapaxes(log[: times.size], 0, 1) for name, log in recorder.result(context)[1].items()}
    platforms = signals["platforms"].reshape(1, times.size, -1, 6)
    return signals["truth"], platforms, np.isfinite(signals["sensed"])


def _one(
    names: list[str],
    block: Estimator,
    wired: Wired,
    times: Array,
    truth: Array,
    platforms: Array,
    present: NDArray[np.bool_],
    scale: Array,
) -> Observability:
    model, motion = block.bound_model, block.motion
    seen = rows_present(wired, block, present)
    roots = information_roots(truth, platforms, times, model, motion, scale, seen)[0]
    axes = len(shared(POSITION, motion.names))
    words, rotation = direction_axes(truth[0, 0], platforms[0, 0, 0], wired.frame, axes)
    labels, turned = _components(motion.names, words, rotation)
    sight = np.zeros(motion.size)
    away = truth[0, 0, :axes] - platforms[0, 0, 0, :axes]
    sight[:axes] = rotation @ (away / np.linalg.norm(away))
    # scales are alike within a block, so turning and scaling commute
    found = spectrum(roots @ turned.T)
    return Observability(names, list(model.names), times, labels, scale, list(motion.units), found, sight)


def report(found: Sequence[Observability], title: str) -> None:
    """Print a table per set of measurements, and the verdict."""
    from diagrams.tables import Column, Table, print_table
    from diagrams.terminal import say

    for one in found:
        s = one.spectrum
        table = Table(
            f"{title}: {', '.join(one.estimators)}",
            ["time [s]", "rank", "better than prior", "condition", Column("worst direction"), "its sigma"],
            caption=f"rows {', '.join(one.rows)}; counted in {_counted(one)} (the prior's largest sigma)",
        )
        for k in _telling(s):
            worst = s.sigma[k, -1]
            table.add(
                f"{one.times[k]:g}",
                f"{s.rank[k]} of {len(one.components)}",
                f"{s.known[k]}",
                f"{s.condition[k]:.2g}" if np.isfinite(s.condition[k]) else "infinite",
                one.weakest_words(k),
                f"{worst:.3g} x prior" if np.isfinite(worst) else "infinite",
            )
        print_table(table)
        say(f"{', '.join(one.estimators)}: {one.verdict()}")


def _counted(one: Observability) -> str:
    pairs = dict.fromkeys(f"{value:.3g} {unit}" for value, unit in zip(one.scale, one.units, strict=True))
    return ", ".join(pairs)


def _telling(s: Spectrum, most: int = 9) -> Iterator[int]:
    """Yield the first and last epoch, and those at which rank or number of known directions changes."""
    counts = np.stack([s.rank, s.known], axis=-1)
    changes = np.flatnonzero(np.any(np.diff(counts, axis=0) != 0, axis=-1)) + 1
    yield from sorted({0, *changes[: most - 2].tolist(), len(counts) - 1})


def write_observability(path: Path, found: Sequence[Observability], system: str) -> None:
    """Write ``summary.json``: ``system``, ``time_s``, and under ``sets`` what `Observability.summary` returns."""
    name, variant = split_name(system)
    whole = {
        "system": name,
        "variant": variant,
        "time_s": [float(t) for t in found[0].times],
        "sets": [one.summary() for one in found],
    }
    path.write_text(json.dumps(whole, indent=1, allow_nan=False) + "\n", encoding="utf-8")
