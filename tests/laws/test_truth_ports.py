"""No estimator, gate or resolver is connected to the truth, in any packaged diagram."""

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.score import Score
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.plants.emitter import StraightLine
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.recorder import Recorder
from quietfix.systems.signals import leaf_systems
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import PLACES, place
from tests.laws.packaged import EVERYTHING, Packaged

CLOCK = Periodic(1.0)
# Who may see the truth: what measures it, what writes it down, and what scores an estimate against it.
ALLOWED = (Recorder, Score)


PLANTS = ("quietfix.systems.plants", "quietfix.systems.signal_chain.transmitter", "quietfix.systems.playback.track_")
SENSORS = ("quietfix.systems.sensors", "quietfix.systems.signal_chain")


def is_truth(block):
    return type(block).__module__.startswith(PLANTS)


def may_read_truth(block):
    return isinstance(block, ALLOWED) or (type(block).__module__.startswith(SENSORS) and not is_truth(block))


def connections(diagram):
    """Every (source block, output port, target block, input port) of leaf systems, through nested diagrams."""
    found = []
    for (target, i), (source, o) in diagram.connection_map().items():
        found.append((source, source.get_output_port(o), target, target.get_input_port(i)))
    for part in diagram.GetSystems():
        if isinstance(part, Diagram):
            found += connections(part)
    return found


def leaks(diagram, truth):
    """Connections from the plants to what must not see them; `truth` is the port of the target's state.

    A plant may pass the truth on to another plant, which is then truth, too. Where the carriers are is known, with or
    without a navigation error: an input ``platforms`` may come from a plant that has nothing of the target.
    """
    assert not any(isinstance(part, Diagram) for part in diagram.GetSystems()), "nested: exported ports to be followed"
    wires = connections(diagram)
    target_like = {truth.get_system()}
    while more := {t for s, _, t, _ in wires if s in target_like and is_truth(t)} - target_like:
        target_like |= more
    return [
        f"{source.get_name()}.{port.get_name()} -> {target.get_name()}.{entry.get_name()}"
        for source, port, target, entry in wires
        if is_truth(source)
        and not is_truth(target)
        and not may_read_truth(target)
        and not (entry.get_name() == "platforms" and source not in target_like)
    ]


@pytest.mark.parametrize("name", EVERYTHING)
def test_no_packaged_diagram_leaks_the_truth(name, request, monkeypatch):
    try:
        packaged = Packaged(name, 1)
    except UserError as error:
        if "QUIETFIX_DATA" not in str(error):
            raise
        monkeypatch.setenv("QUIETFIX_DATA", str(request.getfixturevalue("data_dir")))  # or skip
        packaged = Packaged(name, 1)
    wired, diagram = packaged.wired, packaged.diagram
    assert leaks(diagram, wired.truth) == []
    # the walk has seen what it is about: a plant that is the truth, sensors on it, and every estimator
    sources = {source for source, _, target, _ in connections(diagram) if may_read_truth(target)}
    assert wired.truth.get_system() in sources
    assert set(wired.estimators.values()) <= set(leaf_systems(diagram))
    assert all(any(target is block for _, _, target, _ in connections(diagram)) for block in wired.estimators.values())


@pytest.mark.parametrize("port", ["measurement", "platforms"])
def test_a_leak_is_found(port):
    """An emitter wired to an estimator, as if it were a measurement or a carrier, is reported."""
    builder = DiagramBuilder()
    emitter = builder.AddSystem(StraightLine(place(*PLACES["(0,300)"]), name="emitter"))
    carriers = builder.AddSystem(DenseOrbit([[7.1e6, 0, 0, 0, 7.5e3, 0]], 10.0, name="satellites"))
    model = Altitude(10.0)  # one row, six trials: as wide as a state
    block = builder.AddSystem(
        Ekf().make(
            "ekf", model, ConstantVelocity(0.1), GivenStart(np.zeros(6), np.eye(6)), Wiring(6, model.names, CLOCK, 1, 1)
        )
    )
    other = "platforms" if port == "measurement" else "measurement"
    builder.Connect(emitter.GetOutputPort("state"), block.GetInputPort(port))
    if other == "platforms":
        builder.Connect(carriers.GetOutputPort("state"), block.GetInputPort(other))
    diagram = builder.Build()
    assert leaks(diagram, emitter.GetOutputPort("state")) == [f"emitter.state -> ekf.{port}"]
