"""Judge the requirements of a file, each on as many trials as it needs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.source import beside
from quietfix.diagrams.chunks.jobs import Runner, run_here
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.origins import Origins
from quietfix.diagrams.statistics.sequential import FAILS, UNDECIDED, WORDS, judge
from quietfix.diagrams.studies.request import check_threads
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION
from quietfix.diagrams.tables.verification import limit_words, readable
from quietfix.diagrams.verification.specification import Requirement, Specification, read_specification
from quietfix.diagrams.verification.trials import Array, GrowingStudy, Kept, NotYet

__all__ = ["Finding", "Report", "Verification", "verify"]

Keep = Callable[[int, Array | None, Kept], None]


@dataclass(frozen=True)
class Finding:
    """What came out of one requirement.

    Attributes
    ----------
    requirement : Requirement
        What was asked.
    unit : str
        Of metric and limits.
    verdict : int
        `HOLDS`, `FAILS` or `UNDECIDED`.
    trials : int
        How many were used.
    estimate, lower, upper : float
        The metric, and its interval at the look that decided.
    tail : float
        Share of repetitions in which each end of the interval misses.
    """

    requirement: Requirement
    unit: str
    verdict: int
    trials: int
    estimate: float
    lower: float
    upper: float
    tail: float

    @property
    def word(self) -> str:
        """The verdict in words."""
        return f"undecided at {self.trials} trials" if self.verdict == UNDECIDED else WORDS[self.verdict]

    @property
    def limit(self) -> str:
        """The limit in words."""
        return limit_words(self.requirement.at_least, self.requirement.at_most)

    @property
    def metric(self) -> str:
        """The metric in words."""
        return self.requirement.measured.title()

    def sentence(self) -> str:
        """Return all of it in one line."""
        unit = f" {self.unit}" if self.unit else ""
        asked = self.requirement
        case = f" in case {asked.case}" if asked.case else ""
        return (
            f"{asked.name}: {self.word}; {self.metric} of {asked.estimator}{case} is {readable(self.estimate)}"
            f" [{readable(self.lower)}, {readable(self.upper)}]{unit}, limit {self.limit}{unit},"
            f" confidence {asked.confidence:g}, {self.trials} trials"
        )

    def as_json(self) -> dict[str, Any]:
        """Return it for ``verification.json``; null for what is not finite."""
        asked = self.requirement
        numbers = {"estimate": self.estimate, "lower": self.lower, "upper": self.upper}
        return {
            "name": asked.name,
            "case": asked.case or None,
            "estimator": asked.estimator,
            "metric": self.metric,
            "unit": self.unit or None,
            **{key: value if math.isfinite(value) else None for key, value in numbers.items()},
            "tail": self.tail,
            "at_least": asked.at_least,
            "at_most": asked.at_most,
            "confidence": asked.confidence,
            "verdict": WORDS[self.verdict],
            "trials": self.trials,
            "why": asked.why or None,
        }


@dataclass(frozen=True)
class Report:
    """What came out of a file.

    Attributes
    ----------
    path : Path
        The file.
    specification : Specification
        What is in it.
    seed : int
        Seed of all noise.
    looks : tuple of int
        The planned numbers of trials.
    findings : tuple of Finding
        In the order of the file.
    version : str
        Of Quietfix.
    """

    path: Path
    specification: Specification
    seed: int
    looks: tuple[int, ...]
    findings: tuple[Finding, ...]
    version: str

    @property
    def status(self) -> int:
        """Exit status: 0 all hold, 1 one fails, 3 none fails and one is undecided."""
        verdicts = {finding.verdict for finding in self.findings}
        return 1 if FAILS in verdicts else 3 if UNDECIDED in verdicts else 0

    def as_json(self) -> str:
        """Return ``verification.json``."""
        content = {
            "schema_version": SCHEMA_VERSION,
            "file": self.path.name,
            "system": self.specification.system,
            "seed": self.seed,
            "looks": list(self.looks),
            "version": self.version,
            "status": self.status,
            "requirements": [finding.as_json() for finding in self.findings],
        }
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


class Verification:
    """The requirements of a file; each is judged when it is asked for, and those of one case share its trials.

    The verdict on one requirement does not depend on which others are judged: every case is looked at after the
    same numbers of trials, and those are the same trials.

    Parameters
    ----------
    path : Path
        Requirements file.
    trials : int, optional
        Trials at the last look, instead of the file's.
    seed : int, optional
        Instead of the file's.
    chunk, threads : int
        As of `quietfix.diagrams.run_study`.
    runner : callable
        Who runs the trials.

    Raises
    ------
    UserError
        For a mistake in the file, naming field, value and what is allowed.
    """

    def __init__(
        self,
        path: Path | str,
        trials: int | None = None,
        seed: int | None = None,
        chunk: int | None = None,
        threads: int = 1,
        runner: Runner = run_here,
    ) -> None:
        self.path = Path(path)
        self.specification = read_specification(self.path)
        if trials is not None and trials < 1:
            raise UserError(f"--trials: {trials} is not allowed; a whole number >= 1")
        if seed is not None and seed < 0:
            raise UserError(f"--seed: {seed} is not allowed; a whole number >= 0")
        self.looks = self.specification.looks_at(trials)
        self.seed = self.specification.seed if seed is None else seed
        self._chunk, self._threads = chunk, check_threads(threads, self.looks[-1])
        self._runner = runner
        self._keep: Keep | None = None
        self._studies: dict[str, GrowingStudy] = {}

    def build(self) -> None:
        """Build the diagram of every case and check every requirement against it, before any trial is run."""
        for requirement in self.specification.requirements:
            self._study(requirement.case)

    @property
    def version(self) -> str:
        """Of Quietfix, as the studies say it."""
        return next(study.version for study in self._studies.values())

    def _study(self, case: str) -> GrowingStudy:
        if case not in self._studies:
            where = f"case {case}: " if case else ""
            with beside(self.path.parent):
                try:
                    self._studies[case] = GrowingStudy(
                        self.specification, self.path, case, self.looks, self.seed, self._chunk, self._threads
                    )
                except ValueError as error:  # a block says what is wrong with its arguments in the user's words
                    own = str(error).startswith("requirements.")
                    place = Origins([self.path]).place(str(error)) if own else self.path.name
                    raise UserError(f"{place}: {where}{error}") from error
        return self._studies[case]

    @property
    def plan(self) -> Plan:
        """What is asked for; its chunks are those of the first look at the first case, of the second, and so on."""
        asked: dict[str, Any] = {"command": "verify", "seed": self.seed, "looks": list(self.looks)}
        asked["requirements"] = self.path.read_text(encoding="utf-8")
        for case, study in self._studies.items():
            where = f"case {case}: " if case else ""
            asked |= {f"{where}{key}": value for key, value in study.plan.asked.items() if key != "command"}
            asked[f"{where}chunk"] = study.plan.chunk
        return Plan(asked, len(self._numbers), 1)

    @property
    def _numbers(self) -> dict[tuple[str, int, int], int]:
        """Which chunk of all it is, by case, look and number."""
        looks = range(len(self.looks))
        places = [(c, k, n) for c, study in self._studies.items() for k in looks for n in range(study.chunks(k))]
        return {place: i for i, place in enumerate(places)}

    def resume(self, finished: Mapping[int, tuple[Array | None, Kept]], keep: Keep) -> None:
        """Take chunks that were finished before, and have those that are run kept.

        Parameters
        ----------
        finished : mapping of int to tuple
            Of a chunk its part of the sums, and what was kept of it.
        keep : callable
            Gets number, sums and what is to be kept.
        """
        self._keep = keep
        for (case, look, number), place in self._numbers.items():
            if place in finished:
                self._studies[case].take(look, number, *finished[place])

    def _grow(self, wanted: Sequence[tuple[str, int]]) -> None:
        """Run the trials of cases up to a look."""
        numbers = self._numbers if self._keep is not None else {}
        jobs = [self._studies[case].job(look) for case, look in wanted]
        for which, part in self._runner(jobs):
            case, look = wanted[which]
            kept = self._studies[case].reduced(part.dataset)
            if self._keep is not None:
                self._keep(numbers[case, look, part.number], part.sums, kept)
            self._studies[case].take(look, part.number, part.sums, kept)
            del part

    def judge(self, requirement: Requirement) -> Finding:
        """Run as many trials as this requirement needs, and judge it."""
        (finding,) = self.judge_all([requirement])
        return finding

    def judge_all(self, requirements: Sequence[Requirement]) -> tuple[Finding, ...]:
        """Run as many trials as each of these requirements needs, those of all cases together, and judge them."""
        found: dict[int, Finding] = {}
        while len(found) < len(requirements):
            wanted: dict[tuple[str, int], None] = {}
            with beside(self.path.parent):
                for i, requirement in enumerate(requirements):
                    if i not in found:
                        try:
                            found[i] = self._judged(requirement)
                        except NotYet as more:
                            wanted[more.case, more.look] = None
                if wanted:
                    self._grow(list(wanted))
        return tuple(found[i] for i in range(len(requirements)))

    def _judged(self, requirement: Requirement) -> Finding:
        study = self._study(requirement.case)
        metric, confidence = requirement.measured, requirement.confidence
        assert confidence is not None
        found = judge(
            lambda n: study.samples(requirement, n),
            metric.statistic(study.run),
            requirement.limit,
            confidence,
            self.looks,
        )
        return Finding(
            requirement,
            metric.unit(study.run),
            int(found.verdict),
            int(found.trials),
            float(found.estimate),
            float(found.lower),
            float(found.upper),
            requirement.limit.tail(confidence, len(self.looks)),
        )

    def report(self) -> Report:
        """Judge all requirements."""
        self.build()
        findings = self.judge_all(self.specification.requirements)
        return Report(self.path, self.specification, self.seed, self.looks, findings, self.version)


def verify(
    path: Path | str,
    *,
    trials: int | None = None,
    seed: int | None = None,
    chunk: int | None = None,
    threads: int = 1,
) -> Report:
    """Judge all requirements of a file.

    Parameters
    ----------
    path : path
        A requirements file; see `quietfix.diagrams.verification.specification.Specification`.
    trials, seed : int, optional
        Trials at the last look and seed, instead of the file's.
    chunk, threads : int
        As of `quietfix.diagrams.run_study`.

    Returns
    -------
    Report

    Raises
    ------
    UserError
        For a mistake in the file, naming field, value and what is allowed.
    """
    return Verification(path, trials, seed, chunk, threads).report()
