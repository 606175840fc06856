"""The one builder: from a declared model to a diagram under construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from quietfix.diagrams.assembly.biased import biased
from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.checks import check_assumed
from quietfix.diagrams.assembly.dot import Notes
from quietfix.diagrams.assembly.late import LateRefusal, refusals
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.quantities.frame import LOCAL
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Clock
from quietfix.systems.counting import tally
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.signals import EnsembleBlock, components_of

__all__ = ["Assembly", "build"]


@dataclass(frozen=True)
class Assembly:
    """A diagram under construction, after truth, sensors and estimators are in it.

    Attributes
    ----------
    model : Model
        What was declared.
    bus : Bus
        All signals.
    estimators : mapping of str to Estimator
        The estimators side by side.
    dashed : sequence of (str, str)
        Feedback connections (from block, to block) of the drawing.
    """

    model: Model
    bus: Bus
    estimators: Mapping[str, Estimator]
    dashed: Sequence[tuple[str, str]]

    def finish(self, name: str | None = None) -> Diagram:
        """Return the diagram, which can be made once; all that is said here of it stays true."""
        tally("built")
        diagram = self.bus.builder.Build()
        if name is not None:
            diagram.set_name(name)
        return diagram

    @property
    def truth(self) -> OutputPort:
        """State of the target; with the platforms the only truth that metrics and bounds read."""
        return self.bus["truth"]

    @property
    def platforms(self) -> OutputPort:
        """States of the carriers, as they are."""
        return self.bus["platforms"]

    @property
    def platform_names(self) -> tuple[str, ...]:
        """Names of the platforms.

        Raises
        ------
        UserError
            If the model's `platforms` are not as many different names as there are platforms.
        """
        if "platforms" not in self.bus:
            return ()
        count, declared = self.bus.shape("platforms")[1] // 6, self.model.platforms
        if declared is None:
            return tuple(f"platform_{i}" for i in range(count))
        fits = not isinstance(declared, str) and all(isinstance(name, str) and name for name in declared)
        if not fits or len(declared) != count or len(set(declared)) != count:
            raise UserError(f"platforms: {declared!r} is not allowed; {count} different names")
        return tuple(declared)

    @property
    def measurement(self) -> OutputPort:
        """What the estimators get."""
        return self.bus["measurement"]

    @property
    def sensed(self) -> OutputPort:
        """Its finite rows say what was measured at all, for the bounds; the rows of the stream come first on it."""
        return self.bus[next(signal for signal in ("sensed", "raw", "measurement") if signal in self.bus)]

    @property
    def course(self) -> dict[str, OutputPort]:
        """What the bounds and the smoothers read of a run."""
        known = {name: self.bus[name] for name in ("truth", "platforms") if name in self.bus}
        for name, block in self.estimators.items():
            if block.smoother is not None:
                whole = block.HasOutputPort("whole")
                ports = ["whole", "whole_covariance"] if whole else ["estimate", "covariance"]
                ports += [port for port in ("releases", "restarts") if port in block.tallies()]
                known |= {f"{name}/{port}": block.GetOutputPort(port) for port in ports}
        late = ["arrival", *(f"{name}.dropped" for name in self.estimators)]
        known |= {signal.replace(".", "/"): self.bus[signal] for signal in late if signal in self.bus}
        return known | {"sensed": self.sensed}

    @property
    def signals(self) -> dict[str, OutputPort]:
        """What else is worth a log: the model's, and what the estimators tell of themselves."""
        found = {name: self.bus[signal] for name, signal in self.model.signals.items() if signal in self.bus}
        for name, block in self.estimators.items():
            found |= {f"{port}_{name}": block.GetOutputPort(port) for port in block.diagnostics()}
        return found

    @property
    def tallies(self) -> dict[str, OutputPort]:
        """What the estimators count, of measurements and trials; a summary tells it."""
        named = self.estimators.items()
        return {f"{port}_{name}": block.GetOutputPort(port) for name, block in named for port in block.tallies()}

    @property
    def note(self) -> str:
        """What a reader of the results must know, of the model and of the estimators."""
        notes = [self.model.note, *(block.note for block in self.estimators.values())]
        return " ".join(dict.fromkeys(note for note in notes if note))

    @property
    def clock(self) -> Clock:
        """When measurements come."""
        return self.model.clock

    @property
    def duration(self) -> float:
        """Length of a run [s]."""
        return self.model.duration

    @property
    def stream(self) -> list[str] | None:
        """Names of the rows of `sensed`, where not all estimators are wired to it as it is."""
        return None if self.model.rows is None else list(self.model.rows)

    @property
    def contents(self) -> dict[str, list[str]]:
        """Names of the platforms and of the rows that are measured, by the block that they come from, for a drawing."""
        ports = [port for port in self.bus.ports("measurement") if isinstance(port.get_system(), EnsembleBlock)]
        rows = {
            port.get_system().get_name(): [row.name for row in port.get_system().components(port.get_name())]
            for port in ports
        }
        if "platforms" not in self.bus:
            return rows
        return rows | {self.platforms.get_system().get_name(): list(self.platform_names)}

    def notes(self, trials: int | None = None) -> Notes:
        """Return what a drawing says of a run of so many trials; None: how many is not known."""
        units = {}
        for signal in ("platforms", "known"):
            if signal in self.bus:
                units[self._origin(signal)] = ["m", "m/s"]
        if "truth" in self.bus:
            states = [row for e in self.estimators.values() for row in components_of(e.motion.reported)]
            known = {row.name: row.unit for row in reversed(states)}
            units[self._origin("truth")] = [known.get(name, "") for name in self.truth_names]
        return Notes(self.dashed, self.contents, tuple(self.estimators), trials, units)

    def _origin(self, signal: str) -> tuple[str, str]:
        port = self.bus[signal]
        return port.get_system().get_name(), port.get_name()

    @property
    def row_units(self) -> dict[str, str]:
        """SI units of the rows that are measured, by their names, as far as a block says them."""
        blocks = [(port.get_system(), port.get_name()) for port in self.bus.ports("measurement")]
        found = [row for block, port in blocks if isinstance(block, EnsembleBlock) for row in block.components(port)]
        found += [row for block in self.estimators.values() for row in components_of(block.model)]
        return {row.name: row.unit for row in reversed(found)}

    @property
    def truth_names(self) -> tuple[str, ...]:
        """Names of the components on `truth`.

        Raises
        ------
        UserError
            If the model's `truth_states` do not fit the port, or nothing says what its components are.
        """
        if "truth" not in self.bus:
            return ()
        size, declared = self.bus.shape("truth")[1], self.model.truth_states
        if declared is not None:
            if len(declared) != size or len(set(declared)) != size:
                raise UserError(f"truth_states: {list(declared)} is not allowed; {size} different names")
            return tuple(declared)
        for motion in (getattr(self.truth.get_system(), "motion", None), self.model.truth_motion):
            if isinstance(motion, MotionModel) and motion.size == size:
                return tuple(motion.names)
        alike = {tuple(e.motion.reported.names) for e in self.estimators.values() if e.motion.reported.size == size}
        if len(alike) != 1:
            raise UserError(f"truth_states: None is not allowed; names of the {size} components of the truth")
        return alike.pop()

    @property
    def estimated_names(self) -> tuple[str, ...]:
        """Names of the components that the estimators have: of the largest state, then what others have beside it."""
        motions = [estimator.motion.reported for estimator in self.estimators.values()]
        if not motions:
            return ()
        largest = max(motions, key=lambda motion: motion.size)
        return tuple(dict.fromkeys([*largest.names, *(name for motion in motions for name in motion.names)]))


