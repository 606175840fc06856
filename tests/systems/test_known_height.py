"""The known-height TDOA fix and its covariance, against placed targets and Monte Carlo."""

import numpy as np
import pytest

from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.fixes.known_height import (
    DegenerateFormationError,
    has_closed_form,
    known_height_covariance,
    known_height_fix,
    position_per_velocity,
    wave_front_fix,
)
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.starts.known_height_start import KnownHeightStart
from tests.laws.cases import PASS, PLACES, place, satellites, six, tdoa

MIDDLE = satellites(PASS / 2)[None]


def visible_targets(count, height, reach=1200e3, formation="tri"):
    """Random targets that all three satellites see."""
    rng = np.random.default_rng(17)
    targets = place(*rng.uniform(-reach, reach, (2, 2 * count)), height, rng.uniform(0, 360, 2 * count))
    seen = ElevationMask().visible(targets, satellites(PASS / 2, formation)[None]).all(axis=-1)
    assert seen.sum() >= count
    return targets[seen][:count]


@pytest.mark.parametrize("method", ["auto", "closed_form", "newton"])
@pytest.mark.parametrize("height", [0.0, 10e3])
def test_four_hundred_targets(height, method):
    """Every one within a micrometre: nothing is lost, and no wrong root is taken."""
    targets = visible_targets(400, height)
    fix = known_height_fix(tdoa().predict(targets, MIDDLE), MIDDLE, np.full(400, height), method)
    # A delay of 1e-4 s in a double is good to 1e-20 s; geometry dilutes 4e-12 m to some 1e-8 m.
    assert np.abs(fix - targets[:, :3]).max() < 1e-6
    np.testing.assert_allclose(ecef_to_geodetic(fix)[2], height, atol=1e-6)


def test_from_a_prediction():
    """A filter's prediction tens of kilometres off leads to the same place."""
    targets = visible_targets(400, 8e3)
    start = targets[:, :3] + np.random.default_rng(3).normal(size=(400, 3)) * 30e3
    fix = known_height_fix(tdoa().predict(targets, MIDDLE), MIDDLE, np.full(400, 8e3), start=start)
    assert np.abs(fix - targets[:, :3]).max() < 1e-6


def test_both_ways_agree_with_noise():
    """What the receivers say is not exact: quartic and Newton still mean the same place."""
    targets = visible_targets(400, 10e3)
    rng = np.random.default_rng(5)
    delays = tdoa().predict(targets, MIDDLE) + 20e-9 * rng.normal(size=(400, 2))
    height = 10e3 + 3e3 * rng.normal(size=400)
    a, b = (known_height_fix(delays, MIDDLE, height, method) for method in ("closed_form", "newton"))
    np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
    assert np.nanmax(np.abs(a - b)) < 1e-5
    assert np.isfinite(a).all(axis=-1).mean() > 0.99  # some targets at the horizon lie below it when moved


def test_collinear_formation():
    line = satellites(PASS / 2, "line")[None]
    targets = place(*np.array(list(PLACES.values())[1:]).T)
    delays = tdoa().predict(targets, line)
    assert not has_closed_form(line).any() and has_closed_form(MIDDLE).all()
    with pytest.raises(DegenerateFormationError, match="closed form"):
        known_height_fix(delays, line, np.full(3, 10e3), "closed_form")
    fix = known_height_fix(delays, line, np.full(3, 10e3), "auto")
    # The target's mirror image on the other side of the track has the same delays, to what the turning Earth and
    # the ellipsoid leave of the symmetry; the start decides which one is found.
    found = tdoa().predict(np.concatenate([fix, np.zeros((3, 3))], axis=-1), line)
    np.testing.assert_allclose(found, delays, rtol=0, atol=1e-15)
    np.testing.assert_allclose(ecef_to_geodetic(fix)[2], 10e3, atol=1e-5)


def test_plane_through_the_centre_of_the_earth():
    flat = MIDDLE.copy()
    flat[0, 0, :3] = 0.6 * flat[0, 1, :3] + 0.5 * flat[0, 2, :3]
    assert not has_closed_form(flat).any()
    with pytest.raises(DegenerateFormationError):
        known_height_fix(np.zeros((1, 2)), flat, np.zeros(1), "closed_form")


