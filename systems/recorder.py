"""The recorder: one block that logs any number of named signals at the ticks of a clock.

Drake's own ``LogVectorOutput`` allocates a thousand full-width samples in every context and knows only periodic
clocks; it serves notebooks. Studies use this block: memory is what is recorded, and the log lives in the
context, so that one diagram serves many runs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from quietfix.systems.clocks import Clock, at_ticks, same_instant
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Log", "Recorder", "record"]


class Log:
    """What one run recorded: times and, per signal, one flat array per tick."""

    def __init__(self, names: list[str]) -> None:
        self.times: list[float] = []
        self.values: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
        self.columns = list(self.values.values())

    def __deepcopy__(self, memo: object) -> Log:
        """Return an empty log: a cloned context records its own run."""
        return Log(list(self.values))


class Recorder(EnsembleBlock):
    """Record named signals; an input port each.

    Parameters
    ----------
    signals : mapping of str to (trials, size)
        Name and shape of each signal.
    clock : Clock
        When to record.
    name : str
        Name of the block.
    """

    def __init__(self, signals: Mapping[str, tuple[int, int]], clock: Clock, name: str = "recorder") -> None:
        super().__init__(name)
        self._shapes = dict(signals)
        for signal, (trials, size) in self._shapes.items():
            self.declare_input(signal, trials, size)
        names = list(self._shapes)
        self._ports = [self._inputs[signal][0] for signal in names]
        # A parameter, which nothing depends on, for it is reached in half the time of a cache entry.
        self._log = self.DeclareAbstractParameter(AbstractValue.Make(Log(names)))
        self._clock = clock
        at_ticks(
            clock,
            lambda period, offset: self.DeclarePeriodicPublishEvent(period, offset, self._publish),
            lambda: self.DeclarePerStepPublishEvent(self._publish_at_tick),
        )

    def _log_of(self, context: Context) -> Log:
        log: Log = context.get_abstract_parameter(self._log).get_value()
        return log

    def _publish(self, context: Context) -> None:
        log: Log = context.get_abstract_parameter(self._log).get_value()
        time = context.get_time()
        if log.times and same_instant(time, log.times[-1]):  # two merged clocks ticked together
            return
        log.times.append(time)
        for index, values in zip(self._ports, log.columns, strict=True):
            value = self.EvalVectorInput(context, index)
            if value is None:  # not connected: the port says so
                self.get_input_port(index).Eval(context)
            values.append(value.CopyToVector())  # flat, as it comes

    def _publish_at_tick(self, context: Context) -> None:
        if self._clock.index(context.get_time()) is not None:
            self._publish(context)

    def result(self, root_context: Context) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Return the times [s], shape (samples,), and each signal, shape (samples, trials, size)."""
        log = self._log_of(self.GetMyContextFromRoot(root_context))
        stacked = {
            name: np.array(values, dtype=float).reshape(len(values), *self._shapes[name])
            for name, values in log.values.items()
        }
        return np.array(log.times), stacked


def record(builder: DiagramBuilder, ports: Mapping[str, OutputPort], clock: Clock, name: str = "recorder") -> Recorder:
    """Add a recorder to a diagram and connect it to output ports of Quietfix blocks.

    Parameters
    ----------
    builder : DiagramBuilder
        The diagram under construction.
    ports : mapping of str to OutputPort
        What to record, by the name it gets in the log.
    clock : Clock
        When to record.
    name : str
        Name of the recorder.

    Returns
    -------
    Recorder
    """
    shapes = {}
    for signal, port in ports.items():
        block = port.get_system()
        if isinstance(block, EnsembleBlock):
            shapes[signal] = block.output_size(port.get_name())
        else:
            shapes[signal] = (1, port.size())
    recorder = builder.AddSystem(Recorder(shapes, clock, name))
    for signal, port in ports.items():
        builder.Connect(port, recorder.GetInputPort(signal))
    return recorder
