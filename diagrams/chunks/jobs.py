"""Chunks of several studies that are to be run, and how this process runs them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan

__all__ = ["Job", "Runner", "Tell", "run_here"]

Tell = Callable[[float], None]
"""Is told how many trials are done."""


class Cut(Protocol):
    """A study that runs chunk by chunk."""

    @property
    def system(self) -> Any:
        """What it is of, which has a name."""
        ...

    def parts(
        self,
        progress: bool | Tell = False,
        first: int = 0,
        count: int | None = None,
        numbers: Collection[int] | None = None,
        width: int | None = None,
    ) -> Iterator[Part]:
        """See `quietfix.diagrams.studies.study.Study.parts`."""
        ...


@dataclass(frozen=True)
class Job:
    """Chunks of one study.

    Attributes
    ----------
    study : Study
    plan : Plan
        Of the whole study.
    numbers : collection of int
        Which of its chunks are run; where `count` is given, of those trials.
    first, count, width : int, optional
        The trials that are cut into chunks, and how wide these are, where they are not all of the study.
    beside : Path, optional
        A folder with modules of the user's.
    """

    study: Cut
    plan: Plan
    numbers: Collection[int]
    first: int = 0
    count: int | None = None
    width: int | None = None
    beside: Path | None = None

    @property
    def trials(self) -> int:
        """How many trials are to be run."""
        return sum(end - begin for begin, end in map(self.place, self.numbers))

    def place(self, number: int) -> tuple[int, int]:
        """Return where a chunk begins and ends, counted from `first`."""
        whole = self.plan.trials if self.count is None else self.count
        return Plan({}, whole, self.width or self.plan.chunk).place(number)


Runner = Callable[[Sequence[Job]], Iterator[tuple[int, Part]]]
"""Yields the chunks of jobs as they are finished, in any order, each with the number of its job."""


def run_here(jobs: Sequence[Job], tell: Tell | None = None) -> Iterator[tuple[int, Part]]:
    """Run jobs in this process, one after the other.

    Parameters
    ----------
    jobs : sequence of Job
    tell : callable, optional
        Is told how many trials are done of all that are to be run.
    """
    done = 0

    def told(now: float) -> None:
        if tell is not None:
            tell(done + now)

    for which, job in enumerate(jobs):
        for part in job.study.parts(told, job.first, job.count, job.numbers, job.width):
            yield which, part
            del part  # a generator keeps its variables while it waits and while the next chunk runs
        done += job.trials
