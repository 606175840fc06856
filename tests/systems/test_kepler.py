"""Kepler orbits: what a conic conserves, and numerical integration."""

import numpy as np
import pytest

from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories.gravity import GravityConstants, energy
from quietfix.systems.trajectories.kepler import (
    KeplerElements,
    eccentric_anomaly,
    mean_anomaly,
    mean_motion,
    state_of,
)

MU = GravityConstants().mu
RNG = np.random.default_rng(11)


def some_elements(shape=(6, 50)):
    return KeplerElements(
        RNG.uniform(6.6e6, 4.2e7, shape),
        RNG.uniform(0.001, 0.95, shape),
        RNG.uniform(0.01, 3.13, shape),
        *RNG.uniform(0, 2 * np.pi, (3, *shape)),
    )


def test_keplers_equation_up_to_the_hardest_corner():
    m = np.linspace(-20, 20, 4001)[:, None]
    e = np.array([0.0, 1e-8, 0.1, 0.7, 0.99, 0.999999])
    anomaly = eccentric_anomaly(m, e)
    np.testing.assert_allclose(anomaly - e * np.sin(anomaly), np.broadcast_to(m, anomaly.shape), atol=2e-14)
    # close to perigee of a very long ellipse the equation is nearly cubic
    m = np.logspace(-12, -1, 200)
    anomaly = eccentric_anomaly(m, 0.9999)
    np.testing.assert_allclose(anomaly - 0.9999 * np.sin(anomaly), m, atol=1e-15)


def test_one_anomaly_does_not_depend_on_its_neighbours():
    m, e = RNG.uniform(-3, 3, 200), RNG.uniform(0, 0.999, 200)
    together = eccentric_anomaly(m, e)
    alone = np.array([eccentric_anomaly(a, b) for a, b in zip(m, e, strict=True)])
    np.testing.assert_array_equal(together, alone)


def test_energy_momentum_node_and_perigee():
    elements = some_elements()
    a, e, i, node, perigee, _ = elements.arrays()
    x = state_of(elements, MU)
    np.testing.assert_allclose(energy(x, GravityConstants(), j2=False), -MU / (2 * a), rtol=1e-12)
    h = np.cross(x[..., :3], x[..., 3:])
    length = np.sqrt(MU * a * (1 - e**2))
    want = np.stack([np.sin(i) * np.sin(node), -np.sin(i) * np.cos(node), np.cos(i)], axis=-1)
    np.testing.assert_allclose(h / length[..., None], want, atol=1e-13)
    to_perigee = np.cross(x[..., 3:], h) / MU - x[..., :3] / np.linalg.norm(x[..., :3], axis=-1, keepdims=True)
    c, s = np.cos(perigee), np.sin(perigee)
    across = np.stack([-np.sin(node) * np.cos(i), np.cos(node) * np.cos(i), np.sin(i)], axis=-1)
    along = np.stack([np.cos(node), np.sin(node), np.zeros_like(node)], axis=-1)
    # the two terms are about 1 / (1 - e) at perigee, 20 at most
    np.testing.assert_allclose(to_perigee, e[..., None] * (c[..., None] * along + s[..., None] * across), atol=1e-13)


def test_the_mean_anomaly_of_a_true_one():
    """The angle from perigee to the satellite, in the plane of its orbit, is the true anomaly."""
    e, true = np.meshgrid([0.0, 0.1, 0.6, 0.95], np.radians([-170, -90, -1e-3, 0, 60, 179]))
    x = state_of(KeplerElements(9e6, e, 0.0, 0.0, 0.0, mean_anomaly(true, e)), MU)
    np.testing.assert_allclose(np.arctan2(x[..., 1], x[..., 0]), true, atol=1e-13)
    assert mean_anomaly(1.234, 0.0) == 1.234
    # whole revolutions stay
    np.testing.assert_allclose(mean_anomaly(true + 4 * np.pi, e), mean_anomaly(true, e) + 4 * np.pi, atol=1e-13)


def test_the_anomaly_advances_as_an_integrator_says():
    dt = 4000.0
    start = KeplerElements(9e6, [0.0, 0.25], 1.0, 0.2, 0.3, 0.4)
    later = KeplerElements(9e6, [0.0, 0.25], 1.0, 0.2, 0.3, 0.4 + mean_motion(9e6, MU) * dt)
    orbit = DenseOrbit(state_of(start, MU), dt, GravityConstants(), j2=False)
    # DOP853 at rtol 1e-12 over half a revolution: measured 2e-5 m
    np.testing.assert_allclose(orbit.at(dt)[:, :3], state_of(later, MU)[:, :3], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"eccentricity": 1.0}, "eccentricity: 1.0 is not allowed"),
        ({"eccentricity": [0.1, -0.1]}, "eccentricity: -0.1 is not allowed"),
        ({"semi_major_axis": 0.0}, "semi_major_axis: 0.0 is not allowed"),
        ({"raan": np.nan}, "raan"),
        ({"eccentricity": 0.2, "perigee_above": 6378137.0}, "perigee is 5600000 m"),
    ],
)
def test_bad_elements(change, message):
    good = {
        "semi_major_axis": 7e6,
        "eccentricity": 0.01,
        "inclination": 1.0,
        "raan": 0.0,
        "argument_of_perigee": 0.0,
        "mean_anomaly": 0.0,
    }
    KeplerElements(**good)
    with pytest.raises(ValueError, match=message):
        KeplerElements(**(good | change))
