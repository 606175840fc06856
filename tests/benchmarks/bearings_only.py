"""Cost of locating by bearings: what the paper calls too complex, beside what it does, in a diagram of 100 trials."""

from __future__ import annotations

from functools import partial

from quietfix.diagrams.studies.study import Study
from tests.benchmarks.harness import Peer, Size, race, ratios
from tests.benchmarks.report import Section, microseconds, spread

__all__ = ["compare"]

_NAMES = ("way2_first", "way2_lines", "ekf", "mgekf", "ukf", "iekf", "ml")


def _run(name: str, trials: int, duration: float) -> float:
    """Run a study of one estimator; return its last epoch [s]."""
    study = Study("bearing_crossing", trials=trials, estimators=[name], set=[f"duration_s={duration}"], every=50)
    return float([chunk["time"].values[-1] for chunk in study.chunks()][-1])


def compare(size: Size) -> Section:
    """Return the table: a whole study each, with sensor, azimuth filter, recorder and bound."""
    duration = 6.0 if size.tiny else 60.0
    section = Section(
        f"Bearing crossing, whole studies of {size.trials} trials and {duration:g} steps: cost of one trial and step",
        ("estimator", "microseconds: median (range)", "this / way2_first (range)"),
    )
    work = int(size.trials * duration)
    timings = race([Peer(name, partial(_run, name, size.trials, duration), work) for name in _NAMES], size)
    for name in _NAMES:
        mine = timings[name]
        section.rows.append((name, microseconds(mine.costs), spread(ratios(mine, timings["way2_first"]))))
    section.notes.append(
        "The Jacobian of a bearing costs less than the azimuth filter and the crossing that are to avoid it. ml fits "
        "all bearings so far at every step, so its cost grows with them; iekf is eight filters."
    )
    return section
