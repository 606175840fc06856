"""Studies: the same numbers however they are cut, and a result that can be run again from itself."""

import math

import numpy as np
import pytest
import xarray as xr

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study

SHORT = ["duration_s=20"]


@pytest.fixture(scope="module")
def whole():
    return run_study("three_satellite", trials=6, seed=3, set=SHORT, keep="all")


def test_dimensions_and_attributes(whole):
    assert dict(whole.sizes) == {
        "trial": 6,
        "time": 21,
        "state": 6,
        "state_": 6,
        "estimator": 5,
        "row": 6,
        "innovation_row": 6,
        "integers_row": 2,
        "platform": 3,
        "coordinate": 6,
    }
    assert list(whole["estimator"].values) == ["iekf", "ekf", "ukf", "iekf_tdoa_fdoa_phase", "iekf_tdoa_phase"]
    assert list(whole["row"].values) == ["tdoa_10", "tdoa_20", "fdoa_10", "fdoa_20", "phase_a", "phase_b"]
    assert whole.attrs["system"] == "three_satellite" and whole.attrs["seed"] == 3
    assert np.isfinite(whole["estimate"]).all()
    assert (whole["nis_dof"].sel(estimator="iekf_tdoa_phase").isel(time=slice(1, None)) == 3).all()


@pytest.mark.parametrize("chunk", [1, 4])
def test_chunks_change_no_number(whole, chunk):
    again = run_study("three_satellite", trials=6, seed=3, set=SHORT, keep="all", chunk=chunk)
    for name in whole:
        # Fixed mathematics per trial and counter-based noise: equal to rounding, whatever the batch.
        np.testing.assert_allclose(again[name], whole[name], rtol=1e-9, atol=1e-9, err_msg=str(name))


def test_one_trial_alone(whole):
    alone = run_study("three_satellite", trials=1, first_trial=5, seed=3, set=SHORT, keep="all")
    np.testing.assert_array_equal(alone["measurement"].values[0], whole["measurement"].values[5])
    np.testing.assert_allclose(alone["estimate"].values[:, 0], whole["estimate"].values[:, 5], rtol=1e-9)


def test_another_seed_gives_other_noise(whole):
    other = run_study("three_satellite", trials=1, seed=4, set=SHORT, keep="all")
    assert not np.any(other["measurement"].values[0] == whole["measurement"].values[0])


def test_nees_is_that_of_the_kept_covariance(whole):
    error = (whole["estimate"] - whole["truth"]).values
    nees = np.einsum("...i,...i->...", error, np.linalg.solve(whole["covariance"].values, error[..., None])[..., 0])
    # The covariances mix metres and m/s and are nearly of rank one at the start, condition number 1e8.
    np.testing.assert_allclose(whole["nees"], nees, rtol=1e-6)


def test_every_keeps_epochs_and_the_last(whole):
    thin = run_study("three_satellite", trials=6, seed=3, set=SHORT, every=8)
    np.testing.assert_array_equal(thin["time"], [0, 8, 16, 20])
    np.testing.assert_array_equal(thin["estimate"], whole["estimate"].sel(time=thin["time"]))
    for name in ("bound_position", "bound_truth_velocity"):
        np.testing.assert_allclose(thin[name], whole[name].sel(time=thin["time"]), rtol=1e-12)


def test_bounds_of_fewer_measurements_are_larger(whole):
    last = whole["bound_position"].isel(time=-1)
    assert last.sel(estimator="iekf") <= last.sel(estimator="iekf_tdoa_fdoa_phase")
    assert last.sel(estimator="iekf_tdoa_fdoa_phase") < last.sel(estimator="iekf_tdoa_phase")
    assert (whole["bound_truth_position"] <= whole["bound_position"] * (1 + 1e-12)).all()
    assert last.sel(estimator="ekf") == last.sel(estimator="iekf")


