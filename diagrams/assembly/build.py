"""The one builder: from a declared model to a diagram under construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder, OutputPort

from diagrams.assembly.bus import Bus, port_shape
from diagrams.assembly.model import Assumed, Model
from systems.estimators.base import Estimator, Wiring

__all__ = ["Assembly", "build"]

Array = NDArray[np.float64]


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

    @property
    def truth(self) -> OutputPort:
        """State of the target; with the platforms the only truth that metrics and bounds read."""
        return self.bus["truth"]

    @property
    def platforms(self) -> OutputPort:
        """States of the carriers, as they are."""
        return self.bus["platforms"]

    @property
    def measurement(self) -> OutputPort:
        """What the estimators get."""
        return self.bus["measurement"]

    @property
    def sensed(self) -> OutputPort:
        """Its finite rows say what was measured at all, for the bounds; the rows of the stream come first on it."""
        return self.bus["raw" if "raw" in self.bus else "measurement"]

    @property
    def signals(self) -> dict[str, OutputPort]:
        """What else is worth a log: the model's, and what the estimators tell of themselves."""
        found = {name: self.bus[signal] for name, signal in self.model.signals.items() if signal in self.bus}
        for name, block in self.estimators.items():
            found |= {f"{port}_{name}": block.GetOutputPort(port) for port in block.diagnostics()}
        return found

    @property
    def looks_ahead(self) -> list[str]:
        """Estimators that use measurements before they are made (as a paper may); a summary says so."""
        return [name for name, block in self.estimators.items() if not block.causal]

    @property
    def note(self) -> str:
        """What a reader of the results must know, of the model and of the estimators."""
        notes = [self.model.note, *(block.note for block in self.estimators.values())]
        return " ".join(dict.fromkeys(note for note in notes if note))

    @property
    def stream(self) -> list[str]:
        """Names of the rows of `measurement`."""
        if self.model.rows is not None:
            return list(self.model.rows)
        rows = port_shape(self.measurement)[1]
        for block in self.estimators.values():
            if len(block.wiring.stream) == rows:
                return list(block.wiring.stream)
        return [str(i) for i in range(rows)]


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
    bus = Bus(builder, trials)
    for part in model.parts:
        part(bus)
    if "known" not in bus:
        bus.publish(known=bus["platforms"])
    blocks = {name: _estimator(model, bus, name, option) for name, option in options.items()}
    for name in list(blocks)[:1]:
        bus.publish(**{port: bus[f"{name}.{port}"] for port in ("prediction", "prediction_covariance")})
    return Assembly(model, bus, blocks, bus.close())


def _estimator(model: Model, bus: Bus, name: str, options: Any) -> Estimator:
    assumed: Assumed = model.assume(bus, name, options)
    takes = {"platforms": "known", **assumed.takes}
    carriers = bus.shape(takes["platforms"])
    wiring = Wiring(
        bus.trials,
        list(assumed.rows),
        assumed.clock or model.clock,
        platforms=carriers[1] // 6,
        platform_trials=carriers[0],
        noise_port="noise_covariance" in {**takes, **assumed.feedback},
    )
    block: Estimator = options.make(name, assumed.model, assumed.motion, assumed.start, wiring)
    for port, make in assumed.on_demand.items():
        if block.HasInputPort(port):
            takes[port] = make(bus, block)
    return bus.add(block, takes=takes, feedback=assumed.feedback)
