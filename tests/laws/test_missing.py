"""A row that is NaN is left out in its trial, and nowhere else."""

import numpy as np
import pytest

from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from tests.laws.cases import FILTERS, SEVERAL_MOTIONS, estimators, fdoa, phase, tdoa
from tests.laws.rig import PORTS, Scene

TRIALS = 5


def close(a, b, sigma, tolerance=1e-9):
    """Whether two means agree in units of their own standard deviation."""
    return np.nanmax(np.abs(a - b) / sigma) < tolerance


def deviations(values):
    return np.sqrt(np.diagonal(values["covariance"], axis1=-2, axis2=-1))


# A row that is taken out leaves a model without it: correlated rows need the sub-block of R, and so a new whitener.
WITHOUT = {
    "both phases": ([4, 5], Stack([tdoa(), fdoa()])),
    "one phase": ([4], Stack([tdoa(), fdoa(), phase(axes=["b"])])),
    "one of two correlated delays": (
        [0],
        Stack([tdoa(correlated=True, receivers=(2,)), fdoa(correlated=True), phase()]),
    ),
    "a receiver": (
        [1, 3],
        Stack([tdoa(correlated=True, receivers=(1,)), fdoa(correlated=True, receivers=(1,)), phase()]),
    ),
    "all but one": ([0, 1, 2, 4, 5], Stack([fdoa(receivers=(2,))])),
}


@pytest.mark.parametrize("case", WITHOUT)
@pytest.mark.parametrize("name", FILTERS)
def test_bare_filter_without_the_rows(name, case):
    gone, short = WITHOUT[case]
    correlated = "correlated" in case or "receiver" in case
    model = Stack([tdoa(correlated=correlated), fdoa(correlated=correlated), phase()])
    scene = Scene(TRIALS, 1, model=model)
    algorithm = FILTERS[name]
    measurement = scene.measurement[0].copy()
    measurement[2, gone] = np.nan
    covariance = np.broadcast_to(scene.covariance, (TRIALS, 6, 6))
    platforms = scene.platforms[0].reshape(1, 3, 6)

    def update(model, rows, trials):
        whitener = Whitener(model.noise_covariance())
        return algorithm.update(
            scene.mean[trials],
            covariance[trials],
            Observation(measurement[trials][:, rows], platforms, whitener),
            model,
        )

    everything = slice(None)
    batch = update(model, everything, everything)
    kept = [row for row in range(6) if row not in gone]
    alone = update(short, kept, slice(2, 3))
    sigma = np.sqrt(np.diagonal(alone.covariance[0]))
    # the innovation of an unscented filter is a mean over sigma points: rounding of 1e6 m in a delay of 1e-4 s
    tolerance = 1e-7 if "alpha 0.1" in name else 1e-9
    assert close(batch.mean[2], alone.mean[0], sigma, tolerance)
    assert np.abs((batch.covariance[2] - alone.covariance[0]) / np.outer(sigma, sigma)).max() < tolerance
    assert np.isnan(batch.innovation[2, gone]).all()
    noise = model.sigmas[kept]
    np.testing.assert_allclose(
        batch.innovation[2, kept] / noise, alone.innovation[0] / noise, rtol=tolerance, atol=1e-6
    )
    np.testing.assert_allclose(batch.nis[2], alone.nis[0], rtol=1e-6)
    assert batch.nis_dof[2] == len(kept) and np.all(np.delete(batch.nis_dof, 2) == 6)

    # and the other trials are as if nothing were missing
    measurement[2] = scene.measurement[0, 2]
    whole = update(model, everything, everything)
    others = np.arange(TRIALS) != 2
    assert close(batch.mean[others], whole.mean[others], sigma)
    np.testing.assert_allclose(batch.nis[others], whole.nis[others], rtol=1e-9)


