"""Biases in studies: believed in scenarios, estimated or considered, in the result, the table and the bound."""

import json
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands import command_line
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.metrics import summarise

DRONE = str(Path(__file__).parents[1] / "own" / "drone.yaml")
ROLL, CLOCK = {"truth.errors.attitude_roll_deg": 0.05}, {"truth.errors.clock_offset_ns": 20}
RESIDUALS = {"stop_s": 80, "sensor.sigma_station_residual_mps": 0.3}
MODES = ["estimate", "consider"]


def believing(**biases):
    """Return the setting of a belief."""
    return {"belief.biases": json.dumps({name: dict(one) for name, one in biases.items()})}


def study(system, estimators=("iekf",), trials=20, **settings):
    return run_study(system, estimators=list(estimators), trials=trials, set=settings)


def last(dataset, estimator="iekf"):
    """Return squared position errors and NEES of the trials, and the bound, at the end."""
    one = dataset.sel(estimator=estimator).isel(time=-1)
    error = (one["estimate"] - one["truth"]).values[:, :3]
    return np.sum(error**2, axis=-1), one["nees"].values, float(one["bound_position"])


def rmse(squares):
    return np.sqrt(squares.mean())


# ------------------------------------------------------------------------------------------------- results


@pytest.fixture(scope="module")
def biased():
    belief = believing(roll_satellite_0={"sigma": 0.05}, fdoa={"sigma": 0.5, "mode": "consider"})
    return study("three_satellite", ("iekf", "tdoa_phase"), 6, duration_s=10, **ROLL, **belief, **TWO)


TWO = {"estimators.tdoa_phase": "!Iekf {measurements: [tdoa, phase]}"}


def test_the_state_is_the_targets(biased):
    plain = study("three_satellite", ("iekf", "tdoa_phase"), 6, duration_s=10, **TWO)
    assert biased["state"].values.tolist() == plain["state"].values.tolist() == ["x", "y", "z", "vx", "vy", "vz"]
    assert "bias_estimate" not in plain and "bias_row" not in plain.dims
    # one that uses no FDOA knows nothing of its biases
    assert biased["bias_row"].values.tolist() == ["roll_satellite_0", "bias_fdoa_10", "bias_fdoa_20"]
    assert biased["bias_row_units"].values.tolist() == ["rad", "Hz", "Hz"]
    assert biased["bias_estimated"].values.tolist() == [[True, False, False], [True, False, False]]
    told = np.isfinite(biased["bias_sigma"].values).all(axis=(1, 2))
    assert told.tolist() == [[True, True, True], [True, False, False]]
    considered = biased.sel(estimator="iekf").isel(bias_row=slice(1, None))
    assert not considered["bias_estimate"].values.any()
    np.testing.assert_allclose(considered["bias_sigma"].values, 0.5, rtol=1e-12)


def test_summary(biased):
    found = summarise(biased)["iekf"]["biases"]
    assert list(found) == ["roll_satellite_0"] and found["roll_satellite_0"]["unit"] == "rad"
    value = biased["bias_estimate"].sel(estimator="iekf", bias_row="roll_satellite_0").isel(time=-1).values
    assert found["roll_satellite_0"]["mean"] == pytest.approx(value.mean(), rel=1e-12)
    assert found["roll_satellite_0"]["spread"] == pytest.approx(value.std(), rel=1e-12)


def test_table(tmp_path, capsys):
    belief = "belief.biases={roll_satellite_0: {sigma: 0.05}}"
    arguments = ["run", "three_satellite", "--estimator", "iekf", "--trials", "2", "--set", belief, "--set"]
    with pytest.raises(SystemExit) as stop:
        command_line.main([*arguments, "duration_s=3", "--out", str(tmp_path / "out")])
    assert not stop.value.code
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line for line in lines if line[:3] == ["iekf", "roll_satellite_0", "deg"]]


def test_an_estimator_without_such_rows_is_as_before():
    settings = {"estimators.delays": "!Iekf {measurements: [tdoa]}", "duration_s": 6}
    before = study("three_satellite", ("delays",), 4, **settings)
    now = study("three_satellite", ("delays",), 4, **settings, **believing(fdoa={"sigma": 1.0}))
    for name in ("estimate", "nees", "nis", "bound_position"):
        np.testing.assert_array_equal(now[name].values, before[name].values)


