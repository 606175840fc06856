"""States by their names: bounds, errors and NEES of estimators whose state is not the truth's."""

import dataclasses
import warnings

import numpy as np
import pytest

from quietfix.diagrams.figures.consistency import draw_consistency
from quietfix.diagrams.figures.ground import draw_ground
from quietfix.diagrams.quantities.states import CarriedMotion, block, columns, translated
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bounds import bound_squares
from quietfix.diagrams.statistics.consistency import nees_statistics
from quietfix.diagrams.statistics.metrics import rmse, summarise
from quietfix.diagrams.statistics.state_errors import axis_errors, errors
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study
from quietfix.diagrams.verification.study_view import StudyFacts
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.motion.pass_oscillator import PassOscillator
from tests.diagrams.named_states import SIGMA, STATES, STATIONS, SYSTEM, TRUTH, WEIGHTS, Drift, Ranges, Scenario, belief


@pytest.fixture
def data():
    return run_study(SYSTEM, scenario=Scenario(density=0.5), trials=40, seed=1, keep="covariance")


def dense_bound(names, course, times, noisy):
    """The covariance of the last state given all measurements, by conditioning the whole trajectory at once.

    Nothing of the recursion is in it: the joint covariance of all states and all measurements, and one Schur
    complement. `course`: one trial's truth (time, 4); `noisy`: the process noise density of each component.
    """
    n, epochs = len(names), times.size
    joint = np.zeros((epochs * n, epochs * n))
    # every state as a linear map of the start and of all process noise
    maps = np.zeros((epochs, n, n * epochs))
    sources = np.zeros((epochs * n, epochs * n))
    sources[:n, :n] = belief(names)[1]
    maps[0, :, :n] = np.eye(n)
    for k in range(1, epochs):
        dt = times[k] - times[k - 1]
        phi = np.eye(n)
        for axis in "xy":
            if axis in names and "v" + axis in names:
                phi[names.index(axis), names.index("v" + axis)] = dt
        maps[k] = phi @ maps[k - 1]
        maps[k, :, k * n : (k + 1) * n] += np.eye(n)
        sources[k * n : (k + 1) * n, k * n : (k + 1) * n] = np.diag([noisy.get(name, 0.0) * dt for name in names])
    flat = maps.reshape(epochs * n, -1)
    joint = flat @ sources @ flat.T
    rows = np.zeros((epochs * 3, epochs * n))
    for k in range(epochs):
        offset = course[k, [TRUTH.index("x"), TRUTH.index("y")]] - STATIONS[0, :, :2]
        along = offset / np.linalg.norm(offset, axis=-1, keepdims=True)
        for name, values in (("x", along[:, 0]), ("y", along[:, 1]), ("bias", np.ones(3))):
            if name in names:
                rows[3 * k : 3 * k + 3, k * n + names.index(name)] = values
    cross = joint[-n:] @ rows.T
    return joint[-n:, -n:] - cross @ np.linalg.solve(rows @ joint @ rows.T + SIGMA**2 * np.eye(3 * epochs), cross.T)


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("kind", ["bound", "bound_truth"])
def test_the_bound_of_any_state_is_what_conditioning_the_whole_course_gives(data, name, kind):
    states, times = STATES[name], data["time"].values
    truth = data["truth"].sel(state=list(TRUTH)).values
    filters = {component: 0.5 * weight for component, weight in WEIGHTS.items()}
    noise = filters if kind == "bound" else {c: q for c, q in filters.items() if c in TRUTH}
    covariances = np.array([dense_bound(states, course, times, noise) for course in truth])

    def expected(*components):
        places = [states.index(component) for component in components]
        return np.sqrt(covariances[:, places, places].sum(axis=-1).mean())

    found = data.sel(estimator=name).isel(time=-1)
    # Conditioning 33 measurements at once loses eight digits of sixteen.
    assert float(found[f"{kind}_position"]) == pytest.approx(expected("x", "y"), rel=1e-7)
    if name == "still":
        assert np.isnan(found[f"{kind}_velocity"]) and np.isnan(found[f"{kind}_speed"])
    else:
        assert float(found[f"{kind}_velocity"]) == pytest.approx(expected("vx", "vy"), rel=1e-7)
        assert 0 < float(found[f"{kind}_speed"]) < float(found[f"{kind}_velocity"])
    assert f"{kind}_bias" not in data


