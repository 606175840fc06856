"""Light time against solutions by brute force that share no formula with the code."""

import numpy as np
import pytest

from quietfix.systems.constants import EARTH_RATE, SPEED_OF_LIGHT
from quietfix.systems.geometry.light_time import arrival, in_orbit
from quietfix.systems.trajectories.gravity import GravityConstants
from tests.laws.cases import CARRIER, EARTH_FIXED, PASS, fdoa, place, satellites, tdoa

C = np.longdouble(SPEED_OF_LIGHT)
MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.0826261e-3


def inertial(state):
    """Earth-fixed state -> inertial state, axes together now, in extended precision."""
    state = np.asarray(state, dtype=np.longdouble)
    spin = np.array([-EARTH_RATE * state[..., 1], EARTH_RATE * state[..., 0], 0 * state[..., 2]], dtype=np.longdouble)
    return np.concatenate([state[..., :3], state[..., 3:6] + np.moveaxis(spin, 0, -1)], axis=-1)


def fall(position):
    """Pull of the Earth with J2, written out in components."""
    x, y, z = position
    r = norm(position)
    level = 1.5 * J2 * (RADIUS / r) ** 2
    equatorial = -MU / r**3 * (1 + level * (1 - 5 * (z / r) ** 2))
    return np.array([equatorial * x, equatorial * y, -MU / r**3 * (1 + level * (3 - 5 * (z / r) ** 2)) * z])


def orbiting(state, time):
    """Path of a satellite: one Runge-Kutta step of two bodies and J2, good to 1e-15 m over milliseconds."""
    p, v = state[:3], state[3:]
    k1 = fall(p)
    k2 = fall(p + time / 2 * v)
    k3 = fall(p + time / 2 * v + time**2 / 4 * k1)
    return p + time * v + time**2 / 6 * (k1 + k2 + k3)


def turned_with_the_earth(state, time):
    """Inertial path of what moves straight in Earth-fixed axes."""
    fixed = state[3:] - np.array([-EARTH_RATE * state[1], EARTH_RATE * state[0], 0.0])
    p, angle = state[:3] + fixed * time, EARTH_RATE * time
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]])


CARRIER_PATHS = {"satellites": orbiting, "stations": turned_with_the_earth}


def norm(v):
    return np.sqrt((v * v).sum())


def emission(emitter, receiver, path, carrier_path):
    """Iterate: when did the front leave that reaches the receiver at time 0?"""
    at = np.longdouble(0)
    for _ in range(40):
        at = -norm(carrier_path(receiver, np.longdouble(0)) - path(emitter, at)) / C
    return at


def reception(emitter, receiver, at, path, carrier_path):
    """Iterate: when does the front that left at `at` reach the receiver?"""
    when = np.longdouble(0)
    for _ in range(40):
        when = at + norm(carrier_path(receiver, when) - path(emitter, at)) / C
    return when


def brute_force(target, platforms, reference, carrier_path, path=turned_with_the_earth):
    """Return delays against the reference and frequency ratios minus 1, one receiver at a time."""
    emitter, carriers = inertial(target), inertial(platforms)
    at = emission(emitter, carriers[reference], path, carrier_path)
    step = np.longdouble(1e-3)
    delays, ratios = [], []
    for carrier in carriers:
        delays.append(reception(emitter, carrier, at, path, carrier_path))
        # received over emitted frequency = emission interval over reception interval
        late = reception(emitter, carrier, at + step, path, carrier_path)
        early = reception(emitter, carrier, at - step, path, carrier_path)
        ratios.append(2 * step / (late - early) - 1)
    return np.array(delays, dtype=float), np.array(ratios, dtype=float)


@pytest.mark.parametrize("geometry", EARTH_FIXED)
@pytest.mark.parametrize("reference", [0, 1])
def test_one_wave_front(geometry, reference):
    scene = EARTH_FIXED[geometry]
    wave = arrival(scene.targets, scene.platforms, reference)
    for i, target in enumerate(scene.targets):
        delay, ratio = brute_force(target, scene.platforms[0], reference, CARRIER_PATHS[geometry])
        # Doubles resolve 1 000 km / c to 4e-19 s; a few operations. The ratio is differenced over 2 ms, where the
        # curvature of the range (100 m/s^2) adds its third derivative only.
        np.testing.assert_allclose(wave.delay[i], delay, rtol=0, atol=3e-18)
        np.testing.assert_allclose(wave.frequency_ratio[i], ratio, rtol=0, atol=2e-15)


