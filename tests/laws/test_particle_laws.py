"""The laws for estimators that draw particles: what is exact for them, and what holds within their scatter.

Their draws are a function of the trial's number, so that a trial alone has to be told its number.
"""

import numpy as np
import pytest

from quietfix.systems.options.pf import Pf
from quietfix.systems.options.pf_sir import PfSir
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import SAMPLED
from tests.laws.rig import PORTS, Scene, assert_same, make, run, with_gaps

TRIALS, EPOCHS = 100, 5
PARTS = {"1": slice(37, 38), "7": slice(33, 40), "100": slice(0, 100)}
FEW = 300
CASES = {
    "pf": Pf(particles=FEW),
    "pf, stratified": Pf(particles=FEW, resampling="stratified"),
    "pf, residual": Pf(particles=FEW, resampling="residual"),
    "pf_sir": PfSir(particles=FEW),
    "pf_sir, multinomial": PfSir(particles=FEW, resampling="multinomial"),
}
each_case = pytest.mark.parametrize("name", CASES)


def run_part(scene, name, first=0, **changes):
    block = scene.estimator(name.partition(",")[0], CASES[name], **changes)
    return run(block, scene.measurement, scene.platforms, scene.clock, first_trial=first)[1]


def test_every_sampled_estimator_is_here():
    assert {name.partition(",")[0] for name in CASES} == set(SAMPLED)


@each_case
def test_a_trial_alone_is_that_trial_of_the_batch(name):
    """Batches of 1, 7 and 100, with gaps: the same draws, stages and resampling, and so the same bits."""
    scene = Scene(TRIALS, EPOCHS)
    scene.measurement = with_gaps(scene.measurement)
    batch = run_part(scene, name)
    assert np.isfinite(batch["estimate"]).all()
    for rows in PARTS.values():
        part = run_part(scene.only(rows), name, rows.start)
        assert_same(part, {port: values[:, rows] for port, values in batch.items()})


def test_sums_over_more_particles_than_a_buffer_holds(monkeypatch):
    """With 9000 particles two trials are worked on at once, and alone one."""
    monkeypatch.setitem(CASES, "pf, many", Pf(particles=9000))
    scene = Scene(3, 3)
    batch = run_part(scene, "pf, many")
    for rows in (slice(0, 1), slice(1, 3)):
        part = run_part(scene.only(rows), "pf, many", rows.start)
        assert_same(part, {port: values[:, rows] for port, values in batch.items()})


@each_case
def test_nothing_measured_is_the_motion_model(name):
    """Twenty epochs without a measurement: the moments are predicted, within the scatter of the process noise."""
    scene = Scene(5, 34)
    scene.measurement[4:24] = np.nan
    values = run_part(scene, name)
    assert np.isfinite(values["estimate"]).all() and np.isfinite(values["covariance"]).all()
    assert np.isnan(values["nis"][4:24]).all() and np.isnan(values["innovation"][4:24]).all()
    assert not values["nis_dof"][4:24].any() and np.isfinite(values["nis"][24:]).all()
    np.testing.assert_array_equal(values["estimate"][4:24], values["prediction"][4:24])
    # From the first prediction on (before it the cloud is resampled): 19 s of 0.1 m/s^2 are 4 m, of 300 particles
    # the mean scatters by 0.25 m; six of these.
    x = values["estimate"][4] + 19 * np.concatenate([values["estimate"][4][:, 3:], np.zeros((5, 3))], axis=-1)
    assert np.abs(values["estimate"][23] - x)[:, :3].max() < 1.5


@each_case
@pytest.mark.parametrize("what", ["measurement", "platforms", "mean", "covariance"])
def test_a_trial_that_is_nan_changes_no_other(name, what):
    scene = Scene(5, 6)
    scene.platforms = np.tile(scene.platforms, (1, 5, 1))
    scene.covariance = np.tile(scene.covariance, (5, 1, 1))
    clean = run_part(scene, name)
    broken = scene.only(slice(None))
    setattr(broken, what, getattr(scene, what).copy())
    if what in ("mean", "covariance"):
        getattr(broken, what)[3] = np.nan
    else:
        getattr(broken, what)[:, 3] = np.nan
    values = run_part(broken, name)
    others = np.arange(5) != 3
    for port in PORTS:
        np.testing.assert_allclose(values[port][:, others], clean[port][:, others], rtol=1e-9, err_msg=port)
    assert not values["nis_dof"][:, 3].any() and np.isnan(values["nis"][:, 3]).all()
    if what in ("mean", "covariance"):
        assert np.isnan(values["covariance"][:, 3]).all()
    else:
        assert np.isfinite(values["estimate"][:, 3]).all()


@each_case
def test_a_row_that_is_missing_is_left_out(name):
    """A platform that is lost, a variance that is NaN and a row that is NaN are the same."""
    scene = Scene(5, 6)
    gone = scene.model.platforms_used(3)[:, 2]
    blank = scene.only(slice(None))
    blank.measurement = scene.measurement.copy()
    blank.measurement[2:4, :, gone] = np.nan
    expected = run_part(blank, name)
    assert np.all(expected["nis_dof"][2:4] == 4) and np.all(expected["nis_dof"][4:] == 6)

    lost = scene.only(slice(None))
    lost.platforms = scene.platforms.copy()
    lost.platforms[2:4, :, 12:] = np.nan
    noise = np.tile(scene.model.noise_covariance(), (6, 5, 1, 1))
    noise[2:4, :, gone] = np.nan
    noise[2:4, :, :, gone] = np.nan
    block = scene.estimator(name.partition(",")[0], CASES[name], noise_port=True)
    inputs = {"noise_covariance": noise.reshape(6, 5, -1)}
    told = run(block, scene.measurement, scene.platforms, scene.clock, inputs=inputs)[1]
    for values in (run_part(lost, name), told):
        for port in PORTS:
            np.testing.assert_allclose(values[port], expected[port], rtol=1e-9, equal_nan=True, err_msg=port)


@each_case
def test_covariances_are_symmetric_and_definite(name):
    """Also those of a cloud of which one particle is left."""
    values = run_part(Scene(20, 6), name)
    for port in ("covariance", "prediction_covariance"):
        np.testing.assert_array_equal(values[port], np.swapaxes(values[port], -1, -2))
        sigma = np.sqrt(np.diagonal(values[port], axis1=-2, axis2=-1))
        np.linalg.cholesky(values[port] / (sigma[..., None] * sigma[..., None, :]))


@each_case
def test_other_trials_have_other_draws(name):
    scene = Scene(3, 2)
    scene.measurement[:] = scene.measurement[:, :1]
    start = GivenStart(scene.mean[:1], scene.covariance)
    values = run_part(scene, name, start=start)
    assert np.unique(values["estimate"][:, :, 0]).size == values["estimate"][:, :, 0].size


def test_ports():
    block = make("pf", Pf(particles=FEW), trials=3)
    for port in ("effective_particles", "ancestors", "evidence", "recent_evidence", "diverged", "stages", "restarts"):
        assert block.output_size(port) == (3, 1)
