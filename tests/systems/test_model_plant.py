"""Truth from a motion model: moments against theory, reproducibility, ordering of logs and updates."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity, WhiteNoiseAcceleration
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, set_draw

MEAN = np.array([6.4e6, -1e5, 2e5, 250.0, -120.0, 30.0])
_A = np.random.default_rng(8).normal(size=(6, 6)) * np.array([1e3, 2e3, 500, 10, 20, 5])[:, None]
COVARIANCE = _A @ _A.T


class Swinging(MotionModel):
    """A nonlinear model whose noise depends on the state: what the plant has to take as well."""

    names = ("angle", "rate")
    units = ("rad", "rad/s")

    def propagate(self, state, dt):
        angle, rate = state[..., 0], state[..., 1]
        return np.stack([angle + dt * rate, rate - dt * np.sin(angle)], axis=-1)

    def transition(self, state, dt):
        raise NotImplementedError

    def process_noise(self, state, dt):
        q = np.zeros((*state.shape, 2))
        q[..., 1, 1] = dt * (0.01 + state[..., 0] ** 2)
        return q


def simulate(plant, end, draw=None, every=None):
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    recorder = record(builder, {"state": plant.GetOutputPort("state")}, every or plant.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, draw or Draw())
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    times, logs = recorder.result(simulator.get_context())
    return times, logs["state"]


def random_walk(trials, name="emitter", model=None, clock=None):
    return ModelPlant(model or WhiteNoiseAcceleration(4.0), clock or Periodic(1.0), MEAN, COVARIANCE, trials, name)


# ---------------------------------------------------------------------------------------------- square root


def test_root_of_a_regular_matrix_is_cholesky():
    np.testing.assert_allclose(semidefinite_root(COVARIANCE), np.linalg.cholesky(COVARIANCE), rtol=1e-10)


@pytest.mark.parametrize("rank", [0, 1, 3, 5])
def test_root_of_a_singular_matrix(rank):
    a = np.random.default_rng(rank).normal(size=(20, 6, rank)) * np.logspace(-6, 6, 6)[:, None]
    p = a @ np.swapaxes(a, -1, -2)
    root = semidefinite_root(p)
    sigma = np.sqrt(np.diagonal(p, axis1=-2, axis2=-1))
    scale = np.where(sigma > 0, sigma, 1)
    error = (root @ np.swapaxes(root, -1, -2) - p) / scale[..., :, None] / scale[..., None, :]
    # rounding of unit numbers, amplified by how close to singular the leading blocks are: measured 2e-13
    assert np.abs(error).max() < 1e-10
    assert np.array_equal(semidefinite_root(p[3]), root[3])  # alone = in a batch


def test_root_of_the_process_noise_has_its_rank():
    root = semidefinite_root(ConstantVelocity(0.1).process_noise(MEAN, 1.0))
    assert np.linalg.matrix_rank(root) == 3


@pytest.mark.parametrize(
    ("p", "message"),
    [
        ([[1.0, 2.0], [2.0, 1.0]], "negative eigenvalue"),
        ([[-1.0]], "variance is negative"),
        ([[1.0, 0.5], [0.2, 1.0]], "symmetric"),
        ([[1.0, np.nan], [np.nan, 1.0]], "finite"),
        ([1.0, 2.0], "shape"),
        ([[0.0, 1.0], [1.0, 0.0]], "negative eigenvalue"),
    ],
)
def test_root_refuses_what_is_no_covariance(p, message):
    with pytest.raises(ValueError, match=message):
        semidefinite_root(p)


# -------------------------------------------------------------------------------------------------- moments


@pytest.mark.parametrize("model", [WhiteNoiseAcceleration(4.0), ConstantVelocity(2.0)], ids=["full", "rank3"])
def test_moments_after_steps_are_the_theory(model):
    trials, steps = 20_000, 5
    times, states = simulate(random_walk(trials, model=model), float(steps))
    assert times.tolist() == [0, 1, 2, 3, 4, 5]
    mean, p = MEAN, COVARIANCE
    phi, q = model.transition(MEAN, 1.0), model.process_noise(MEAN, 1.0)
    for k in range(steps + 1):
        x = states[k]
        sigma = np.sqrt(np.diag(p))
        # whitened by the scale of each state; the mean scatters by 1/sqrt(N), a covariance element by at most
        # sqrt(2/N) = 0.01: five sigma for 6 + 21 numbers at 6 epochs
        assert np.abs((x.mean(axis=0) - mean) / sigma).max() < 5 / np.sqrt(trials)
        assert np.abs((np.cov(x.T) - p) / np.outer(sigma, sigma)).max() < 5 * np.sqrt(2 / trials)
        mean, p = phi @ mean, phi @ p @ phi.T + q


def test_process_noise_alone_is_its_covariance_and_white():
    trials, model = 20_000, ConstantVelocity(2.0)
    _, states = simulate(ModelPlant(model, Periodic(1.0), MEAN, np.zeros((6, 6)), trials), 3.0)
    assert np.ptp(states[0], axis=0).max() == 0  # no covariance: the start is the mean, exactly
    w = states[1:] - model.propagate(states[:-1], 1.0)
    q = model.process_noise(MEAN, 1.0)
    sigma = np.sqrt(np.diag(q))
    for k in range(3):
        assert np.abs((np.cov(w[k].T) - q) / np.outer(sigma, sigma)).max() < 5 * np.sqrt(2 / trials)
    # rank 3: the position noise is the velocity noise times dt/2, up to the rounding of 6.4e6 m
    np.testing.assert_allclose(w[..., :3], w[..., 3:] / 2, atol=1e-8)
    across = np.einsum("ti,tj->ij", w[0], w[1]) / trials / np.outer(sigma, sigma)
    assert np.abs(across).max() < 5 / np.sqrt(trials)


def test_noise_that_depends_on_the_state():
    trials, model = 20_000, Swinging()
    plant = ModelPlant(model, Periodic(0.5), [1.0, 0.0], np.diag([0.25, 0.0]), trials)
    _, x = simulate(plant, 1.0)
    for k in range(2):
        w = (x[k + 1] - model.propagate(x[k], 0.5)) / np.sqrt(0.5 * (0.01 + x[k, :, :1] ** 2))
        assert not w[:, 0].any()
        assert abs(w[:, 1].var() - 1) < 5 * np.sqrt(2 / trials)


# ------------------------------------------------------------------------------------------ reproducibility


@pytest.mark.parametrize("model", [WhiteNoiseAcceleration(4.0), Swinging()], ids=["linear", "nonlinear"])
def test_trial_37_alone_is_bit_equal_whatever_the_chunks(model):
    n = model.size
    mean, p = MEAN[:n] * 1e-5, COVARIANCE[:n, :n] * 1e-10

    def states(trials, first):
        plant = ModelPlant(model, Periodic(1.0), mean, p, trials)
        return simulate(plant, 10.0, Draw(seed=7, first_trial=first))[1]

    batch = states(100, 0)
    np.testing.assert_array_equal(states(1, 37)[:, 0], batch[:, 37])
    np.testing.assert_array_equal(states(7, 35), batch[:, 35:42])


def test_seed_and_name_matter_and_nothing_else():
    _, a = simulate(random_walk(5), 3.0, Draw(seed=1))
    _, again = simulate(random_walk(5), 3.0, Draw(seed=1))
    np.testing.assert_array_equal(a, again)
    for other in (
        simulate(random_walk(5), 3.0, Draw(seed=2))[1],
        simulate(random_walk(5, name="other"), 3.0, Draw(seed=1))[1],
    ):
        assert np.all(other[:, :, 0] != a[:, :, 0])


def test_one_diagram_serves_two_runs():
    plant = random_walk(4)
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    diagram = builder.Build()
    ends = []
    for seed in (1, 2, 1):
        context = diagram.CreateDefaultContext()
        set_draw(diagram, context, Draw(seed=seed))
        Simulator(diagram, context).AdvanceTo(3.0)
        ends.append(plant.GetOutputPort("state").Eval(plant.GetMyContextFromRoot(context)))
    np.testing.assert_array_equal(ends[0], ends[2])
    assert np.all(ends[0] != ends[1])


# --------------------------------------------------------------------------------------------------- timing


def test_between_ticks_the_state_is_propagated_and_a_log_changes_nothing():
    model = WhiteNoiseAcceleration(4.0)
    _, coarse = simulate(random_walk(3), 4.0)
    times, fine = simulate(random_walk(3), 4.0, every=Periodic(0.25))
    np.testing.assert_array_equal(fine[::4], coarse)
    for k in range(len(times) - 1):
        tick = k - k % 4
        if (k + 1) % 4:
            want = model.propagate(fine[tick], times[k + 1] - times[tick])
            np.testing.assert_array_equal(fine[k + 1], want)


def test_what_is_logged_at_a_tick_is_what_the_next_step_starts_from():
    model = ConstantVelocity(2.0)
    _, x = simulate(random_walk(3, model=model), 6.0)
    w = x[1:] - model.propagate(x[:-1], 1.0)
    np.testing.assert_allclose(w[..., :3], w[..., 3:] / 2, atol=1e-8)  # only true if x[k] was really used


def test_a_port_read_after_the_update_still_shows_the_same():
    plant = random_walk(3)
    simulator = Simulator(plant)
    simulator.Initialize()
    simulator.AdvanceTo(2.0)
    before = plant.GetOutputPort("state").Eval(simulator.get_context())
    simulator.AdvancePendingEvents()
    np.testing.assert_array_equal(plant.GetOutputPort("state").Eval(simulator.get_context()), before)


def test_irregular_ticks_and_a_late_first_one():
    stamps = [0.7, 1.0, 3.5]
    trials, model = 20_000, WhiteNoiseAcceleration(4.0)
    times, x = simulate(random_walk(trials, clock=Times(stamps)), 3.5)
    assert times.tolist() == stamps
    mean, p, t = MEAN, COVARIANCE, 0.0
    for k, stamp in enumerate(stamps):
        phi, q = model.transition(MEAN, stamp - t), model.process_noise(MEAN, stamp - t)
        mean, p, t = phi @ mean, phi @ p @ phi.T + q, stamp
        sigma = np.sqrt(np.diag(p))
        assert np.abs((x[k].mean(axis=0) - mean) / sigma).max() < 5 / np.sqrt(trials)
        assert np.abs((np.cov(x[k].T) - p) / np.outer(sigma, sigma)).max() < 5 * np.sqrt(2 / trials)


def test_means_and_covariances_per_trial():
    means = MEAN + np.arange(3)[:, None] * 1e4
    covariances = np.stack([np.zeros((6, 6)), COVARIANCE, np.zeros((6, 6))])
    _, x = simulate(ModelPlant(ConstantVelocity(0.0), Periodic(1.0), means, covariances, 3), 0.0)
    np.testing.assert_array_equal(x[0, [0, 2]], means[[0, 2]])
    assert np.all(x[0, 1] != means[1])


def test_before_it_is_started_the_port_shows_the_start():
    """All blocks are initialised at once: what reads the truth then must not see another one."""
    plant = random_walk(2)
    simulator = Simulator(plant)
    plant.set_draw(simulator.get_mutable_context(), Draw(seed=3, first_trial=5))
    port = plant.GetOutputPort("state")
    before = port.Eval(simulator.get_context())
    simulator.Initialize()
    np.testing.assert_array_equal(port.Eval(simulator.get_context()), before)
    assert np.all(before.reshape(2, 6) != MEAN)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trials": 0}, "trials: 0"),
        ({"trials": -1}, "trials: -1"),
        ({"mean": MEAN[:5]}, "emitter mean: shape"),
        ({"mean": MEAN * np.nan}, "emitter mean: all numbers must be finite"),
        ({"covariance": COVARIANCE[:5, :5]}, "emitter covariance: shape"),
        ({"covariance": -COVARIANCE}, "variance is negative"),
        ({"name": ""}, "name"),
    ],
)
def test_bad_arguments(change, message):
    good = {"mean": MEAN, "covariance": COVARIANCE, "trials": 3, "name": "emitter"}
    with pytest.raises(ValueError, match=message):
        ModelPlant(ConstantVelocity(1.0), Periodic(1.0), **(good | change))
