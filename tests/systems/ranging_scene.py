"""The paper's two satellites, and their arc as SciPy integrates it."""

from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.plants.orbit import derivative
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.kepler import KeplerElements, mean_motion, state_of

EARTH = GravityConstants(mu=3.986004415e14, radius=6378136.0, j2=1.0826261e-3)
SIGMAS = np.array([1e-3, 1e-3, 1e-5, 1e-5, 10.0, 0.05])
TIMES = 10.0 * np.arange(501)
PRIOR = np.diag([500e3**2] * 3 + [500.0**2] * 3)


def _state(axis, eccentricity, inclination, node, perigee, passage):
    anomaly = -mean_motion(axis, EARTH.mu) * passage
    return state_of(KeplerElements(axis, eccentricity, inclination, node, perigee, anomaly), EARTH.mu)


TARGET = _state(7500e3, 0.0, np.pi / 4, np.pi / 3, 3 * np.pi / 5, 500.0)
OBSERVER = _state(22000e3, 0.2, 2 * np.pi / 5, np.pi / 6, np.pi / 3, 0.0)
POLAR = _state(7500e3, 0.0, np.pi / 2, np.pi / 3, 3 * np.pi / 5, 500.0)


def sensor(j2=False):
    """All six rows with the paper's errors."""
    return RelativeKinematics(dict(zip(ROWS, SIGMAS, strict=True)), EARTH, j2)


@lru_cache(maxsize=8)
def _solve(j2, polar):
    both = np.concatenate([OBSERVER, POLAR if polar else TARGET])
    path = solve_ivp(
        lambda t, x: derivative(x.reshape(2, 6), EARTH, j2).ravel(),
        (0.0, 5000.0),
        both,
        method="DOP853",
        rtol=1e-13,
        atol=1e-7,
        dense_output=True,
    )
    return path.sol


def arc(j2=False, polar=False, times=TIMES):
    """Return observer and target (epochs, 6) at `times`."""
    states = _solve(bool(j2), bool(polar))(times).T
    return states[:, :6], states[:, 6:]


def measurements(trials, epochs, seed, j2=False, polar=False):
    """Return noisy rows (trials, epochs, 6), observer and target (epochs, 6)."""
    observer, target = arc(j2, polar, TIMES[:epochs])
    exact = sensor(j2).predict(target, observer[:, None])
    noise = np.random.default_rng(seed).standard_normal((trials, epochs, 6)) * SIGMAS
    return exact + noise, observer, target
