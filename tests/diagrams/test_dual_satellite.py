"""What the two-satellite system must show, at measurement level; statements at full size are slow."""

import math

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.library.fields.dual_satellite import Truth
from quietfix.diagrams.library.models.dual_satellite import delay_doppler_sigmas, models, target_state
from quietfix.diagrams.parts import formation
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.geometry.lines_of_sight import line_of_sight

# Truth that moves as the filters believe, its velocity drawn from their prior.
BAYES = {"truth.motion": "!RandomAcceleration {sigma_velocity_mps: 200}"}
EPOCHS = [10, 30, 60, 100, 150]


def squared(study, name, columns=slice(0, 3)):
    """Squared errors (trial, time)."""
    error = (study["estimate"].sel(estimator=name) - study["truth"]).transpose("trial", "time", "state")
    return np.square(error.values[..., columns]).sum(axis=-1)


def ratios(study, name):
    """RMSE over bound, of position and velocity, at the epochs."""
    position = np.sqrt(squared(study, name).mean(axis=0)) / study["bound_position"].sel(estimator=name).values
    velocity = np.sqrt(squared(study, name, slice(3, 6)).mean(axis=0))
    return position[EPOCHS], (velocity / study["bound_velocity"].sel(estimator=name).values)[EPOCHS]


def signal(study, port, name):
    """A health port of a particle filter, (trial, time)."""
    return study[f"{port}_{name}"].values[..., 0]


# ---------------------------------------------------------------------------------------------------- geometry


def test_signs_and_sizes_at_the_start():
    """Range, direction, delay and Doppler difference of a prototype that shares no code; its digits are asserted."""
    scenario = load_scenario("dual_satellite")
    target = target_state(scenario)
    platforms = inertial_to_earth_fixed(formation.satellite_orbit(scenario, 2).at(0.0), 0.0)
    model = models(scenario, believed=False)
    assert line_of_sight(target, platforms).distance[0] == pytest.approx(986e3, abs=500)
    np.testing.assert_allclose(np.degrees(model["direction"].predict(target, platforms)), [22.85, 47.3], atol=0.03)
    assert model["tdoa"].predict(target, platforms)[0] == pytest.approx(216e-6, abs=0.5e-6)
    assert model["fdoa"].predict(target, platforms)[0] == pytest.approx(3356.0, abs=1.0)
    # the emitter is ahead of and below both: nearer to the main satellite, which is ahead
    distance = line_of_sight(target, platforms).distance
    assert distance[1] - distance[0] == pytest.approx(model["tdoa"].predict(target, platforms)[0] * 299792458.0)


def test_stein():
    """BT gamma of 24.7 dB: 15.8 ns at beta = 3.69e6 rad/s, and 1.96 Hz in 16.4 ms."""
    snr = -14 + 10 * math.log10(4 / 2.5)  # -14 dB in 4 MHz
    truth = Truth(differences="stein", snr_main_db=snr, snr_auxiliary_db=snr, rms_bandwidth_mhz=3.69 / 2 / math.pi)
    tau, f = delay_doppler_sigmas(truth)
    assert tau == pytest.approx(15.8e-9, rel=0.01) and f == pytest.approx(1.96, rel=0.01)
    assert delay_doppler_sigmas(Truth(sigma_tdoa_ns=30.0, sigma_fdoa_hz=2.0)) == pytest.approx((30e-9, 2.0))


def test_bounds_at_the_end():
    """A prototype's bounds for q = 0.1 m/s^2 and a straight line: 2146 m, 1865 m of height, 19.0 m/s."""
    study = run_study("dual_satellite", estimators=["iekf"], trials=2)
    for quantity, value in (("position", 2146), ("height", 1865), ("velocity", 19.0)):
        assert float(study[f"bound_{quantity}"][0, -1]) == pytest.approx(value, rel=0.002)


@pytest.mark.parametrize(
    "settings",
    [
        {"truth.direction": "cosines"},
        {"truth.light_time": True},
        {"belief.start": "measurement"},
        {"truth.differences": "stein", "belief.sigma_tdoa_ns": 30},
        {"truth.motion": "!GreatCircle {}", "belief.start": "measurement", "truth.direction": "cosines"},
    ],
    ids=lambda settings: ", ".join(settings),
)
def test_options_work(settings):
    """All estimators run, and none is further off than five of its own standard deviations of a dimension of six."""
    few = {"estimators.pf.particles": 500, "duration_s": 5}
    study = run_study("dual_satellite", trials=3, set={**few, **settings}, estimators=["iekf", "ukf", "ekf", "pf"])
    assert np.isfinite(study["estimate"].values).all()
    assert study["nees"].values[..., 0].max() < 60 and np.isfinite(study["bound_position"].values).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"truth.latitude_deg": 80.0}, "latitude_deg"),
        ({"truth.sigma_tdoa_ns": 0}, "sigma_tdoa_ns"),
        ({"satellites": "[!Offset {}]"}, "satellites: 1 are given; exactly 2"),
        ({"belief.start": "guess"}, "prior, measurement"),
        ({"estimators.pf.resampling": "roulette"}, "systematic"),
        ({"estimators.pf.particles": 1}, "particles"),
        ({"estimators.iekf.measurements": "[phase]"}, "any of direction, tdoa, fdoa"),
    ],
)
def test_mistakes(settings, words):
    with pytest.raises(UserError, match=words):
        run_study("dual_satellite", trials=1, set={"duration_s": 1, **settings})


