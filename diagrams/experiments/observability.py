"""What the measurements of a run say of the state at its start, in words: `quietfix observe`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.assembly.lineup import estimator_key
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.quantities.directions import named_components
from quietfix.diagrams.quantities.states import POSITION, VELOCITY, shared, translated
from quietfix.diagrams.schema.errors import UserError, texts
from quietfix.diagrams.statistics.bounds import alike, rows_present
from quietfix.diagrams.statistics.fisher_information import Spectrum, information_roots, spectrum
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.studies.study import Study
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.integration import simulator_of
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw

__all__ = ["Observability", "observe", "prior_root", "share_words"]

Array = NDArray[np.float64]

_SMALL = 0.05  # shares below it are not worth a word
_UNTOLD = 0.99  # share of a prior variance that is left, from which on the measurements tell nothing of it
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
    root : ndarray, shape (n, n)
        Square root of the prior's covariance P0, rows in `components`, SI units.
    units : list of str
        Their units.
    spectrum : Spectrum
        Over the epochs: the generalised eigenvalues of the information against the inverse of P0, as standard
        deviations in terms of the prior's.
    sight : ndarray, shape (n,)
        The line of sight from the first platform at the first epoch, in the position's components, else NaN.
    platform : str
        That platform's name.
    ranged : bool
        Whether components are told along and across that line.
    """

    estimators: list[str]
    rows: list[str]
    times: Array
    components: list[str]
    root: Array
    units: list[str]
    spectrum: Spectrum
    sight: Array
    platform: str
    ranged: bool

    @property
    def observable_from(self) -> float:
        """When the last direction is known better than the prior, seconds after the first epoch; NaN: never."""
        whole = self.spectrum.known == len(self.components)
        return float(self.times[np.argmax(whole)] - self.times[0]) if whole[-1] else math.nan

    @property
    def prior_sigma(self) -> Array:
        """Standard deviation of each component in the prior, shape (n,), SI units."""
        return np.asarray(np.linalg.norm(self.root, axis=-1))

    @property
    def weakest_shares(self) -> Array:
        """What the direction that is known worst is made of, each component in its prior sigma, shape (time, n)."""
        shares = self.spectrum.shares(self.root)[:, -1]
        return np.asarray(shares / shares.sum(axis=-1, keepdims=True))

    def weakest(self, epoch: int = -1) -> dict[str, float]:
        """Return the share of each component in the direction that is known worst, largest first."""
        return _sorted(self.components, self.weakest_shares[epoch])

    def unknown(self, epoch: int = -1) -> dict[str, float]:
        """Return the share of each component that the measurements do not know better than the prior, largest first.

        Of its variance in the prior: the part in such directions.
        """
        return _sorted(self.components, self.spectrum.unknown(self.root)[epoch])

    def remaining(self, epoch: int = -1) -> dict[str, float]:
        """Return posterior over prior variance of each component, largest first: near 1 nothing is told of it."""
        return _sorted(self.components, self.spectrum.remaining(self.root)[epoch])

    def weakest_words(self, epoch: int = -1) -> str:
        """Return the worst direction in words."""
        words = share_words(self.weakest(epoch))
        place = np.where(np.isnan(self.sight), 0.0, self.root @ self.spectrum.directions[epoch, -1])
        length = float(place @ place)
        widest = float(np.square(self.prior_sigma[~np.isnan(self.sight)]).sum())
        if "range" not in self.components and length > _SMALL * widest:
            along = float(place @ np.nan_to_num(self.sight)) ** 2 / length
            if along > _IN_SIGHT:
                words += f" (position: along the line of sight from {self.platform}, {100 * along:.0f} %)"
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
        untold = [name for name, left in self.remaining().items() if left > _UNTOLD]
        nothing = f"; they tell nothing of {', '.join(untold)}" if untold else ""
        if rank < n:
            return (
                f"unobservable within {span}: rank {rank} of {n}; {n - known} directions no better known than the "
                f"prior: {share_words(self.unknown())}{nothing}"
            )
        return (
            f"weakly observable within {span}: rank {n}, but {n - known} of {n} directions no better known than "
            f"the prior: {share_words(self.unknown())}{nothing}"
        )

    def summary(self) -> dict[str, Any]:
        """Return what goes into ``summary.json``; null where a number is infinite or undefined."""
        s = self.spectrum
        return {
            "estimators": self.estimators,
            "rows": self.rows,
            "components": self.components,
            "ranges_from": self.platform if self.ranged else None,
            "prior_sigma": json_numbers(self.prior_sigma),
            "units": self.units,
            "rank": s.rank.tolist(),
            "known": s.known.tolist(),
            "condition": json_numbers(s.condition),
            "sigma": json_numbers(s.sigma),
            "weakest": json_numbers(self.weakest_shares),
            "unknown": json_numbers(s.unknown(self.root)),
            "variance_left": json_numbers(s.remaining(self.root)),
            "variance_left_of_directions": json_numbers(s.left),
            "observable_from_s": json_numbers(self.observable_from),
            "verdict": self.verdict(),
        }


