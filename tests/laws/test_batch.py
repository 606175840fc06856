"""Maximum a posteriori over a window: the Kalman filter where all is linear, and what a solver of others finds else."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from quietfix.systems.batch.solving import Rule, solve
from quietfix.systems.batch.window import Path, Window
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.motion.current_statistical import CurrentStatistical
from quietfix.systems.options.batch import Batch
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.smoothing.smoother import Smoother
from quietfix.systems.starts.start import GivenStart
from tests.laws.cases import Turning
from tests.laws.rig import Linear, Scene, assert_same, make, run, with_gaps
from tests.laws.test_linear_gaussian import EPOCHS, MISSING, TRIALS, Problem
from tests.laws.test_linear_gaussian import assert_same as assert_textbook


@pytest.mark.parametrize("missing", MISSING)
@pytest.mark.parametrize("epochs", [1, 2, 7, 60])
@pytest.mark.parametrize("motion", [ConstantVelocity(0.5), WhiteNoiseAcceleration(0.3)], ids=lambda m: type(m).__name__)
def test_is_the_kalman_filter_where_all_is_linear(motion, epochs, missing):
    """Whatever the window: what leaves it loses nothing. A Q of half the rank, too."""
    problem = Problem(missing, motion)
    block = make("batch", Batch(epochs), problem.model, motion, GivenStart(problem.mean, problem.covariance), TRIALS)
    _, values = run(block, problem.measurement, np.zeros((EPOCHS, 1, 18)), block.wiring.clock)
    # a window of 60 epochs is solved 40 times over, forward and back
    assert_textbook(values, problem.expected(), problem, 1e-8 if epochs > 7 else 1e-9)


def window(measurement, motion, model, mean, covariance, step=1.0, moves=None):
    """Return a window of epochs (epochs, trials, rows)."""
    epochs, trials = measurement.shape[:2]
    whitener = Whitener(model.noise_covariance())
    noise = motion.process_noise(mean, step)
    return Window(
        mean,
        covariance,
        [0.0] + [step] * (epochs - 1),
        np.ones((trials, epochs), dtype=bool) & (np.arange(epochs) > 0),
        [Observation(measurement[k], np.zeros((1, 3, 6)), whitener) for k in range(epochs)],
        model,
        motion,
        [noise] * epochs,
    )


def test_a_whole_window_is_the_smoother():
    """All of the path, not only its end."""
    problem = Problem("some")
    expected = problem.expected()
    smooth, _ = Smoother(IteratedExtendedKalman(), problem.motion).smooth(
        np.arange(float(EPOCHS)), expected["estimate"], expected["covariance"]
    )
    covariance = np.broadcast_to(problem.covariance, (TRIALS, 6, 6))
    one = window(problem.measurement, problem.motion, problem.model, problem.mean, covariance)
    found = solve(one, Path(problem.mean, np.zeros((TRIALS, EPOCHS, 6))), Rule())
    sigma = np.sqrt(np.einsum("...ii->...i", expected["covariance"]))
    assert np.abs((np.stack(found.states) - smooth) / sigma).max() < 1e-8


class Distances(Linear):
    """Distances from three places in the plane: far from linear, where one is near."""

    places = np.array([[0.0, 0.0], [40.0, 0.0], [0.0, 30.0]])

    def __init__(self, sigma):
        super().__init__(np.zeros((3, 4)), np.eye(3) * sigma**2)

    def predict(self, target, platforms):
        return np.linalg.norm(target[..., None, :2] - self.places, axis=-1)

    def jacobian(self, target, platforms):
        away = target[..., None, :2] - self.places
        rows = np.zeros((*away.shape[:-1], 4))
        rows[..., :2] = away / np.linalg.norm(away, axis=-1, keepdims=True)
        return rows

    def linearize(self, target, platforms):
        return self.predict(target, platforms), self.jacobian(target, platforms)


def turning_scene(trials=8, epochs=12, sigma=0.5):
    """Return a target that turns, seen by distances; its start is far off."""
    rng = np.random.default_rng(4)
    motion, model = Turning(), Distances(sigma)
    truth = np.array([15.0, 5.0, 0.3, 0.1])
    states = []
    for _ in range(epochs):
        states.append(truth)
        truth = motion.propagate(truth, 1.0)
    exact = model.predict(np.array(states), None)
    measurement = exact[:, None] + sigma * rng.normal(size=(epochs, trials, 3))
    covariance = np.broadcast_to(np.diag([100.0, 100.0, 0.3, 0.02]), (trials, 4, 4))
    mean = states[0] + rng.normal(size=(trials, 4)) * np.sqrt(np.diagonal(covariance[0]))
    return motion, model, measurement, mean, covariance, np.array(states)


def test_is_what_least_squares_finds():
    """The same minimum as SciPy's trust region over all unknowns at once, of a motion and rows that are not linear."""
    motion, model, measurement, mean, covariance, _ = turning_scene()
    epochs, trials = measurement.shape[:2]
    one = window(measurement, motion, model, mean, covariance)
    found = solve(one, Path(mean, np.zeros((trials, epochs, 4))), Rule(max_iterations=100, tolerance=1e-10))
    cost, _ = one.cost(found.path, one.looked_at(found.states))
    for trial in range(trials):
        root = semidefinite_root(motion.process_noise(mean[trial : trial + 1], 1.0))
        root = root[0] if root.ndim == 3 else root
        spread = np.linalg.cholesky(covariance[trial])

        def residuals(unknown, trial=trial, root=root, spread=spread):
            state = mean[trial] + spread @ unknown[:4]
            parts = [unknown, (measurement[0, trial] - model.predict(state, None)) / 0.5]
            for k in range(1, epochs):
                state = motion.propagate(state, 1.0) + root @ unknown[4 * k : 4 * k + 4]
                parts.append((measurement[k, trial] - model.predict(state, None)) / 0.5)
            return np.concatenate(parts)

        start = np.zeros(4 * epochs)
        start[:4] = np.linalg.solve(spread, found.path.first[trial] - mean[trial])
        start[4:] = found.path.pushes[trial, 1:].ravel()
        assert np.sum(residuals(start) ** 2) == pytest.approx(cost[trial], rel=1e-10)
        best = least_squares(residuals, np.zeros(4 * epochs), method="trf", xtol=1e-12, ftol=1e-12, gtol=1e-12)
        assert cost[trial] <= 2 * best.cost * (1 + 1e-6)