def test_chunks_and_trials_alone():
    settings = {**ROLL, **believing(roll_satellite_0={"sigma": 0.05}, clock_satellite_1={"sigma": 9}), "duration_s": 8}
    whole = run_study("three_satellite", estimators=["iekf", "ukf"], trials=5, set=settings)
    cut = run_study("three_satellite", estimators=["iekf", "ukf"], trials=5, set=settings, chunk=2)
    alone = run_study("three_satellite", estimators=["iekf", "ukf"], trials=1, first_trial=3, set=settings)
    for name in ("estimate", "nees", "nis", "bias_estimate", "bias_sigma"):
        np.testing.assert_array_equal(cut[name].values, whole[name].values)
        np.testing.assert_array_equal(alone[name].values, whole[name].isel(trial=[3]).values)


@pytest.mark.parametrize("name", ["bearing_crossing", "satellite_ranging", "dual_satellite", "beacon_rocket"])
def test_every_packaged_system_has_them(name):
    ranging = ROLL_OF["satellite_ranging"]
    belief, settings, estimators = {
        "bearing_crossing": ({"yaw_observer": {"sigma": 1.0}}, {"duration_s": 20}, ["ekf", "mgekf", "ukf"]),
        "satellite_ranging": (ranging, {"duration_s": 100}, ["iekf", "ukf"]),
        "dual_satellite": ({"clock_main": {"sigma": 10}, "roll_main": {"sigma": 0.1}}, {"duration_s": 5}, ["iekf"]),
        "beacon_rocket": ({"range_rate_3": {"sigma": 0.3, "walk": 0.01}}, {"stop_s": 50.5}, ["ukf", "ekf"]),
    }[name]
    found = study(name, estimators, 4, **settings, **believing(**belief))
    assert np.isfinite(found["estimate"].values).all() and np.isfinite(found["bias_sigma"].values).all()
    assert found["bias_row"].size == len(belief)
    # what is learnt of a bias is never less than nothing
    assert (found["bias_sigma"].isel(time=-1) <= found["bias_sigma"].isel(time=0) * 1.1).all()
    assert np.isfinite(found["bound_position"].values).all()


ROLL_OF = {"satellite_ranging": {"roll_observer": {"sigma": 0.1}, "radial_velocity": {"sigma": 5.0}}}


def test_the_bound_has_these_states():
    """As much as a filter linearised at the truth is told of a row that has an offset: of one station among many."""
    settings = {"stop_s": 50.5}
    nominal = study("beacon_rocket", ("ekf",), 1, **settings)["bound_position"].values[0, -1]
    vague = study("beacon_rocket", ("ekf",), 1, **settings, **believing(range_rate={"sigma": 1e-6}))
    known = study("beacon_rocket", ("ekf",), 1, **settings, **believing(range_rate={"sigma": 3.0}))
    # offsets of 1e-6 m/s are none beside a noise of 0.03
    assert vague["bound_position"].values[0, -1] == pytest.approx(nominal, rel=1e-6)
    assert known["bound_position"].values[0, -1] > 1.01 * nominal


# ------------------------------------------------------------------------------------------------ a YAML file


@pytest.mark.parametrize("mode", MODES)
def test_of_ones_own(mode):
    """Clocks and the direction finder's axes are off as they are believed to be, and the target moves as it is."""
    truth = {
        "target": "!RandomMotion {start: !Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}}",
        "sensors.tdoa.errors.sigma_clock_offset_ns": 60,
        "sensors.bearing.errors.sigma_attitude_deg": 1.0,
    }
    belief = {f"clock_{name}": {"sigma": 60, "mode": mode} for name in ("alpha", "bravo", "charlie", "delta")}
    belief |= {f"{turn}_alpha": {"sigma": 1.0, "mode": mode} for turn in ("roll", "pitch", "yaw")}
    silent = last(study(DRONE, ("ukf",), 100, **truth), "ukf")
    told = last(study(DRONE, ("ukf",), 100, **truth, **believing(**belief)), "ukf")
    assert silent[1].mean() / 6 > 10
    # of 100 trials of six states: 0.89 to 1.12 holds 95 %; five sigma are 0.29
    assert told[1].mean() / 6 == pytest.approx(1, abs=0.29)
    if mode == "estimate":  # five sigma of an RMSE of 100 trials, of which one direction is the weakest
        assert rmse(told[0]) / told[2] == pytest.approx(1, abs=0.35)
    assert told[2] < rmse(told[0]) * 1.35 < rmse(silent[0])


# ------------------------------------------------------------------------------------------------- smoothers