@pytest.mark.parametrize("name", estimators())
def test_every_row_missing_for_twenty_epochs(name):
    """Nothing but the motion model then: mean and covariance are predicted 20 times, and the filter comes back."""
    options = estimators()[name]
    scene = Scene(TRIALS, 45)
    scene.measurement[10:30] = np.nan
    values = scene.run(name, options)
    assert np.isfinite(values["estimate"]).all() and np.isfinite(values["covariance"]).all()
    assert np.isnan(values["nis"][10:30]).all() and np.isnan(values["innovation"][10:30]).all()
    assert not values["nis_dof"][10:30].any()
    phi, q = scene.motion.transition(scene.mean, 1.0), scene.motion.process_noise(scene.mean, 1.0)
    x, p = values["estimate"][9], values["covariance"][9]
    for k in range(10, 30):
        x, p = x @ phi.T, phi @ p @ phi.T + q
        sigma = np.sqrt(np.diagonal(p, axis1=-2, axis2=-1))
        assert close(values["estimate"][k], x, sigma)
        assert close(values["prediction"][k], x, sigma)
        if name.split()[0] not in SEVERAL_MOTIONS:
            assert np.abs((values["covariance"][k] - p) / (sigma[..., None] * sigma[..., None, :])).max() < 1e-9
    assert np.isfinite(values["nis"][30:]).all()
    error = np.linalg.norm((values["estimate"][-1] - scene.truth[-1]) / deviations(values)[-1], axis=-1)
    assert np.all(error < 6)  # six sigma in six dimensions: probability 1e-6 for a filter that is consistent


@pytest.mark.parametrize("what", ["measurement", "platforms", "mean", "covariance"])
@pytest.mark.parametrize("name", estimators())
def test_a_trial_that_is_nan_changes_no_other(name, what):
    """Nothing measured, carriers unknown, no start, or a belief that is lost: the other trials go on."""
    options = estimators()[name]
    scene = Scene(TRIALS, 20)
    scene.platforms = np.tile(scene.platforms, (1, TRIALS, 1))
    scene.covariance = np.tile(scene.covariance, (TRIALS, 1, 1))
    clean = scene.run(name, options)
    broken = scene.only(slice(None))
    setattr(broken, what, getattr(scene, what).copy())
    if what in ("mean", "covariance"):
        getattr(broken, what)[3] = np.nan
    else:
        getattr(broken, what)[:, 3] = np.nan
    values = broken.run(name, options)
    others = np.arange(TRIALS) != 3
    tolerance = getattr(options, "tolerance", 1e-6) if getattr(options, "max_iterations", 1) > 1 else None
    sigma = deviations(clean)[:, others]
    for port in ("estimate", "prediction"):
        difference = np.abs(values[port][:, others] - clean[port][:, others])
        assert np.all(difference <= (tolerance or 1e-9 * sigma))
    np.testing.assert_allclose(values["covariance"][:, others], clean["covariance"][:, others], rtol=1e-5)
    np.testing.assert_array_equal(values["nis_dof"][:, others], clean["nis_dof"][:, others])
    if what == "covariance":
        assert np.isnan(values["covariance"][:, 3]).all()
        return
    assert not values["nis_dof"][:, 3].any() and np.isnan(values["nis"][:, 3]).all()
    if what == "mean":
        assert np.isnan(values["estimate"][:, 3]).all()
    else:
        x = broken.mean[3] + np.arange(20)[:, None] * np.concatenate([broken.mean[3, 3:], np.zeros(3)])
        np.testing.assert_allclose(values["estimate"][:, 3], x, rtol=1e-12)


@pytest.mark.parametrize("name", estimators())
def test_a_platform_that_is_nan_takes_its_rows_and_no_more(name):
    """Satellite 2 is lost for a while: rows against it go, the others are used."""
    options = estimators()[name]
    scene = Scene(TRIALS, 20)
    lost = scene.only(slice(None))
    lost.platforms = scene.platforms.copy()
    lost.platforms[8:12, :, 12:] = np.nan
    blank = scene.only(slice(None))
    blank.measurement = scene.measurement.copy()
    blank.measurement[8:12][..., scene.model.platforms_used(3)[:, 2]] = np.nan
    assert np.isnan(blank.measurement[8]).sum() == 2 * TRIALS
    a, b = lost.run(name, options), blank.run(name, options)
    for port in PORTS:
        np.testing.assert_allclose(a[port], b[port], rtol=1e-12, equal_nan=True)
    assert np.all(a["nis_dof"][8:12] == 4) and np.all(a["nis_dof"][12:] == 6)


