"""Clocks: Drake fires at exactly their ticks, and every instant is one tick or none."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from quietfix.systems.clocks import Merged, Periodic, Times, same_instant

STAMPS = np.sort(np.random.default_rng(1).uniform(0, 30, 40))
CLOCKS = {
    "periodic": Periodic(0.7),
    "periodic, not exact in binary": Periodic(0.1),
    "periodic, with offset": Periodic(1 / 3, 0.07),
    "times": Times(STAMPS),
    "merged": Merged([Periodic(1.0), Periodic(0.3)]),
    "merged with times": Merged([Periodic(0.1), Times(STAMPS), Periodic(2.5, 1.0)]),
}


class Fired(LeafSystem):
    """Remembers when its events came."""

    def __init__(self, clock):
        super().__init__()
        self.at = []
        self.DeclareDiscreteState(1)
        clock.declare(lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._event))

    def _event(self, context, discrete):
        self.at.append(context.get_time())


@pytest.mark.parametrize("name", CLOCKS)
def test_drake_fires_at_the_ticks(name):
    clock = CLOCKS[name]
    block = Fired(clock)
    simulator = Simulator(block)
    simulator.Initialize()
    simulator.AdvanceTo(20.0)
    simulator.AdvancePendingEvents()
    ticks = clock.ticks(20.0)
    at = np.array(block.at)
    if not isinstance(clock, Merged):
        np.testing.assert_array_equal(at, ticks)  # bit for bit
    indices = [clock.index(time) for time in at]
    assert None not in indices
    # merged clocks may fire twice for one tick; none is left out
    np.testing.assert_array_equal(np.unique(indices), np.arange(len(ticks)))
    np.testing.assert_allclose(ticks[indices], at, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("name", CLOCKS)
def test_index_counts_the_ticks(name):
    clock = CLOCKS[name]
    ticks = clock.ticks(25.0)
    assert np.all(np.diff(ticks) > 1e-6) and ticks[0] >= 0 and ticks[-1] <= 25.0 + 1e-9
    assert [clock.index(time) for time in ticks] == list(range(len(ticks)))
    # up to the last bits, and in any order of asking
    assert [clock.index(time) for time in np.nextafter(ticks, np.inf)[::-1]] == list(range(len(ticks)))[::-1]
    assert [clock.index(time) for time in np.nextafter(ticks[1:], -np.inf)] == list(range(1, len(ticks)))
    between = (ticks[1:] + ticks[:-1]) / 2
    assert all(clock.index(time) is None for time in between)
    np.testing.assert_array_equal(clock.ticks(10.0), ticks[: len(clock.ticks(10.0))])


def test_the_last_tick_is_counted_although_rounding_puts_it_later():
    """3 * 0.1 > 0.3: a study that ends at 0.3 s has its sample at 0.3 s."""
    assert 3 * 0.1 > 0.3
    ticks = Periodic(0.1).ticks(0.3)
    assert len(ticks) == 4 and ticks[-1] == 3 * 0.1
    assert len(Periodic(0.1).ticks(0.3 - 1e-9)) == 3
    assert len(Merged([Periodic(0.1), Periodic(0.3)]).ticks(0.3)) == 4


def test_one_instant_of_two_clocks_is_one_tick():
    """0.1 and 0.3 meet ten times in 3 s, and differ in the last bit at three of these."""
    merged = Merged([Periodic(0.1), Periodic(0.3)])
    assert (0.1 * np.arange(0, 31, 3) != 0.3 * np.arange(11)).any()
    ticks = merged.ticks(3.0)
    np.testing.assert_allclose(ticks, 0.1 * np.arange(31), atol=1e-15)
    for k in range(11):
        assert merged.index(0.3 * k) == merged.index(0.1 * (3 * k)) == 3 * k


def test_times_beside_periodic():
    merged = Merged([Times([0.3, 0.35]), Periodic(0.1)])
    assert Times([0.3]).index(3 * 0.1) == 0
    assert [merged.index(t) for t in (0.0, 0.1, 0.3, 3 * 0.1, 0.35, 0.4)] == [0, 1, 3, 3, 4, 5]


def test_a_long_run_stays_cheap():
    """Ten thousand ticks are listed a few times, not at every tick."""
    calls = []

    class Counted(Periodic):
        def ticks(self, end):
            calls.append(end)
            return super().ticks(end)

    merged = Merged([Counted(1.0), Periodic(0.25)])
    for k in range(4000):
        assert merged.index(0.25 * k) == k
    assert len(calls) < 20


def test_same_instant():
    assert same_instant(0.1 * 3, 0.3) and same_instant(0.0, 0.0)
    assert same_instant(86400.0, np.nextafter(86400.0, 0))
    assert not same_instant(1.0, 1.0 + 1e-9) and not same_instant(0.0, 1e-9)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_bad_period(period):
    with pytest.raises(ValueError, match=r"clock period: .* > 0 s"):
        Periodic(period)


@pytest.mark.parametrize("offset", [-1.0, np.nan, np.inf])
def test_bad_offset(offset):
    with pytest.raises(ValueError, match=r"clock offset: .* >= 0 s"):
        Periodic(1.0, offset)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([], "at least one"),
        ([[1.0]], "one-dimensional"),
        ([0.0, np.nan], "finite"),
        ([-1.0, 0.0], ">= 0"),
        ([0.0, 2.0, 2.0], "stamp 2 is 2.0 after 2.0"),
        ([0.0, 2.0, 1.0], "stamp 2 is 1.0 after 2.0"),
        ([0.0, 0.3, 3 * 0.1], "increase strictly"),  # one instant, written in two ways
    ],
)
def test_bad_stamps(stamps, message):
    with pytest.raises(ValueError, match=message):
        Times(stamps)


def test_bad_merge():
    with pytest.raises(ValueError, match="at least one"):
        Merged([])


def test_stamps_are_not_shared_with_the_caller():
    stamps = np.array([0.0, 1.0])
    clock = Times(stamps)
    stamps[1] = 5.0
    assert clock.index(1.0) == 1
