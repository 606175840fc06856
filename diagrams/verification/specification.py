"""A requirements file: typed YAML, loaded and checked like a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.assembly.lineup import estimator_key
from quietfix.diagrams.assembly.source import beside
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.schema.origins import Origins
from quietfix.diagrams.schema.scenario import load, read_yaml
from quietfix.diagrams.statistics.sequential import Limit, plan_looks
from quietfix.diagrams.studies.recordings import only_simulated
from quietfix.diagrams.verification.metric import Metric
from quietfix.diagrams.verification.metrics import MetricChoice, RmseRatio
from quietfix.systems.documented import Allowed, count, documented, number, text

__all__ = ["Case", "Requirement", "Specification", "read_specification"]

_CONFIDENCE = Allowed(lambda v: 0.5 <= v < 1, "a number >= 0.5 and < 1, such as 0.95")
_FEWEST = 20


@dataclass
class Case:
    """One study: the system of the file, with a variant or settings of its own."""

    variant: str = text("variant of the system; by default the file's")
    set: list[str] = documented("changes of the scenario, KEY=VALUE, after the file's own", factory=list)


@dataclass
class Requirement:
    """What is asked."""

    name: str = text("what the report calls it")
    metric: MetricChoice | None = documented("what is measured: !Rmse, !Median, !Percentile ...", None)
    estimator: str = text("of which estimator; by default the file's only one")
    case: str = text("of which case; by default the file's only one")
    at_least: float | None = number("the metric is at least this, in its own unit (m, m/s, deg, s)", None)
    at_most: float | None = number("the metric is at most this", None)
    confidence: float | None = documented("that the verdict is right; by default the file's", None, allowed=_CONFIDENCE)
    why: str = text("where the limit comes from")

    @property
    def measured(self) -> Metric:
        """The metric, which a file that has been read has."""
        assert isinstance(self.metric, Metric)
        return self.metric

    @property
    def limit(self) -> Limit:
        """What the metric may be."""
        return Limit(self.at_least, self.at_most)


@dataclass
class Specification:
    """Requirements on one system."""

    system: str = text("NAME[:VARIANT], package.module:OBJECT, FILE.py:OBJECT or FILE.yaml, relative to this file")
    scenario: str = text("a YAML file laid over the packaged scenario, relative to this file")
    set: list[str] = documented("changes of the scenario, KEY=VALUE", factory=list)
    estimators: list[str] = documented("names, or package.module:Class (beside this file, too)", factory=list)
    cases: dict[str, Case] = documented("studies of the same system with other settings, by name", factory=dict)
    trials: int = count("trials at the first look", 100, at_least=_FEWEST)
    trial_limit: int = count("trials at the last look", 1000, at_least=_FEWEST)
    looks: int = count("planned looks, from the first to the last in equal ratios", 4)
    seed: int = count("seed of all noise", 0, at_least=0)
    confidence: float = documented("that a verdict is right, each requirement by itself", 0.95, allowed=_CONFIDENCE)
    slow: bool = documented("whether pytest marks the tests `slow`", True)
    requirements: list[Requirement] = documented("what is asked", factory=list)

    def looks_at(self, trials: int | None = None) -> tuple[int, ...]:
        """Return at how many trials is looked; `trials` instead of the file's limit."""
        limit = self.trial_limit if trials is None else trials
        return plan_looks(min(self.trials, limit), limit, self.looks)


def read_specification(path: Path) -> Specification:
    """Read and check a requirements file, as far as that can be done without building its diagrams.

    Raises
    ------
    UserError
        Naming the file, the field, the value and what is allowed.
    """
    data = read_yaml(path, "requirements file")
    if not data:
        raise UserError(f"requirements file: {path} is empty; a system and its requirements are needed")
    with Origins([path]).placing():
        specification: Specification = load(Specification, [data])
        with beside(path.parent):
            _complete(specification, path.parent)
    return specification


def _complete(specification: Specification, folder: Path) -> None:
    """Fill in what a requirement leaves to the file, and check what belongs together."""
    if not specification.system:
        raise UserError("system: it is missing; a name that `quietfix list` prints")
    found = find(specification.system, folder=folder)
    only_simulated(found, "verify")
    if specification.trials > specification.trial_limit:
        raise UserError(
            f"trials: {specification.trials} is not allowed; at most trial_limit, which is {specification.trial_limit}"
        )
    for name, case in specification.cases.items():
        if case.variant:
            try:
                found.of(case.variant)
            except UserError as error:
                raise UserError(f"cases.{name}.variant: {error}") from error
    if not specification.requirements:
        raise UserError("requirements: none is given; at least one is needed")
    keys: dict[str, str] = {}
    for name in specification.estimators:
        first = keys.setdefault(estimator_key(name), name)
        if first != name:
            raise UserError(f"estimators: {name} is not allowed; {first} has the same name, {estimator_key(name)}")
    names: dict[str, int] = {}
    for i, requirement in enumerate(specification.requirements):
        where = f"requirements.{i}"
        _complete_one(specification, requirement, where)
        if requirement.name in names:
            raise UserError(
                f"{where}.name: {requirement.name!r} is not allowed; number {names[requirement.name]} has it"
            )
        names[requirement.name] = i


def _complete_one(specification: Specification, requirement: Requirement, where: str) -> None:
    if requirement.metric is None:
        raise UserError(f"{where}.metric: it is missing; a tag such as !Rmse {{of: position, time_s: 100}}")
    least, most = requirement.at_least, requirement.at_most
    if least is None and most is None:
        raise UserError(f"{where}: there is no limit; at_least, at_most or both")
    if least is not None and most is not None and not least < most:
        raise UserError(f"{where}.at_least: {least:g} is not allowed; less than at_most, which is {most:g}")
    requirement.confidence = specification.confidence if requirement.confidence is None else requirement.confidence
    requirement.case = (
        _only(requirement.case, list(specification.cases), f"{where}.case") if specification.cases else ""
    )
    keys = [estimator_key(name) for name in specification.estimators]
    if keys:
        requirement.estimator = _only(estimator_key(requirement.estimator), keys, f"{where}.estimator")
    elif not requirement.estimator:
        raise UserError(f"{where}.estimator: it is missing; a name that `quietfix show {specification.system}` prints")
    if isinstance(requirement.metric, RmseRatio):
        if not requirement.metric.to:
            raise UserError(f"{where}.metric.to: it is missing; another estimator")
        if keys:
            requirement.metric.to = choose(f"{where}.metric.to", estimator_key(requirement.metric.to), keys)
    if not requirement.name:
        requirement.name = requirement.measured.title()


def _only(value: str, allowed: list[str], where: str) -> str:
    """Return the value if it is allowed, the only allowed one if there is none."""
    if not value and len(allowed) == 1:
        return allowed[0]
    if not value:
        raise UserError(f"{where}: it is missing; one of {', '.join(allowed)}")
    return choose(where, value, allowed)
