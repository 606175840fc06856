"""One trial in a whole Drake diagram: what a step costs, and what the diagram alone costs of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from tests.benchmarks.agreement import agreement
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.iterated_filter import COVARIANCE, POSITION, STONE_SOUP
from tests.benchmarks.own_peers import diagram
from tests.benchmarks.recorded_pass import record_pass
from tests.benchmarks.report import Section, Threshold, microseconds, spread
from tests.benchmarks.stone_soup_peers import iterated

__all__ = ["compare"]

Array = NDArray[np.float64]

WHOLE = "iekf in the diagram"
SHELL = "the diagram round a filter that does nothing"
FASTER = Threshold(8, at_least=True)
"""How many times a step costs Stone Soup what it costs in the diagram."""
LONGEST = Threshold(110, at_least=False)
"""Microseconds a step."""


class Idle(GaussianFilter):
    """A filter that returns what it is given: what is left is the diagram."""

    def __init__(self, trials: int, rows: int) -> None:
        self._report = np.zeros((trials, rows)), np.zeros(trials), np.full(trials, float(rows))

    def predict(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
        """See `GaussianFilter.predict`."""
        return mean, covariance

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        return Posterior(mean, covariance, *self._report)


def compare(size: Size) -> Section:
    """Return the table."""
    recorded = record_pass(size).first(1)
    section = Section(
        f"One trial in a whole Drake diagram (source, estimator, recorder), three_satellite, {len(recorded.times) - 1} "
        "steps: cost of a step",
        ("what", "microseconds: median (range)", "Stone Soup / this (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    work, peer = recorded.work, iterated(recorded)
    timings = race(
        [
            Peer(WHOLE, diagram(recorded.algorithm, recorded), work),
            Peer(SHELL, diagram(Idle(recorded.trials, recorded.model.size), recorded), work),
            Peer(STONE_SOUP, peer.run, work, peer.parts(size.slices)),
        ],
        size,
    )
    theirs, whole, shell = timings[STONE_SOUP], timings[WHOLE], timings[SHELL]
    gain = ratios(theirs, whole)
    section.rows += [
        (WHOLE, microseconds(whole.costs), spread(gain), str(FASTER), section.judge(gain, FASTER)),
        ("", "", "", f"{LONGEST} us", section.judge([1e6 * cost for cost in whole.costs], LONGEST)),
        (SHELL, microseconds(shell.costs), spread(ratios(theirs, shell)), "", ""),
        (STONE_SOUP, microseconds(theirs.costs), "1", "", ""),
    ]
    what = f"{WHOLE} and Stone Soup"
    section.notes += [
        agreement(whole.result, theirs.result).require(POSITION, COVARIANCE, what) + ".",
        "The diagram plays the measurements back from a source block, keeps the estimator's state, hands estimate and "
        "covariance to a recorder, and makes a new context for every run. Its own cost does not depend on the filter.",
    ]
    return section