def test_a_smoother_knows_the_biases_of_its_filter():
    settings = {**ROLL, **believing(roll_satellite_0={"sigma": 0.05}), "duration_s": 60}
    found = study("three_satellite", ("iekf", "iekf_smoothed"), 40, **settings)
    middle = found.isel(time=30)
    squares = np.sum((middle["estimate"] - middle["truth"]).values[..., :3] ** 2, axis=-1).mean(axis=-1)
    assert squares[1] < 0.8 * squares[0]
    np.testing.assert_array_equal(found["estimate"].values[0, :, -1], found["estimate"].values[1, :, -1])
    assert 0.3 < middle["nees"].values[1].mean() / 6 < 1.2
    with pytest.raises(UserError, match="a smoother is not allowed with biases that are considered"):
        considered = believing(roll_satellite_0={"sigma": 0.05, "mode": "consider"})
        study("three_satellite", ("iekf", "iekf_smoothed"), 1, duration_s=2, **considered)


# -------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("biases", "message"),
    [
        ("{tdoa_13: {sigma: 1}}", r"belief.biases: tdoa_13 is not known \(did you mean tdoa_10\?\); there are tdoa_10"),
        ("{roll: {sigma: 1}}", "belief.biases: roll is not known"),
        ("{roll_satellite_1: {sigma: 1}}", "belief.biases: roll_satellite_1 is not known"),
        ("{tdoa: {sigma: -1}}", "belief.biases.tdoa.sigma: -1 is not allowed; a finite number > 0"),
        ("{tdoa: {sigma: 0}}", "belief.biases.tdoa.sigma: 0 is not allowed"),
        ("{tdoa: {}}", "belief.biases.tdoa.sigma: none is given"),
        ("{tdoa: {sigma: 1, walk: -1}}", "belief.biases.tdoa.walk: -1 is not allowed; a finite number >= 0"),
        ("{tdoa: {sigma: 1, mode: estimated}}", "belief.biases.tdoa.mode: 'estimated' is not allowed; one of estimate"),
        ("{tdoa: {sigma: 1, sigmas: 2}}", "sigmas"),
        ("{tdoa: {sigma: many}}", "belief.biases.tdoa.sigma: 'many' is not allowed"),
        ("{tdoa_10: {sigma: 1, shared: true}}", "belief.biases.tdoa_10.shared: true is not allowed"),
        ("{tdoa: {sigma: 1}, tdoa_10: {sigma: 1}}", "belief.biases.tdoa_10: bias_tdoa_10 is not allowed twice"),
        ("[tdoa]", "belief.biases"),
    ],
)
def test_mistakes(biases, message):
    with pytest.raises(UserError, match=message):
        run_study("three_satellite", trials=1, set={"belief.biases": biases})


@pytest.mark.parametrize("name", ["pf", "iekf_hypotheses"])
def test_estimators_that_know_nothing_of_them_are_refused(name):
    settings = {"truth.phase": "unambiguous"} if name == "pf" else {}
    with pytest.raises(UserError, match=f"estimators.{name}: it is not allowed with belief.biases"):
        run_study("three_satellite", estimators=[name], trials=1, set=settings | believing(tdoa={"sigma": 1.0}))


def test_positions_that_are_made_of_rows_are_refused():
    settings = {"estimators.own": "!Iekf {measurements: [position]}", **believing(azimuth={"sigma": 0.1})}
    with pytest.raises(UserError, match=r"estimators.own.measurements: \[position\] is not allowed with belief.biases"):
        run_study("satellite_ranging", estimators=["own"], trials=1, set=settings)


def test_one_line_and_status_2(capsys):
    with pytest.raises(SystemExit) as stop:
        command_line.main(["run", DRONE, "--trials", "1", "--set", "belief.biases={tdoa_bravo: {sigma: 1}}"])
    told = capsys.readouterr().err.strip()
    assert stop.value.code == 2 and len(told.splitlines()) == 1
    assert "belief.biases: tdoa_bravo is not known (did you mean tdoa_bravo_delta?)" in told


# ------------------------------------------------------------------------------------------ at full size, slow

TRIALS = 400


