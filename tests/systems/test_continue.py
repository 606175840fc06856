"""A run that is continued: a cloned context in a Simulator of its own goes on where it stood."""

import warnings

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from quietfix.systems.signals import Draw, set_draw
from tests.laws.packaged import Packaged

SETTINGS = {"truth.motion": "!RandomAcceleration {}"}
NAMES = ["iekf", "ukf", "pf"]


@pytest.fixture(scope="module")
def packaged():
    return Packaged("three_satellite", 2, SETTINGS | {"estimators.pf": "!Pf {particles: 50}"}, NAMES)


@pytest.mark.parametrize("pause", [4.0, 4.5])
def test_a_clone_goes_on_bit_for_bit(packaged, pause):
    times, straight = packaged.run(seed=2, end=9.0)
    context = packaged.diagram.CreateDefaultContext()
    set_draw(packaged.diagram, context, Draw(2))
    Simulator(packaged.diagram, context).AdvanceTo(pause)
    again = Simulator(packaged.diagram, context.Clone())
    again.Initialize()
    again.AdvanceTo(9.0)
    later, continued = packaged.recorder.result(again.get_context())
    assert later[0] == np.ceil(pause)
    for name in straight:
        np.testing.assert_array_equal(continued[name], straight[name][times >= later[0]], err_msg=name)


def test_a_context_set_back_to_zero_begins_anew(packaged):
    """The same context, another seed, from the first instant: nothing of the run before is left."""
    _, straight = packaged.run(seed=7, end=3.0)
    context = packaged.diagram.CreateDefaultContext()
    set_draw(packaged.diagram, context, Draw(2))
    simulator = Simulator(packaged.diagram, context)
    simulator.AdvanceTo(5.0)
    set_draw(packaged.diagram, context, Draw(7))
    context.SetTime(0.0)
    simulator.Initialize()
    simulator.AdvanceTo(3.0)
    _, again = packaged.recorder.result(context)
    for name in straight:
        np.testing.assert_array_equal(again[name][-4:], straight[name], err_msg=name)


def test_a_forgotten_seed_is_said(packaged):
    with pytest.warns(RuntimeWarning, match="seed: it was not set; seed 0"):
        Simulator(packaged.diagram).Initialize()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        packaged.run(seed=0, end=1.0)