def test_every_trial_for_itself():
    """NaN, impossible delays, a degenerate or a lost formation in one trial leave the others as they are."""
    targets = visible_targets(8, 10e3)
    own = np.tile(MIDDLE, (8, 1, 1))
    own[3] = satellites(PASS / 2, "line")
    own[5] = np.nan
    delays = tdoa().predict(targets, np.where(np.isnan(own), MIDDLE, own))
    height = np.full(8, 10e3)
    clean = known_height_fix(delays, np.where(np.isnan(own), MIDDLE, own), height)
    delays[1] = np.nan
    delays[2] = 1.0  # a light second between satellites 100 km apart
    height[6] = np.nan
    with np.errstate(all="raise"):
        fix = known_height_fix(delays, own, height)
    bad = [1, 2, 5, 6]
    assert np.isnan(fix[bad]).all()
    good = [0, 3, 4, 7]
    np.testing.assert_array_equal(fix[good], clean[good])
    assert np.abs(fix[[0, 4, 7]] - targets[[0, 4, 7], :3]).max() < 1e-6
    for i in good:
        alone = known_height_fix(delays[i : i + 1], own[i : i + 1], height[i : i + 1])
        assert np.abs(alone - fix[i]).max() < 1e-6


@pytest.mark.parametrize("method", ["closed_form", "newton"])
def test_a_direction_that_misses_the_earth_has_no_solution(method):
    """The delays of something in space beyond the horizon."""
    beyond = place(4000e3, 500e3, height=1500e3)
    fix = known_height_fix(tdoa().predict(beyond[None], MIDDLE), MIDDLE, np.full(1, 10e3), method)
    assert np.isnan(fix).all()


def test_all_three_must_see_it():
    """At the horizon of one of them there is a place that two see: no fix there."""
    targets = place(np.linspace(2600e3, 2900e3, 200), np.zeros(200))
    seen = ElevationMask().visible(targets, MIDDLE)
    some, everyone = seen.any(axis=-1) & ~seen.all(axis=-1), seen.all(axis=-1)
    assert some.sum() > 2 and everyone.sum() > 2
    fix = known_height_fix(tdoa().predict(targets, MIDDLE), MIDDLE, np.full(200, 10e3), start=targets[:, :3])
    assert np.isnan(fix[some]).all()
    np.testing.assert_allclose(fix[everyone], targets[everyone, :3], atol=1e-3)  # grazing: height over range is flat


# ------------------------------------------------------------------------------------------------ covariance P1

# Reference (a), at mid pass: 20 ns, 3 km, 10 m per axis. sqrt tr P1 [m], of which TDOA alone, satellites, height.
TABLE = {
    "(0,50)": (3039, 86, 176, 3032),
    "(0,300)": (3446, 103, 223, 3437),
    "(150,-500)": (3834, 123, 280, 3822),
    "(-300,700)": (5213, 218, 525, 5182),
}


@pytest.mark.parametrize("where", PLACES)
def test_size_as_the_reference_has_it(where):
    target = place(*PLACES[where])
    tiny = 1e-9

    def spread(delay, height, satellite):
        return np.sqrt(np.trace(known_height_covariance(target, MIDDLE[0], delay, height, satellite)))

    values = (spread(20e-9, 3e3, 10.0), spread(20e-9, tiny, 0.0), spread(1e-16, tiny, 10.0), spread(1e-16, 3e3, 0.0))
    np.testing.assert_allclose(values, TABLE[where], rtol=0.01)


@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
@pytest.mark.parametrize("where", PLACES)
def test_covariance_explains_the_errors(where, correlated):
    """NEES of 1000 drawn starts: mean 3, and 2.7 to 3.3 is four standard deviations of it, sqrt(6/1000) = 0.077."""
    draws = 1000
    rng = np.random.default_rng(23)
    target, model = place(*PLACES[where]), tdoa(correlated=correlated)
    root = np.linalg.cholesky(model.noise_covariance())
    true = MIDDLE + np.concatenate([10.0 * rng.normal(size=(draws, 3, 3)), np.zeros((draws, 3, 3))], axis=-1)
    delays = model.predict(np.broadcast_to(target, (draws, 6)), true) + rng.normal(size=(draws, 2)) @ root.T
    height = 10e3 + 3e3 * rng.normal(size=draws)
    start = KnownHeightStart(model, six().names, 3e3, 400.0, 10.0)
    measurement = np.concatenate([delays, np.full((draws, 4), np.nan)], axis=-1)
    mean, covariance = start.begin(measurement, MIDDLE, {"assumed_height": height[:, None]})
    error = mean[:, :3] - target[:3]
    whitened = np.linalg.solve(np.linalg.cholesky(covariance[:, :3, :3]), error[..., None])[..., 0]
    assert 2.7 < (whitened**2).sum(axis=-1).mean() < 3.3
    # and not only on average: each of the three directions, TDOA and height, has its own variance right
    np.testing.assert_allclose(whitened.var(axis=0), 1.0, atol=5 * np.sqrt(2 / draws))
    assert np.abs(whitened.mean(axis=0)).max() < 5 / np.sqrt(draws)
    np.testing.assert_allclose(
        np.sqrt((error**2).sum(axis=-1).mean()),
        np.sqrt(np.trace(start.covariance_at(target, MIDDLE[0])[:3, :3])),
        rtol=0.08,
    )
    # the ignorance of the velocity is what was asked for, and nothing ties it to the place
    np.testing.assert_array_equal(covariance[:, 3:, 3:], np.broadcast_to(400.0**2 * np.eye(3), (draws, 3, 3)))
    assert not covariance[:, :3, 3:].any() and not mean[:, 3:].any()


