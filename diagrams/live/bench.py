"""The diagram that is stepped by hand, and the contexts in which the targets are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import InitializeParams
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from quietfix.diagrams.assembly.build import build
from quietfix.diagrams.assembly.checks import check_model
from quietfix.diagrams.own.fed.handed import Handed
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.system import declare
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.integration import simulator_of
from quietfix.systems.sensors.handed_rows import HandedRows
from quietfix.systems.signals import Draw, leaf_systems, set_draw

__all__ = ["Bench", "Moment", "Runner", "Told"]

Array = NDArray[np.float64]

_UNKNOWN = np.full(6, np.nan)


class Told(NamedTuple):
    """What an estimator says then: state (n,), covariance (n, n), NIS and its degrees of freedom; if it is lost."""

    estimate: Array
    covariance: Array
    nis: float
    nis_dof: float
    lost: bool


def _told(ports: Sequence[OutputPort], context: Context) -> Told:
    estimate, covariance, nis, freedom, lost = (port.Eval(context) for port in ports)
    n = len(estimate)
    return Told(estimate, covariance.reshape(n, n), float(nis[0]), float(freedom[0]), bool(lost[0]))


@dataclass(frozen=True)
class Moment:
    """All that a context knows: it goes on from here as if nothing had been in between.

    Attributes
    ----------
    time : float
        [s].
    number : int
        Of its tick.
    value, scale : ndarray, shape (rows,)
        What was handed over last.
    discrete : sequence of ndarray
        Groups of discrete states.
    continuous : ndarray
        Continuous states.
    """

    time: float
    number: int
    value: Array
    scale: Array
    discrete: Sequence[Array]
    continuous: Array


class Bench:
    """A diagram that is built once; each target has a context of its own.

    Parameters
    ----------
    scenario : OwnScenario
    folder : Path
        What paths in the scenario are relative to.
    estimators : sequence of str
        Those that run.
    scaled : bool
        Whether the noise of rows is handed over with them.

    Raises
    ------
    ValueError
        If something does not fit.
    """

    def __init__(self, scenario: OwnScenario, folder: Path, estimators: Sequence[str], scaled: bool = False) -> None:
        self._made_of = scenario, folder, estimators
        self.model = declare(scenario, folder, live=True, scaled=scaled)
        check_model(self.model)
        self.handed = next(part for part in self.model.parts if isinstance(part, Handed))
        options = {name: scenario.estimators[name] for name in estimators}
        builder = DiagramBuilder()
        wired = build(self.model, builder, options, 1)
        for name, one in wired.estimators.items():
            if one.smoother is not None:
                raise UserError(f"estimators.{name}: a smoother is not allowed live; it looks back when a run is over")
        block = wired.bus["raw"].get_system()
        assert isinstance(block, HandedRows)
        self.block, self.estimators = block, wired.estimators
        self.diagram = wired.finish("live")
        for leaf in leaf_systems(self.diagram):
            if leaf.num_abstract_states():
                raise UserError(
                    f"live: {leaf.get_name()} is not allowed; it keeps what is no vector of numbers, and could not "
                    "go on from a state that is kept"
                )

    def with_scales(self) -> Bench:
        """Return such a bench to which the noise of rows is handed over with them."""
        return Bench(*self._made_of, scaled=True)

    def knows(self, target: str) -> bool:
        """Return whether anybody knows where a target is at the start."""
        path = self.handed.paths.get(target, self.handed.paths.get(""))
        return path is not None and bool(np.isfinite(path(0.0)).all())


class Runner:
    """One target on a bench.

    Parameters
    ----------
    bench : Bench
    target : str
        Its name.
    number : int
        Its own, for whatever is drawn: it is the trial of that number.
    """

    def __init__(self, bench: Bench, target: str, number: int) -> None:
        self._bench, self.target, self.number = bench, target, number
        paths = bench.handed.paths
        self._path = paths.get(target, paths.get(""))
        self._last: Moment | None = None
        context = bench.diagram.CreateDefaultContext()
        set_draw(bench.diagram, context, Draw(0, number))
        self._simulator = simulator_of(bench.diagram, context, bench.model.step)
        self._context = self._simulator.get_mutable_context()
        self._mine = bench.block.GetMyMutableContextFromRoot(self._context)
        self._ports = {
            name: ([block.GetOutputPort(port) for port in Told._fields], block.GetMyContextFromRoot(self._context))
            for name, block in bench.estimators.items()
        }
        self._before: list[tuple[float, int]] = []
        self._handed: tuple[Array, Array] | None = None

    def step(self, time: float, value: Array, scale: Array) -> Mapping[str, Told]:
        """Go on to a tick, hand over what was measured at it, and return what the estimators say.

        Parameters
        ----------
        time : float
            [s], later than the last one.
        value, scale : ndarray, shape (rows,)
            See `quietfix.systems.sensors.handed_rows.HandedRows.hand`.
        """
        clock = self._bench.handed.clock
        number = self._before[-1][1] + 1 if self._before else 0
        if not self._before:
            self._begin(value if time <= 0 else np.full_like(value, np.nan), scale, [(0.0, 0)] if time <= 0 else [])
        if time > self._context.get_time():
            clock.say(*self._before)
            self._simulator.AdvanceTo(time)
        self._before = [(time, number)]
        return self.hand_over(value, scale)

    def hand_over(self, value: Array, scale: Array) -> Mapping[str, Told]:
        """Hand over what was measured now, in the place of what was before, and return what the estimators say."""
        self._hand(self._before[-1][0], value, scale)
        return {name: _told(ports, context) for name, (ports, context) in self._ports.items()}

    def _begin(self, value: Array, scale: Array, ticks: list[tuple[float, int]]) -> None:
        self._hand(0.0, value, scale)
        self._bench.handed.clock.say(*ticks)
        self._simulator.Initialize()

    def _hand(self, time: float, value: Array, scale: Array) -> None:
        self._handed = value, scale
        self._bench.handed.clock.say(*self._before)
        path = self._path
        state = _UNKNOWN if path is None or time > self._bench.handed.known else path(time)
        self._bench.block.hand(self._mine, value, scale, state)

    def moment(self) -> Moment | None:
        """Return all that is known now; None before the first tick."""
        if self._handed is None:
            return None
        context, (time, number) = self._context, self._before[-1]
        states = context.get_discrete_state()
        return Moment(
            time,
            number,
            *self._handed,
            [np.array(states.get_value(i)) for i in range(states.num_groups())],
            np.array(context.get_continuous_state_vector().CopyToVector()),
        )

    def go_back(self, moment: Moment | None) -> None:
        """Go on from what was known at a moment; None: from the beginning.

        Raises
        ------
        UserError
            If it is of another diagram.
        """
        context = self._context
        if moment is None:
            initial = self._bench.diagram.CreateDefaultContext()
            set_draw(self._bench.diagram, initial, Draw(0, self.number))
            context.SetTimeStateAndParametersFrom(initial)
            self._before, self._handed = [], None
            return
        states = context.get_discrete_state()
        sizes = [len(one) for one in moment.discrete]
        continuous = context.num_continuous_states()
        if sizes != [states.get_vector(i).size() for i in range(states.num_groups())]:
            raise UserError(f"it is of other estimators: states of {sizes} numbers are not allowed")
        if len(moment.continuous) != continuous or len(moment.value) != len(self._bench.handed.rows):
            raise UserError("it is of other sensors or parts")
        context.SetTime(moment.time)
        for i, values in enumerate(moment.discrete):
            context.SetDiscreteState(i, values)
        if continuous:
            context.SetContinuousState(moment.continuous)
        self._before = [(moment.time, moment.number)]
        self._hand(moment.time, moment.value, moment.scale)
        self._simulator.Initialize(InitializeParams(suppress_initialization_events=True))
