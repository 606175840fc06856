"""Satellite ranging end to end: wiring, mistakes, and the numbers that it must show."""

import sys

import numpy as np
import pytest

from quietfix.diagrams import load_scenario, run_study
from quietfix.diagrams.library.models import satellite_ranging as satellite_ranging_models
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.consistency import nees_statistics
from quietfix.diagrams.statistics.metrics import armse, convergence_time, diverged, median, rmse, summarise
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.study import Study
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.plants.recorded import hermite
from quietfix.systems.sensors.preview import Preview
from tests.systems.ranging_scene import EARTH, OBSERVER, PRIOR, SIGMAS, TARGET

NAME = "satellite_ranging"
KM = 1e3


def curves(result, name):
    """RMSE and median of one estimator's position [km]."""
    error = errors(result)["position"].sel(estimator=name, drop=True)
    return rmse(error).values / KM, median(error).values / KM


def at(result, curve, *times):
    """Values of a curve at some times [s]."""
    return [float(curve[int(np.flatnonzero(result["time"].values == time)[0])]) for time in times]


def converged(result, curve):
    return convergence_time(result["time"].values, KM * curve, result.attrs["convergence_m"])


def within(values, bands):
    return all(low <= value <= high for value, (low, high) in zip(values, bands, strict=True))


# ----------------------------------------------------------------------------------------------- scenario, wiring


