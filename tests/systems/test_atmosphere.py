"""Delays of the air and the ionosphere: published values, integrals along the ray, derivatives."""

import numpy as np
import pytest
from scipy.integrate import quad

from quietfix.systems.atmosphere.columns import EARTH_RADIUS
from quietfix.systems.atmosphere.delayed import Delayed, excess
from quietfix.systems.atmosphere.ionosphere import ThinShell
from quietfix.systems.atmosphere.troposphere import (
    Troposphere,
    saastamoinen_hydrostatic,
    saastamoinen_wet,
    vapour_pressure,
)
from quietfix.systems.earth.geodetic import enu_rotation, geodetic_state, geodetic_to_ecef, vertical
from quietfix.systems.measurement.distance import Range

AIR, L1 = Troposphere(), 1575.42e6
SHELL = ThinShell(20.0, 350e3, L1)


def column(medium, height, elevation_deg):
    return float(medium.column(np.array([height]), np.sin(np.radians([elevation_deg]))).value[0])


def refractivity(height):
    return sum(zenith / scale * np.exp(-height / scale) for zenith, scale in AIR.layers)


def along(radius, sine, length):
    """The integral of the refractivity along a straight line from a radius."""
    places = [x for x in (1e3, 1e4, 1e5, 3e5) if x < length]
    return quad(
        lambda s: refractivity(np.sqrt(radius**2 + s**2 + 2 * radius * s * sine) - EARTH_RADIUS),
        0,
        length,
        points=places,
        limit=400,
    )[0]


def seen(place, azimuth_deg, elevation_deg, distance):
    """A place in that direction from a geodetic place (degrees, degrees, m)."""
    b, l, h = np.radians(place[0]), np.radians(place[1]), place[2]  # noqa: E741
    a, e = np.radians([azimuth_deg, elevation_deg])
    local = distance * np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])
    return geodetic_to_ecef(b, l, h) + local @ enu_rotation(b, l)


def still(position):
    return np.concatenate([position, np.zeros(3)])


def test_zenith_delays_at_sea_level():
    """Davis et al. 1985: 2.307 m of dry air at 1013.25 hPa; Saastamoinen 1972: 1 cm of vapour per 1 hPa at 15 deg C."""
    assert saastamoinen_hydrostatic(1013.25) == pytest.approx(2.307, abs=5e-4)
    assert vapour_pressure(288.15, 1.0) == pytest.approx(17.04, rel=2e-3)  # steam tables
    assert saastamoinen_wet(288.15, 10.0) == pytest.approx(0.1003, abs=1e-4)
    assert column(Troposphere(humidity=0.0), 0.0, 90.0) == pytest.approx(2.307, abs=5e-4)
    assert column(AIR, 0.0, 90.0) == pytest.approx(2.392, abs=1e-3)


@pytest.mark.parametrize(
    ("height", "pressure"), [(0, 1013.25), (1e3, 898.76), (5e3, 540.48), (10e3, 265.0), (20e3, 55.29), (40e3, 2.871)]
)
def test_dry_air_falls_as_the_standard_atmosphere(height, pressure):
    """U.S. Standard Atmosphere 1976, table I; the two exponentials are within 0.9 % of the pressure at sea level."""
    zenith = column(Troposphere(humidity=0.0), height, 90.0)
    assert zenith == pytest.approx(saastamoinen_hydrostatic(pressure), abs=0.009 * 2.307)


@pytest.mark.parametrize(("elevation", "within"), [(30, 5e-4), (15, 1.5e-3), (10, 3e-3), (5, 8e-3), (3, 1.5e-2)])
def test_mapping_against_niells(elevation, within):
    """His hydrostatic function at 45 degrees, of the year's mean; ours is of a straight ray, hence longer below."""
    a, b, c = 1.2465397e-3, 2.9288445e-3, 63.721774e-3  # his table 3
    s = np.sin(np.radians(elevation))
    niell = (1 + a / (1 + b / (1 + c))) / (s + a / (s + b / (s + c)))
    if elevation == 5:
        assert niell == pytest.approx(10.13, abs=0.01)
    dry = Troposphere(humidity=0.0)
    ours = column(dry, 0.0, elevation) / column(dry, 0.0, 90)
    assert niell < ours < niell * (1 + within)


