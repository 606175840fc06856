"""The packaged system three_satellite, said in YAML: the same numbers, bit by bit.

Noise is a function of (seed, block, trial, tick), and the blocks that draw have the same names here: ``sensor``,
``assumed_height``, ``platform_error``. Not so ``target`` (packaged: ``emitter``), which draws where it is random, and
what ``errors`` add (``sensor_reading_error``).

The place of the target is said in two ways: beside the track, and by latitude and longitude. How the last digit comes
out is the processor's affair (NumPy's sine is another with AVX-512), so the packaged one is told the other's place.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.library.models import three_satellite as packaged_models
from quietfix.systems.earth.geodetic import geodetic_state

FILE = str(Path(__file__).parent / "three_satellite.yaml")
SENSOR = "sensors.sensor"
PHASE = f"{SENSOR}.kinds.phase"
# the target is beside the middle of the pass: fewer epochs, not a shorter pass
RARE = {"period_s": 3}, {f"{SENSOR}.every_s": 3}


def wrong(sigma_tdoa, sigma_fdoa, sigma_phase):
    """Return the belief in these standard deviations."""
    return {
        "belief.sensors": f"{{tdoa: !Tdoa {{reference: s0, sigma_ns: {sigma_tdoa}}}, "
        f"fdoa: !Fdoa {{reference: s0, sigma_hz: {sigma_fdoa}, carrier_mhz: 3000}}, "
        f"phase: !Phase {{platform: s0, sigma_deg: {sigma_phase}, baseline_m: 3, carrier_mhz: 3000}}}}"
    }


CASES = {
    "as it stands": ({}, {}),
    "ten times the noise": (
        {"truth.sigma_tdoa_ns": 200, "truth.sigma_fdoa_hz": 10, "truth.sigma_phase_deg": 150},
        {f"{SENSOR}.kinds.tdoa.sigma_ns": 200, f"{SENSOR}.kinds.fdoa.sigma_hz": 10, f"{PHASE}.sigma_deg": 150},
    ),
    "wrong beliefs": (
        {
            "belief.sigma_tdoa_ns": 60,
            "belief.sigma_fdoa_hz": 0.3,
            "belief.sigma_phase_deg": 5,
            "belief.sigma_assumed_height_km": 9,
            "belief.sigma_satellite_m": 20,
            "belief.acceleration_mps2": 1,
        },
        {
            **wrong(60, 0.3, 5),
            "start.believed_sigma_height_m": 9000,
            "start.sigma_platform_m": 20,
            "belief.motion.acceleration_mps2": 1,
        },
    ),
    "a chain of baselines": (
        {"truth.chain_m": [0.04, 0.4]},
        {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.04, 0.4]},
    ),
    "an ideal interferometer": (
        {"truth.phase": "unambiguous"},
        {f"{PHASE}.resolved_by": "''", f"{PHASE}.wrapped": False},
    ),
    "one wave front, correlated": (
        {"truth.light_time": True, "truth.correlated": True},
        {f"{SENSOR}.kinds.{kind}.{field}": True for kind in ("tdoa", "fdoa") for field in ("light_time", "correlated")},
    ),
    "one wave front, believed to be of one instant": (
        {"truth.light_time": True, "belief.light_time": False},
        {
            **{f"{SENSOR}.kinds.{kind}.light_time": True for kind in ("tdoa", "fdoa")},
            **wrong(20, 1, 15),
        },
    ),
    "the paper's sign": ({"truth.paper_sign": True}, {f"{SENSOR}.kinds.fdoa.paper_sign": True}),
    "a great circle": (
        {"truth.motion": "!GreatCircle {}"},
        {
            "target": "!GreatCircle {latitude_deg: 2.4734561597037277, longitude_deg: 4.86600292893607, "
            "height_m: 10000, course_deg: 60, speed_mps: 300}"
        },
    ),
    "satellites that nobody knows well, low ones hidden": (
        {"truth.errors.sigma_platform_position_m": 10, "truth.minimum_elevation_deg": 30},
        {"platform_errors.sigma_position_m": 10, f"{SENSOR}.minimum_elevation_deg": 30},
    ),
}


@pytest.fixture(autouse=True)
def one_place(monkeypatch):
    """Let both begin at the very place that the file says, which is the packaged one to rounding."""
    beside_track = packaged_models.beside_track
    angles = math.radians(2.4734561597037277), math.radians(4.86600292893607)
    there = geodetic_state(*angles, 10e3, math.radians(60), 300)

    def at_that_place(scenario, orbit, along_km, cross_km):
        np.testing.assert_allclose(beside_track(scenario, orbit, 0, 300), there, rtol=0, atol=1e-7)  # 100 ulp
        assert (along_km, cross_km) == (0, 300)
        return there

    monkeypatch.setattr(packaged_models, "beside_track", at_that_place)


def both(packaged, own, estimators, trials=3):
    about = {"estimators": estimators, "trials": trials, "seed": 5, "keep": "all"}
    return run_study("three_satellite", set=packaged, **about), run_study(FILE, set=own, **about)


def check_the_same(first, second):
    assert set(first) == set(second)
    # packaged, a great circle counts as a straight line for the bound of the truth; in YAML it is no motion model
    none = "!GreatCircle" in second.attrs["scenario"]
    for name in first:
        if none and name.startswith("bound_truth"):
            assert np.isnan(second[name]).all()
        else:
            np.testing.assert_array_equal(second[name].values, first[name].values, err_msg=name)
    assert list(first["estimator"].values) == list(second["estimator"].values)


@pytest.mark.parametrize("title", CASES)
def test_the_numbers_are_those_of_the_packaged_system(title):
    packaged, own = CASES[title]
    first, second = both(RARE[0] | packaged, RARE[1] | own, ["iekf", "ukf"])
    check_the_same(first, second)
    assert np.isfinite(second["estimate"].values).all()
    if "integers" in first and "chain" not in title:
        cycles = second["integers"].values[:, 1:]
        assert np.isfinite(cycles).all() and np.abs(cycles).max() > 5


def test_all_estimators():
    """With the row-wise choice of the paper's two comparison methods; iekf_hypotheses resolves the phases itself."""
    every = ["iekf", "ekf", "ukf", "iekf_tdoa_fdoa_phase", "iekf_tdoa_phase", "iekf_hypotheses"]
    added = {"estimators.iekf_hypotheses": "!IekfHypotheses {hypotheses: 3}"}
    check_the_same(*both(RARE[0] | added, RARE[1] | added, every, trials=2))