def _sorted(names: Sequence[str], shares: Array) -> dict[str, float]:
    return {names[i]: float(shares[i]) for i in np.argsort(-shares, kind="stable")}


def share_words(shares: Mapping[str, float]) -> str:
    """Return components and their shares in words, without those below 5 %."""
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items() if share >= _SMALL)


def prior_root(names: Sequence[str], covariances: Sequence[Array]) -> Array:
    """Return the square root (n, n) of the prior that says most: of the covariance with the smallest determinant.

    Parameters
    ----------
    names : sequence of str
        Components of the state.
    covariances : sequence of ndarray, shape (n, n)
        Priors; an estimator that starts without one has a huge covariance, and another's then counts.

    Raises
    ------
    UserError
        If a prior knows a component, or a combination of them, exactly: nothing can be compared with that.
    """
    roots = []
    for covariance in covariances:
        sigma = np.sqrt(np.diagonal(covariance))
        exact = [name for name, value in zip(names, sigma, strict=True) if not (math.isfinite(value) and value > 0)]
        if exact:
            raise UserError(f"start: sigma of {exact[0]} is {sigma[list(names).index(exact[0])]:g}; finite and > 0")
        try:
            roots.append(sigma[:, None] * np.linalg.cholesky(covariance / np.outer(sigma, sigma)))
        except np.linalg.LinAlgError as error:
            raise UserError(f"start: its covariance of {', '.join(names)} is singular; it must not be") from error
    return min(roots, key=lambda root: float(np.log(np.diagonal(root)).sum()))


# -------------------------------------------------------------------------------------------------- of a run


def observe(
    system: str | System | Found,
    *,
    estimators: Sequence[str] | None = None,
    window: float | None = None,
    variant: str | None = None,
    scenario: Any = None,
    set: Sequence[str] | Mapping[str, Any] | None = None,
    seed: int = 0,
) -> list[Observability]:
    """Return what the measurements of a run say of the state at its start, and when.

    Compared with the narrowest covariance P0 that an estimator of the same state starts from, at the truth. A start
    that is made from the first measurement knows that one already; it counts among the measurements all the same.

    Parameters
    ----------
    system : str or System
        As of `quietfix.diagrams.run_study`.
    estimators : sequence of str, optional
        Whose measurements and motion; by default all of the scenario, each set of rows once.
    window : float, optional
        Length from the first epoch on [s]; by default the whole run.
    variant, scenario, set, seed
        See `quietfix.diagrams.run_study`; the truth is that of trial 0.

    Returns
    -------
    list of Observability
        One per set of rows and motion model.

    Raises
    ------
    UserError
        For a window outside the run, an unknown estimator, or one whose start nobody can say.
    """
    asked = texts("estimators", estimators)
    # the scenario's estimators are there too, for the priors that they know
    everyone = ["default", *asked] if asked else None
    study = Study(system, estimators=everyone, trials=1, variant=variant, scenario=scenario, set=set, seed=seed)
    chosen = list(study.request.estimators)
    if asked and "default" not in asked:
        chosen = list(dict.fromkeys(map(estimator_key, asked)))
    with study.blaming():
        return _observed(study, chosen, window, bool(asked))


