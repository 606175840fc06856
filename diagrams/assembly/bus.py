"""The bus: the named signals of a diagram under construction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort, PortDataType, System

from quietfix.systems.signals import EnsembleBlock

__all__ = ["Bus"]

Block = TypeVar("Block", bound=LeafSystem)


class Bus:
    """Named signals while a diagram is being built.

    Every output port of a block that was added is the signal ``BLOCK.port``; a part publishes more under names that
    say what they are: ``truth`` (all that metrics and bounds read), ``target`` (what sensors see), ``platforms`` (as
    they are), ``known`` (the platforms as the estimators know them), ``measured`` (by the sensor), ``raw`` (with the
    errors that nobody knows of), ``measurement`` (what estimators get), ``initial_estimate``, ``assumed_height`` ...

    Parameters
    ----------
    builder : DiagramBuilder
        The diagram.
    trials : int
        Trials of the ensemble.
    """

    goes_back: bool = False
    """Whether estimators go back to when a late measurement was made, and resolve its phases themselves."""

    def __init__(self, builder: DiagramBuilder, trials: int) -> None:
        self.builder, self.trials = builder, trials
        self._ports: dict[str, OutputPort] = {}
        self._feedback: list[tuple[str, LeafSystem, InputPort]] = []

    def __contains__(self, signal: str) -> bool:
        """Return whether there is such a signal."""
        return signal in self._ports

    def __getitem__(self, signal: str) -> OutputPort:
        """Return the port of a signal.

        Raises
        ------
        ValueError
            If there is none.
        """
        if signal not in self._ports:
            raise ValueError(f"signal: {signal} is not there; there are {', '.join(sorted(self._ports)) or 'none'}")
        return self._ports[signal]

    def ports(self, name: str) -> list[OutputPort]:
        """Return the output ports of that name, of all blocks."""
        return [port for signal, port in self._ports.items() if signal.endswith(f".{name}")]

    def publish(self, **signals: OutputPort) -> None:
        """Give ports a name; one that is given again stands for the new port from now on."""
        self._ports |= signals

    def shape(self, signal: str) -> tuple[int, int]:
        """Return (trials, size) of a signal; 1 trial where all share it."""
        return port_shape(self[signal])

    def add(
        self,
        block: Block,
        gives: Mapping[str, str] | None = None,
        takes: Mapping[str, str] | None = None,
        feedback: Mapping[str, str] | None = None,
    ) -> Block:
        """Put a block into the diagram and connect its inputs.

        Parameters
        ----------
        block : LeafSystem
        gives : mapping of str to str
            Signals to publish, and the output port of each.
        takes : mapping of str to str
            Input ports and the signal that each gets; a port that is not here gets the signal of its own name.
        feedback : mapping of str to str
            The same for signals that are there only when all is built.

        Returns
        -------
        LeafSystem
            The block.

        Raises
        ------
        ValueError
            If a signal is not there, or does not have the size of the port, or a block has the name of another.
        """
        if not isinstance(block, System):
            raise ValueError(f"block: {type(block).__name__} is not allowed; a Drake system is needed")
        if self.builder.HasSubsystemNamed(block.get_name()):
            raise ValueError(f"block: the name {block.get_name()} is not allowed; another block of the diagram has it")
        takes, feedback = takes or {}, feedback or {}
        added = self.builder.AddSystem(block)
        for i in range(added.num_input_ports()):
            port = added.get_input_port(i)
            name = port.get_name()
            if name in feedback:
                self._feedback.append((feedback[name], added, port))
            else:
                self._connect(takes.get(name, name), added, port)
        for i in range(added.num_output_ports()):
            out = added.get_output_port(i)
            self._ports[f"{added.get_name()}.{out.get_name()}"] = out
        self.publish(**{signal: added.GetOutputPort(port) for signal, port in (gives or {}).items()})
        return added

    def _connect(self, signal: str, block: LeafSystem, port: InputPort) -> None:
        source = self[signal]
        vector = PortDataType.kVectorValued
        if source.get_data_type() == port.get_data_type() == vector and source.size() != port.size():
            raise ValueError(
                f"{block.get_name()}: input {port.get_name()} takes {port.size()} numbers, the signal {signal} carries "
                f"{source.size()}"
            )
        self.builder.Connect(source, port)

    def close(self) -> list[tuple[str, str]]:
        """Connect what was put off; return these connections (from block, to block), as a drawing shows them."""
        made: dict[tuple[str, str], None] = {}
        for signal, block, port in self._feedback:
            self._connect(signal, block, port)
            made[self[signal].get_system().get_name(), block.get_name()] = None
        self._feedback.clear()
        return list(made)


def port_shape(port: OutputPort) -> tuple[int, int]:
    """Return (trials, size) of a port; of a block that is not ours, one trial."""
    block = port.get_system()
    return block.output_size(port.get_name()) if isinstance(block, EnsembleBlock) else (1, port.size())
