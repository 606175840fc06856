"""The current statistical model against high-precision closed forms, quadrature and published numbers."""

from decimal import Decimal, getcontext

import numpy as np
import pytest
from scipy.integrate import quad_vec

from quietfix.systems.motion.current_statistical import (
    CurrentStatistical,
    singer_input,
    singer_noise,
    singer_transition,
)

ALPHA_T = np.geomspace(1e-6, 5.0, 29)
LIMITS = [44.0, 14.0, 0.5], [-0.6, -9.7, -0.5]


def closed_form(alpha, dt):
    """Singer's closed forms in 80 digits, where they may cancel as they like."""
    getcontext().prec = 80
    a, t = Decimal(float(alpha)), Decimal(float(dt))
    x = a * t
    e, e2 = (-x).exp(), (-2 * x).exp()
    q11 = (1 - e2 + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * e) / (2 * a**5)
    q12 = (e2 + 1 - 2 * e + 2 * x * e - 2 * x + x**2) / (2 * a**4)
    q13 = (1 - e2 - 2 * x * e) / (2 * a**3)
    q22 = (4 * e - 3 - e2 + 2 * x) / (2 * a**3)
    q23 = (e2 + 1 - 2 * e) / (2 * a**2)
    q33 = (1 - e2) / (2 * a)
    return np.array([[q11, q12, q13], [q12, q22, q23], [q13, q23, q33]], dtype=float)


@pytest.mark.parametrize("dt", [0.05, 1.0])
@pytest.mark.parametrize("x", ALPHA_T)
def test_noise_is_the_closed_form_and_the_integral(x, dt):
    alpha = x / dt
    q = singer_noise(alpha, dt)
    np.testing.assert_allclose(q, closed_form(alpha, dt), rtol=1e-12)

    def response(s):
        # (as - 1 + e^-as)/a^2 by the integral of its derivative, which expm1 gives without cancellation
        velocity = -np.expm1(-alpha * s) / alpha
        terms = [s * s * sum((-alpha * s) ** n / fact for n, fact in enumerate(_FACTORIALS))]
        return np.array([terms[0], velocity, np.exp(-alpha * s)])

    integral = quad_vec(lambda s: np.outer(response(s), response(s)), 0.0, dt, epsabs=0.0, epsrel=1e-12)[0]
    np.testing.assert_allclose(q, integral, rtol=1e-10)


_FACTORIALS = [float(np.prod(np.arange(1, n + 3, dtype=float))) for n in range(40)]  # (n + 2)!


def test_published_values():
    """MathWorks, documentation of singerProcessNoise and singerjac."""
    np.testing.assert_allclose(
        2 * 0.05 * singer_noise(0.05, 1.0),
        [[0.0049, 0.0121, 0.0159], [0.0121, 0.0321, 0.0476], [0.0159, 0.0476, 0.0952]],
        atol=5e-5,
    )
    np.testing.assert_allclose(
        2 * 0.1 * singer_noise(0.1, 2.0),
        [[0.2868, 0.3508, 0.2188], [0.3508, 0.4603, 0.3286], [0.2188, 0.3286, 0.3297]],
        atol=5e-5,
    )
    np.testing.assert_allclose(singer_transition(0.05, 1.0)[:, 2], [0.4918, 0.9754, 0.9512], atol=5e-5)


def test_at_the_papers_own_step_the_double_closed_form_is_rounding():
    """Why there is a series: alpha T = 5e-4."""
    x = 0.01 * 0.05
    bracket = 1 - np.exp(-2 * x) + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * np.exp(-x)
    true = singer_noise(0.01, 0.05)[0, 0]
    assert abs(bracket / (2 * 0.01**5) - true) > true  # worse than no digit
    np.testing.assert_allclose(true, 0.05**5 / 20, rtol=1e-3)
    assert np.linalg.eigvalsh(singer_noise(1e-4, 0.05) / 0.05)[0] > 0


@pytest.mark.parametrize("x", ALPHA_T)
def test_input_and_transition_make_constant_acceleration(x):
    total = singer_transition(x, 1.0)[:, 2] + singer_input(x, 1.0)
    np.testing.assert_allclose(total, [0.5, 1.0, 1.0], rtol=1e-14)
    assert np.all(singer_input(x, 1.0) > 0)
    two = singer_transition(x, 1.0) @ singer_transition(x, 0.5)
    np.testing.assert_allclose(two, singer_transition(x, 1.5), rtol=1e-13)


def test_noise_adds_up_over_steps():
    whole, half = singer_noise(0.4, 2.0), singer_noise(0.4, 1.0)
    phi = singer_transition(0.4, 1.0)
    np.testing.assert_allclose(whole, phi @ half @ phi.T + half, rtol=1e-12)


def test_adaptive_variance():
    model = CurrentStatistical(0.01, *LIMITS, floor=1.0)
    mean = np.array([[4.0, -3.0, 0.0], [44.0, -9.7, -0.2]])
    factor = (4 - np.pi) / np.pi
    expected = factor * np.array([[40.0**2, 6.7**2, 0.5**2], [0.0, 0.0, 0.3**2]])
    np.testing.assert_allclose(model.variance(mean), np.maximum(expected, 1.0), rtol=1e-12)
    blind = CurrentStatistical(0.01, *LIMITS, floor=0.0)
    assert blind.variance(mean)[1, 0] == 0.0  # the trap: just before burn-out nothing is expected to happen


def test_both_rules_of_the_mean():
    state = np.zeros((2, 10))
    state[:, 6:9] = [[3.0, 2.0, 1.0], [-1.0, 0.0, 4.0]]
    previous = np.ones((2, 3))
    plain = CurrentStatistical(0.5, *LIMITS, bias_densities=[1.0])
    np.testing.assert_array_equal(plain.next_input(state, previous, 0.1), state[:, 6:9])
    filtered = CurrentStatistical(0.5, *LIMITS, bias_densities=[1.0], rule="filtered")
    keep = np.exp(-0.05)
    np.testing.assert_allclose(filtered.next_input(state, previous, 0.1), keep * state[:, 6:9] + (1 - keep), rtol=1e-15)
    held = filtered.driven(previous)
    expected = singer_transition(0.5, 0.1)[2, 2] * state[:, 6:9] + singer_input(0.5, 0.1)[2]
    np.testing.assert_allclose(held.propagate(state, 0.1)[:, 6:9], expected, rtol=1e-14)
    np.testing.assert_allclose(held.process_noise(state, 0.1)[0], held.process_noise(state + 5.0, 0.1)[0])
    assert held.process_noise(state, 0.1)[0, 9, 9] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, *LIMITS), "alpha: 0.0"),
        ((-1.0, *LIMITS), "alpha: -1.0"),
        ((0.01, [-1.0, 1, 1], LIMITS[1]), "a_max"),
        ((0.01, LIMITS[0], [1.0, 0, 0]), "a_min"),
        ((0.01, [1.0, 1.0], LIMITS[1]), "a_max"),
        ((0.01, *LIMITS, -1.0), "floor"),
        ((0.01, *LIMITS, 1.0, [-1.0]), "bias density"),
        ((0.01, *LIMITS, 1.0, [], "mean"), "mean acceleration"),
    ],
)
def test_what_is_not_allowed(arguments, message):
    with pytest.raises(ValueError, match=message):
        CurrentStatistical(*arguments)
