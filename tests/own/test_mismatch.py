"""Filters whose beliefs are wrong: their error is that of a linear recursion with their gains, written out here."""

from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from tests.own.by_hand import SYSTEMS, gradient, moved

FILE = str(Path(__file__).parent / "drone.yaml")
ROWS = list(SYSTEMS["drone.yaml"]["rows"].values())
SIGMAS = np.array(SYSTEMS["drone.yaml"]["sigmas"])
POINT = {name: path([0.0])[0] for name, path in SYSTEMS["drone.yaml"]["platforms"].items()}
FINE_DEG = 0.02
DENSITY, SPREAD = 0.3, np.diag(np.square([300.0] * 3 + [10.0] * 3))
SETTING = {
    "duration_s": 60,
    "target": "!Straight {position_km: [-2, 3, 1.5], velocity_mps: [40, 5, 0]}",
    "belief.motion": f"!WhiteNoiseAcceleration {{density_m2ps3: {DENSITY}}}",
    "start": "!Prior {sigma_position_m: 300, sigma_velocity_mps: 10}",
}


def nothing(state):
    return np.zeros((5, 0))


def late_reference(state):
    return np.array([[-50e-9]] * 3 + [[0]] * 2)


def clocks(state):
    return 40e-9 * np.vstack([np.hstack([np.eye(3), -np.ones((3, 1))]), np.zeros((2, 4))])


def turned(state):
    """Axes that are turned to the left see everything further to the right."""
    return np.radians([[0], [0], [0], [-0.1], [0]])


def misplaced(state):
    """Of 20 m per axis and station: what is measured at the true places less what is expected at those known."""
    found = []
    for name in POINT:
        for axis in range(3):
            moved_by = {sign: POINT | {name: POINT[name] + sign * np.eye(6)[axis]} for sign in (-1, 1)}
            found.append([20 * (row(state, moved_by[-1]) - row(state, moved_by[1])) / 2 for row in ROWS])
    return np.array(found).T


# Of each case: what is set, the believed sigmas over the true ones, and constant errors of the rows (rows, draws), each
# times an independent draw of variance one.
CASES = {
    "sigma believed thrice": (
        {"belief.sensors": "{tdoa: !Tdoa {reference: delta, sigma_ns: 90}}"},
        [3, 3, 3, 1, 1],
        nothing,
    ),
    "sigma believed a third": (
        {"belief.sensors": "{tdoa: !Tdoa {reference: delta, sigma_ns: 10}}"},
        [1 / 3, 1 / 3, 1 / 3, 1, 1],
        nothing,
    ),
    "clock of the reference": (
        {"sensors.tdoa.errors.clock_offset_ns": 50, "sensors.tdoa.errors.clock_offset_platform": "delta"},
        [1] * 5,
        late_reference,
    ),
    "clocks of all": ({"sensors.tdoa.errors.sigma_clock_offset_ns": 40}, [1] * 5, clocks),
    "a turned direction finder": (
        # otherwise nothing beside the TDOA
        {"sensors.bearing.sigma_deg": FINE_DEG, "sensors.bearing.errors.attitude_yaw_deg": 0.1},
        [1] * 5,
        turned,
    ),
    "misplaced stations": ({"platform_errors.sigma_position_m": 20}, [1] * 5, misplaced),
}


def error_moments(times, truth, seen, sigmas, believed, biases):
    """T (time, 6, 6) and M (time, 6, draws) of the error of a filter linearised at the truth: T + M M' in all.

    With the filter's gain K from what it believes, A = I - K h for every row: its P, the covariance T of what noise
    does and the response M to constant errors b each go their own way, T without the process noise that the truth does
    not have.
    """
    p, t, m = SPREAD, SPREAD, None
    found = []
    for k, time in enumerate(times):
        if k:
            dt = time - times[k - 1]
            phi = np.eye(6)
            phi[:3, 3:] = dt * np.eye(3)
            p, t, m = moved(p, dt, DENSITY, 0.0).astype(float), phi @ t @ phi.T, phi @ m
        error = biases(truth[k])
        m = np.zeros((6, error.shape[1])) if m is None else m
        for i in np.flatnonzero(seen[k]):
            h = gradient(ROWS[i], truth[None, k], POINT)[0]
            gain = p @ h / (h @ p @ h + believed[i] ** 2)
            a = np.eye(6) - np.outer(gain, h)
            p = a @ p @ a.T + believed[i] ** 2 * np.outer(gain, gain)
            t = a @ t @ a.T + sigmas[i] ** 2 * np.outer(gain, gain)
            m = a @ m + np.outer(gain, error[i])
        found.append((t, m))
    return (np.array(part) for part in zip(*found, strict=True))


def check(case, trials, tolerance):
    changes, factor, biases = CASES[case]
    result = run_study(FILE, trials=trials, set=SETTING | changes, estimators=["iekf", "ukf"], keep="all")
    seen = np.isfinite(result["measurement"].isel(trial=0).transpose("time", "row").values)
    truth = result["truth"].values
    sigmas = np.where([k == 3 and biases is turned for k in range(5)], np.radians(FINE_DEG), SIGMAS)
    noise, response = error_moments(result["time"].values, truth, seen, sigmas, sigmas * factor, biases)
    expected = noise + response @ np.swapaxes(response, 1, 2)
    for estimator in ("iekf", "ukf"):
        error = (result["estimate"].sel(estimator=estimator) - result["truth"]).values
        for part in (slice(0, 3), slice(3, 6)):
            size = np.trace(expected[:, part, part], axis1=1, axis2=2)
            ratio = np.sqrt((error[..., part] ** 2).sum(-1).mean(0) / size)[[20, 40, 60]]
            assert np.abs(ratio - 1).max() < tolerance, ratio
        if response.shape[-1] == 1:  # the same in every trial: of its sign, too; four standard deviations of a mean
            off = (error.mean(0) - response[..., 0]) / np.sqrt(np.diagonal(noise, axis1=1, axis2=2) / trials)
            assert np.abs(off[[20, 40, 60]]).max() < 4, off


@pytest.mark.parametrize("case", ["sigma believed thrice", "misplaced stations"])
def test_what_a_wrong_belief_costs(case):
    # an RMSE of one weak direction has a standard deviation of 1 / sqrt(2 trials), 0.05; three and a half of them
    check(case, 200, 0.175)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_what_a_wrong_belief_costs_exactly(case):
    check(case, 2000, 0.055)
