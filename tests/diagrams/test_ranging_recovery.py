"""`ra` and `bank` off nominal: no trial is lost without a word, and `bank` loses none."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.statistics.state_errors import errors

ELEMENTS = ("semi_major_axis_km", "eccentricity", "inclination_deg", "raan_deg", "perigee_passage_s")


def target(*numbers):
    """The target's orbit, as settings."""
    return {f"target.{name}": value for name, value in zip(ELEMENTS, numbers, strict=True)}


CASES = {
    "another place of the orbit": ({"target.perigee_passage_s": -500}, 40),
    "both at another place": ({"target.perigee_passage_s": -500, "observer.perigee_passage_s": -500}, 40),
    "another orbit": (target(8200, 0.05, 120, 200, 900), 30),
    "all sigmas times ten": (
        {
            "truth.sigma_angle_mrad": 10.0,
            "truth.sigma_angle_rate_mradps": 0.1,
            "truth.sigma_radial_velocity_mps": 100.0,
            "truth.sigma_radial_acceleration_mps2": 0.5,
        },
        30,
    ),
    "a sun-synchronous orbit": (target(7200, 0.02, 98, 320, 2000), 30),
    "a high orbit": (target(15000, 0.1, 20, 100, -3000), 30),
    "an eccentric orbit": (target(9000, 0.2, 60, 10, 0), 30),
}
BEYOND = 27.9  # chi2.isf(1e-4, 6): an error that the covariance does not allow for


def lost_trials(settings, trials, seed, names=("ra", "bank")):
    """Of each estimator: trials that are lost at the end, and those of them that do not say so, (trials,) each.

    Lost: further off than 100 km, and further than its own covariance allows with a probability of 1e-4. With sigmas
    times ten the bound of `ra` is 59 km: errors of more than 100 km are then what the covariance says.
    """
    result = run_study("satellite_ranging", estimators=list(names), trials=trials, seed=seed, set=settings)
    off = errors(result)["position"].transpose("estimator", "trial", "time").values[..., -1]
    nees = result["nees"].transpose("estimator", "trial", "time").values[..., -1]
    said = result["lost"].transpose("estimator", "trial", "time").values[..., -1] > 0
    lost = ~(off < 100e3) & ~(nees < BEYOND)
    print({name: (int((off[i] > 100e3).sum()), int(lost[i].sum())) for i, name in enumerate(names)})
    return {name: (lost[i], lost[i] & ~said[i]) for i, name in enumerate(names)}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_no_trial_is_lost_without_a_word(case):
    settings, trials = CASES[case]
    for seed in (0, 1):
        for name, (lost, unsaid) in lost_trials(settings, trials, seed).items():
            assert not unsaid.any(), (name, seed)
            assert name != "bank" or not lost.any()


def test_the_plane_of_another_orbit():
    """Clustered planes alone took the mirror orbit's in 5 of 30 trials, and its gate kept the true one out for ever."""
    settings = {**target(8200, 0.05, 120, 200, 900), "duration_s": 1000.0}
    found = run_study("satellite_ranging", estimators=["ra"], trials=30, set=settings)
    assert np.all(errors(found)["position"].values[0, :, -1] < 200e3)


def test_a_bank_that_began_without_the_true_root_begins_again():
    """Sigmas times ten, seed 1: the first epoch of three trials has no root near the true one."""
    settings = {**CASES["all sigmas times ten"][0], "duration_s": 3000.0}
    changes = {**settings, "estimators.bank.restart": False}
    stays, again = (
        errors(run_study("satellite_ranging", estimators=["bank"], trials=11, seed=1, set=each))["position"].values[0]
        for each in (changes, settings)
    )
    assert (stays[:, -1] > 1e6).sum() >= 2 and np.all(again[:, -1] < 200e3)