def test_a_bias_that_the_truth_lacks_widens_the_bound_and_has_no_row(data):
    biased, usual = (data.sel(estimator=name) for name in ("biased", "usual"))
    for kind in ("bound", "bound_truth"):
        assert (biased[f"{kind}_position"][1:] > usual[f"{kind}_position"][1:]).all()
    found = errors(data)
    assert "bias" not in found and "rmse_bias_mps" not in summarise(data)["biased"]
    assert axis_errors(data).sel(state="bias").isnull().all()
    assert data["estimate"].sel(estimator="biased", state="bias").notnull().all()
    assert np.isfinite(rmse(found["position"])).all()
    # lacking is not lost: no number, not an infinite one
    assert found["velocity"].sel(estimator="still").isnull().all()
    assert np.isfinite(found["velocity"].sel(estimator=["usual", "turned", "biased"])).all()


def test_the_order_of_a_state_changes_nothing(data):
    for variable in ("estimate", "nees", "nis", *(name for name in data if name.startswith("bound"))):
        one, other = (data[variable].sel(estimator=name) for name in ("usual", "turned"))
        np.testing.assert_allclose(one, other, rtol=1e-9, err_msg=str(variable))


def test_nees_is_over_what_both_states_have(data):
    for name in STATES:
        both = [component for component in STATES[name] if component in TRUTH]
        one = data.sel(estimator=name, state=both)
        error = (one["estimate"] - one["truth"]).values
        places = [list(data["state"].values).index(component) for component in both]
        part = data["covariance"].sel(estimator=name).values[..., places, :][..., places]
        expected = np.einsum("...i,...i->...", error, np.linalg.solve(part, error[..., None])[..., 0])
        np.testing.assert_allclose(data["nees"].sel(estimator=name), expected, rtol=1e-7)
    statistics = nees_statistics(data)
    assert statistics["freedom"].values.tolist() == [4, 4, 4, 2]
    # 40 trials of a filter that believes what is true: 95 % of the epochs in the band of 4 degrees of freedom
    usual = statistics.sel(estimator="usual")
    inside = (usual["mean"] > usual["lower"]) & (usual["mean"] < usual["upper"])
    assert inside.mean() > 0.7 and float(usual["upper"][0]) == pytest.approx(4.93, abs=0.01)


def test_figures_of_different_states(data):
    axes = draw_consistency(data, "nees").axes[0]
    assert axes.get_ylabel() == "mean NEES over trials / components judged (consistent: 1)"
    drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    for name, freedom in zip(STATES, (4, 4, 4, 2), strict=True):
        mean = data["nees"].sel(estimator=name).mean("trial")
        np.testing.assert_allclose(drawn[name], mean / freedom, rtol=1e-12)
    right = next(axes for axes in draw_ground(data).axes if axes.get_title().startswith("estimate minus truth"))
    dots = next(line for line in right.get_lines() if line.get_label() == "turned").get_xydata()
    offset = errors(data)["position"].sel(estimator="turned").isel(time=-1).values
    unit = {"east [m]": 1.0, "east [km]": 1e3}[right.get_xlabel()]
    np.testing.assert_allclose(unit * np.linalg.norm(dots, axis=-1), offset, rtol=1e-9)