def test_the_packaged_scenario_is_the_papers():
    scenario = load_scenario(NAME)
    observer, target = satellite_ranging_models.initial_states(scenario)
    np.testing.assert_allclose(target, TARGET, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(observer, OBSERVER, rtol=1e-12, atol=1e-6)
    np.testing.assert_array_equal(satellite_ranging_models.prior_covariance(scenario), PRIOR)
    np.testing.assert_allclose(satellite_ranging_models.true_sensor(scenario).sigmas, SIGMAS)
    assert (
        satellite_ranging_models.gravity(scenario).mu == EARTH.mu
        and scenario.duration_s == 5000
        and scenario.period_s == 10
    )
    assert list(scenario.estimators) == ["ra", "ra_look_ahead", "ra_paper", "bo", "bcr", "iekf", "ukf", "bank"]


@pytest.mark.parametrize("variant", [None, "j2", "mismatch", "occulted", "polar"])
def test_every_variant_runs(variant):
    result = run_study(NAME, variant=variant, trials=3, set={"duration_s": 300})
    assert result.attrs["frame"] == "inertial"
    assert np.isfinite(result["estimate"].values).all()
    summary = summarise(result)
    assert summary["iekf"]["rmse_height_m"][-1] is None and summary["iekf"]["rmse_course_deg"][-1] is None
    assert summary["iekf"]["rmse_position_m"][-1] < 60 * KM
    assert summary["ra"]["causal"] and not summary["ra_look_ahead"]["causal"]
    assert summary["iekf"]["bound_position_m"][-1] > 0 and summary["iekf"]["bound_height_m"][-1] is None


def test_looking_ahead_is_a_block_that_is_seen():
    for names, expected in ((["ra", "iekf"], 0), (["ra_look_ahead"], 1)):
        diagram, _ = Study(NAME, estimators=names, trials=1).diagram()
        assert sum(isinstance(block, Preview) for block in diagram.GetSystems()) == expected


def test_no_estimator_reads_the_truth():
    diagram, wired = Study(NAME, trials=1).diagram()
    truths = {wired.truth.get_system().get_name()}
    for (reader, port), (source, _) in diagram.connection_map().items():
        if reader.get_name() in wired.estimators:
            assert source.get_name() not in truths, (reader.get_name(), port)


def test_a_study_is_paired_and_trials_can_be_run_alone():
    names = ["ra", "iekf", "bank"]
    together = run_study(NAME, estimators=names, trials=4, set={"duration_s": 250})
    alone = run_study(NAME, estimators=names[:2], trials=1, first_trial=2, set={"duration_s": 250})
    for name in names[:2]:
        one, other = (r["estimate"].sel(estimator=name, trial=2).values for r in (alone, together))
        np.testing.assert_allclose(one, other, rtol=0, atol=0.1)  # of 8 to 50 km of error


def test_any_filter_takes_the_ranged_position_from_a_port():
    """An ordinary EKF on the ranging block's position and its covariance, root next to the prediction."""
    scenario = load_scenario(NAME)
    scenario.estimators = {"position": Ekf(measurements=["position"])}
    scenario.duration_s = 600.0
    result = run_study(NAME, scenario=scenario, trials=20, keep="measurements")
    assert result["measurement"].shape[-1] == 6
    assert curves(result, "position")[1][-1] < 60  # RA's bound is 29 km here; a wrong root is 6000 km off
    np.testing.assert_allclose(result["bound_position"].values[0, 50] / KM, 31.0, atol=0.1)


def test_an_error_of_the_observers_position():
    plain = run_study(NAME, estimators=["iekf"], trials=10, set={"duration_s": 600})
    settings = {"duration_s": 600, "truth.sigma_observer_m": 30e3}
    moved = run_study(NAME, estimators=["iekf"], trials=10, set=settings)
    assert curves(moved, "iekf")[1][-1] > 2 * curves(plain, "iekf")[1][-1]
    tiny = {"duration_s": 600, "truth.sigma_observer_m": 1.0, "truth.sigma_observer_mps": 1e-3}
    near = run_study(NAME, estimators=["iekf", "ra_look_ahead"], trials=10, set=tiny)
    np.testing.assert_allclose(curves(near, "iekf")[0][-1], curves(plain, "iekf")[0][-1], rtol=0.01)


def test_the_papers_propagation_is_an_option():
    settings = {"duration_s": 600, "belief.propagation": "second_order"}
    taylor = run_study(NAME, estimators=["ra_look_ahead"], trials=5, set=settings)
    exact = run_study(NAME, estimators=["ra_look_ahead"], trials=5, set={"duration_s": 600})
    one, other = (curves(result, "ra_look_ahead")[0] for result in (taylor, exact))
    assert 0 < np.abs(one - other).max() < 0.2  # km: harmless without process noise, as the reference says


def test_the_cost_in_python_calls_does_not_grow_with_the_trials():
    """One diagram with 50 trials is stepped like one with a single trial."""

    def calls(trials):
        study = Study(
            NAME, estimators=["ra", "iekf"], trials=trials, set={"duration_s": 300, "estimators.iekf.max_iterations": 1}
        )
        counted = 0

        def count(frame, event, argument):
            nonlocal counted
            counted += event == "call"

        sys.setprofile(count)
        try:
            list(study.chunks())
        finally:
            sys.setprofile(None)
        return counted

    few, many = calls(1), calls(50)
    # the clustering, once a run, walks through the trials: about 200 calls each
    assert many < 1.3 * few + 50 * 400


# ------------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"target.eccentricity": 1.2}, "target.eccentricity: 1.2 is not allowed; 0 <= eccentricity < 1"),
        ({"target.semi_major_axis_km": 6300}, "inside it"),
        ({"observer.eccentricity": 0.8}, "the perigee is 4400 km from the centre of the Earth, inside it"),
        ({"target.inclination_deg": 72, "target.raan_deg": 30}, "coplanar orbits are not observable by this method"),
        ({"target.inclination_deg": 108, "target.raan_deg": 210}, "coplanar orbits are not observable"),
        ({"estimators.bo.measurements": "[range]"}, "range is not allowed; any of angles, rates"),
        ({"estimators.ra.measurements": "[angles]"}, "ranging needs all rows"),
        ({"truth.sigma_angle_mrad": 0}, "truth.sigma_angle_mrad: 0 is not allowed"),
        ({"belief.propagation": "euler"}, "belief.propagation: 'euler' is not allowed"),
        ({"duration_s": 180}, "duration_s: 180 is not allowed; ra_look_ahead looks ahead, at least 190 s are needed"),
        ({"estimators.ra.plane_epochs": 1}, "estimators.ra.plane_epochs: 1 is not allowed"),
    ],
)
def test_mistakes_are_one_clear_line(settings, words):
    with pytest.raises(UserError) as caught:
        Study(NAME, trials=1, set=settings)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_recorded_truth_without_data(monkeypatch):
    monkeypatch.setenv("QUIETFIX_DATA", "/nowhere")
    with pytest.raises(UserError, match=r"QUIETFIX_DATA names \(/nowhere\); source: ftp"):
        Study(NAME, variant="jason2", trials=1)


