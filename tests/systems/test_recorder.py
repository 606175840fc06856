"""The recorder: what is on its ports at the ticks, per context."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from quietfix.systems.clocks import Merged, Periodic, Times
from quietfix.systems.recorder import record
from quietfix.systems.signals import EnsembleBlock


class Ramp(EnsembleBlock):
    """(trial + 1) * time and its square."""

    def __init__(self, trials=3):
        super().__init__("ramp")
        self.declare_output("ramp", trials, 2, lambda c: self._at(c.get_time(), trials), {self.time_ticket()})

    @staticmethod
    def _at(time, trials):
        value = time * np.arange(1.0, trials + 1)
        return np.stack([value, value**2], axis=-1)


def scene(clock):
    builder = DiagramBuilder()
    ramp = builder.AddSystem(Ramp())
    source = builder.AddSystem(ConstantVectorSource([4.0, 5.0]))
    recorder = record(builder, {"ramp": ramp.GetOutputPort("ramp"), "drake": source.get_output_port()}, clock)
    return builder.Build(), recorder


def simulate(diagram, end, context=None):
    simulator = Simulator(diagram, context or diagram.CreateDefaultContext())
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return simulator.get_context()


@pytest.mark.parametrize(
    "clock",
    [Periodic(1.0), Periodic(0.1), Periodic(0.3, 0.2), Times([0.0, 0.4, 2.9, 3.0]), Times([1.0])],
    ids=["1 s", "0.1 s", "offset", "times", "once"],
)
def test_every_tick_first_and_last_included(clock):
    diagram, recorder = scene(clock)
    ticks = clock.ticks(3.0)
    times, values = recorder.result(simulate(diagram, ticks[-1]))
    np.testing.assert_array_equal(times, ticks)
    np.testing.assert_array_equal(values["ramp"], np.stack([Ramp._at(t, 3) for t in ticks]))
    assert values["drake"].shape == (len(ticks), 1, 2)


def test_clocks_that_meet_are_recorded_once():
    """Also where the last bit of the instant differs."""
    diagram, recorder = scene(Merged([Periodic(0.1), Periodic(0.3), Times([0.35])]))
    times, values = recorder.result(simulate(diagram, 1.0))
    np.testing.assert_allclose(times, np.sort([*np.arange(11) * 0.1, 0.35]), atol=1e-12)
    assert len(values["ramp"]) == len(times)


def test_the_log_is_in_the_context():
    diagram, recorder = scene(Periodic(1.0))
    first = simulate(diagram, 3.0)
    kept = recorder.result(first)
    second = simulate(diagram, 5.0)
    assert len(recorder.result(first)[0]) == 4 and len(recorder.result(second)[0]) == 6
    np.testing.assert_array_equal(kept[1]["ramp"], recorder.result(second)[1]["ramp"][:4])
    clone = first.Clone()
    assert len(recorder.result(clone)[0]) == 0  # a clone begins its own record
    clone.SetTime(0.0)
    simulate(diagram, 2.0, clone)
    assert len(recorder.result(clone)[0]) == 3 and len(recorder.result(first)[0]) == 4


def test_a_result_is_not_the_log():
    diagram, recorder = scene(Periodic(1.0))
    context = simulate(diagram, 3.0)
    recorder.result(context)[1]["ramp"][:] = 0.0
    assert recorder.result(context)[1]["ramp"].any()
