"""Blocks of the same name in inner diagrams draw numbers of their own; a flat diagram keeps its numbers."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.noise import normal
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import Constant, Draw, set_draw
from tests.laws.cases import tdoa
from tests.laws.rig import Scene

SCENE = Scene(1, 1)


def half(name):
    """A sensor with all that it needs, in a diagram of its own."""
    builder = DiagramBuilder()
    sensor = builder.AddSystem(Sensor(Stack([tdoa()]), Periodic(1.0), trials=3, platforms=3, name="sensor"))
    for port, value in (("target", SCENE.mean), ("platforms", SCENE.platforms[0])):
        source = builder.AddSystem(Constant(port, np.reshape(value, (1, -1))))
        builder.Connect(source.GetOutputPort("state"), sensor.GetInputPort(port))
    builder.ExportOutput(sensor.GetOutputPort("measurement"), "measurement")
    diagram = builder.Build()
    if name:
        diagram.set_name(name)
    return diagram


def measured(diagram, port="measurement", seed=1):
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(seed))
    return diagram.GetOutputPort(port).Eval(context)


def pair(*names):
    builder = DiagramBuilder()
    for i, name in enumerate(names):
        builder.ExportOutput(builder.AddSystem(half(name)).GetOutputPort("measurement"), f"m{i}")
    return builder.Build()


def test_two_inner_diagrams_draw_different_noise():
    both = pair("left", "right")
    left, right = measured(both, "m0"), measured(both, "m1")
    assert not np.any(left == right)
    # and what they draw does not depend on what stands beside them, or in which order
    np.testing.assert_array_equal(measured(pair("right", "other", "left"), "m2"), left)


def test_a_flat_diagram_is_keyed_by_the_name_alone():
    """Whatever the root diagram is called: the packaged systems' numbers hang on this."""
    named, unnamed = half("whatever"), half(None)
    np.testing.assert_array_equal(measured(named), measured(unnamed))
    alone = Sensor(Stack([tdoa()]), Periodic(1.0), trials=3, platforms=3, name="sensor")
    assert alone.noise_name() == "sensor"
    clean = measured(named) - normal(1, "sensor", 0, 3, 0, 2).ravel() @ np.kron(
        np.eye(3), np.linalg.cholesky(alone.model.noise_covariance()).T
    )
    # three trials of one truth: without their noise they are alike, to the rounding of a delay of 1e-3 s
    np.testing.assert_allclose(clean.reshape(3, 2), clean.reshape(3, 2)[:1].repeat(3, 0), rtol=0, atol=1e-15)


def test_an_inner_diagram_without_a_name_is_refused():
    """Drake names it by its address: the noise would be another in every process."""
    with pytest.raises(ValueError, match=r"sensor: a diagram around it has no name.*set_name"):
        measured(pair("left", None), "m1")
