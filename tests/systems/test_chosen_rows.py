"""Some rows of a measurement model: those of the whole, with their noise."""

import numpy as np
import pytest

from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.measurement.chosen import ChosenRows, only
from quietfix.systems.measurement.tdoa import Tdoa
from tests.laws.cases import MEASUREMENTS

PLACES = np.random.default_rng(2).normal(size=(5, 4, 6)) * 1e4
TARGETS = np.random.default_rng(3).normal(size=(5, 6)) * 1e4


def test_rows_values_and_noise_are_those_of_the_whole():
    whole = Tdoa(50e-9, [0, 2, 3], 1, correlated=True)
    chosen = only(whole, ["tdoa_31", "tdoa_01"])
    assert chosen.names == ("tdoa_01", "tdoa_31") and chosen.units == ("s", "s")
    value, jacobian = chosen.linearize(TARGETS, PLACES)
    full, slopes = whole.linearize(TARGETS, PLACES)
    np.testing.assert_array_equal(value, full[:, [0, 2]])
    np.testing.assert_array_equal(jacobian, slopes[:, [0, 2]])
    # correlated through the reference: half the variance
    np.testing.assert_allclose(chosen.noise_covariance(), 2.5e-15 * np.array([[1, 0.5], [0.5, 1]]), rtol=1e-12)
    np.testing.assert_array_equal(chosen.platforms_used(4), [[1, 1, 0, 0], [0, 1, 0, 1]])


def test_a_phase_stays_one_that_can_be_resolved():
    whole = InterferometerPhase(0.1, 3.0, 0.1, platform=2, wrapped=True)
    chosen = only(whole, ["phase_b"])
    assert isinstance(chosen, InterferometerPhase) and chosen.names == ("phase_b",)
    np.testing.assert_array_equal(chosen.predict(TARGETS, PLACES), whole.predict(TARGETS, PLACES)[:, 1:])
    assert chosen.unambiguous().residual(np.array([7.0]), np.array([0.0])) == 7.0
    assert whole.wrapped and whole.names == ("phase_a", "phase_b")


def test_an_angle_is_wrapped():
    chosen, _ = MEASUREMENTS["chosen rows"]
    residual = chosen.residual(np.array([[3.1, 10.0]]), np.array([-3.1, 4.0]))
    np.testing.assert_allclose(residual, [[6.2 - 2 * np.pi, 6.0]], atol=1e-12)


def test_rows_that_are_not_there():
    with pytest.raises(ValueError, match=r"rows: \['tdoa_9'\] is not allowed; of tdoa_10, tdoa_20"):
        ChosenRows(Tdoa(1e-9), ["tdoa_9"])
    with pytest.raises(ValueError, match="rows: none is not allowed"):
        ChosenRows(Tdoa(1e-9), [])
