"""What two workers gain over one: the chunks of a study, on this machine."""

from __future__ import annotations

import time
from contextlib import ExitStack

from quietfix.diagrams.chunks.jobs import Job
from quietfix.diagrams.scale.crew import Crew
from quietfix.diagrams.studies.study import Study
from tests.benchmarks.harness import Size
from tests.benchmarks.report import Section, Threshold, spread

__all__ = ["compare"]

GAIN = Threshold(1.8, at_least=True)
_CHUNKS = 16
_CREWS = {"this process": None, "1 worker": 1, "2 workers": 2}


def compare(size: Size) -> Section:
    """Return the table; all run the same chunks, one after the other in interleaved rounds."""
    width = 2 if size.tiny else 500
    trials, settings = _CHUNKS * width, [f"duration_s={min(size.duration, 30.0)}"]
    study = Study("three_satellite", estimators=["iekf"], trials=trials, chunk=width, set=settings)
    job = Job(study, study.plan(command="run"), range(_CHUNKS))
    section = Section(
        f"Workers: {_CHUNKS} chunks of {width} trials of three_satellite, `iekf`",
        ("who", "seconds: median (range)", "1 worker / this (range)", "threshold", "verdict"),
        judged=not size.tiny,
    )
    seconds: dict[str, list[float]] = {name: [] for name in _CREWS}
    with ExitStack() as stack:
        crews = {name: stack.enter_context(Crew(count, progress=False)) for name, count in _CREWS.items()}
        for crew in crews.values():
            _run(crew, job)  # every worker builds the study
        for turn in range(size.rounds):
            names = list(crews)[turn % len(crews) :] + list(crews)[: turn % len(crews)]
            for name in names:
                seconds[name].append(_run(crews[name], job))
    for name, taken in seconds.items():
        gain = [one / own for one, own in zip(seconds["1 worker"], taken, strict=True)]
        judged = (str(GAIN), section.judge(gain, GAIN)) if name == "2 workers" else ("", "")
        section.rows.append((name, spread(taken), spread(gain), *judged))
    section.notes.append(
        "By the clock on the wall, for the work is done in other processes: it says something on an idle machine of "
        "two cores or more. Workers are there and have built the study; chunks come back to the process that asked."
    )
    return section


def _run(crew: Crew, job: Job) -> float:
    """Run all chunks and return how long it takes [s]."""
    begun = time.monotonic()
    done = sum(part.end - part.begin for _, part in crew.run([job]))
    assert done == job.trials
    return time.monotonic() - begun
