"""The bounds of a user's systems, by a recursion of this file: its own geometry, derivatives, orbits and arithmetic."""

from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from tests.own.by_hand import SYSTEMS, gradient, moved

HERE = Path(__file__).parent


def measured(covariance, h, sigma):
    """P after a row, by Joseph's form: a row after another, for their errors are independent."""
    ph = np.einsum("tij,tj->ti", covariance, h)
    gain = ph / (np.einsum("ti,ti->t", h, ph) + sigma**2)[:, None]
    rest = np.eye(h.shape[-1]) - gain[:, :, None] * h[:, None]
    return rest @ covariance @ np.swapaxes(rest, 1, 2) + sigma**2 * gain[:, :, None] * gain[:, None]


def bound(system, times, truth, seen):
    """Root of the mean over trials of the trace of the position's part of P, after every epoch [m]."""
    platforms = {name: path(times) for name, path in system["platforms"].items()}
    covariance = np.tile(np.diag(np.square(np.array(system["start"], np.longdouble))), (len(truth), 1, 1))
    found = []
    for k, t in enumerate(times):
        if k:
            covariance = moved(covariance, t - times[k - 1], system["density"], system.get("walk", 0.0))
        for i, (row, sigma) in enumerate(zip(system["rows"].values(), system["sigmas"], strict=True)):
            h = gradient(row, truth[:, k], {name: states[k] for name, states in platforms.items()})
            after = measured(covariance, h.astype(np.longdouble), np.longdouble(sigma))
            covariance = np.where(seen[:, k, i, None, None], after, covariance)
        found.append(np.sqrt(np.mean(np.trace(covariance[:, :3, :3], axis1=1, axis2=2))))
    return np.array(found, dtype=float)


# Truth that differs from trial to trial.
RANDOM = {
    "drone.yaml": "!Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}",
    "ship.yaml": "!GreatCircle {latitude_deg: 12, longitude_deg: 14, speed_mps: 8}",
    "beacon.yaml": "!Geodetic {latitude_deg: 46, longitude_deg: 14, height_m: 300}",
    "geostationary.yaml": "!Geodetic {latitude_deg: 48, longitude_deg: 11}",
    "rocket.yaml": "!Straight {position_km: [-1840, 4653, 3979], velocity_mps: [-212, 852, -210]}",
}


def check(name, changes=None):
    # two estimators: what is wired beside it changes nothing
    result = run_study(str(HERE / name), trials=3, estimators=["iekf", "ukf"], set=changes or {}, keep="all")
    system, times = SYSTEMS[name], result["time"].values
    assert list(result["row"].values) == list(system["rows"])
    seen = np.isfinite(result["measurement"].transpose("trial", "time", "row").values)
    truth = result["truth"].values
    truth = np.tile(truth, (3, 1, 1)) if truth.ndim == 2 else truth
    expected = bound(system, times, truth, seen)
    for estimator in ("iekf", "ukf"):
        np.testing.assert_allclose(result["bound_position"].sel(estimator=estimator), expected, rtol=1e-6)


@pytest.mark.parametrize("name", SYSTEMS)
def test_bound_along_the_truth(name):
    check(name, {"duration_s": 50})


@pytest.mark.parametrize("name", SYSTEMS)
def test_bound_along_each_trials_own_truth(name):
    spread = "sigma_position_m: 3000, sigma_velocity_mps: 20"
    check(name, {"duration_s": 50, "target": f"!RandomMotion {{start: {RANDOM[name]}, {spread}}}"})


@pytest.mark.slow
@pytest.mark.parametrize("name", SYSTEMS)
def test_bound_of_the_whole_run(name):
    check(name)
