"""Extended and unscented Kalman filters against FilterPy's."""

from __future__ import annotations

from functools import partial

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.unscented import UnscentedKalman
from tests.benchmarks.agreement import agreement
from tests.benchmarks.filterpy_peers import extended, unscented
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.own_peers import diagram, loop
from tests.benchmarks.recorded_pass import record_pass
from tests.benchmarks.report import Section, Threshold, microseconds, spread

__all__ = ["compare"]

# The same equations without a stop rule, so only rounding: 1e-16 of 6e6 m, through covariances with condition
# numbers up to 1e8.
POSITION = 1e-4
COVARIANCE = 1e-6

ALONE = "quietfix, 1 trial"
DIAGRAM = "quietfix, 1 trial, Drake diagram"
LIMITS = {("ekf", ALONE): Threshold(5, True), ("ekf", DIAGRAM): Threshold(1.5, True)}
"""How many times a step costs FilterPy what it costs here."""


def compare(size: Size) -> Section:
    """Return the table; FilterPy knows one trial at a time."""
    recorded = record_pass(size)
    alone = recorded.first(1)
    section = Section(
        f"Extended and unscented Kalman filter, three_satellite, {len(recorded.times) - 1} steps: cost of one trial "
        "and step",
        ("filter", "peer", "microseconds: median (range)", "FilterPy / this (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    together = f"quietfix, {recorded.trials} trials"
    for name, algorithm, peer in (
        ("ekf", IteratedExtendedKalman(max_iterations=1), extended),
        ("ukf", UnscentedKalman(), unscented),
    ):
        timings = race(
            [
                Peer(together, partial(loop, algorithm, recorded), recorded.work),
                Peer(ALONE, partial(loop, algorithm, alone), alone.work),
                Peer(DIAGRAM, diagram(algorithm, alone), alone.work),
                Peer("FilterPy, 1 trial", peer(alone), alone.work),
            ],
            size,
        )
        theirs = timings["FilterPy, 1 trial"]
        check = agreement(timings[ALONE].result, theirs.result)
        section.notes.append(check.require(POSITION, COVARIANCE, f"{name}: quietfix and FilterPy") + ".")
        for label in (together, ALONE, DIAGRAM):
            gain, limit = ratios(theirs, timings[label]), LIMITS.get((name, label))
            judged = ("", "") if limit is None else (str(limit), section.judge(gain, limit))
            section.rows.append((name, label, microseconds(timings[label].costs), spread(gain), *judged))
        section.rows.append((name, "FilterPy, 1 trial", microseconds(theirs.costs), "1", "", ""))
    section.notes.append(
        "FilterPy gets the measurement function of one state vector and its analytic Jacobian, as Stone Soup does, "
        "with TDOA as range difference in metres (in seconds it warns of an ill-conditioned matrix at every step); "
        "the unscented filters have the same points and weights and draw them anew after the prediction."
    )
    return section