def test_requirements_are_about_what_both_states_have():
    run = StudyFacts(Study(SYSTEM, scenario=Scenario(), trials=1).wire(1)[0])
    assert run.states["biased"] == ["x", "y", "vx", "vy"] and "bias" not in run.quantities["biased"]
    assert "velocity" in run.quantities["turned"] and "velocity" not in run.quantities["still"]
    assert {"position", "x"} <= set(run.quantities["still"])


def test_a_start_that_cannot_be_known_is_said_and_the_rest_is_kept():
    scenario = Scenario(duration_s=2.0, speechless=True)
    with pytest.warns(UserWarning, match=r"estimators\.biased: no bound, its start does not say its .* 5 x 5"):
        found = run_study(SYSTEM, scenario=scenario, trials=3, chunk=1)
    assert found["bound_position"].sel(estimator="biased").isnull().all()
    assert found["bound_position"].sel(estimator=["usual", "turned", "still"]).notnull().all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run_study(SYSTEM, scenario=Scenario(duration_s=2.0), trials=3)


def test_names_that_do_not_fit_the_truth_are_refused():
    declared = SYSTEM.declare(Scenario())
    for names, said in ((["x", "y"], "4 different names"), (["x", "x", "y", "vy"], "4 different names")):
        model = dataclasses.replace(declared, truth_states=names)
        with pytest.raises(UserError, match=rf"truth_states: .*{said}"):
            Study(SYSTEM, scenario=Scenario(), trials=1, model=model)


def test_an_oscillators_rates_are_no_velocity():
    motion = PassOscillator([5.0, 0.1, 1e-3], 600.0)
    rng = np.random.default_rng(0)
    root = rng.standard_normal((6, 6))
    covariance, state = root @ root.T, np.array([4e6, 1e6, 4.8e6, 2.0, 0.1, 0.0])
    position, height, velocity, speed, course, bias = bound_squares(covariance, state, motion.names)
    assert position == pytest.approx(np.trace(covariance[:3, :3])) and 0 < height < position
    assert np.isnan([velocity, speed, course]).all() and bias == covariance[3, 3]


def test_a_turned_state_has_the_same_quantities():
    rng = np.random.default_rng(1)
    names = ConstantVelocity(0.0).names
    root = rng.standard_normal((6, 6))
    covariance, state = root @ root.T, np.array([4e6, 1e6, 4.8e6, 100.0, 150.0, -20.0])
    order = rng.permutation(6)
    turned = bound_squares(block(covariance, list(order)), state[order], [names[i] for i in order])
    np.testing.assert_allclose(turned[:5], bound_squares(covariance, state)[:5], rtol=1e-12)
    assert isinstance(columns(names, ("vx", "vy", "vz")), slice) and columns(names, ("vz", "x")) == [5, 0]


def test_a_component_that_the_truth_lacks_is_worth_what_its_model_says():
    class Scaled(Drift):
        def __init__(self, names):
            super().__init__(names, 0.0)
            self.nominal = {"scale": 1.0}

    motion = Scaled(("scale", "x", "bias"))
    assert translated(np.array([[7.0, 8.0]]), ("vx", "x"), motion).tolist() == [[1.0, 8.0, 0.0]]
    carried = CarriedMotion(Drift(TRUTH, 0.5), Drift(STATES["biased"], 3.0), TRUTH)
    truth = np.zeros(4)
    assert np.diagonal(carried.process_noise(truth, 2.0)).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(carried.transition(truth, 2.0), Drift(STATES["biased"], 0.0).transition(truth, 2.0))


def test_the_jacobians_of_the_test_are_right():
    """The rows of `dense_bound` are written apart from those of the model: both against differences."""
    model, state = Ranges(STATES["biased"]), np.array([5.0, 3e3, 4e3, 1.0, 2.0])
    steps = [(model.predict(state + h, STATIONS[0]) - model.predict(state - h, STATIONS[0])) / 2 for h in np.eye(5)]
    np.testing.assert_allclose(model.jacobian(state, STATIONS[0]), np.transpose(steps), atol=1e-6)
