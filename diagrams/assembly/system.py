"""A system: its scenario, and what it declares of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pydrake.systems.framework import DiagramBuilder

from diagrams.assembly.build import Assembly, build
from diagrams.assembly.model import Model

__all__ = ["System"]


@dataclass(frozen=True)
class System:
    """What is simulated.

    Attributes
    ----------
    name : str
        As on the command line; the packaged scenarios are ``scenarios/NAME.yaml`` and ``NAME.VARIANT.yaml``.
    title : str
        One line.
    scenario : type
        Dataclass of its scenario.
    declare : callable
        ``declare(scenario) -> Model``.
    """

    name: str
    title: str
    scenario: type
    declare: Callable[[Any], Model]

    def build(self, builder: DiagramBuilder, scenario: Any, estimators: Sequence[str], trials: int) -> Assembly:
        """Put what a scenario declares and the estimators of these names into a diagram; see `assembly.build.build`."""
        options = {name: scenario.estimators[name] for name in estimators}
        return build(self.declare(scenario), builder, options, trials)
