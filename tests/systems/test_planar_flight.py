"""A flight from speed and altitude: a known one found again through rounding, and what is refused."""

import numpy as np
import pytest

from quietfix.systems.plants.recorded_flight import RecordedFlight
from quietfix.systems.trajectories.planar_flight import check_record, fit_planar_flight

RADIUS = 6371e3
CUT, LIGHT = 120.3, 128.0


def known():
    """A flight integrated here: speed with two bends, path angle from 90 to 12 degrees."""
    t = np.arange(0.0, 300.001, 1 / 30)
    rate = np.where(t < CUT, 4.0 + 0.12 * t, np.where(t < LIGHT, -6.0, 8.0 + 0.03 * (t - LIGHT)))
    v = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    gamma = np.pi / 2 * (1 - 0.85 * np.sin(np.clip(t / 300.0, 0, 1) * np.pi / 2) ** 1.2)
    h = np.concatenate([[0.0], np.cumsum(0.5 * ((v * np.sin(gamma))[1:] + (v * np.sin(gamma))[:-1]) * np.diff(t))])
    turn = v * np.cos(gamma) / (RADIUS + h)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (turn[1:] + turn[:-1]) * np.diff(t))])
    return t, v, gamma, h, theta


@pytest.fixture(scope="module")
def fitted():
    t, v, _, h, _ = known()
    shown = np.round(v * 3.6) / 3.6, np.where(h < 1e5, np.round(h, -2), np.round(h, -3))
    return fit_planar_flight(t, *shown, [121.0, 128.0], RADIUS, 4.0, search=3.0)


def test_the_flight_is_found_again(fitted):
    t, v, _, h, theta = known()
    assert fitted.breaks[1] == pytest.approx(CUT, abs=0.15)
    for i in range(300, t.size, 300):
        state, _ = fitted.at(float(t[i]))
        place = (RADIUS + h[i]) * np.array([np.sin(theta[i]), np.cos(theta[i]), 0]) - [0, RADIUS, 0]
        assert np.linalg.norm(state[:3] - place) < 700.0  # the altitude is shown to 100 m and 1000 m
        assert abs(np.linalg.norm(state[3:]) - v[i]) < 0.6  # largest beside a bend
    assert fitted.residual_speed == pytest.approx(1 / 3.6 / np.sqrt(12), rel=0.3)
    assert fitted.residual_height < 300.0  # 1 km of rounding is 289 m


def test_state_and_acceleration_belong_together(fitted):
    h = 1e-3
    for time in (1.0, 30.3, 119.0, 122.0, 127.0, 129.0, 200.0, 299.0):
        before, here, after = (fitted.at(time + d)[0] for d in (-h, 0.0, h))
        np.testing.assert_allclose((after - before)[:3] / (2 * h), here[3:], atol=1e-3)
        np.testing.assert_allclose((after - before)[3:] / (2 * h), fitted.at(time)[1], atol=1e-2)


def test_the_acceleration_jumps_at_the_events(fitted):
    cut = fitted.breaks[1]
    before, after = fitted.at(cut - 1e-6), fitted.at(cut + 1e-6)
    np.testing.assert_allclose(before[0], after[0], atol=0.01)
    assert np.linalg.norm(before[1] - after[1]) > 15.0
    assert np.isnan(fitted.at(-1.0)[0]).all() and np.isnan(fitted.at(301.0)[1]).all()


def test_the_block_has_the_ports_of_a_rocket(fitted):
    block = RecordedFlight(fitted)
    context = block.CreateDefaultContext()
    context.SetTime(200.0)
    np.testing.assert_array_equal(block.GetOutputPort("state").Eval(context), fitted.at(200.0)[0])
    np.testing.assert_array_equal(block.GetOutputPort("acceleration").Eval(context), fitted.at(200.0)[1])
    assert block.GetOutputPort("stage").Eval(context)[0] == 2.0


def test_what_is_refused():
    t, v, _, h, _ = known()
    gap = (t < 50.0) | (t > 53.0)
    with pytest.raises(ValueError, match=r"telemetry: the gap from 49.9\d* to 53.0\d* s is not allowed"):
        check_record(t[gap], v[gap], h[gap], 2.0)
    with pytest.raises(ValueError, match="increase strictly"):
        check_record(t[::-1], v, h, 2.0)
    with pytest.raises(ValueError, match="finite"):
        check_record(t, np.where(t > 10, np.nan, v), h, 2.0)
    with pytest.raises(ValueError, match="at least 100"):
        check_record(t[:50], v[:50], h[:50], 2.0)
