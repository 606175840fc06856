"""What a worker does: it builds the study that a plan says, once, keeps it, and runs chunks of it.

What goes to a worker is what a result says of itself, as text: it builds the study from that as ``--from`` does.
"""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from quietfix.diagrams.assembly.source import beside as importable
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.scale.asked import built
from quietfix.diagrams.statistics.tally import tally_of
from quietfix.diagrams.studies.rerun import ask_as
from quietfix.diagrams.studies.study import Study

__all__ = ["run_chunk"]

_ALSO = ("command", "write_measurements", "at")
"""What else a plan says than a study: what is done with it."""
_KEPT = 8
"""So many studies are kept built: those of a comparison, of the cases of requirements; a sweep goes point by point."""
_STUDIES: dict[str, tuple[Study, str]] = {}


def run_chunk(
    plan: str,
    number: int,
    first: int = 0,
    count: int | None = None,
    width: int | None = None,
    beside: str | None = None,
) -> Part:
    """Run a chunk in a worker.

    Parameters
    ----------
    plan : str
        The plan of the study as text.
    number : int
        Which chunk.
    first, count, width : int, optional
        Of which trials, and how wide it is; see `quietfix.diagrams.chunks.jobs.Job`.
    beside : str, optional
        A folder with modules of the user's.

    Raises
    ------
    UserError
        If what is built here is not what was asked for: another version, other files.
    """
    with (
        nullcontext() if beside is None else importable(Path(beside)),
        warnings.catch_warnings(record=True) as told,
    ):
        warnings.simplefilter("always", UserWarning)
        study, command = _study(plan)
        (part,) = study.parts(first=first, count=count, numbers=(number,), width=width)
    words = tuple(str(one.message) for one in told if one.category is UserWarning)
    return replace(part, told=words, tally=tally_of(part.dataset) if command == "run" else {})


def _study(text: str) -> tuple[Study, str]:
    """Return the study of a plan, which is built once, and what it is for."""
    if text not in _STUDIES:
        plan = Plan.read(text)
        also = {key: plan.asked.get(key) for key in _ALSO if key in plan.asked}
        command = str(also.get("command"))
        found, options = ask_as(plan.asked, "--workers: the study", None, {"chunk": plan.chunk}, True)
        study = built(found, options, bool(also.get("write_measurements")), command)
        plan.refuse_other(study.plan(**also), "--workers", "what was asked for")
        while len(_STUDIES) >= _KEPT:
            del _STUDIES[next(iter(_STUDIES))]
        _STUDIES[text] = study, command
    _STUDIES[text] = _STUDIES.pop(text)  # the last one used is the last one forgotten
    return _STUDIES[text]
