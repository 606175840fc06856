"""Gravity against the derivative of its own potential and against SGP4."""

import numpy as np
import pytest

from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories import gravity
from quietfix.systems.trajectories.gravity import GravityConstants

EARTH = GravityConstants()
RNG = np.random.default_rng(5)


def positions():
    p = RNG.normal(size=(4, 25, 3))
    return p * RNG.uniform(6.5e6, 3e7, (4, 25, 1)) / np.linalg.norm(p, axis=-1, keepdims=True)


def central(function, p, step):
    columns = [(function(p + step * axis) - function(p - step * axis)) / (2 * step) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("j2", [True, False])
def test_acceleration_is_the_gradient_of_the_potential(j2):
    p = positions()

    def potential(q):
        return -gravity.energy(np.concatenate([q, 0 * q], axis=-1), EARTH, j2)

    a = gravity.acceleration(p, EARTH, j2)
    # step 100 m: truncation (step/r)^2 = 2e-10, rounding 1e-16 r/step = 3e-11 relative
    error = np.abs(a - central(potential, p, 100.0)) / np.linalg.norm(a, axis=-1, keepdims=True)
    assert error.max() < 1e-9


@pytest.mark.parametrize("j2", [True, False])
def test_gradient_is_the_derivative_of_the_acceleration(j2):
    p = positions()
    g = gravity.gradient(p, EARTH, j2)
    error = np.abs(g - central(lambda q: gravity.acceleration(q, EARTH, j2), p, 100.0))
    scale = np.linalg.norm(g, axis=(-2, -1))
    assert (error.max(axis=(-2, -1)) / scale).max() < 1e-8  # truncation of the differences: 20 (step/r)^2 = 5e-9
    np.testing.assert_allclose(g, np.swapaxes(g, -1, -2), atol=1e-20)
    # Laplace: no mass outside the Earth; cancels to rounding of the 2e-6 1/s^2 that are summed
    assert np.abs(np.trace(g, axis1=-2, axis2=-1) / scale).max() < 1e-14


def test_j2_is_as_large_as_it_should_be():
    # at the equator J2 adds 1.5 J2 of the pull, at the pole it takes 3 J2 away (r = R)
    r = EARTH.radius
    one = EARTH.mu / r**2
    a = gravity.acceleration([[r, 0, 0], [0, 0, r]], EARTH)
    np.testing.assert_allclose(a[0], [-one * (1 + 1.5 * EARTH.j2), 0, 0], rtol=1e-15)
    np.testing.assert_allclose(a[1], [0, 0, -one * (1 - 3 * EARTH.j2)], rtol=1e-15)


# SGP4's published verification vectors (Vallado, Crawford, Hujsak, Kelso: Revisiting Spacetrack Report #3,
# AIAA 2006-6753, output file tcppver.out): km and km/s at 0 and at 120 minutes after epoch.
PUBLISHED = {
    "28057": (  # 780 km, sun-synchronous, no drag to speak of
        [-2715.28237486, -6619.26436889, -0.01341443, -1.008587273, 0.422782003, 7.385272942],
        [-1816.87920942, -1835.78762132, 6661.07926465, 2.325140071, 6.655669329, 2.463394512],
    ),
    "06251": (  # 380 km, with drag
        [3988.31022699, 5498.96657235, 0.90055879, -3.290032738, 2.357652820, 6.496623475],
        [-3935.69800083, 409.10980837, 5471.33577327, -3.374784183, -6.635211043, -1.942056221],
    ),
}
TWO_LINES = {
    "28057": (
        "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836",
        "2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550",
    ),
    "06251": (
        "1 06251U 62025E   06176.82412014  .00008885  00000-0  12808-3 0  3985",
        "2 06251  58.0579  54.0425 0030035 139.1568 221.1854 15.56387291  6774",
    ),
}
WGS72 = GravityConstants(mu=3.986008e14, radius=6378135.0, j2=1.082616e-3)  # what SGP4 uses


@pytest.mark.parametrize("number", PUBLISHED)
def test_published_sgp4_vectors(number):
    """Start from SGP4's state at epoch, compare 120 minutes (1.2 and 1.3 revolutions) later."""
    start, end = (np.array(x) * 1e3 for x in PUBLISHED[number])
    miss = {
        j2: np.linalg.norm((DenseOrbit(start[None], 7200.0, WGS72, j2).at(7200.0)[0] - end)[:3]) for j2 in (True, False)
    }
    # SGP4 is first order in J2: it leaves out J2^2 = 1.2e-6 of 56 000 km flown, 70 m, times a few, and
    # 06251 has drag. Measured: 72 and 279 m; without J2 31.9 and 65.3 km.
    assert miss[True] < 500
    assert miss[False] > 20e3


@pytest.mark.parametrize("number", PUBLISHED)
def test_sgp4_over_one_revolution(number):
    api = pytest.importorskip("sgp4.api")
    satellite = api.Satrec.twoline2rv(*TWO_LINES[number], api.WGS72)
    period = 2 * np.pi / satellite.no_kozai * 60
    times = np.linspace(0, period, 60)
    _, r, v = satellite.sgp4_array(np.full(60, satellite.jdsatepoch), satellite.jdsatepochF + times / 86400)
    truth = np.concatenate([r, v], axis=-1) * 1e3
    for j2, least, most in ((True, 0.0, 500.0), (False, 20e3, 100e3)):
        orbit = DenseOrbit(truth[:1], period, WGS72, j2)
        miss = np.linalg.norm((orbit.at(times)[:, 0] - truth)[:, :3], axis=-1).max()
        assert least <= miss < most  # measured 157 and 213 m; without J2 32.1 and 62.5 km


@pytest.mark.parametrize(
    ("field", "value"), [("mu", 0.0), ("mu", np.nan), ("radius", -1.0), ("j2", -1e-3), ("earth_rate", np.inf)]
)
def test_bad_constants(field, value):
    with pytest.raises(ValueError, match=field):
        GravityConstants(**{field: value})


def test_above_surface():
    p = [[6378137.1, 0, 0], [6378136.9, 0, 0], [0, 0, 6356752.4], [0, 0, 6356752.2], [np.nan, 0, 7e6]]
    np.testing.assert_array_equal(gravity.above_surface(p, EARTH), [True, False, True, False, False])
