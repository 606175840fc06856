"""The laws of every estimator, for those that locate by bearings alone, and for the azimuth filter in front of them."""

from functools import cache

import numpy as np
import pytest

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.estimators.azimuth_filter import AzimuthFilter
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.options.bearings.crossing import Crossing
from quietfix.systems.options.bearings.ml import Ml
from quietfix.systems.options.bearings.range_bank import RangeBank
from quietfix.systems.registry import ESTIMATORS
from quietfix.systems.starts.bearing_start import BearingStart
from tests.laws.cases import BEARINGS_ONLY
from tests.laws.rig import PORTS, assert_same, make, run, textbook, with_gaps

SIGMA = np.radians(1.0)
MODEL = Bearing(SIGMA)
TRIALS, EPOCHS = 12, 45
CASES = {
    "range_bank": RangeBank(hypotheses=4, nearest_km=5, farthest_km=120),
    "range_bank ukf": RangeBank(filter="ukf", hypotheses=3),
    "crossing": Crossing(),
    "crossing pair": Crossing(method="pair", baseline_s=20.0),
    "crossing lines": Crossing(method="lines"),
    "crossing iv": Crossing(method="iv"),
    "ml": Ml(),
    "ml window": Ml(window=30),
    "ml prior": Ml(prior=True),
}


def scene(trials=TRIALS, seed=3):
    """An aircraft at 400 m/s passes a target at 30 km: platforms (epochs, 1, 6) and bearings (epochs, trials, 1)."""
    platforms = np.zeros((EPOCHS, 1, 6))
    platforms[:, 0, 0] = 400.0 * np.arange(EPOCHS)
    exact = MODEL.predict(np.array([15e3, 30e3]), platforms.reshape(EPOCHS, 1, 6))
    noise = np.random.default_rng(seed).standard_normal((EPOCHS, trials, 1))
    return MODEL.represent(exact[:, None] + SIGMA * noise), platforms


def locate(name, measurement, platforms, clock=None, motion=None):
    motion = motion or Stationary(2)
    clock = clock or Periodic(1.0)
    start = BearingStart(MODEL, MODEL.names, motion.size, 40e3, 20e3, 20.0)
    wiring = Wiring(measurement.shape[1], MODEL.names, clock, 1, platforms.shape[1])
    block = CASES[name].make(name, MODEL, motion, start, wiring)
    end = clock.ticks(1e9)[-1] if isinstance(clock, Times) else None
    return run(block, measurement, platforms, clock, end=end)[1]


@cache
def undisturbed(name, moving=False):
    """What the first scene gives; not to be changed."""
    return locate(name, *scene(), motion=ConstantVelocity(0.0, 2) if moving else None)


def test_every_locator_is_here():
    assert {name.split()[0] for name in CASES} == set(BEARINGS_ONLY) <= set(ESTIMATORS)


def same(a, b, sigma):
    """Fits stop when a step would change the cost by 1e-3, so warm starts agree to a share of a standard deviation."""
    return np.nanmax(np.abs(a - b) / sigma) < 1e-6