@pytest.mark.parametrize("method", ["auto", "newton"])
def test_one_wave_front_gives_the_place(method):
    """With the right velocity to a micrometre; geometry of one instant is tens of metres off."""
    targets, model = visible_targets(400, 10e3), tdoa(light_time=True)
    delays, height = model.predict(targets, MIDDLE), np.full(400, 10e3)
    fix = wave_front_fix(model, delays, MIDDLE, height, method, velocity=targets[:, 3:])
    assert np.abs(fix - targets[:, :3]).max() < 1e-6
    assert np.abs(known_height_fix(delays, MIDDLE, height, method) - targets[:, :3]).max() > 30
    # the velocity left out: off by what the slope says
    off = targets[:, :3] - wave_front_fix(model, delays, MIDDLE, height, method)
    slope = position_per_velocity(model, targets, MIDDLE)
    np.testing.assert_allclose((slope @ targets[:, 3:, None])[..., 0], off, rtol=0.01, atol=0.02)
    assert np.abs(off).max() > 0.3


@pytest.mark.parametrize("time", [0.0, 75.0, 150.0])
@pytest.mark.parametrize("where", PLACES)
def test_nees_of_a_start_from_one_wave_front(where, time):
    """TDOA to 1 ns, velocity as believed: 3 in position, 6 in all, of 4000 starts within four standard deviations.

    Geometry of one instant had 3.0 to 9.6 here.
    """
    draws, sigma = 4000, 1e-9
    rng = np.random.default_rng(29)
    target, carriers, model = (
        np.tile(place(*PLACES[where]), (draws, 1)),
        satellites(time)[None],
        Tdoa(sigma, light_time=True),
    )
    target[:, 3:] = 400.0 * rng.normal(size=(draws, 3))
    delays = model.predict(target, carriers) + sigma * rng.normal(size=(draws, 2))
    height = 10e3 + 3e3 * rng.normal(size=draws)
    start = KnownHeightStart(model, model.names, 3e3, 400.0)
    mean, covariance = start.begin(delays, carriers, {"assumed_height": height[:, None]})
    for size in (3, 6):
        error, spread = (mean - target)[:, :size], covariance[:, :size, :size]
        nees = np.einsum("ti,ti->t", error, np.linalg.solve(spread, error[..., None])[..., 0])
        assert abs(nees.mean() - size) < 4 * np.sqrt(2 * size / draws)


def test_covariance_of_no_fix_is_nan_and_of_the_others_not():
    targets = visible_targets(3, 10e3)
    targets[1] = np.nan
    covariance = known_height_covariance(targets, MIDDLE, 20e-9, 3e3)
    assert np.isnan(covariance[1]).all() and np.isfinite(covariance[[0, 2]]).all()
    np.testing.assert_array_equal(covariance[0], covariance[0].T)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma_height": 0.0}, "sigma_height"),
        ({"sigma_height": np.nan}, "sigma_height"),
        ({"sigma_velocity": -1.0}, "sigma_velocity"),
        ({"sigma_satellite": -1.0}, "sigma_satellite"),
        ({"sigma_satellite": np.nan}, "sigma_satellite"),
        ({"stream": ["tdoa_10"]}, "tdoa_20"),
        ({"tdoa": tdoa(receivers=(1,))}, "two TDOAs"),
    ],
)
def test_bad_arguments(change, message):
    good = {"tdoa": tdoa(), "stream": six().names, "sigma_height": 3e3, "sigma_velocity": 400.0}
    with pytest.raises(ValueError, match=message):
        KnownHeightStart(**(good | change))
