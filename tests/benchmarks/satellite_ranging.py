"""Ranging and RA for an ensemble, against the filter update alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.relative_kinematics import ROWS
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.memory import Epoch
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.orbit_plane import plane_normal
from quietfix.systems.fixes.ranging import RangingEquation
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.options.ranging.range_decomposed import RangeDecomposed
from quietfix.systems.signals import Draw
from quietfix.systems.starts.start import GivenStart
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.report import Section, Threshold, spread
from tests.systems.ranging_scene import EARTH, PRIOR, TARGET, measurements, sensor

__all__ = ["compare"]

Array = NDArray[np.float64]

STEP = 10.0
LIMITS = {False: 5.0, True: 15.0}
"""Milliseconds a step that roots and filter of RA may take, without and with J2."""


def compare(size: Size) -> Section:
    """Return the table, without and with J2."""
    section = Section(
        f"Satellite ranging: roots and RA for {size.trials} trials, a step",
        ("dynamics", "what", "ms: median (range)", "over the filter alone (range)", "threshold [ms]", "verdict"),
        judged=not size.tiny,
    )
    for j2 in (False, True):
        _add(section, j2, size)
    section.notes += [
        "Roots: all positive roots of the ranging equation and the gates. RA: roots, choice by the orbit plane, "
        "covariance at the prediction, prediction with variational equations, update, plane. "
        "Filter alone: prediction and one extended Kalman update with the raw six rows.",
        "The thresholds are for an idle core of 2 GHz.",
    ]
    return section


def _add(section: Section, j2: bool, size: Size) -> None:
    epochs = 3 if size.tiny else 50
    measured, observer, _ = measurements(size.trials, epochs, 1, j2)
    motion = OrbitalMotion(EARTH, j2)
    prior = TARGET + np.random.default_rng(2).standard_normal((size.trials, 6)) * np.sqrt(np.diag(PRIOR)) / 10
    equation = RangingEquation(EARTH, j2)
    work = size.trials * epochs
    peers: dict[str, Callable[[], Array]] = {
        "roots": partial(_roots, equation, measured, observer),
        "RA": partial(_ra, motion, measured, observer, prior, j2),
        "filter alone": partial(_filter, motion, measured, observer, prior, j2),
    }
    timings = race([Peer(name, run, work) for name, run in peers.items()], size)
    if not np.isfinite(timings["RA"].result).all() or not np.isfinite(timings["filter alone"].result).all():
        raise ArithmeticError("RA and the filter should have followed every trial, but it is not so")
    alone, limit = timings["filter alone"], Threshold(LIMITS[j2], at_least=False)
    for name, timing in timings.items():
        spent = [1e3 * cost * size.trials for cost in timing.costs]
        judged = name == "RA"
        section.rows.append(
            (
                "J2" if j2 else "two bodies",
                name,
                spread(spent),
                spread(ratios(timing, alone)),
                str(limit) if judged else "",
                section.judge(spent, limit) if judged else "",
            )
        )


def _roots(equation: RangingEquation, measured: Array, observer: Array) -> Array:
    return np.stack([equation.candidates(measured[:, k], own, 100e3)[0] for k, own in enumerate(observer)])


def _ra(motion: OrbitalMotion, measured: Array, observer: Array, prior: Array, j2: bool) -> Array:
    trials = len(prior)
    wiring = Wiring(trials, tuple(ROWS), Periodic(STEP), 1)
    block = RangeDecomposed("ra", sensor(j2), motion, GivenStart(prior, PRIOR), wiring)
    whitener = Whitener(block.model.noise_covariance())
    memory = block.begin(prior, np.tile(PRIOR, (trials, 1, 1)), Epoch(0.0, 0, Draw()))
    memory |= {"normal": np.tile(plane_normal(TARGET), (trials, 1)), "count": np.full((trials, 1), 20.0)}
    for k, own in enumerate(observer):
        epoch = Epoch(STEP * k, k, Draw())
        if k:
            memory = block.predict(memory, STEP, epoch)
        memory, _ = block.update(memory, Observation(measured[:, k], own[None, None], whitener), epoch)
    return memory["mean"]


def _filter(motion: OrbitalMotion, measured: Array, observer: Array, prior: Array, j2: bool) -> Array:
    model, algorithm = sensor(j2), IteratedExtendedKalman(max_iterations=1)
    whitener = Whitener(model.noise_covariance())
    mean, covariance = prior, np.tile(PRIOR, (len(prior), 1, 1))
    for k, own in enumerate(observer):
        if k:
            mean, covariance = algorithm.predict(mean, covariance, motion, STEP)
        result = algorithm.update(mean, covariance, Observation(measured[:, k], own[None, None], whitener), model)
        mean, covariance = result.mean, result.covariance
    return mean