@pytest.mark.parametrize("elevation", [90, 30, 10, 5, 1, 0])
@pytest.mark.parametrize("height", [0.0, 3e3, 12e3])
def test_columns_are_integrals_along_the_ray(height, elevation):
    """The approximation for thin layers is of the order of scale height over radius, 1e-3."""
    exact = along(EARTH_RADIUS + height, np.sin(np.radians(elevation)), 2e6)
    assert column(AIR, height, elevation) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize(
    ("below", "elevation", "distance"),
    [
        (100.0, 0.5, 30e3),
        (100.0, 30.0, 5e3),
        (300.0, 2.0, 150e3),
        (8e3, -0.5, 80e3),
        (50.0, -0.1, 60e3),
        (0.0, 10.0, 2.5e6),
    ],
)
def test_between_two_places_it_is_the_integral_along_the_chord(below, elevation, distance):
    """On the ellipsoid: heights at 200 points of the chord; curvature of sphere and ellipsoid differ by 0.5 %."""
    place = (48.0, 11.0, below)
    target, platform = still(seen(place, 60.0, elevation, 0.0)), still(seen(place, 60.0, elevation, distance))
    nodes, weights = np.polynomial.legendre.leggauss(400)
    share = (nodes + 1) / 2
    points = target[:3] + share[:, None] * (platform[:3] - target[:3])
    exact = distance / 2 * float(weights @ refractivity(vertical(points)[1]))
    there = excess([AIR], target, platform[None]).path[0]
    back = excess([AIR], platform, target[None]).path[0]
    assert there == pytest.approx(exact, rel=5e-3)
    assert back == pytest.approx(there, rel=1e-12)


def test_the_ionosphere_at_l1():
    """0.162 m per TECU at L1 (IS-GPS-200; Hofmann-Wellenhof and others), obliquity about 3 at 5 degrees."""
    assert column(SHELL, 0.0, 90.0) == pytest.approx(3.25, abs=5e-3)
    assert column(ThinShell(1.0, 350e3, L1), 0.0, 90.0) == pytest.approx(0.162, abs=5e-4)
    crossing = np.arcsin(EARTH_RADIUS * np.cos(np.radians(5)) / (EARTH_RADIUS + 350e3))
    assert column(SHELL, 0.0, 5.0) == pytest.approx(column(SHELL, 0.0, 90.0) / np.cos(crossing), rel=1e-12)


def test_only_rays_that_cross_are_delayed():
    ground, jet = still(seen((48.0, 11.0, 200.0), 0, 0, 0)), still(seen((48.0, 11.0, 200.0), 30, 4, 120e3))
    low, high = still(seen((48.0, 11.0, 200.0), 80, 30, 1.2e6)), still(seen((48.0, 11.0, 200.0), 70, 40, 2e6))
    assert excess([SHELL], ground, jet[None]).path[0] == 0
    assert excess([SHELL], low, high[None]).path[0] == 0
    assert abs(excess([AIR], low, high[None]).path[0]) < 1e-9  # of the air above 600 km
    assert excess([SHELL], ground, low[None]).path[0] > 3.25
    once = excess([SHELL], ground, low[None]).path[0]
    assert excess([SHELL], low, ground[None]).path[0] == once
    # from orbit to orbit past the Earth's limb, 200 km above the ground: through the shell twice, and no air
    limb = geodetic_state(0, np.radians([-22.0, 22.0]), 720e3, 0, 0)
    perigee = (EARTH_RADIUS + 720e3) * np.cos(np.radians(22.0)) - EARTH_RADIUS
    assert 1e5 < perigee < 3e5
    crossing = (EARTH_RADIUS + perigee) / (EARTH_RADIUS + 350e3)
    twice = 2 * SHELL.zenith / np.sqrt(1 - crossing**2)
    assert excess([SHELL], limb[0], limb[1:]).path[0] == pytest.approx(twice, rel=1e-9)
    assert excess([AIR], limb[0], limb[1:]).path[0] == pytest.approx(0.0, abs=1e-6)


