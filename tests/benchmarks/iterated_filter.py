"""The iterated extended Kalman filter against Stone Soup's: 100 trials, and one alone."""

from __future__ import annotations

from functools import partial

from tests.benchmarks.agreement import agreement
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.own_peers import diagram, loop
from tests.benchmarks.recorded_pass import RecordedPass, record_pass
from tests.benchmarks.report import Section, Threshold, microseconds, spread
from tests.benchmarks.stone_soup_peers import iterated

__all__ = ["compare"]

# Both make the same Gauss-Newton steps and stop by the same rule, ||step|| <= 0.01, so only rounding may differ:
# a hundredth of the stop rule shows that they also stopped at the same step.
POSITION = 1e-4
# Stone Soup subtracts K S K^T from covariances with condition numbers up to 1e8: 1e-16 becomes 1e-8.
COVARIANCE = 1e-6

FUNCTIONS = "quietfix iekf, functions in a loop"
DIAGRAM = "quietfix iekf, Drake diagram"
STONE_SOUP = "Stone Soup IteratedKalmanUpdater"


def compare(size: Size) -> Section:
    """Return the table for an ensemble and for a single trial."""
    recorded = record_pass(size)
    section = Section(
        f"Iterated extended Kalman filter, three_satellite, {len(recorded.times) - 1} steps: cost of one trial "
        "and step",
        ("trials", "peer", "microseconds: median (range)", "Stone Soup / this (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    for trials, threshold in ((recorded.trials, Threshold(170, True)), (1, Threshold(25, True))):
        _add(section, recorded.first(trials), threshold, size)
    section.notes += [
        "One prediction and one update, on the same recorded measurements, with the same start, Q, R and stop rule "
        "(the state moves by less than 0.01 m; at most 10 linearisations).",
        "All peers start from the same arrays of measurements and satellite states. Stone Soup (KalmanPredictor, "
        "time-invariant F and Q) runs trial by trial; its measurement model is written for one state vector, with an "
        "analytic Jacobian, and is made once per epoch for all trials.",
        "What differs: Stone Soup always makes a second linearisation, Quietfix only if the first step was longer "
        "than the tolerance (here it always is); Stone Soup subtracts K S K^T, Quietfix keeps the covariance "
        "positive definite, looks for missing rows and reports innovation and NIS.",
        "The diagram plays the recorded measurements back and records estimate and covariance; it is built once, "
        "and every run has a new context.",
    ]
    return section


def _add(section: Section, recorded: RecordedPass, threshold: Threshold, size: Size) -> None:
    work = recorded.work
    peer = iterated(recorded)
    timings = race(
        [
            Peer(FUNCTIONS, partial(loop, recorded.algorithm, recorded), work),
            Peer(DIAGRAM, diagram(recorded.algorithm, recorded), work),
            Peer(STONE_SOUP, peer.run, work, peer.parts(size.slices)),
        ],
        size,
    )
    theirs = timings[STONE_SOUP]
    trials = str(recorded.trials)
    for name in (FUNCTIONS, DIAGRAM):
        mine = timings[name]
        gain = ratios(theirs, mine)
        # The diagram is judged against the loop, in a comparison of its own.
        judged = (str(threshold), section.judge(gain, threshold)) if name == FUNCTIONS else ("", "")
        section.rows.append((trials, name, microseconds(mine.costs), spread(gain), *judged))
        check = agreement(mine.result, theirs.result)
        what = f"{recorded.trials} trial{'s' * (recorded.trials > 1)}: {name} and Stone Soup"
        section.notes.append(check.require(POSITION, COVARIANCE, what) + ".")
    section.rows.append((trials, STONE_SOUP, microseconds(theirs.costs), "1", "", ""))
