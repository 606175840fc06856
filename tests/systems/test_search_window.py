"""Search windows and joined measurements."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.angles.direction import Direction
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart
from quietfix.systems.signal_chain.search_window import SearchWindow, delay_doppler_spread, direction_belief
from quietfix.systems.signals import Component, Constant, components_of
from tests.systems.dual_scene import CARRIER, scene

HERE = scene()
PLATFORMS = HERE.platforms[None]
DIRECTION = Direction(np.radians(0.5))
TDOA, FDOA = Tdoa(20e-9, receivers=(1,)), Fdoa(1.0, CARRIER, receivers=(1,))
MODEL = Stack([TDOA, FDOA])
EXACT = MODEL.predict(HERE.target[None], PLATFORMS)[0]


def test_spread_is_that_of_drawn_beliefs():
    rng = np.random.default_rng(0)
    covariance = np.diag([5e3**2] * 3 + [200.0**2] * 3)
    centre, sigma = delay_doppler_spread(MODEL, HERE.target[None], covariance[None], PLATFORMS)
    np.testing.assert_allclose(centre[0], EXACT)
    drawn = HERE.target + rng.standard_normal((20000, 6)) * np.sqrt(np.diag(covariance))
    # 20000 draws: 0.5 %; curvature over 5 km at 1000 km: a per mille
    np.testing.assert_allclose(sigma[0], MODEL.predict(drawn, PLATFORMS).std(axis=0), rtol=0.02)


def test_a_direction_and_a_height_give_a_place_as_good_as_they_are():
    rng = np.random.default_rng(1)
    exact = DIRECTION.predict(HERE.target[None], PLATFORMS)
    measured = exact + np.radians(0.5) * rng.standard_normal((4000, 2))
    mean, covariance = direction_belief(measured, PLATFORMS, DIRECTION, 10e3, 3e3, 200.0)
    error = (mean - HERE.target)[:, :3]
    # the height of the target is the assumed one here: only the angles scatter
    at_truth = direction_belief(exact, PLATFORMS, DIRECTION, 10e3, 1.0, 200.0)[1][0, :3, :3]
    spread = np.cov(error.T)
    assert np.linalg.norm(spread - at_truth) < 0.1 * np.linalg.norm(at_truth)
    assert np.all(mean[:, 3:] == 0) and np.all(covariance[:, 3:, 3:] == 200.0**2 * np.eye(3))
    upwards = direction_belief(np.array([[0.3, -0.2]]), PLATFORMS, DIRECTION, 10e3, 3e3, 200.0)
    assert np.isnan(upwards[0][:, :3]).all() and np.isnan(upwards[1]).all()


def _window(direction, prediction=None, covariance=None, **options):
    trials = np.atleast_2d(direction).shape[0]
    feedback = prediction is not None
    block = SearchWindow(DIRECTION, TDOA, FDOA, trials, 2, 2e-6, 150.0, feedback=feedback, **options)
    context = block.CreateDefaultContext()
    block.GetInputPort("direction").FixValue(context, np.ravel(direction))
    block.GetInputPort("platforms").FixValue(context, HERE.platforms.ravel())
    if feedback:
        block.GetInputPort("prediction").FixValue(context, np.ravel(prediction))
        block.GetInputPort("prediction_covariance").FixValue(context, np.ravel(covariance))
    return block.GetOutputPort("window").Eval(context).reshape(-1, 4)


def test_a_prediction_is_preferred_and_a_direction_serves_where_there_is_none():
    exact = DIRECTION.predict(HERE.target[None], PLATFORMS)[0]
    prediction = np.stack([HERE.target, np.full(6, np.nan), np.full(6, np.nan)])
    covariance = np.stack([np.diag([100.0**2] * 3 + [1.0] * 3)] * 3)
    window = _window(np.stack([exact, exact, exact * np.nan]), prediction, covariance)
    np.testing.assert_allclose(window[0], [*EXACT, 2e-6, 150.0])  # so good a prediction needs the least window
    at_rest = MODEL.predict(np.concatenate([HERE.target[:3], np.zeros(3)])[None], PLATFORMS)[0]
    # the straight line is not quite at 10 km: metres, that is nanoseconds
    assert np.all(np.abs(window[1, :2] - at_rest) < [5e-9, 0.1])
    assert 5e-6 < window[1, 2] < 30e-6 and 500 < window[1, 3] < 2000
    assert np.isnan(window[2, :2]).all() and np.isfinite(window[2, 2:]).all()


def test_windows_hold_the_truth():
    rng = np.random.default_rng(2)
    exact = DIRECTION.predict(HERE.target[None], PLATFORMS)
    window = _window(exact + np.radians(0.5) * rng.standard_normal((500, 2)))
    off = np.abs(window[:, :2] - EXACT) / window[:, 2:]
    # five sigma of position; the speed, 300 m/s, is 1.5 sigma
    assert off.max() < 1.0 and off[:, 0].std() > 0.05
    assert len(np.unique(window[:, 2:], axis=0)) < 12  # a few sizes


def test_windows_have_a_largest_size():
    exact = DIRECTION.predict(HERE.target[None], PLATFORMS)
    window = _window(exact, largest_half_frequency=400.0, largest_half_delay=3e-6)
    np.testing.assert_allclose(window[0, 2:], [3e-6, 400.0])
    with pytest.raises(ValueError, match="largest half-widths of the window"):
        _window(exact, largest_half_frequency=100.0)
    with pytest.raises(ValueError, match="one TDOA and one FDOA"):
        SearchWindow(DIRECTION, Tdoa(1e-9), FDOA, 1, 2, 1e-6, 1.0)


def test_measurements_are_joined_with_their_noise():
    builder = DiagramBuilder()
    joined = builder.AddSystem(JoinedMeasurements({"a": JoinedPart(1, [[4.0]]), "b": JoinedPart(2)}, 2))
    for port, value in {
        "a": [[1.0], [np.nan]],
        "b": [[2.0, 3.0], [4.0, 5.0]],
        "b_noise_covariance": [[1.0, 0.5, 0.5, 2.0], [np.nan] * 4],
    }.items():
        source = builder.AddSystem(Constant(port + "_source", value))
        builder.Connect(source.GetOutputPort("state"), joined.GetInputPort(port))
    diagram = builder.Build()
    context = joined.GetMyContextFromRoot(diagram.CreateDefaultContext())
    rows = joined.GetOutputPort("measurement").Eval(context).reshape(2, 3)
    noise = joined.GetOutputPort("noise_covariance").Eval(context).reshape(2, 3, 3)
    np.testing.assert_array_equal(rows, [[1, 2, 3], [np.nan, 4, 5]])
    np.testing.assert_array_equal(noise[0], [[4, 0, 0], [0, 1, 0.5], [0, 0.5, 2]])
    np.testing.assert_array_equal(np.isnan(noise[1]), [[0, 0, 0], [0, 1, 1], [0, 1, 1]])
    with pytest.raises(ValueError, match="no measurement is given"):
        JoinedMeasurements({}, 1)
    with pytest.raises(ValueError, match="a noise_covariance: shape"):
        JoinedMeasurements({"a": JoinedPart(2, [1.0])}, 1)


def test_joined_rows_have_the_names_and_units_of_their_parts():
    parts = {"a": JoinedPart(1, [[4.0]], [Component("up", "m")]), "b": JoinedPart(2, components=components_of(MODEL))}
    joined = JoinedMeasurements(parts, 1)
    assert joined.components("measurement") == (("up", "m"), ("tdoa_10", "s"), ("fdoa_10", "Hz"))
    square = joined.components("noise_covariance")
    assert len(square) == 9 and square[3] == ("tdoa_10_up", "s m") and square[8] == ("fdoa_10_fdoa_10", "Hz Hz")
    half = JoinedMeasurements(parts | {"c": JoinedPart(1, [[1.0]])}, 1)  # where one says nothing, nothing is said
    assert half.components("measurement") == half.components("noise_covariance") == ()