@pytest.mark.parametrize("name", FILTERS)
def test_infinite_is_missing(name):
    scene = Scene(TRIALS, 1)
    whitener = Whitener(scene.model.noise_covariance())
    covariance = np.broadcast_to(scene.covariance, (TRIALS, 6, 6))
    results = []
    for bad in (np.inf, -np.inf, np.nan):
        measurement = scene.measurement[0].copy()
        measurement[1, 2] = bad
        platforms = scene.platforms[0].reshape(1, 3, 6)
        results.append(
            FILTERS[name].update(scene.mean, covariance, Observation(measurement, platforms, whitener), scene.model)
        )
    for result in results[:2]:
        for value, expected in zip(result, results[2], strict=True):
            np.testing.assert_array_equal(value, expected)


class Fragile(Altitude):
    """Reads nothing below sea level: a model that a filter's iterations can leave."""

    def linearize(self, target, platforms):
        value, jacobian = super().linearize(target, platforms)
        below = value < 0.0
        return np.where(below, np.nan, value), np.where(below[..., None], np.nan, jacobian)


@pytest.mark.parametrize("name", FILTERS)
def test_an_iteration_that_leaves_the_model_hurts_no_other_trial(name):
    """Trial 1 is thrown 20 km down by its first iteration, where the model has no value."""
    model = Stack([Fragile(1.0)])
    scene = Scene(3, 1, model=model)
    measurement = scene.measurement[0].copy()
    measurement[1] = -10e3
    covariance = np.broadcast_to(scene.covariance, (3, 6, 6))
    platforms = scene.platforms[0].reshape(1, 3, 6)
    whitener = Whitener(model.noise_covariance())
    batch = FILTERS[name].update(scene.mean, covariance, Observation(measurement, platforms, whitener), model)
    others = [0, 2]
    alone = FILTERS[name].update(
        scene.mean[others], covariance[others], Observation(measurement[others], platforms, whitener), model
    )
    np.testing.assert_allclose(batch.mean[others], alone.mean, rtol=1e-14)
    np.testing.assert_allclose(batch.covariance[others], alone.covariance, rtol=1e-9)
    assert np.isfinite(batch.mean).all() and np.isfinite(batch.covariance).all()


@pytest.mark.parametrize("name", estimators())
def test_noise_covariance_with_gaps(name):
    """Where R comes with the measurement, a variance that is NaN is a row that is not there."""
    options = estimators()[name]
    scene = Scene(TRIALS, 6)
    rows = scene.model.size
    r = np.tile(scene.model.noise_covariance().ravel(), (6, TRIALS, 1)).reshape(6, TRIALS, rows, rows)
    r[2, 1, 3, :], r[2, 1, :, 3] = np.nan, np.nan
    r[3, 4] = np.nan
    blank = scene.only(slice(None))
    blank.measurement = scene.measurement.copy()
    blank.measurement[2, 1, 3] = np.nan
    blank.measurement[3, 4] = np.nan
    a = scene.run_with_noise(name, options, r)
    b = blank.run(name, options)
    tolerance = getattr(options, "tolerance", 0.0) if getattr(options, "max_iterations", 1) > 1 else 1e-6
    np.testing.assert_allclose(a["estimate"], b["estimate"], rtol=0, atol=tolerance)
    np.testing.assert_array_equal(a["nis_dof"], b["nis_dof"])
    assert a["nis_dof"][2, 1] == 5 and a["nis_dof"][3, 4] == 0
