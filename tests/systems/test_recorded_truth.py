"""Truth interpolated from samples."""

import numpy as np
import pytest

from quietfix.systems.plants.recorded import RecordedTruth, hermite

TIMES = np.array([2.0, 3.0, 4.5, 5.0, 8.0])
COEFFICIENTS = np.random.default_rng(3).normal(size=(4, 2, 3))  # cubics: power, trial, axis


def cubic(t):
    """Position, velocity, acceleration of two cubic motions; a Hermite spline reproduces them exactly."""
    c = COEFFICIENTS
    p = 6e6 + c[0] + c[1] * t + c[2] * t**2 + c[3] * t**3
    return np.concatenate([p, c[1] + 2 * c[2] * t + 3 * c[3] * t**2], axis=-1), 2 * c[2] + 6 * c[3] * t


RECORD = np.stack([cubic(t)[0] for t in TIMES])


def ports(block, time):
    context = block.CreateDefaultContext()
    context.SetTime(time)
    return [
        block.GetOutputPort(name).Eval(context).reshape(block.output_size(name)) for name in ("state", "acceleration")
    ]


@pytest.mark.parametrize("time", [2.0, 2.3, 3.0, 4.49, 7.9, 8.0])
def test_a_cubic_is_met_exactly(time):
    state, acceleration = ports(RecordedTruth(TIMES, RECORD), time)
    want, curvature = cubic(time)
    # rounding of 6e6 m is 1e-9, divided by the half-second interval once and twice
    np.testing.assert_allclose(state[:, :3], want[:, :3], atol=1e-8)
    np.testing.assert_allclose(state[:, 3:], want[:, 3:], atol=1e-7)
    np.testing.assert_allclose(acceleration, curvature, atol=1e-7)


def test_samples_are_met_bit_for_bit():
    block = RecordedTruth(TIMES, RECORD)
    for time, sample in zip(TIMES, RECORD, strict=True):
        np.testing.assert_array_equal(ports(block, time)[0], sample)


def test_error_of_a_smooth_motion_is_of_fourth_order():
    def worst(step):
        t = np.arange(0, 20 + step / 2, step)
        x = np.zeros((t.size, 6))
        x[:, 0], x[:, 3] = np.sin(t), np.cos(t)
        at = np.linspace(0, 20, 777)
        return max(abs(hermite(t, x, s)[0][0] - np.sin(s)) for s in at)

    assert worst(0.5) < 0.5**4 / 384  # the bound, fourth derivative at most 1
    assert 14 < worst(0.5) / worst(0.25) < 18  # 2^4


def test_nan_outside_the_record():
    block = RecordedTruth(TIMES, RECORD[:, 0])
    for time in (1.999, 8.001):
        assert all(np.isnan(value).all() for value in ports(block, time))
    assert ports(block, 5.5)[0].shape == (1, 6)


def test_a_gap_stays_in_its_trial():
    record = RECORD.copy()
    record[2, 1] = np.nan
    block = RecordedTruth(TIMES, record)
    for time in (3.5, 4.7):
        state, acceleration = ports(block, time)
        assert np.isfinite(state[0]).all() and np.isnan(state[1]).all() and np.isnan(acceleration[1]).all()
    assert np.isfinite(ports(block, 6.0)[0]).all()


def test_positions_alone():
    # second-order differences are exact for a parabola, ends included
    t = TIMES[:, None]
    p = np.concatenate([1 + t, 2 * t**2 - t, -(t**2)], axis=-1)
    state, acceleration = ports(RecordedTruth(TIMES, p), 6.1)
    np.testing.assert_allclose(state[0], [7.1, 2 * 6.1**2 - 6.1, -(6.1**2), 1, 4 * 6.1 - 1, -2 * 6.1], rtol=1e-12)
    np.testing.assert_allclose(acceleration[0], [0, 4, -2], atol=1e-11)


def test_velocities_of_positions_alone_are_of_fourth_order():
    """Off by h^4/30 x^(5) inside and h^4/5 x^(5) at the ends, with a tenth more for the terms that follow."""
    for step in (0.5, 0.25):
        t = np.arange(0, 20 + step / 2, step)
        p = np.stack([np.sin(t), np.cos(t), 0 * t], axis=-1)
        off = np.abs(RecordedTruth(t, p).states[:, 0, 3:] - np.stack([np.cos(t), -np.sin(t), 0 * t], axis=-1))
        assert off[2:-2].max() < 1.1 * step**4 / 30 and 0.3 * step**4 / 5 < off.max() < 1.1 * step**4 / 5


def test_a_gap_in_positions_alone_stays_in_its_trial():
    t = np.arange(12.0)
    p = np.stack([t**2, t, 0 * t], axis=-1)
    p = np.stack([p, p + 5, p], axis=1)
    p[6, 1] = np.nan
    states = RecordedTruth(t, p).states
    want = np.stack([2 * t, 1 + 0 * t, 0 * t], axis=-1)
    for trial in (0, 2):
        np.testing.assert_allclose(states[:, trial, 3:], want, atol=1e-12)
    np.testing.assert_allclose(np.delete(states[:, 1, 3:], 6, axis=0), np.delete(want, 6, axis=0), atol=1e-12)
    assert np.isnan(states[6, 1]).all()


@pytest.mark.parametrize(
    ("times", "states", "message"),
    [
        ([1.0], RECORD[:1], "at least two samples"),
        (TIMES[::-1], RECORD, "must increase strictly, but 5.0 s follows 8.0 s"),
        ([2, 3, 3, 4, 5], RECORD, "must increase strictly"),
        ([0, 1, np.nan, 3, 4], RECORD, "finite"),
        (TIMES, RECORD[:4], "shape"),
        (TIMES, RECORD[..., :4], "shape"),
    ],
)
def test_bad_records(times, states, message):
    with pytest.raises(ValueError, match=message):
        RecordedTruth(times, states)
