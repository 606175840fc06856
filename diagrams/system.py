"""What a system is to studies, figures and the command line: its scenario and how it is wired."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort

from diagrams.assembly.build import build
from diagrams.assembly.model import Model
from diagrams.errors import UserError
from systems.clocks import Clock
from systems.estimators.base import Estimator
from systems.motion.base import MotionModel

__all__ = ["System", "Wired"]

Array = NDArray[np.float64]


@dataclass
class Wired:
    """A diagram under construction, after truth, sensors and estimators are in it.

    Attributes
    ----------
    truth, platforms : OutputPort
        State of the target, states of the carriers; the only truth that metrics and bounds read.
    measurement : OutputPort
        What the estimators get.
    sensed : OutputPort, optional
        Its finite rows say what was measured at all, for the bounds; by default `measurement`. The rows of the
        estimators' stream come first on it.
    estimators : mapping of str to Estimator
        The estimators side by side.
    clock : Clock
        When measurements come.
    duration : float
        Length of a run [s].
    divergence : float
        Position error at the last epoch beyond which a trial counts as diverged [m].
    truth_motion : MotionModel, optional
        The motion that the truth really has, for the bound that does not know the filter's process noise (of a rocket:
        deviations from a flight whose acceleration is known); None where it is none of the models, and that bound is
        then NaN.
    signals : mapping of str to OutputPort
        Further signals worth a log, such as resolved integers.
    dashed : sequence of (str, str)
        Feedback connections (from block, to block) of the drawing.
    looks_ahead : sequence of str
        Estimators that use measurements before they are made (as a paper may); a summary says so.
    frame : {'earth_fixed', 'inertial', 'local', 'launch'}
        Axes of states and platforms; heights and courses mean nothing in inertial and launch ones. ``local``: east,
        north and, where there is a third axis, up, on a flat Earth.
    note : str
        What a reader of the results must know; printed below the table.
    convergence : float or None
        The convergence time is when the RMSE of the position falls below this for good [m]; None: as `metrics` has it.
    truth_states : sequence of str, optional
        Names of the components on `truth`; by default those of the block's motion model, of `truth_motion`, or of the
        estimators with so many, whichever is the first to fit.
    stream : sequence of str, optional
        Names of the rows of `measurement`, where estimators are wired to something else that is made of it.
    widest : int, optional
        Most trials at once, where blocks need much memory of their own for each.
    """

    truth: OutputPort
    platforms: OutputPort
    measurement: OutputPort
    estimators: Mapping[str, Estimator]
    clock: Clock
    duration: float
    divergence: float
    truth_motion: MotionModel | None
    sensed: OutputPort | None = None
    signals: Mapping[str, OutputPort] = field(default_factory=dict)
    dashed: Sequence[tuple[str, str]] = ()
    looks_ahead: Sequence[str] = ()
    frame: str = "earth_fixed"
    note: str = ""
    convergence: float | None = None
    truth_states: Sequence[str] | None = None
    stream: Sequence[str] | None = None
    widest: int | None = None

    @property
    def truth_names(self) -> tuple[str, ...]:
        """Names of the components on `truth`.

        Raises
        ------
        UserError
            If `truth_states` does not fit the port, or nothing says what its components are.
        """
        block = self.truth.get_system()
        size = block.output_size(self.truth.get_name())[1]
        if self.truth_states is not None:
            if len(self.truth_states) != size or len(set(self.truth_states)) != size:
                raise UserError(f"truth_states: {list(self.truth_states)} is not allowed; {size} different names")
            return tuple(self.truth_states)
        for motion in (getattr(block, "motion", None), self.truth_motion):
            if isinstance(motion, MotionModel) and motion.size == size:
                return tuple(motion.names)
        alike = {tuple(e.motion.names) for e in self.estimators.values() if e.motion.size == size}
        if len(alike) != 1:
            raise UserError(f"truth_states: None is not allowed; names of the {size} components of the truth")
        return alike.pop()

    @property
    def estimated_names(self) -> tuple[str, ...]:
        """Names of the components that the estimators have: of the largest state, then what others have beside it."""
        motions = [estimator.motion for estimator in self.estimators.values()]
        largest = max(motions, key=lambda motion: motion.size)
        return tuple(dict.fromkeys([*largest.names, *(name for motion in motions for name in motion.names)]))


@dataclass(frozen=True)
class System:
    """A system from the literature.

    Attributes
    ----------
    name : str
        As on the command line; the packaged scenarios are ``scenarios/NAME.yaml`` and ``NAME.VARIANT.yaml``.
    title : str
        One line.
    scenario : type
        Dataclass of its scenario.
    declare : callable, optional
        ``declare(scenario) -> Model``.
    wired_by : callable, optional
        ``(builder, scenario, estimators, trials) -> Wired``, of a system that is not declared yet.
    """

    name: str
    title: str
    scenario: type
    declare: Callable[[Any], Model] | None = None
    wired_by: Callable[[DiagramBuilder, Any, Sequence[str], int], Wired] | None = None

    def wire(self, builder: DiagramBuilder, scenario: Any, estimators: Sequence[str], trials: int) -> Wired:
        """Put a scenario's truth, sensors and estimators into a diagram."""
        if self.declare is None:
            assert self.wired_by is not None
            return self.wired_by(builder, scenario, estimators, trials)
        model = self.declare(scenario)
        made = build(model, builder, {name: scenario.estimators[name] for name in estimators}, trials)
        return Wired(
            made.truth,
            made.platforms,
            made.measurement,
            made.estimators,
            model.clock,
            model.duration,
            model.divergence,
            model.truth_motion,
            made.sensed,
            made.signals,
            made.dashed,
            made.looks_ahead,
            model.frame,
            made.note,
            model.convergence,
            model.truth_states,
            model.rows,
            model.widest,
        )
