"""Packaged systems with every error of their sensors on: a trial is the same alone, in a batch and in any chunk.

Bit for bit, whatever its neighbours miss, for every registered estimator.
"""

import numpy as np
import pytest

from quietfix.diagrams.studies.whole import run_study
from quietfix.systems.registry import ESTIMATORS
from tests.laws.packaged import EVERYTHING

_ROWS = {"drop_out_rate": 0.15, "outlier_rate": 0.05}
_KNOWN = {"sigma_platform_position_m": 20, "sigma_platform_velocity_mps": 0.1}
_TURNED = {"attitude_roll_deg": 0.02, "sigma_attitude_deg": 0.05}
_CLOCKS = {"clock_offset_ns": 5, "sigma_clock_offset_ns": 20}
_CUSTOM = "quietfix.systems.filters.iterated_extended:IteratedExtendedKalman"
_CLOUDS = {"estimators.pf": "!Pf {particles: 300}", "estimators.pf_sir": "!PfSir {particles: 300}"}


def _on(path, *groups):
    return {f"{path}.{name}": value for group in groups for name, value in group.items()}


ERRORS = {
    "three_satellite": _on("truth.errors", _ROWS, _KNOWN, _TURNED, _CLOCKS)
    | {"truth.motion": "!RandomAcceleration {}"}
    | _CLOUDS,
    "dual_satellite": _on("truth.errors", _ROWS, _KNOWN, _TURNED, _CLOCKS) | _CLOUDS,
    "beacon_rocket": _on("sensor.errors", _ROWS, _KNOWN) | {"sensor.minimum_elevation_deg": 3},
    "satellite_ranging": _on("truth.errors", _ROWS, _TURNED)
    | {"truth.sigma_observer_m": 20, "truth.sigma_observer_mps": 0.1, "estimators.ra_paper.look_ahead": False},
    "bearing_crossing": _on("truth.errors", _ROWS) | {"truth.errors.sigma_attitude_deg": 0.5},
}
"""Errors that each system has, all on."""

OTHERS = {
    "three_satellite": ["default", "mgekf", "batch", "iekf_hypotheses", "pf", "pf_sir", _CUSTOM],
    "dual_satellite": ["default", "ekf", "mgekf"],
    "beacon_rocket": ["default", "ekf", "ukf_unaugmented", "ukf_monitored"],
    "satellite_ranging": ["ra", "ra_paper", "bo", "bcr", "iekf", "ukf", "bank", "ekf"],
    "bearing_crossing": ["default", "crossing", "range_bank", "mgekf"],
}
"""Estimators: those of the scenario (but none that looks ahead, which errors do not allow), and what else can run."""

_SHORT = {
    "three_satellite": {"duration_s": 4},
    "dual_satellite": {"duration_s": 3},
    "beacon_rocket": {"start_s": 179.8, "stop_s": 180.3},
    "satellite_ranging": {"duration_s": 80, "estimators.ra.plane_epochs": 5},
    "bearing_crossing": {"duration_s": 6},
}
_LONG = {
    "three_satellite": {"duration_s": 20},
    "dual_satellite": {"duration_s": 20},
    "beacon_rocket": {"start_s": 179, "stop_s": 182},
    "beacon_rocket:falcon9": {"start_s": 60, "stop_s": 63},
    "satellite_ranging": {"duration_s": 400},
    "satellite_ranging:occulted": {"duration_s": 4800, "period_s": 60},
    "bearing_crossing": {"duration_s": 70},
    "bearing_crossing:manoeuvre": {"duration_s": 520, "period_s": 10},
    "dual_satellite:signal": {"duration_s": 2},
    "dual_satellite:pulse_train": {"duration_s": 2},
    "dual_satellite:low_snr": {"duration_s": 2},
}


def run(name, settings, trials, first=0, estimators=None, **more):
    wanted = OTHERS[name.partition(":")[0]] if estimators is None else estimators
    return run_study(
        name, set=settings, estimators=wanted, trials=trials, first_trial=first, seed=4, keep="all", **more
    )


def assert_same(part, whole, first):
    """Assert that all that has trials is equal, bit for bit; the bounds are of all trials of a study together."""
    here = slice(first, first + part.sizes["trial"])
    for name, values in whole.data_vars.items():
        if name.startswith("bound"):
            continue
        expected = values.isel(trial=here) if "trial" in values.dims else values
        np.testing.assert_array_equal(part[name].values, expected.values, err_msg=str(name))


def of(name, lengths):
    head = name.partition(":")[0]
    return ERRORS[head] | (lengths.get(name) or lengths[head])


def test_every_estimator_is_here():
    """Options of the scenarios, too: bearing_crossing's iekf is a bank of ranges, its ml the only one.

    `imm` has no motions but those that a user gives it: its batches are in test_interacting.
    """
    named = {name for names in OTHERS.values() for name in names} | {"iekf", "imm", "ukf", "ml", "custom"}
    assert set(ESTIMATORS) <= named


@pytest.mark.parametrize("name", ERRORS)
def test_alone_and_in_chunks(name):
    """Five trials in chunks of three and one of them alone, of a batch of five."""
    settings = of(name, _SHORT)
    whole = run(name, settings, 5)
    rows = np.isfinite(whole["measurement"].values)
    assert not rows.all() and rows.any()
    assert_same(run(name, settings, 1, 4), whole, 4)
    if name == "beacon_rocket":  # chunks are no business of a system's; this one is quick
        assert_same(run(name, settings, 5, chunk=3), whole, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERYTHING)
def test_batches_of_1_7_11_and_100(name):
    """The whole matrix; the I/Q variants with 11 trials, which are what fits into their time."""
    settings = of(name, _LONG)
    sampled = settings.get("duration_s") == 2
    trials, first = (11, 3) if sampled else (100, 37)
    estimators = ["default"] if sampled else None
    whole = run(name, settings, trials, estimators=estimators)
    for count in (1, 7) if sampled else (1, 7, 11):
        assert_same(run(name, settings, count, first, estimators), whole, first)
    assert_same(run(name, settings, trials, estimators=estimators, chunk=4 if sampled else 23), whole, 0)
