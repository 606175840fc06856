"""Results made by hand, for the tests of what reads a study's result."""

import numpy as np
import xarray as xr

from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.trajectories.great_circle import straight_line

STATES = ["x", "y", "z", "vx", "vy", "vz"]


def level_flight(epochs: int = 21, period: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and an Earth-fixed straight line: 10 km high, 300 m/s, course 60 deg."""
    times = period * np.arange(epochs)
    start = geodetic_state(np.radians(3.0), np.radians(4.0), 10e3, np.radians(60.0), 300.0)
    return times, straight_line(start, times)


def result(
    names: tuple[str, ...] = ("iekf", "ukf"),
    trials: int = 8,
    epochs: int = 21,
    scale: float = 1e3,
    seed: int = 0,
    divergence: float = 50e3,
) -> xr.Dataset:
    """A result whose errors shrink with time; NEES and NIS are drawn from their distributions."""
    rng = np.random.default_rng(seed)
    times, truth = level_flight(epochs)
    shape = (len(names), trials, epochs)
    sigma = np.array([1.0] * 3 + [0.02] * 3) * scale / (1 + times[:, None] / 20)
    estimate = truth + sigma * rng.standard_normal((*shape, 6))
    dims = ("estimator", "trial", "time")
    return xr.Dataset(
        {
            "truth": (("time", "state"), truth),
            "estimate": ((*dims, "state"), estimate),
            "nees": (dims, rng.chisquare(6, shape)),
            "nis": (dims, rng.chisquare(5, shape)),
            "nis_dof": (dims, np.full(shape, 5.0)),
        },
        coords={"estimator": list(names), "trial": np.arange(trials), "time": times, "state": STATES},
        attrs={"system": "three_satellite", "frame": "earth_fixed", "divergence_m": divergence, "seed": seed},
    )
