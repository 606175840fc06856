"""What has trials of its own and what all share: known from the wiring, whatever the chunks and their sizes."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study

CASES = {
    "random truth": ("three_satellite", {"truth.motion": "!RandomAcceleration {}", "duration_s": 3}),
    "shared truth": ("three_satellite", {"duration_s": 3}),
    "errors": (
        "three_satellite",
        {"truth.errors.drop_out_rate": 0.3, "truth.errors.sigma_platform_position_m": 5, "duration_s": 3},
    ),
    "random place": ("bearing_crossing", {"duration_s": 30}),
    "bias per run": ("beacon_rocket", {"stop_s": 51}),
    "own satellites": ("satellite_ranging", {"duration_s": 60}),
    "clouds": ("dual_satellite", {"duration_s": 3}),
}
ESTIMATORS = {"bearing_crossing": ["ekf", "raw_lines"], "satellite_ranging": ["ra", "ukf"], "dual_satellite": ["iekf"]}


def study(case, **options):
    name, settings = CASES[case]
    estimators = ESTIMATORS.get(name)
    return {"system": name, "estimators": estimators, "set": settings, "seed": 5, "keep": "all"} | options


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("chunk", [1, 4])
def test_a_chunk_changes_no_dimension_and_no_number(case, chunk):
    """Chunks of one trial, and a last chunk of one (5 = 4 + 1)."""
    whole = run_study(**study(case, trials=5))
    cut = run_study(**study(case, trials=5, chunk=chunk))
    assert {name: cut[name].dims for name in cut} == {name: whole[name].dims for name in whole}
    for name in whole:
        # the same operations on the same numbers: rounding of the batched linear algebra at most
        np.testing.assert_allclose(cut[name], whole[name], rtol=1e-6, atol=1e-9, err_msg=str(name))


@pytest.mark.parametrize("case", CASES)
def test_a_study_of_one_trial_has_the_dimensions_of_a_hundred(case):
    one = run_study(**study(case, trials=1, first_trial=2))
    three = run_study(**study(case, trials=3))
    assert {name: one[name].dims for name in one} == {name: three[name].dims for name in three}
    np.testing.assert_array_equal(one["measurement"].values[0], three["measurement"].values[2])


def test_each_trial_keeps_its_own_truth():
    """Six trials one by one: six truths, and errors that are theirs."""
    whole = run_study(**study("random truth", trials=6, chunk=1))
    assert whole["truth"].dims == ("trial", "time", "state")
    assert np.unique(whole["truth"].isel(time=-1, state=0)).size == 6


@pytest.mark.parametrize("case", ["errors", "random truth"])
def test_a_store_with_a_last_chunk_of_one_trial_can_be_read(tmp_path, case):
    with OutputFolder(tmp_path / "z") as folder:
        for chunk in Study(**study(case, trials=9, chunk=4)).chunks():
            folder.append(chunk)
        folder.finish()
    whole, stored = run_study(**study(case, trials=9)), open_result(tmp_path / "z")
    assert stored["integers"].sizes["trial"] == 9
    for name in whole:
        np.testing.assert_allclose(stored[name].transpose(*whole[name].dims), whole[name], rtol=1e-6, atol=1e-9)
