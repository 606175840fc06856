"""No estimator, gate or resolver is connected to the truth, in any packaged diagram."""

import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder

from diagrams.errors import UserError
from diagrams.score import Score
from systems.clocks import Periodic
from systems.plants.emitter import StraightLine
from systems.plants.orbit import DenseOrbit
from systems.recorder import Recorder
from systems.signals import leaf_systems
from tests.laws.cases import PLACES, estimators, place, six
from tests.laws.packaged import EVERYTHING, Packaged
from tests.laws.rig import make

# Who may see the truth: what measures it, what writes it down, and what scores an estimate against it.
ALLOWED = (Recorder, Score)


def is_truth(block):
    return type(block).__module__.startswith("systems.plants")


def may_read_truth(block):
    return isinstance(block, ALLOWED) or type(block).__module__.startswith("systems.sensors")


def connections(diagram):
    """Every (source block, output port, target block, input port) of leaf systems, through nested diagrams."""
    found = []
    for (target, i), (source, o) in diagram.connection_map().items():
        found.append((source, source.get_output_port(o), target, target.get_input_port(i)))
    for part in diagram.GetSystems():
        if isinstance(part, Diagram):
            found += connections(part)
    return found


def leaks(diagram, platforms):
    """Connections from a plant to what must not see it; `platforms` is the port of the known carriers."""
    assert not any(isinstance(part, Diagram) for part in diagram.GetSystems()), "nested: exported ports to be followed"
    carriers = platforms.get_system()
    return [
        f"{source.get_name()}.{port.get_name()} -> {target.get_name()}.{entry.get_name()}"
        for source, port, target, entry in connections(diagram)
        if is_truth(source) and source is not carriers and not may_read_truth(target)
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
    assert leaks(diagram, wired.platforms) == []
    # the walk has seen what it is about: a plant that is the truth, sensors on it, and every estimator
    sources = {source for source, _, target, _ in connections(diagram) if may_read_truth(target)}
    assert wired.truth.get_system() in sources
    assert set(wired.estimators.values()) <= set(leaf_systems(diagram))
    assert all(any(target is block for _, _, target, _ in connections(diagram)) for block in wired.estimators.values())


def test_a_leak_is_found():
    """An emitter wired to an estimator, as if it were a measurement, is reported."""
    builder = DiagramBuilder()
    emitter = builder.AddSystem(StraightLine(place(*PLACES["(0,300)"]), name="emitter"))
    carriers = builder.AddSystem(DenseOrbit([[7.1e6, 0, 0, 0, 7.5e3, 0]] * 3, 10.0, name="satellites"))
    block = builder.AddSystem(make("ekf", estimators()["ekf"], six(), clock=Periodic(1.0)))
    builder.Connect(emitter.GetOutputPort("state"), block.GetInputPort("measurement"))
    builder.Connect(carriers.GetOutputPort("state"), block.GetInputPort("platforms"))
    diagram = builder.Build()
    assert leaks(diagram, carriers.GetOutputPort("state")) == ["emitter.state -> ekf.measurement"]
