"""What the Drake diagram costs: the same filters in a plain loop over the same measurements."""

from __future__ import annotations

from functools import partial

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.unscented import UnscentedKalman
from tests.benchmarks.agreement import agreement
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.own_peers import diagram, loop
from tests.benchmarks.recorded_pass import record_pass
from tests.benchmarks.report import Section, Threshold, microseconds, spread

__all__ = ["compare"]

# The same functions on the same arrays.
EXACT = 1e-9


def compare(size: Size) -> Section:
    """Return the table for `iekf` (which has the threshold), `ekf` and `ukf`."""
    recorded = record_pass(size)
    section = Section(
        f"Drake diagram against the bare filter functions in a loop, {recorded.trials} trials: cost of one trial "
        "and step, microseconds",
        ("filter", "loop (range)", "diagram (range)", "diagram / loop (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    for name, algorithm in (
        ("iekf", recorded.algorithm),
        ("ekf", IteratedExtendedKalman(max_iterations=1)),
        ("ukf", UnscentedKalman()),
    ):
        timings = race(
            [
                Peer("loop", partial(loop, algorithm, recorded), recorded.work),
                Peer("diagram", diagram(algorithm, recorded), recorded.work),
            ],
            size,
        )
        inside, outside = timings["diagram"], timings["loop"]
        agreement(inside.result, outside.result).require(EXACT, EXACT, f"{name}: diagram and loop")
        cost = ratios(inside, outside)
        threshold = Threshold(1.3, False) if name == "iekf" else None
        section.rows.append(
            (
                name,
                microseconds(outside.costs),
                microseconds(inside.costs),
                spread(cost),
                str(threshold) if threshold else "",
                section.judge(cost, threshold) if threshold else "",
            )
        )
    section.notes += [
        "Both predict and update all trials at once from the same arrays and keep mean and covariance of every "
        f"epoch; they agree within {EXACT:.0e} m and m/s.",
        "The diagram besides copies what goes over its wires, plays the measurements back from a source block, "
        "reports innovation and NIS, remembers when it was last updated, and makes a new context for every run.",
        "The overhead is per step, not per trial: the cheaper the filter, the larger its share.",
    ]
    return section
