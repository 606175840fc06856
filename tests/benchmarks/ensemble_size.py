"""What a whole study costs, in time and memory, against the number of trials."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from tests.benchmarks.harness import Size
from tests.benchmarks.report import Section, microseconds, spread

__all__ = ["compare"]

_EXPENSIVE = 1000  # trials from which one run says enough: it averages over the machine's moods itself


def compare(size: Size) -> Section:
    """Return the table; every study runs in a process of its own."""
    counts = (3,) if size.tiny else (1, 10, 100, 1000, 10_000)
    bare = _run(0, size.duration)["megabytes"]
    streamed = {trials: _run(trials, size.duration, "chunks")["megabytes"] for trials in counts}
    runs: dict[int, list[dict[str, Any]]] = {trials: [] for trials in counts}
    for turn in range(size.rounds):
        for trials in counts:
            if turn == 0 or trials < _EXPENSIVE:
                runs[trials].append(_run(trials, size.duration))
    first = runs[counts[0]][0]
    section = Section(
        f"Whole study of three_satellite, {first['estimators']} estimators, {first['steps']} steps: time and peak "
        "memory",
        (
            "trials",
            "runs",
            "seconds: median (range)",
            "microseconds per trial, step and estimator",
            "peak memory, MB",
            "chunk by chunk, MB",
        ),
    )
    for trials, reports in runs.items():
        seconds = [report["seconds"] for report in reports]
        work = trials * first["estimators"] * first["steps"]
        section.rows.append(
            (
                str(trials),
                str(len(reports)),
                spread(seconds),
                microseconds([s / work for s in seconds]),
                f"{max(report['megabytes'] for report in reports):.0f}",
                f"{streamed[trials]:.0f}",
            )
        )
    section.notes += [
        "`run_study` with its defaults, each run in a process of its own; the time is that of the call, with building "
        "the diagram, simulating truth and sensors, resolving ambiguities, bounds, errors and the returned Dataset.",
        "The last column is a run whose chunks are not kept, as on the command line, which writes each to disk; the "
        "others return all trials in one Dataset.",
        f"Of the peak memory, {bare:.0f} MB are there after the imports, before anything runs.",
    ]
    return section


def _run(trials: int, duration: float, *mode: str) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.benchmarks.one_study", str(trials), str(duration), *mode]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"a study of {trials} trials ended with status {done.returncode}:\n{done.stderr}")
    report = json.loads(done.stdout.splitlines()[-1])
    assert report["trials"] == trials, f"{report['trials']} trials were run instead of {trials}"
    return report
