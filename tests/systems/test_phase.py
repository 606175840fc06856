"""Interferometer phases: the body frame they refer to, wrapping, and the angle that a phase means."""

import numpy as np
import pytest

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.phase import InterferometerPhase, phase_angle
from quietfix.systems.constants import EARTH_RATE
from tests.laws.cases import PASS, WAVELENGTH, phase, place, satellites

CYCLES = 3.0 / WAVELENGTH


def body(target):
    """The target in satellite 0's body frame, from the words of the paper: z down, y = z x v inertial, x = y x z."""
    carrier = satellites(PASS / 2)[0]
    r, v = carrier[:3], carrier[3:] + np.cross([0, 0, EARTH_RATE], carrier[:3])
    z = -r / np.linalg.norm(r)
    y = np.cross(z, v) / np.linalg.norm(np.cross(z, v))
    return np.stack([np.cross(y, z), y, z]) @ (target[:3] - r)


def test_definition():
    """phase_a = 2 pi n x_b / r along the track, phase_b = 2 pi n y_b / r across it."""
    for along, cross in ((0, 0), (300e3, 0), (-200e3, 500e3), (0, -700e3)):
        target = place(along, cross)
        b = body(target)
        expected = 2 * np.pi * CYCLES * b[:2] / np.linalg.norm(b)
        value = phase().predict(target, satellites(PASS / 2))
        np.testing.assert_allclose(value, expected, atol=1e-9)
        # a target ahead has phase_a > 0, one to the right phase_b > 0
        assert along == 0 or np.sign(value[0]) == np.sign(along)
        assert cross == 0 or np.sign(value[1]) == np.sign(cross)


def test_axes_are_rows_of_it():
    target, platforms = place(100e3, 200e3), satellites(PASS / 2)
    both = phase().predict(target, platforms)
    np.testing.assert_array_equal(phase(axes=["a"]).predict(target, platforms), both[:1])
    np.testing.assert_array_equal(phase(axes=["b", "a"]).predict(target, platforms), both[::-1])
    other = phase(platform=2).predict(target, platforms)
    np.testing.assert_allclose(other, phase().predict(target, platforms[[2, 1, 0]]), rtol=1e-12)
    assert np.all(np.abs(other - both) > 1.0)


def test_wrap():
    angles = np.linspace(-40, 40, 4001)
    wrapped = wrap(angles)
    assert wrapped.min() >= -np.pi and wrapped.max() < np.pi
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angles), atol=1e-13)
    assert wrap(np.pi) == -np.pi and wrap(-np.pi) == -np.pi and wrap(0.0) == 0.0
    assert np.isnan(wrap(np.nan))


def test_residual_of_a_wrapped_phase_is_the_short_way_round():
    wrapped, plain = phase(wrapped=True), phase()
    a, b = np.array([3.1, -3.1]), np.array([-3.1, 3.1])
    np.testing.assert_allclose(wrapped.residual(a, b), [6.2 - 2 * np.pi, 2 * np.pi - 6.2])
    np.testing.assert_allclose(plain.residual(a, b), [6.2, -6.2])


def test_angle_that_a_phase_means():
    """Eq. (4): there and back, and nothing for a phase that no direction has."""
    beta = np.radians(np.linspace(0.0, 180.0, 37))
    values = 2 * np.pi * CYCLES * np.cos(beta)
    # near end-fire the cosine is flat: 1e-16 of it is 1e-8 of an angle
    np.testing.assert_allclose(phase_angle(values, 3.0, WAVELENGTH), beta, atol=1e-7)
    impossible = phase_angle(2 * np.pi * CYCLES * np.array([1.001, -1.001, np.nan]), 3.0, WAVELENGTH)
    assert np.isnan(impossible).all()


@pytest.mark.parametrize("beta", np.radians([20.0, 60.0, 90.0]))
def test_error_of_the_angle_depends_on_the_direction(beta):
    """sigma_phi / (2 pi n sin beta): why the phase, whose error is the same everywhere, is the measurement."""
    sigma = np.radians(15.0)
    noise = sigma * np.random.default_rng(1).normal(size=20000)
    angle = phase_angle(2 * np.pi * CYCLES * np.cos(beta) + noise, 3.0, WAVELENGTH)
    np.testing.assert_allclose(angle.std(), sigma / (2 * np.pi * CYCLES * np.sin(beta)), rtol=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": 0.0}, "sigma_phase"),
        ({"sigma": np.nan}, "sigma_phase"),
        ({"baseline": -3.0}, "baseline"),
        ({"wavelength": 0.0}, "wavelength"),
        ({"axes": []}, "phase axes"),
        ({"axes": ["c"]}, "phase axes"),
    ],
)
def test_bad_arguments(change, message):
    with pytest.raises(ValueError, match=message):
        InterferometerPhase(**({"sigma": 0.2, "baseline": 3.0, "wavelength": 0.1} | change))


@pytest.mark.parametrize(("baseline", "wavelength"), [(0.0, 0.1), (3.0, -0.1), (np.inf, 0.1)])
def test_bad_angle(baseline, wavelength):
    with pytest.raises(ValueError, match=r"baseline|wavelength"):
        phase_angle(1.0, baseline, wavelength)