def test_phases_are_advanced_by_what_groups_are_delayed():
    ground, satellite = still(seen((48, 11, 200.0), 0, 0, 0)), still(seen((48, 11, 200.0), 80, 30, 1.2e6))
    satellite[3:] = [5e3, 4e3, -3e3]
    group, phase = (excess([SHELL], ground, satellite[None], phase) for phase in (False, True))
    assert phase.path[0] == -group.path[0] and phase.rate[0] == -group.rate[0] != 0
    group, phase = (excess([AIR], ground, satellite[None], phase) for phase in (False, True))
    assert phase.path[0] == group.path[0] > 0


CASES = {
    "ground to ground": ((48, 11, 100.0), (48.5, 11.7, 600.0)),
    "aircraft over a station": ((48, 11, 10e3), (48.5, 12.7, 300.0)),
    "satellite low over the ground": ((48, 11, 300.0), (58, 31, 700e3)),
    "satellite as target": ((50, 15, 700e3), (48, 11, 300.0)),
    "past the limb": ((0, 0, 700e3), (5, 50, 800e3)),
    "aircraft far apart": ((0, 0, 12e3), (0, 6, 11e3)),
    "near the pole": ((90, 0, 100.0), (88, 70, 9e3)),
}


@pytest.mark.parametrize("medium", [AIR, ThinShell(20.0, 350e3, 1e9)], ids=["air", "shell"])
@pytest.mark.parametrize("case", CASES)
def test_gradients_and_rates_are_those_of_differences(case, medium):
    """Five points 30 m or 0.05 s apart: the fourth power of the step over a scale height is below 1e-7."""
    rng = np.random.default_rng(5)
    target, platform = (
        np.concatenate([geodetic_to_ecef(np.radians(b), np.radians(l), h), rng.normal(size=3) * 300])
        for b, l, h in CASES[case]  # noqa: E741
    )
    found = excess([medium], target, platform[None])
    if found.path[0] == 0:
        assert not any(np.any(part) for part in (found.rate, found.gradient, found.rate_gradient))
        return

    def slope(function, moves):
        return np.stack(
            [(8 * (function(m) - function(-m)) - (function(2 * m) - function(-2 * m))) / 12 for m in moves], axis=-1
        )

    steps = 30.0 * np.eye(6)[:3]
    gradient = slope(lambda m: excess([medium], target + m, platform[None]).path[0], steps) / 30
    rate_gradient = slope(lambda m: excess([medium], target + m, platform[None]).rate[0], steps) / 30
    by_velocity = slope(lambda m: excess([medium], target + m, platform[None]).rate[0], 10 * np.eye(6)[3:]) / 10

    def later(dt):
        moved = [np.concatenate([x[:3] + dt * x[3:], x[3:]]) for x in (target, platform)]
        return excess([medium], moved[0], moved[1][None]).path[0]

    rate = slope(later, [0.05])[0] / 0.05
    for ours, numeric in (
        (found.gradient[0], gradient),
        (found.rate_gradient[0], rate_gradient),
        (found.gradient[0], by_velocity),
        (found.rate, rate),
    ):
        assert np.abs(ours - numeric).max() <= 1e-6 * np.abs(numeric).max()


def test_a_target_anywhere_has_a_number():
    """Particles and diverged trials: at the centre of the Earth's other side, below the ground, far out."""
    rng = np.random.default_rng(6)
    targets = np.concatenate([rng.normal(size=(400, 3)) * 10.0 ** rng.uniform(2, 9, (400, 1)), np.zeros((400, 3))], 1)
    platforms = np.stack([geodetic_state(0.8, 0.2, h, 0, 0) for h in (300.0, 7e5, 3.6e7)])
    with np.errstate(all="raise"):
        found = excess([AIR, SHELL], targets, platforms)
    for part in (found.path, found.rate, found.gradient, found.rate_gradient):
        assert np.isfinite(part).all()


def test_the_rows_must_fit():
    with pytest.raises(ValueError, match="receivers"):
        Delayed(Range(5.0, [0, 1]), [AIR], [0])
    with pytest.raises(ValueError, match="media"):
        Delayed(Range(5.0, [0, 1]), [], [0, 1])