@pytest.mark.parametrize("formation", ["tri", "line"])
def test_frequencies_of_one_wave_front_along_the_orbit(formation):
    """All over the visible ground, over a pass: 5e-5 Hz at 3 GHz, where gravity between the arrivals is 0.02 Hz."""
    for time, where in ((0.0, (-300e3, 700e3)), (60.0, (150e3, -500e3)), (140.0, (900e3, 400e3))):
        platforms, target = satellites(time, formation), place(*where, 10e3, 60.0, 3000.0)
        exact = brute_force(target, platforms, 0, orbiting)[1]
        shift = fdoa(light_time=True).predict(target, platforms[None])
        assert np.abs(shift - CARRIER * (exact[1:] - exact[0])).max() < 5e-5


@pytest.mark.parametrize(
    ("state", "falls"),
    [
        ([7078e3, 0, 0, 0, 7504.0, 0], True),
        ([42164e3, 0, 0, 0, 3074.7, 0], True),
        ([46e6, 0, 0, 0, 1.5e3, 0], True),  # the apogee of a Molniya orbit
        ([7078e3, 0, 0, 0, 12e3, 0], True),  # a hyperbola
        ([6378e3, 0, 0, 0, 465.1, 0], False),  # a station
        ([6388e3, 0, 0, 0, 700.0, 0], False),  # an aircraft
        ([6500e3, 0, 0, 2e3, 5e3, 0], False),  # a rocket before it reaches orbit
        ([7078e3, 0, 0, 0, 0, 0], False),
        ([0, 0, 0, 0, 0, 0], False),
    ],
)
def test_what_is_in_orbit(state, falls):
    state = np.array(state, dtype=float)
    assert bool(in_orbit(state[:3], state[3:], GravityConstants())) is falls


def test_size_of_the_effect():
    """Some 5 ns and 0.1 Hz at baselines of 80 km in low orbit, over the visible ground.

    An independent prototype had 4.7 ns and 0.05 Hz. The FDOA is nearly all because one *wave front* is compared, as
    a cross-ambiguity function does: the other receiver hears it up to 0.27 ms after the reference, and range rates
    change by 70 m/s^2. Heard at the same instant, the frequencies differ by less than a millihertz from geometry.
    """
    rng = np.random.default_rng(5)
    targets = place(*rng.uniform(-1500e3, 1500e3, (2, 3000)), 10e3, rng.uniform(0, 360, 3000))
    for formation in ("tri", "line"):
        platforms = satellites(PASS / 2, formation)[None]
        offset = platforms[..., :3] - targets[:, None, :3]
        up = targets[:, None, :3] / np.linalg.norm(targets[:, None, :3], axis=-1, keepdims=True)
        seen = ((offset * up).sum(axis=-1) > np.sin(np.radians(3)) * np.linalg.norm(offset, axis=-1)).all(axis=-1)
        delay = tdoa(light_time=True).predict(targets, platforms) - tdoa().predict(targets, platforms)
        shift = fdoa(light_time=True).predict(targets, platforms) - fdoa().predict(targets, platforms)
        assert 3.5e-9 < np.abs(delay[seen]).max() < 5.5e-9
        assert 0.05 < np.abs(shift[seen]).max() < 0.12


def test_without_earth_rotation_and_motion_it_is_geometry():
    """Nothing moves, nothing turns: one wave front is the geometry of one instant."""
    still = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    scene = EARTH_FIXED["satellites"]
    targets, platforms = scene.targets * still, scene.platforms * still
    exact = tdoa().predict(targets, platforms)
    np.testing.assert_allclose(
        tdoa(light_time=True, earth_rate=0.0).predict(targets, platforms), exact, rtol=0, atol=3e-18
    )
    assert not fdoa(light_time=True, earth_rate=0.0).predict(targets, platforms).any()