def test_store_is_the_same_dataset(tmp_path, whole):
    study = Study("three_satellite", trials=6, seed=3, set=SHORT, keep="all", chunk=4)
    with OutputFolder(tmp_path / "out") as folder:
        for chunk in study.chunks():
            folder.append(chunk)
        folder.finish()
    assert not (tmp_path / "out.partial").exists()
    stored = open_result(tmp_path / "out")
    for name in whole:
        np.testing.assert_allclose(stored[name].transpose(*whole[name].dims), whole[name], rtol=1e-9, atol=1e-9)
    assert stored.attrs["scenario"] == whole.attrs["scenario"]


def test_interrupted_run_keeps_finished_chunks(tmp_path):
    study = Study("three_satellite", trials=12, set=["duration_s=3"], chunk=5)
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path / "out") as folder:
        for chunk in study.chunks():
            folder.append(chunk)
            if folder.chunks == 2:
                raise KeyboardInterrupt
    assert not (tmp_path / "out").exists()
    assert open_result(tmp_path / "out.partial").sizes["trial"] == 10


def test_nothing_finished_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError), OutputFolder(tmp_path / "out"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_folder_with_other_content_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("years of work")
    for overwrite in (False, True):
        with pytest.raises(UserError, match=r"thesis\.tex"):
            OutputFolder(tmp_path / "out", overwrite)
    assert (tmp_path / "out" / "thesis.tex").read_text() == "years of work"
    with pytest.raises(UserError, match="cannot be written"):
        OutputFolder(tmp_path / "out" / "thesis.tex" / "inside")
    with pytest.raises(UserError, match="not a folder"):
        OutputFolder(tmp_path / "out" / "thesis.tex")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"trials": 0}, "trials: 0"),
        ({"trials": -1}, "trials: -1"),
        ({"trials": 2.5}, "trials: 2.5"),
        ({"trials": True}, "trials: True"),
        ({"seed": -1}, "seed: -1"),
        ({"chunk": 0}, "chunk: 0"),
        ({"every": 0}, "every: 0"),
        ({"keep": "everything"}, "keep: everything"),
        ({"estimators": ["nobody"]}, "estimator: nobody"),
        ({"estimators": ["no.such.module:Thing"]}, "no.such.module"),
        ({"estimators": ["quietfix.diagrams.schema.errors:UserError"]}, "a subclass of"),
        ({"set": ["satellites=[]"]}, "satellites: 0 are given"),
        ({"set": ["truth.cross_km=4000"]}, "below 0 deg elevation"),
        ({"set": ["satellites.0.across_km=0", "belief.start=closed_form"]}, "belief.start: closed_form"),
        ({"set": ["truth.chain_m=[0.2, 0.9]"]}, "half a wavelength"),
        ({"set": ["estimators.iekf.measurements=[tdoa, smell]"]}, "smell"),
        ({"set": ["estimators.ukf.kappa=-7"]}, "kappa: -7"),
        ({"set": ["satellites.0=!PositionVelocity {position_km: [1, 2]}"]}, "position_km"),
        ({"set": ["satellites.0=!Kepler {semi_major_axis_km: 6000}"]}, "below the Earth's surface"),
    ],
)
def test_mistakes(options, words):
    with pytest.raises(UserError) as caught:
        run_study("three_satellite", **({"trials": 1} | options))
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_chunk_bounds_the_memory():
    study = Study("three_satellite", trials=10**6)
    floats = 5 * (6 + 3) + 6 + 6
    assert 100 <= study.chunk <= 2000
    # The log of a chunk stays under the stated 150 MB, so that three copies fit into the design's 1 GB.
    assert study.chunk * 151 * floats * 8 < 1.5e8


def test_users_own_filter_takes_part():
    result = run_study("three_satellite", estimators=["iekf", f"{__name__}:HalfGain"], trials=2, set=["duration_s=5"])
    assert list(result["estimator"].values) == ["iekf", "halfgain"]
    assert isinstance(result, xr.Dataset) and math.isfinite(result["estimate"].sum())


def __getattr__(name):
    """Define the user's class late: the registry imports this module by its name."""
    if name != "HalfGain":
        raise AttributeError(name)
    from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

    class HalfGain(IteratedExtendedKalman):
        def update(self, mean, *rest):
            result = super().update(mean, *rest)
            return result._replace(mean=0.5 * (mean + result.mean))

    return HalfGain