def build(model: Model, builder: DiagramBuilder, options: Mapping[str, Any], trials: int) -> Assembly:
    """Put a model's parts and the estimators into a diagram.

    Parameters
    ----------
    model : Model
        What a system declares.
    builder : DiagramBuilder
        The diagram.
    options : mapping of str to EstimatorOptions
        The estimators by name. The prediction of the first one is the signal ``prediction``, its covariance
        ``prediction_covariance``, for what is fed back.
    trials : int
        Trials of the ensemble.

    Raises
    ------
    ValueError
        If something does not fit, in the user's words.
    """
    tally("wired")
    bus = Bus(builder, trials)
    for part in model.parts:
        part(bus)
    if model.recorded is None and "truth" not in bus:
        raise ValueError("signal: truth is not there; a part must publish it")
    _check_signals(model, bus)
    if "known" not in bus and "platforms" in bus:
        bus.publish(known=bus["platforms"])
    if model.late is not None:
        model.late.add(bus, model.clock, model.duration)
    blocks, refused = {}, []
    for name, option in options.items():
        try:
            blocks[name] = _estimator(model, bus, name, option)
        except LateRefusal as refusal:
            refused.append(refusal)
    if refused:
        raise UserError(refusals(refused, list(blocks)))
    for name in list(blocks)[:1]:
        bus.publish(**{port: bus[f"{name}.{port}"] for port in ("prediction", "prediction_covariance")})
    return Assembly(model, bus, blocks, bus.close())