@pytest.mark.parametrize("moving", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("name", CASES)
def test_alone_and_in_a_batch(name, moving):
    """Bit for bit, with gaps, so that one trial has more bearings behind it; with platforms of its own, too."""
    measurement, platforms = scene()
    measurement = with_gaps(measurement)
    motion = ConstantVelocity(0.0, 2) if moving else Stationary(2)
    batch = locate(name, measurement, platforms, motion=motion)
    for rows, own in ((slice(7, 8), platforms), (slice(3, 10), np.tile(platforms, (1, 7, 1)))):
        alone = locate(name, measurement[:, rows], own, motion=motion)
        assert_same(alone, {port: values[:, rows] for port, values in batch.items()})
    covariance = batch["covariance"]
    known = np.isfinite(covariance).all(axis=(-1, -2))
    covariance = covariance[known]
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    np.testing.assert_allclose(covariance, np.swapaxes(covariance, -1, -2), rtol=1e-12)
    scale = sigma[..., :, None] * sigma[..., None, :]
    assert np.linalg.eigvalsh(covariance / scale).min() > 0


@pytest.mark.parametrize("name", CASES)
def test_missing_bearings_are_no_bearings(name):
    """Every bearing missing for twenty epochs is as if there were no such epochs: the target stands still."""
    measurement, platforms = scene()
    blank = measurement.copy()
    blank[15:35] = np.nan
    values = locate(name, blank, platforms)
    assert np.isfinite(values["estimate"]).all() and not values["nis_dof"][15:35].any()
    np.testing.assert_array_equal(values["estimate"][15:35], np.repeat(values["estimate"][14:15], 20, axis=0))
    kept = np.r_[0:15, 35:EPOCHS]
    short = locate(name, measurement[kept], platforms[kept], Times(kept.astype(float)))
    sigma = np.sqrt(np.diagonal(short["covariance"], axis1=-2, axis2=-1))
    assert same(values["estimate"][kept], short["estimate"], sigma)


@pytest.mark.parametrize("what", ["all", "the first ten"])
@pytest.mark.parametrize("name", CASES)
def test_a_trial_that_is_nan_changes_no_other(name, what):
    measurement, platforms = scene()
    clean = undisturbed(name)
    broken = measurement.copy()
    broken[: None if what == "all" else 10, 4] = np.nan
    values = locate(name, broken, platforms)
    others = np.arange(TRIALS) != 4
    sigma = np.sqrt(np.diagonal(clean["covariance"][:, others], axis1=-2, axis2=-1))
    assert same(values["estimate"][:, others], clean["estimate"][:, others], sigma)
    if what == "all":
        assert np.isnan(values["estimate"][:, 4]).all() and not values["nis_dof"][:, 4].any()
    else:
        assert np.isnan(values["estimate"][:10, 4]).all()
        assert np.isfinite(values["estimate"][10:, 4]).all()
        assert np.linalg.norm(values["estimate"][-1, 4] - [15e3, 30e3]) < 10e3


@pytest.mark.parametrize("name", [name for name in CASES if name.startswith("crossing")])
def test_a_crossing_makes_nothing_of_elevations(name):
    """The fix in the plane is that of the azimuths alone; where only an azimuth is missing there is no line."""
    measurement, platforms = scene(trials=3)
    measurement[10:13, 1] = np.nan
    both = Bearing(SIGMA, SIGMA)
    elevated = np.concatenate([measurement, np.full_like(measurement, -0.2)], axis=-1)
    start = BearingStart(both, both.names, 3, 40e3, 20e3, 20.0)
    block = CASES[name].make(name, both, Stationary(3), start, Wiring(3, both.names, Periodic(1.0), 1))
    values = run(block, elevated, platforms, Periodic(1.0))[1]
    plane = locate(name, measurement, platforms)
    # from the twentieth on both have a fix of their own; iv's first instruments are those of the start
    np.testing.assert_allclose(values["estimate"][20:, :, :2], plane["estimate"][20:], rtol=1e-6)


def test_other_measurements_are_refused_in_words():
    for name in BEARINGS_ONLY:
        with pytest.raises(ValueError, match="bearing"):
            make(name, CASES[name])


# --------------------------------------------------------------------------------------------- azimuth filter


@pytest.mark.parametrize("density", [0.0, 1e-6])
@pytest.mark.parametrize("keep_rate", [False, True], ids=["way 1", "way 2"])
@pytest.mark.parametrize("piece", [np.inf, 20.0])
def test_azimuth_filter_is_the_textbooks_restarted(piece, keep_rate, density):
    """Against the textbook filter and the restart written out, with the azimuth running over +-180 deg."""
    rng = np.random.default_rng(1)
    truth = 3.0 + 0.01 * np.arange(EPOCHS)
    measurement = wrap(truth[:, None, None] + SIGMA * rng.standard_normal((EPOCHS, 3, 1)))
    measurement[20:23, 1] = np.nan  # the sample of the restart is missing: it is then made up for
    measurement[5, 2] = np.nan
    wiring = Wiring(3, MODEL.names, Periodic(1.0), 1)
    block = AzimuthFilter("filter", SIGMA, 0.002, density, piece, keep_rate, wiring)
    values = run(block, measurement, np.zeros((EPOCHS, 1, 6)), Periodic(1.0))[1]
    phi, h, r = np.array([[1.0, 1], [0, 1]]), np.array([[1.0, 0]]), np.array([[SIGMA**2]])
    q = block.motion.process_noise(np.zeros(2), 1.0)
    fresh = np.diag([SIGMA**2, 0.002**2])
    for i in range(3):
        x, p, begun = np.array([measurement[0, i, 0], 0.0]), fresh, 0
        for k in range(1, EPOCHS):
            near = (phi @ x)[0]
            z = near + wrap(measurement[k, i] - near)
            _, (after, spread), _, nis, _ = textbook(x, p, phi, q, h, r, z)
            if k // piece > begun and np.isfinite(z[0]):
                after, spread, begun = np.array([z[0], (phi @ x)[1] if keep_rate else 0.0]), fresh, k // piece
            x, p = after, spread
            np.testing.assert_allclose(values["estimate"][k, i], x, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(values["covariance"][k, i], p, rtol=1e-8, atol=1e-15)
            np.testing.assert_allclose(values["nis"][k, i], nis, rtol=1e-8)
    assert values["estimate"][-1, 0, 0] > np.pi  # it has run on
    assert set(PORTS) <= set(values)