def test_no_root_for_the_whole_run():
    """A sensor that the ranging equation cannot explain: RA stays at its prior and says so, the bank has nothing."""
    scenario = load_scenario(NAME)
    scenario.duration_s = 400.0
    scenario.truth.occultation = True
    scenario.truth.grazing_height_km = 1e4
    result = run_study(NAME, scenario=scenario, estimators=["ra", "ra_look_ahead", "iekf", "bank"], trials=3)
    assert not result["nis_dof"].values.any()
    assert np.isnan(result["estimate"].sel(estimator="bank").values).all()
    for name in ("ra", "ra_look_ahead", "iekf"):
        assert 300 < curves(result, name)[0][-1] < 3000
    assert summarise(result)["bank"]["rmse_position_m"][-1] is None


# -------------------------------------------------------------------------------------------------- what it shows


@pytest.fixture(scope="module")
def short():
    """25 trials of the first 1000 s."""
    return run_study(NAME, trials=25, seed=31, set={"duration_s": 1000.0})


def test_ra_and_raw_six_early(short):
    """The issue's bands for 100 trials, widened by the scatter of 25: 1.4 of each end."""
    ahead, causal = curves(short, "ra_look_ahead")[0], curves(short, "ra")[0]
    assert within(at(short, ahead, 100, 500, 1000), [(27, 75), (18, 50), (12, 36)])
    assert within(at(short, curves(short, "iekf")[0], 100, 500, 1000), [(20, 60), (7, 20), (3.5, 10)])
    np.testing.assert_allclose(causal[20:], ahead[20:], rtol=1e-6)
    assert at(short, causal, 180)[0] > 700 and converged(short, causal) in (190.0, 200.0, 210.0)
    assert not diverged(short).sel(estimator=["ra", "ra_look_ahead", "iekf", "ukf", "bank"]).any()
    assert summarise(short)["ra"]["convergence_time_s"] == converged(short, causal)


def test_the_bounds_early(short):
    reference = {"bo": 234, "bcr": 187, "ra": 21.1, "iekf": 5.95}
    for name, value in reference.items():
        bound = short["bound_position"].sel(estimator=name).values[-1] / KM
        assert bound == pytest.approx(value, rel=0.01), name
    prior = short["bound_position"].sel(estimator="bank").values[0]
    assert prior > short["bound_position"].sel(estimator="iekf").values[0]  # it has none


def test_consistency_early(short):
    nees = nees_statistics(short).sel(estimator=["iekf", "ra", "bank"])
    late = nees.isel(time=slice(30, None))
    assert np.all(late["mean"] < 6 * 1.35) and np.all(late["mean"] > 6 * 0.6)
    bo = nees_statistics(short)["mean"].sel(estimator="bo").values[-1]
    assert bo > 9  # the angles alone make an EKF overconfident


def test_the_bank_finds_the_right_root_without_a_prior():
    """The issue wants 96 % after 10 and 99 % after 20 epochs of 300 runs; 120 here, of the mixture's mean."""
    result = run_study(NAME, estimators=["bank"], trials=120, seed=33, set={"duration_s": 200.0})
    error = errors(result)["position"].values[0] / KM
    assert np.mean(error[:, 10] < 1000) >= 0.93 and np.mean(error[:, 20] < 1000) >= 0.98


def test_jason_2(recorded, monkeypatch):
    monkeypatch.setenv("QUIETFIX_DATA", str(recorded("sp3").parent))
    result = run_study(NAME, variant="jason2", estimators=["iekf", "ra_look_ahead"], trials=8, set={"duration_s": 600})
    assert curves(result, "iekf")[0][-1] < 40 and curves(result, "ra_look_ahead")[0][-1] < 150
    with pytest.raises(UserError, match="s of the record are left, duration_s is 5000"):
        Study(NAME, variant="jason2", trials=1, set={"target.start_s": 320000})
    with pytest.raises(UserError, match="satellite L99 is not in it"):
        Study(NAME, variant="jason2", trials=1, set={"target.satellite": "L99"})
    with pytest.raises(UserError, match=r"other.sp3 cannot be read"):
        Study(NAME, variant="jason2", trials=1, set={"target.file": "other.sp3"})