def _check_signals(model: Model, bus: Bus) -> None:
    """Refuse signals of a size that cannot be."""
    for signal in ("platforms", "known"):
        size = bus.shape(signal)[1] if signal in bus else 0
        if size % 6:
            raise ValueError(f"signal: {signal} of {size} numbers is not allowed; six for each platform")
    sensed = "raw" if "raw" in bus else "measurement"
    if model.rows is not None and sensed in bus and len(model.rows) != bus.shape(sensed)[1]:
        raise ValueError(f"Model.rows: {list(model.rows)} is not allowed; as many names as {sensed} has rows")


def _estimator(model: Model, bus: Bus, name: str, options: Any) -> Estimator:
    if bus.builder.HasSubsystemNamed(name):
        raise UserError(f"estimators: the name {name} is not allowed; another block of the diagram has it")
    assumed: Assumed = model.assume(bus, name, getattr(options, "plain", options))
    if not isinstance(assumed, Assumed):
        raise ValueError(
            f"{name}: assume returned {type(assumed).__name__}; quietfix.diagrams.assembly.model.Assumed is needed"
        )
    takes = {"platforms": "known", **assumed.takes}
    carriers = bus.shape(takes["platforms"])
    check_assumed(name, assumed, carriers[1] // 6)
    assumed = biased(assumed, model.biases, name, options)
    wiring = Wiring(
        bus.trials,
        list(assumed.rows),
        assumed.clock or model.clock,
        platforms=carriers[1] // 6,
        platform_trials=carriers[0],
        noise_port="noise_covariance" in {**takes, **assumed.feedback},
        tails=assumed.tails,
        level=model.axes is LOCAL,
    )
    try:
        block: Estimator = options.make(name, assumed.model, assumed.motion, assumed.start, wiring)
    except UserError:
        raise
    except ValueError as error:
        # by its own name a message is found in the user's file; the error stays, for it knows whose code raised it
        if not str(error).startswith((f"{name}:", "estimators.")):
            error.args = (f"{name}: {error}",)
        raise
    if model.late is not None and not model.late.known:
        model.late.check_as_they_come(name, takes)
    if model.late is not None and model.late.known:
        span = model.clock, model.duration
        block, own = model.late.going_back(block, assumed.takes, assumed.clearings, bus, span)
        takes = takes | own
    for port, make in assumed.on_demand.items():
        if block.HasInputPort(port):
            takes[port] = make(bus, block)
    for i in range(block.num_input_ports()):
        port = block.get_input_port(i).get_name()
        if port not in assumed.feedback and takes.get(port, port) not in bus:
            raise ValueError(f"{name}: it needs {takes.get(port, port)}, which nothing in this system gives")
    return bus.add(block, takes=takes, feedback=assumed.feedback)