@pytest.fixture(scope="module")
def nominal():
    return last(study("three_satellite", trials=TRIALS))


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_roll(nominal, mode):
    """Unknown it costs 5.2 times the RMSE, and a NEES of 3.1 per state instead of 0.56."""
    belief = believing(roll_satellite_0={"sigma": 0.05, "mode": mode})
    squares, nees, bound = last(study("three_satellite", trials=TRIALS, **ROLL, **belief))
    assert rmse(squares) <= 1.3 * rmse(nominal[0])
    assert 0.8 < nees.mean() / nominal[1].mean() < 1.2
    assert bound > nominal[2] and np.sqrt(squares).max() < 50e3


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_clock(nominal, mode):
    """Unknown it costs 1.2 times the RMSE, and a NEES of 23.9 per state."""
    belief = believing(clock_satellite_0={"sigma": 20, "mode": mode})
    squares, nees, _ = last(study("three_satellite", trials=TRIALS, **CLOCK, **belief))
    assert 0.8 < nees.mean() / nominal[1].mean() < 1.2
    assert rmse(squares) < 1.2 * rmse(nominal[0])


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_a_filter_that_believes_the_truth_is_consistent(mode):
    """Motion, clocks and axes drawn as they are believed: the NEES is 1 from the start on, the RMSE the bound."""
    names = [*(f"clock_satellite_{i}" for i in range(3)), *(f"{turn}_satellite_0" for turn in ("roll", "pitch", "yaw"))]
    belief = {name: {"sigma": 20 if name.startswith("clock") else 0.05, "mode": mode} for name in names}
    drawn = {"truth.errors.sigma_clock_offset_ns": 20, "truth.errors.sigma_attitude_deg": 0.05}
    settings = {"truth.motion": "!RandomAcceleration {}", **drawn, **believing(**belief)}
    found = study("three_satellite", trials=TRIALS, **settings).sel(estimator="iekf")
    nees = found["nees"].mean("trial").values / 6
    # 400 trials of six states: 0.944 to 1.057 holds 95 % of the epochs' means; five sigma of one are 0.144
    assert (np.abs(nees[[0, 1, 10, 50, 100, 150]] - 1) < 0.144).all()
    squares = np.sum((found["estimate"] - found["truth"]).values[..., :3] ** 2, axis=-1).mean(axis=0)
    ratio = np.sqrt(squares) / found["bound_position"].values
    assert (np.abs(ratio[[0, 1, 10, 50, 100, 150]] - 1) < 0.1).all()
    assert float(found["nis"].sum() / found["nis_dof"].sum()) == pytest.approx(1, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["iekf", "ukf", "ekf"])
def test_station_residuals(estimator):
    """Unknown they cost all trials: 2422 m instead of 14 m."""
    nominal = last(study("beacon_rocket", (estimator,), TRIALS, stop_s=80), estimator)
    told = study("beacon_rocket", (estimator,), TRIALS, **RESIDUALS, **believing(range_rate={"sigma": 0.3}))
    squares, nees, bound = last(told, estimator)
    assert rmse(squares) <= 1.15 * bound
    # as without residuals: below 1, for the rocket flies otherwise than the filter believes
    assert 0.8 < nees.mean() / nominal[1].mean() < 1.2 and nees.mean() / 10 < 1.05
    assert np.sqrt(squares).max() < 1e3


OTHERS = {
    "estimators.window": "!Batch {epochs: 4}",
    "estimators.imm": "!Imm {filter: !Iekf {}, models: {calm: !AsBelieved {}, agile: !AsBelieved "
    "{added_density_m2ps3: 4}}, transitions: !Sojourn {mean_s: {calm: 1000, agile: 10}}}",
}


def test_windows_and_interacting_models_have_them_too():
    """A plain augmentation: beside the filter with the same states, and not as far off as one without.

    The three see the same measurements, and differ by what a window and a second motion change: 1 % and 2 % of the
    RMSE here, 10 % are asked for. Without the bias the filter has 5 times the RMSE.
    """
    settings = dict(duration_s=40, **ROLL, **believing(roll_satellite_0={"sigma": 0.05}), **OTHERS)
    found = study("three_satellite", ("iekf", "window", "imm"), 30, **settings)
    want, _, bound = last(found)
    for name in ("window", "imm"):
        squares, nees, own = last(found, name)
        assert own == bound and abs(rmse(squares) / rmse(want) - 1) < 0.1
        assert nees.mean() < 9  # 6 +- 0.6 if the truth moved as they believe
    assert found["bias_row"].values.tolist() == ["roll_satellite_0"]


@pytest.mark.parametrize("name", ["window", "imm"])
def test_which_do_not_only_consider_them(name):
    with pytest.raises(UserError, match=rf"estimators\.{name}: .* biases that are considered \(roll_satellite_0\)"):
        belief = believing(roll_satellite_0={"sigma": 0.05, "mode": "consider"})
        study("three_satellite", (name,), 2, duration_s=3, **belief, **OTHERS)