def _observed(study: Study, chosen: Sequence[str], window: float | None, asked: bool) -> list[Observability]:
    """Return what a study's measurements say; `asked`: whether those chosen were asked for."""
    wired = study.probe
    times = _window(wired.clock.ticks(wired.duration), window)
    truth, platforms, present = _course(study, times)
    states = {name: translated(truth, wired.truth_names, block.motion) for name, block in wired.estimators.items()}
    priors: dict[str, Array] = {}
    for name, block in wired.estimators.items():
        known = block.bound_prior(states[name][:, 0], platforms[:, 0])[0]
        if known is not None and known.shape[-1] == block.motion.size:
            priors[name] = known if known.ndim == 2 else known[0]
    usable = {name: wired.estimators[name] for name in priors}
    lacking = [name for name in chosen if name not in usable]
    if asked and lacking:
        raise UserError(f"estimator: {lacking[0]} has a start that nobody can say; one of {', '.join(usable)}")
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
        raise UserError(
            f"{study.found.title}: of no estimator's start can be said what it knows, so that nothing is compared"
        )

    found = []
    for members, block in groups:
        like = [priors[name] for name, other in usable.items() if other.motion.names == block.motion.names]
        prior = prior_root(block.motion.names, like)
        found.append(_one(members, block, wired, times, states[members[0]], platforms, present, prior))
    return found


def _window(ticks: Array, window: float | None) -> Array:
    span = float(ticks[-1] - ticks[0])
    if window is None:
        return ticks
    if not (math.isfinite(window) and 0 <= window <= span * (1 + 1e-9)):
        raise UserError(f"window: {window:g} is not allowed; 0 to {span:g} s, the length of the run")
    return ticks[ticks - ticks[0] <= window * (1 + 1e-9)]


def _course(study: Study, times: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Run a diagram until the last of `times`; return truth (1, time, n), platforms (1, time, p, 6), rows measured."""
    builder = DiagramBuilder()
    # one estimator is enough of a diagram; the truth does not depend on which
    alone = study.assemble(builder, 1, study.request.estimators[:1])
    recorder = record(builder, alone.course, alone.clock)
    diagram = alone.finish()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(study.request.seed, 0))
    simulator = simulator_of(diagram, context, study.model.step)
    simulator.Initialize()
    simulator.AdvanceTo(float(times[-1]))
    signals = {name: np.swapaxes(log[: times.size], 0, 1) for name, log in recorder.result(context)[1].items()}
    platforms = signals["platforms"].reshape(1, times.size, -1, 6)
    return signals["truth"], platforms, np.isfinite(signals["sensed"])


def _one(
    names: list[str],
    block: Estimator,
    wired: Assembly,
    times: Array,
    truth: Array,
    platforms: Array,
    present: NDArray[np.bool_],
    prior: Array,
) -> Observability:
    model, motion = block.bound_model, block.motion
    seen = rows_present(wired, block, present)
    roots = information_roots(truth, platforms, times, model, motion, prior, seen)[0]
    placed = [motion.names.index(name) for name in shared(POSITION, motion.names)]
    moving = [motion.names.index(name) for name in shared(VELOCITY, motion.names)]
    place, platform = truth[0, 0, placed], platforms[0, 0, 0]
    velocity = truth[0, 0, moving] if len(moving) == len(placed) else np.zeros(len(placed))
    told = wired.model.axes.directions(place, velocity, platform)
    rotation = told.rotation
    labels, turned = named_components(motion.names, told.names, rotation)
    sight = np.full(motion.size, np.nan)
    away = place - platform[: len(placed)]
    sight[placed] = rotation @ (away / max(float(np.linalg.norm(away)), np.finfo(float).tiny))
    found = spectrum(roots)
    return Observability(
        names,
        list(model.names),
        times,
        labels,
        turned @ prior,
        list(motion.units),
        found,
        sight,
        wired.platform_names[0],
        told.sighted,
    )