# ------------------------------------------------------------------------------------------------- consistency


@pytest.mark.slow
def test_gaussian_filters_400_trials():
    study = run_study("dual_satellite", estimators=["iekf", "ukf"], trials=400, seed=3, set=BAYES)
    position, velocity = ratios(study, "iekf")
    assert np.all((position >= 0.95) & (position <= 1.15)) and np.all((velocity >= 0.95) & (velocity <= 1.15))
    nees = study["nees"].sel(estimator="iekf").mean("trial").values[EPOCHS]
    assert np.all((nees >= 5.5) & (nees <= 7.8)), nees
    assert max(part.max() for part in ratios(study, "ukf")) <= 1.25


def test_gaussian_filters_50_trials():
    """The same of an eighth of the trials: an RMSE scatters by 10 %, a mean NEES by 0.5; three of these."""
    study = run_study("dual_satellite", estimators=["iekf", "ukf"], trials=50, seed=3, set=BAYES)
    for name in ("iekf", "ukf"):
        position, velocity = ratios(study, name)
        assert np.all((position > 0.70) & (position < 1.45)) and np.all((velocity > 0.70) & (velocity < 1.45))
    nees = study["nees"].sel(estimator="iekf").mean("trial").values[EPOCHS]
    assert np.all((nees > 4.3) & (nees < 8.8)), nees


@pytest.mark.slow
def test_particle_filters_30_trials():
    """10,000 particles, 150 s: `pf` is as good as `iekf`, `pf_sir` collapses and says so."""
    study = run_study(
        "dual_satellite", estimators=["iekf", "pf", "pf_sir"], trials=30, seed=3, set=BAYES, keep="measurements"
    )
    rmse = {name: math.sqrt(squared(study, name)[:, 60:].mean()) for name in ("iekf", "pf", "pf_sir")}
    assert rmse["pf"] <= 1.2 * rmse["iekf"], rmse
    nees = study["nees"].sel(estimator="pf").median("trial").values[EPOCHS]
    assert np.all((nees >= 3.0) & (nees <= 9.0)), nees
    summary = summarise(study)
    assert summary["pf"]["diverged"] == 0 and not signal(study, "diverged", "pf").any()
    assert not signal(study, "restarts", "pf").any()

    ancestors = signal(study, "ancestors", "pf_sir")
    assert np.all(ancestors[:, 30:] == 1)
    assert math.sqrt(squared(study, "pf_sir")[:, -1].mean()) > 20e3
    assert np.all(signal(study, "diverged", "pf_sir")[:, 30:] == 1)
    # the effective sample size does not see it: after the collapse it is higher than at the start
    effective = signal(study, "effective_particles", "pf_sir")
    assert np.median(effective[:, 0]) < 10 and np.median(effective[:, 1]) > 1000


def test_particle_filters_few_trials():
    """Four trials of 30 s, a quarter of the particles: the plain filter has one ancestor, the other tracks."""
    settings = {**BAYES, "duration_s": 30, "estimators.pf.particles": 2500, "estimators.pf_sir.particles": 2500}
    study = run_study(
        "dual_satellite", estimators=["iekf", "pf", "pf_sir"], trials=4, seed=3, set=settings, keep="measurements"
    )
    assert np.all(signal(study, "ancestors", "pf_sir")[:, -1] == 1)
    assert np.all(signal(study, "diverged", "pf_sir")[:, -1] == 1)
    assert not signal(study, "diverged", "pf").any()
    # chi-square with six degrees of freedom passes 27.9 once in 10,000; 2500 particles are overconfident by a third
    assert study["nees"].sel(estimator="pf").values.max() < 45
    assert study["nees"].sel(estimator="pf_sir").values[:, -1].min() > 1000
    apart = squared(study, "pf")[:, 10:].mean() / squared(study, "iekf")[:, 10:].mean()
    assert apart < 1.6**2


@pytest.mark.slow
def test_particle_filter_from_one_measurement():
    """Start from direction, height, delay and Doppler difference alone: the first epoch is used once.

    A median NEES of 12 trials scatters by 1.2 about 5.3; pairs of errors are alike, so that their ratio does not.
    """
    settings = {**BAYES, "belief.start": "measurement", "duration_s": 100, "estimators.pf.particles": 5000}
    study = run_study("dual_satellite", estimators=["iekf", "pf"], trials=12, seed=3, set=settings, keep="measurements")
    assert not signal(study, "stages", "pf")[:, 0].any()
    nees = study["nees"].sel(estimator="pf").median("trial").values[[0, 10, 30, 60, 100]]
    assert np.all((nees >= 2.0) & (nees <= 9.5)), nees
    rmse = {name: math.sqrt(squared(study, name)[:, 60:].mean()) for name in ("iekf", "pf")}
    assert rmse["pf"] <= 1.3 * rmse["iekf"] and summarise(study)["pf"]["diverged"] == 0
