"""Ensemble signals: ports, parameters and caches of every block."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.signals import Constant, Draw, EnsembleBlock, ensemble, leaf_systems, set_draw


class Doubler(EnsembleBlock):
    """Reads an ensemble and passes it on twice as large, through a cache entry; counts how often."""

    def __init__(self, trials, size, name="doubler"):
        super().__init__(name)
        self.calls = 0
        self.declare_input("in", trials, size)
        self.entry = self.declare_cached("double", Doubler._double, {self.input_ticket("in")})
        self.declare_output("out", trials, size, lambda c: self.cached(c, self.entry), {self.cached_ticket(self.entry)})

    def _double(self, context):
        self.calls += 1
        return 2 * self.read(context, "in")


class Drawing(EnsembleBlock):
    """Shows what it knows of the run."""

    def __init__(self, name):
        super().__init__(name)
        ticket = self.declare_draw()
        self.declare_output(
            "draw", 1, 2, lambda c: np.array([[self.draw(c).seed, self.draw(c).first_trial]], dtype=float), {ticket}
        )


def test_a_port_carries_trials_times_size_in_c_order():
    value = np.arange(6.0).reshape(3, 2)
    constant = Constant("c", value)
    port = constant.GetOutputPort("state")
    flat = port.Eval(constant.CreateDefaultContext())
    np.testing.assert_array_equal(flat, [0, 1, 2, 3, 4, 5])
    np.testing.assert_array_equal(ensemble(flat, 2), value)
    assert constant.output_size("state") == (3, 2) and constant.output_names() == ["state"]
    value[:] = -1  # the caller's array is not the block's
    np.testing.assert_array_equal(port.Eval(constant.CreateDefaultContext()), flat)
    assert Constant("c", [1.0, 2.0]).output_size("state") == (1, 2)


def test_values_pass_and_are_computed_once():
    builder = DiagramBuilder()
    value = np.array([[1.0, np.nan], [np.inf, 4.0]])
    constant, doubler = builder.AddSystem(Constant("c", value)), builder.AddSystem(Doubler(2, 2))
    builder.Connect(constant.GetOutputPort("state"), doubler.GetInputPort("in"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    mine = doubler.GetMyContextFromRoot(context)
    for _ in range(3):
        np.testing.assert_array_equal(ensemble(doubler.GetOutputPort("out").Eval(mine), 2), 2 * value)
    assert doubler.calls == 1


def test_what_is_read_may_be_changed():
    """`read` gives a copy: a block that works in place changes no other block's signal."""
    doubler = Doubler(1, 2)
    context = doubler.CreateDefaultContext()
    doubler.GetInputPort("in").FixValue(context, [1.0, 2.0])
    doubler.read(context, "in")[:] = 7.0
    np.testing.assert_array_equal(doubler.read(context, "in"), [[1.0, 2.0]])


def test_the_draw_reaches_every_block_that_draws():
    inner = DiagramBuilder()
    a = inner.AddSystem(Drawing("a"))
    outer = DiagramBuilder()
    nested = outer.AddSystem(inner.Build())
    b = outer.AddSystem(Drawing("b"))
    outer.AddSystem(Constant("c", [0.0]))  # draws nothing
    diagram = outer.Build()
    assert {leaf.get_name() for leaf in leaf_systems(diagram)} == {"a", "b", "c"} and nested in diagram.GetSystems()
    context, other = diagram.CreateDefaultContext(), diagram.CreateDefaultContext()
    for draw in (Draw(3, 4), Draw(2**53 - 1, 2**53 - 1)):
        set_draw(diagram, context, draw)
        for block in (a, b):
            mine = block.GetMyContextFromRoot(context)
            assert block.draw(mine) == draw
            # the port's cache has seen it
            np.testing.assert_array_equal(block.GetOutputPort("draw").Eval(mine), [draw.seed, draw.first_trial])
            assert block.draw(block.GetMyContextFromRoot(other)) == Draw()
            assert block.draw(block.GetMyContextFromRoot(context.Clone())) == draw


class Parcel:
    """A frozen object that is its own deep copy."""

    def __init__(self, weight):
        self.weight = weight

    def __deepcopy__(self, memo):
        return self


class Sender(EnsembleBlock):
    """Sends the same object at all times."""

    def __init__(self, value):
        super().__init__("sender")
        self.declare_abstract_output("out", lambda context: value, {self.nothing_ticket()})


class Scale(EnsembleBlock):
    """Weighs a `Parcel`."""

    def __init__(self):
        super().__init__("scale")
        self.declare_abstract_input("parcel", Parcel)
        self.declare_output(
            "weight",
            1,
            1,
            lambda context: np.array([[self.read_abstract(context, "parcel").weight]]),
            {self.input_ticket("parcel")},
        )


def _weighing(value):
    builder = DiagramBuilder()
    sender, scale = builder.AddSystem(Sender(value)), builder.AddSystem(Scale())
    builder.Connect(sender.GetOutputPort("out"), scale.GetInputPort("parcel"))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    return scale, [scale.GetMyContextFromRoot(context) for context in (root, root.Clone())]


def test_an_object_travels_by_reference():
    parcel = Parcel(3.0)
    scale, contexts = _weighing(parcel)
    for context in contexts:
        assert scale.read_abstract(context, "parcel") is parcel
        np.testing.assert_array_equal(scale.GetOutputPort("weight").Eval(context), [3.0])


def test_an_object_of_another_type_is_named():
    scale, (context, _) = _weighing(np.zeros(2))
    with pytest.raises(ValueError, match="scale: input parcel carries ndarray; Parcel is needed"):
        scale.GetOutputPort("weight").Eval(context)


@pytest.mark.parametrize("value", [-1, 2**53, 1.5, "1", None])
@pytest.mark.parametrize("field", ["seed", "first_trial"])
def test_bad_draw(field, value):
    with pytest.raises(ValueError, match=f"{field}: .* whole number"):
        Draw(**{field: value})


@pytest.mark.parametrize("trials", [0, -1, 2.5, "3"])
def test_bad_trials(trials):
    with pytest.raises(ValueError, match=r"trials: .* whole number >= 1"):
        Doubler(trials, 2)


def test_a_block_needs_a_name():
    with pytest.raises(ValueError, match="name"):
        Constant("", [0.0])


def test_a_cached_value_may_be_nothing():
    """Drake 1.58 refuses None as an abstract value, Drake 1.51 takes it."""

    class Silent(EnsembleBlock):
        def __init__(self):
            super().__init__("silent")
            self.index = self.declare_cached("nothing", lambda block, context: None, {self.time_ticket()})

    block = Silent()
    context = block.CreateDefaultContext()
    assert block.cached(context, block.index) is None
    assert block.cached(context.Clone(), block.index) is None