def test_a_recorded_orbit_without_velocities_is_as_good(recorded, monkeypatch, tmp_path):
    """Differences of positions were 3.5 m/s off at 60 s: NEES 440 at the end of the arc."""
    lines = next(recorded("sp3").glob("grgja2*.sp3")).read_text().splitlines()[:324]
    lines[0] = f"{lines[0][:32]}{sum(line.startswith('* ') for line in lines):7d}{lines[0][39:]}"
    (tmp_path / "sp3").mkdir()
    monkeypatch.setenv("QUIETFIX_DATA", str(tmp_path))
    kept = {"all": lines, "positions": [line for line in lines if not line.startswith("V")]}
    at = [i for i, line in enumerate(lines) if line.startswith("P")][50]
    kept["gap"] = [*lines[:at], "PL27" + 3 * "      0.000000", *lines[at + 1 :]]
    found = {}
    for name, text in kept.items():
        (tmp_path / "sp3" / f"{name}.sp3").write_text("\n".join([*text, "EOF", ""]))
    for name in ("all", "positions"):
        scenario = load_scenario(NAME, "jason2", settings=[f"target.file={name}.sp3"])
        times, states = satellite_ranging_models.recorded_orbit(scenario)
        found[name] = np.array([hermite(times, states, t)[0] for t in np.arange(0.0, 5001.0, 10.0)])
    # the velocities of the file scatter by 0.3 mm/s; at the record's ends it is 0.6 mm/s
    off = np.linalg.norm((found["all"] - found["positions"]).reshape(-1, 2, 3), axis=-1)
    assert off[:, 0].max() < 0.02 and off[:, 1].max() < 1.3e-3
    with pytest.raises(UserError, match=r"duration_s 5000; the record has no position, .* 3000 s after the start"):
        Study(NAME, variant="jason2", trials=1, set={"target.file": "gap.sp3"})


# ------------------------------------------------------------------------------------------------------ full size


@pytest.fixture(scope="module")
def full():
    """The packaged scenario, 100 trials."""
    return run_study(NAME, trials=100, seed=1)


@pytest.mark.slow
def test_table_ra(full):
    ahead, causal = curves(full, "ra_look_ahead")[0], curves(full, "ra")[0]
    bands = [(38, 54), (25, 36), (17, 26), (5.5, 8), (5, 7)]
    assert within(at(full, ahead, 100, 500, 1000, 2500, 5000), bands)
    assert 12.5 <= armse(ahead) <= 15
    np.testing.assert_allclose(causal[20:], ahead[20:], rtol=1e-6)
    assert 40 <= armse(causal) <= 50 and 190 <= converged(full, causal) <= 210
    assert not diverged(full).sel(estimator=["ra", "ra_look_ahead"]).any()


@pytest.mark.slow
def test_table_raw_six(full):
    raw = curves(full, "iekf")[0]
    assert within(at(full, raw, 100, 500, 1000, 2500, 5000), [(29, 44), (10, 14), (5, 7), (2.8, 3.9), (1.8, 2.3)])
    assert 5.6 <= armse(raw) <= 6.7
    assert not diverged(full).sel(estimator=["iekf", "ukf", "bank"]).any()


@pytest.mark.slow
def test_table_bo_and_bcr(full):
    bo, middle = curves(full, "bo")
    bcr, _ = curves(full, "bcr")
    assert 130 <= armse(bo) <= 210 and 1600 <= converged(full, bo) <= 2400 and 8 <= middle[-1] <= 17
    assert 120 <= armse(bcr) <= 190 and 1300 <= converged(full, bcr) <= 2200


@pytest.mark.slow
def test_as_printed_a_third_ends_far_off(full):
    """RA without gates and with R at the measured root: 29 to 32 of 100 in the reference."""
    assert 20 <= int(diverged(full).sel(estimator="ra_paper").sum()) <= 45
    assert curves(full, "ra_paper")[1][-1] > 20


@pytest.mark.slow
def test_bounds_at_the_end(full):
    """And of the subsets in between; the bound is the same in every trial, since they share the truth."""
    scenario = load_scenario(NAME)
    rows = {
        "raw5": ["angles", "rates", "radial_acceleration"],
        "bcrd": ["angles", "rates", "radial_velocity"],
    }
    scenario.estimators = {name: Ekf(measurements=kinds) for name, kinds in rows.items()}
    between = run_study(NAME, scenario=scenario, trials=1)
    found = {name: float(between["bound_position"].sel(estimator=name).values[-1]) / KM for name in rows}
    for name in ("bo", "bcr", "ra", "iekf"):
        found[name] = float(full["bound_position"].sel(estimator=name).values[-1]) / KM
    for name, value in {"bo": 6.03, "bcr": 5.99, "raw5": 5.14, "ra": 5.88, "iekf": 1.99, "bcrd": 1.99}.items():
        assert found[name] == pytest.approx(value, rel=0.01), name


