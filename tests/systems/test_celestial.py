"""Precession, nutation and sidereal time against printed values; interpolation by positions and velocities."""

import numpy as np
import pytest

from quietfix.systems.earth.celestial import equinox_to_earth_fixed
from quietfix.systems.earth.time_scales import LEAP_SECONDS, posix_of, posix_to_tai, to_tai
from quietfix.systems.plants.ephemeris import hermite_states, spline_samples
from quietfix.systems.plants.recorded import hermite


def test_sidereal_time():
    """Meeus, Astronomical Algorithms, examples 12.a and 12.b: 197.693195 and 128.737873 deg on 1987 April 10."""
    for day, seconds, degrees in ((545011200, 0, 197.693195), (545011200, 69660, 128.7378734)):
        x = np.array([[1.0, 0, 0, 0, 0, 0]])
        found = equinox_to_earth_fixed(x, day + seconds, 0.0)[0]
        # printed to 1e-6 deg and 1e-7 deg
        assert abs(np.degrees(np.arctan2(-found[1], found[0])) % 360 - degrees) < 1e-6


def test_nutation_and_obliquity():
    """Meeus, example 22.a: on 1987 April 10.0 TD -3.788 and 9.443 arcseconds, true obliquity 23 deg 26' 36.850"."""
    from quietfix.systems.earth.celestial import (  # the printed values are of parts, not of the whole
        _nutation,
        _precession,
    )

    t = np.array([-0.127296372348])
    matrix, equinoxes = _nutation(t)
    arcsecond = np.radians(1 / 3600)
    obliquity = np.radians(23 + 26 / 60 + 36.850 / 3600)
    # the pole of date in mean axes: the first column's z is the nutation in longitude times sin of the obliquity
    longitude = np.arcsin(matrix[0, 2, 0] / np.sin(obliquity)) / arcsecond
    assert abs(longitude - -3.788) < 0.01  # terms that are left out: 0.02 arcseconds at most
    assert abs(equinoxes[0] / arcsecond - -3.788 * np.cos(obliquity)) < 0.01
    np.testing.assert_allclose(matrix[0] @ matrix[0].T, np.eye(3), atol=1e-15)
    # Explanatory Supplement, 3.211: 50.29 arcseconds a year along the ecliptic
    moved = _precession(np.array([0.01]))[0] @ np.array([1.0, 0.0, 0.0])
    assert abs(np.arcsin(abs(moved[1])) / arcsecond - 46.12) < 0.02


def orbit(t):
    n, r = 1.08e-3, 7e6
    c, s, o = np.cos(n * t), np.sin(n * t), np.zeros_like(t)
    return np.stack([r * c, r * s, o, -r * n * s, r * n * c, o], axis=-1)


def test_polynomials_by_positions_and_velocities():
    times = np.array([0.0, 1.0, 2.5, 4.0])
    rng = np.random.default_rng(3)
    factors = rng.normal(size=(8, 3))
    at = np.array([0.0, 0.3, 2.5, 3.9])

    def exact(t):
        powers = np.arange(8)
        value = t[:, None] ** powers @ factors
        slope = (powers[1:] * t[:, None] ** (powers[1:] - 1)) @ factors[1:]
        return np.concatenate([value, slope], axis=-1)

    # order 7 through four nodes is exact; 8 terms of 4^7 lose 5 digits
    np.testing.assert_allclose(hermite_states(times, exact(times), at), exact(at), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("step", "count"), [(60.0, 40), (60.0, 5), (240.0, 20), (240.0, 6), (150.0, 4)])
def test_samples_between_samples(step, count):
    times = step * np.arange(count)
    more, states = spline_samples(times, orbit(times))
    found = np.array([hermite(more, states, t)[0] for t in np.linspace(0, times[-1], 301)])
    off = np.linalg.norm((found - orbit(np.linspace(0, times[-1], 301)))[:, :3], axis=-1)
    assert off.max() < 0.55  # 0.5 m, and how far the polynomial of the lower order was off


def test_steps_that_are_too_long_are_gaps():
    for times in (np.arange(0.0, 9000.0, 900.0)[:8], np.array([0.0, 60.0])):
        _, states = spline_samples(times, orbit(times))
        assert np.isnan(states[:, 0]).sum() == times.size - 1
    with pytest.raises(ValueError, match="1 sample is not allowed"):
        spline_samples(np.zeros(1), orbit(np.zeros(1)))


def test_velocities_of_another_model_give_way():
    times = 60.0 * np.arange(30)
    states = orbit(times)
    other = states + np.array([0, 0, 0, 0.5, 0, 0])
    np.testing.assert_allclose(spline_samples(times, other)[1][12, 3:], states[12, 3:], atol=1e-4)
    rounded = states + np.array([0, 0, 0, 0.005, 0, 0])
    np.testing.assert_array_equal(spline_samples(times, rounded)[1][12], rounded[12])
    with pytest.raises(ValueError, match=r"the velocity at sample \d+ is .* m/s off"):
        spline_samples(times, states * np.array([1, 1, 1, 1.01, 1.01, 1.01]))


def test_leap_seconds():
    assert len(LEAP_SECONDS) == 27  # since 1972, with the 10 s of that year 37
    for day, ahead in (
        ("1972-01-01", 10),
        ("1980-01-06", 19),
        ("1999-01-01", 32),
        ("2016-12-31", 36),
        ("2017-01-01", 37),
    ):
        second, _ = to_tai(f"{day}T00:00:00")
        assert second - posix_of(second) == ahead and posix_to_tai(posix_of(second)) == second
    with pytest.raises(ValueError, match="before 1972"):
        posix_to_tai(0)
