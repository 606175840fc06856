"""Solutions that would not end do."""

import numpy as np
import pytest

from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.plants.solving import solve
from quietfix.systems.trajectories.gravity import GravityConstants


def test_a_solution_is_that_of_the_equation():
    solved = solve("x", lambda t, x: -x, 0.0, 3.0, np.ones(1), rtol=1e-10, atol=1e-12)
    assert solved.sol(2.5)[0] == pytest.approx(np.exp(-2.5), rel=1e-7)  # of SciPy's default method at that rtol


def test_too_many_revolutions_are_told(monkeypatch):
    monkeypatch.setattr("quietfix.systems.plants.solving._MOST_CALLS", 4000)
    with pytest.raises(ValueError, match="spring: it moves too fast to be followed to 1000 s, 4000 steps reach"):
        solve("spring", lambda t, x: np.array([1e9 * x[1], -1e9 * x[0]]), 0.0, 1e3, np.ones(2))


def test_a_satellite_that_falls_is_told():
    start = np.array([[7.0e6, 0, 0, 0, 7.5e3, 0], [7.0e6, 0, 0, 0, 1e3, 0]])
    with pytest.raises(ValueError, match="satellite 1 falls onto the Earth after 388 s"):
        DenseOrbit(start, 3000.0, constants=GravityConstants())
    assert DenseOrbit(start, 300.0).at(300.0).shape == (2, 6)