def test_rows_that_do_not_fit_are_left_out():
    """With gross errors of 40 sigma in a tenth of the rows the path is that of the other rows alone."""
    motion, model, measurement, mean, covariance, truth = turning_scene(trials=30)
    rng = np.random.default_rng(8)
    struck = rng.uniform(size=measurement.shape) < 0.1
    wrong = np.where(struck, measurement + 20.0 * np.sign(rng.normal(size=struck.shape)), measurement)
    begin = Path(mean, np.zeros((30, 12, 4)))
    rule = Rule(max_iterations=100, edit_sigmas=6.0)
    found = solve(window(wrong, motion, model, mean, covariance), begin, rule)
    alone = solve(window(np.where(struck, np.nan, measurement), motion, model, mean, covariance), begin, rule)
    same = (found.edited == np.swapaxes(struck, 0, 1)).all(axis=(-1, -2))
    assert same.mean() > 0.8  # now and then a wrong row pulls the path after it
    np.testing.assert_allclose(found.states[-1][same], alone.states[-1][same], atol=1e-3)
    kept = solve(window(wrong, motion, model, mean, covariance), begin, Rule(max_iterations=100))
    error, worse = (np.linalg.norm((x.states[-1] - truth[-1])[:, :2], axis=-1) for x in (found, kept))
    assert np.median(error) < 0.5 * np.median(worse)


@pytest.mark.parametrize("epochs", [1, 5])
@pytest.mark.parametrize("edit", [None, 4.0])
def test_a_trial_alone(epochs, edit):
    """Bit for bit, through a pass of three satellites; one that is never measured, and one that is lost, harm none."""
    scene = Scene(12, 14)
    scene.measurement = with_gaps(scene.measurement)
    scene.measurement[:, 3] = np.nan
    scene.mean[7] = np.nan
    options = Batch(epochs, edit_sigmas=edit)
    batch = scene.run("batch", options)
    assert np.isnan(batch["estimate"][:, 7]).all()
    assert np.isfinite(np.delete(batch["estimate"], 7, axis=1)).all()
    for trial in (0, 3, 7, 11):
        alone = scene.only(slice(trial, trial + 1)).run("batch", options)
        assert_same(alone, {port: value[:, trial : trial + 1] for port, value in batch.items()})


def test_close_to_the_iterated_filter_where_that_is_good():
    """Three satellites: the same errors within a tenth, and consistent."""
    scene = Scene(100, 40)
    found = {name: scene.run(name, options) for name, options in {"iekf": Iekf(), "batch": Batch(8)}.items()}
    rms = {n: np.sqrt(np.mean((v["estimate"] - scene.truth[:, None])[-10:, :, :3] ** 2)) for n, v in found.items()}
    assert rms["batch"] == pytest.approx(rms["iekf"], rel=0.1)


def test_refused():
    scene = Scene(2, 3)
    scene.motion = CurrentStatistical(0.3, [30.0] * 3, [-20.0] * 3)
    with pytest.raises(ValueError, match="driven by its own estimate"):
        scene.estimator("batch", Batch(), start=GivenStart(np.zeros(9), np.eye(9)))