@pytest.mark.slow
def test_the_raw_six_reach_their_bound():
    """500 trials: within 10 % over the arc, NEES in its 95 % band at 90 % of the epochs or more."""
    result = run_study(NAME, estimators=["iekf"], trials=500, seed=2)
    ratio = KM * curves(result, "iekf")[0] / result["bound_position"].values[0]
    print("ratio", ratio.min(), ratio.max())
    assert np.all(np.abs(ratio[1:] - 1) < 0.10)
    nees = nees_statistics(result).isel(estimator=0)
    inside = (nees["mean"] > nees["lower"]) & (nees["mean"] < nees["upper"])
    print("nees", float(nees["mean"].mean()), float(inside.mean()))
    assert abs(float(nees["mean"].mean()) / 6 - 1) < 0.05


@pytest.mark.slow
def test_bank_full_size():
    result = run_study(NAME, estimators=["bank"], trials=300, seed=3, set={"duration_s": 300.0})
    error = errors(result)["position"].values[0] / KM
    shares = [float(np.mean(error[:, k] < 1000)) for k in (3, 5, 10, 20, 30)]
    print("right root", shares)
    assert shares[2] >= 0.96 and shares[3] >= 0.99


@pytest.mark.slow
def test_mismatch_full_size():
    result = run_study(NAME, variant="mismatch", estimators=["ra_look_ahead", "iekf"], trials=100, seed=4)
    end = {name: at(result, curves(result, name)[0], 5000)[0] for name in ("ra_look_ahead", "iekf")}
    nees = nees_statistics(result)["mean"].values[:, -1]
    print("mismatch", end, nees)
    assert 9 <= end["ra_look_ahead"] <= 13 and 12 <= end["iekf"] <= 16
    assert np.all(nees > 100)
    known = run_study(NAME, variant="j2", estimators=["ra_look_ahead", "iekf"], trials=50, seed=4)
    assert at(known, curves(known, "iekf")[0], 5000)[0] < 2.4
    assert 12 <= armse(curves(known, "ra_look_ahead")[0]) <= 15.5


@pytest.mark.slow
def test_polar_full_size():
    names = ["ra_look_ahead", "ra_normal_look_ahead", "iekf"]
    result = run_study(NAME, variant="polar", estimators=names, trials=100, seed=5)
    lost = {name: int(diverged(result).sel(estimator=name).sum()) for name in names}
    print("polar", lost, {name: armse(curves(result, name)[0]) for name in names})
    assert lost["ra_normal_look_ahead"] == 0 and lost["iekf"] == 0
    early = {name: at(result, curves(result, name)[0], 100)[0] for name in names}
    # slopes diverge there, and clusters of them were false or none in 5 of 100 runs (190 km at 100 s): by likelihood
    # such a run takes the plane of the likeliest root
    assert early["ra_look_ahead"] < 1.1 * early["ra_normal_look_ahead"]
    assert armse(curves(result, "ra_look_ahead")[0]) < 1.1 * armse(curves(result, "ra_normal_look_ahead")[0])


@pytest.mark.slow
def test_four_times_the_prior_variance():
    """How insensitive to the initial error the methods are: P0 times 4."""
    settings = {"belief.sigma_position_km": 1000.0, "belief.sigma_velocity_mps": 1000.0}
    result = run_study(NAME, estimators=["ra_look_ahead", "bo", "bcr"], trials=100, seed=6, set=settings)
    lost = {name: int(diverged(result).sel(estimator=name).sum()) for name in ("ra_look_ahead", "bo", "bcr")}
    print("P0 times 4", lost, {name: armse(curves(result, name)[0]) for name in lost})
    assert lost["ra_look_ahead"] <= 1 and lost["bo"] >= 5
    assert armse(curves(result, "bo")[0]) > 300


@pytest.mark.slow
def test_occulted_full_size():
    result = run_study(NAME, variant="occulted", estimators=["iekf", "ra_look_ahead"], trials=50, seed=7)
    used = result["nis_dof"].sel(estimator="iekf").values
    assert np.all(used[:, :186] == 6) and not used[:, 186:].any()
    raw = curves(result, "iekf")[0]
    assert at(result, raw, 1800)[0] < 5 and at(result, raw, 5000)[0] > 15
