"""Free fall as a motion model: against SciPy's DOP853, and the paper's second-order step."""

import numpy as np
import pytest

from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.trajectories.gravity import gradient, gradient_rate
from tests.systems.ranging_scene import EARTH, TARGET, arc


@pytest.mark.parametrize("j2", [False, True])
def test_gradient_rate_is_the_change_of_the_gradient_along_the_path(j2):
    step = 1e-2
    before, after = (gradient(TARGET[:3] + s * TARGET[3:], EARTH, j2) for s in (-step, step))
    rate = gradient_rate(TARGET[:3], TARGET[3:], EARTH, j2)
    np.testing.assert_allclose(rate, (after - before) / (2 * step), rtol=0, atol=1e-6 * np.abs(rate).max())
    np.testing.assert_allclose(rate, rate.T, rtol=0, atol=1e-15 * np.abs(rate).max())
    assert abs(np.trace(rate)) < 1e-12 * np.abs(rate).max()  # the potential is harmonic


@pytest.mark.parametrize("j2", [False, True])
def test_runge_kutta_against_dop853(j2):
    """500 steps of 10 s: the reference found 9.9 mm."""
    motion, state = OrbitalMotion(EARTH, j2), TARGET
    for _ in range(500):
        state = motion.propagate(state, 10.0)
    error = np.linalg.norm((state - arc(j2)[1][-1])[:3])
    assert 1e-3 < error < 15e-3


def test_long_steps_are_cut():
    motion = OrbitalMotion(EARTH, False)
    state, phi = TARGET, np.eye(6)
    for _ in range(4):
        phi = motion.transition(state, 10.0) @ phi
        state = motion.propagate(state, 10.0)
    np.testing.assert_array_equal(motion.propagate(TARGET, 40.0), state)
    np.testing.assert_allclose(motion.transition(TARGET, 40.0), phi, rtol=1e-12, atol=1e-18)
    error = np.linalg.norm((motion.propagate(TARGET, 35.0) - arc(times=np.array([35.0]))[1][0])[:3])
    assert error < 1e-4


def test_the_papers_second_order_step():
    """(42): 1.15 m and 1.1 mm/s off after one step of 10 s, 518 m after 5000 s, as the reference has it."""
    motion, truth = OrbitalMotion(EARTH, False, "second_order"), arc()[1]
    one = motion.propagate(TARGET, 10.0) - truth[1]
    assert np.linalg.norm(one[:3]) == pytest.approx(1.15, abs=0.02)
    # the velocity is of second order as well, so its error is of the third
    assert np.linalg.norm(one[3:]) < 0.4
    state = TARGET
    for _ in range(500):
        state = motion.propagate(state, 10.0)
    assert np.linalg.norm((state - truth[-1])[:3]) == pytest.approx(518.0, rel=0.05)


def test_the_papers_transition_as_printed_is_not_the_derivative_of_its_own_step():
    """(43) has a factor 1/4 and A where its rate belongs."""
    motion = OrbitalMotion(EARTH, False, "second_order")
    a = np.zeros((6, 6))
    a[:3, 3:], a[3:, :3] = np.eye(3), gradient(TARGET[:3], EARTH, False)
    printed = np.eye(6) + 10.0 * a + 0.25 * (a @ a + a) * 50.0
    steps = np.diag([10.0] * 3 + [1e-2] * 3)
    columns = [(motion.propagate(TARGET + d, 10.0) - motion.propagate(TARGET - d, 10.0)) / (2 * d.max()) for d in steps]
    true = np.stack(columns, axis=-1)
    assert np.abs(motion.transition(TARGET, 10.0) - true)[:3, 3:].max() < 1e-6
    assert np.abs(printed - true)[:3, 3:].max() > 10  # seconds: the printed one moves the position by 12.5 s too much


def test_process_noise_is_additive_over_time_and_zero_by_default():
    assert not OrbitalMotion(EARTH).process_noise(TARGET, 10.0).any()
    noisy = OrbitalMotion(EARTH, density=1e-4)
    shift = np.eye(6)
    shift[:3, 3:] = 5.0 * np.eye(3)
    half = noisy.process_noise(TARGET, 5.0)
    np.testing.assert_allclose(noisy.process_noise(TARGET, 10.0), shift @ half @ shift.T + half, rtol=1e-13)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "euler"}, "propagation: euler is not allowed"),
        ({"step": 0.0}, "step: 0.0 is not allowed"),
        ({"density": -1.0}, "density: -1.0 is not allowed"),
    ],
)
def test_bad_arguments(options, words):
    with pytest.raises(ValueError, match=words):
        OrbitalMotion(EARTH, **options)
