"""Interacting multiple models: one is the filter, several alike are the filter, and all are the textbook's."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from quietfix.systems.clocks import Periodic, Times
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.mode_chain import ModeChain
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.motion.manoeuvring.coordinated_turn import CoordinatedTurn
from quietfix.systems.motion.manoeuvring.driven import Driven
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.interacting.estimator import InteractingModels
from quietfix.systems.options.interacting.imm import Imm
from quietfix.systems.options.interacting.models import AsBelieved
from quietfix.systems.options.interacting.transitions import Matrix, Sojourn
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.starts.start import GivenStart
from tests.laws.rig import PORTS, Linear, Scene, assert_same, make, run, with_gaps

DT, EPOCHS, TRIALS = 2.0, 60, 5
CHAIN = np.array([[0.95, 0.03, 0.02], [0.1, 0.9, 0.0], [0.05, 0.15, 0.8]])
MOTIONS = {
    "straight": WhiteNoiseAcceleration(0.01),
    "left": CoordinatedTurn(0.1, 0.2),
    "agile": WhiteNoiseAcceleration(20.0),
}
FILTERS = {"ekf": Ekf(), "iekf": Iekf(max_iterations=3), "ukf": Ukf()}


def scene(gaps):
    """Three satellites over a target; with `gaps` a seventh of the rows is missing, and of each trial one epoch."""
    whole = Scene(7, 25)
    if gaps:
        whole.measurement = with_gaps(whole.measurement)
    return whole


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("name", FILTERS)
def test_one_model_is_the_filter_bit_for_bit(name, gaps):
    one = Imm(models={"only": AsBelieved()}, transitions=Sojourn({"only": 10.0}), filter=FILTERS[name])
    assert_same(scene(gaps).run("imm", one), scene(gaps).run(name, FILTERS[name]))


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("name", FILTERS)
def test_models_that_are_alike_are_the_filter(name, gaps):
    """To rounding: a mean of three equal numbers by weights that sum to 1 is off in its last bits."""
    chain = Matrix([[0.9, 0.1, 0.0], [0.2, 0.7, 0.1], [0.0, 0.5, 0.5]])
    alike = Imm(models={k: AsBelieved() for k in "abc"}, transitions=chain, filter=FILTERS[name])
    mine, plain = scene(gaps).run("imm", alike), scene(gaps).run(name, FILTERS[name])
    sigma = np.sqrt(np.einsum("...ii->...i", plain["covariance"]))
    # positions are of 6e6 m with sigmas of some 1e2: 1e-9 sigma is the last bit of the state
    tolerance = 3e-8 if name == "iekf" else 1e-8
    assert np.max(np.abs(mine["estimate"] - plain["estimate"]) / sigma) < tolerance
    scale = sigma[..., None] * sigma[..., None, :]
    assert np.max(np.abs(mine["covariance"] - plain["covariance"]) / scale) < tolerance
    np.testing.assert_array_equal(mine["nis_dof"], plain["nis_dof"])
    np.testing.assert_allclose(mine["nis"], plain["nis"], rtol=1e-6, atol=1e-8)


# ---------------------------------------------------------------------------------------------- the textbook's


def gaussian(nu, s):
    return np.exp(-0.5 * nu @ np.linalg.solve(s, nu)) / np.sqrt(np.linalg.det(2 * np.pi * s))


def textbook(x0, p0, z, h, r, first):
    """One trial of the estimator as Bar-Shalom, Li and Kirubarajan (2001), table of section 11.6.6, have it.

    Rows of z (epochs, m) that are NaN are left out. Likelihoods, not their logarithms.
    """
    count = len(MOTIONS)
    xs, ps, mu = [x0] * count, [p0] * count, np.array(first)
    columns = {"estimate": [], "covariance": [], "probabilities": [], "nis": [], "prediction": []}
    for k, row in enumerate(z):
        if k:
            c = CHAIN.T @ mu
            mixed = CHAIN * mu[:, None] / c
            x_in = [sum(mixed[i, j] * xs[i] for i in range(count)) for j in range(count)]
            p_in = [
                sum(mixed[i, j] * (ps[i] + np.outer(xs[i] - x_in[j], xs[i] - x_in[j])) for i in range(count))
                for j in range(count)
            ]
            mu = c
            steps = [(m.transition(x0, DT), m.process_noise(x0, DT)) for m in MOTIONS.values()]
            xs = [phi @ x for (phi, _), x in zip(steps, x_in, strict=True)]
            ps = [phi @ p @ phi.T + q for (phi, q), p in zip(steps, p_in, strict=True)]
        there = np.isfinite(row)
        a, b, value = h[there], r[np.ix_(there, there)], row[there]
        mean = sum(m * x for m, x in zip(mu, xs, strict=True))
        spread = sum(m * (p + np.outer(x - mean, x - mean)) for m, x, p in zip(mu, xs, ps, strict=True))
        columns["prediction"].append(mean)
        nu = value - a @ mean
        columns["nis"].append(nu @ np.linalg.solve(a @ spread @ a.T + b, nu) if there.any() else np.nan)
        if there.any():
            likely = np.empty(count)
            for j in range(count):
                s = a @ ps[j] @ a.T + b
                gain = ps[j] @ a.T @ np.linalg.inv(s)
                nu = value - a @ xs[j]
                likely[j] = gaussian(nu, s)
                xs[j], ps[j] = xs[j] + gain @ nu, ps[j] - gain @ s @ gain.T
            mu = likely * mu / (likely @ mu)
        mean = sum(m * x for m, x in zip(mu, xs, strict=True))
        columns["estimate"].append(mean)
        columns["covariance"].append(
            sum(m * (p + np.outer(x - mean, x - mean)) for m, x, p in zip(mu, xs, ps, strict=True))
        )
        columns["probabilities"].append(mu)
    return {port: np.array(values) for port, values in columns.items()}


@pytest.mark.parametrize("missing", ["none", "some", "whole epochs"])
def test_linear_gaussian_is_the_textbooks(missing):
    rng = np.random.default_rng(5)
    h = np.concatenate([np.eye(3, 6), rng.normal(size=(1, 6))])
    root = rng.normal(size=(4, 4)) + 4 * np.eye(4)
    model = Linear(h, root @ root.T)
    p0 = np.diag([400.0, 400, 400, 25, 25, 25])
    x0 = rng.normal(size=(TRIALS, 6)) * 20
    z = np.empty((EPOCHS, TRIALS, 4))
    truth = np.tile([0.0, 0, 0, 15, 5, 0], (TRIALS, 1))
    for k in range(EPOCHS):
        truth = list(MOTIONS.values())[k // 15 % 3].propagate(truth, DT)
        z[k] = truth @ h.T + rng.normal(size=(TRIALS, 4)) @ root.T
    if missing == "some":
        z[rng.uniform(size=z.shape) < 0.3] = np.nan
    elif missing == "whole epochs":
        z[7:20, 1], z[30:33], z[:, 4] = np.nan, np.nan, np.nan
    first = [0.7, 0.2, 0.1]
    clock = Times(DT * np.arange(EPOCHS))
    wiring = make("ekf", Ekf(), model, trials=TRIALS, clock=clock).wiring
    block = InteractingModels(
        "imm",
        IteratedExtendedKalman(max_iterations=1),
        model,
        MOTIONS["straight"],
        GivenStart(x0, p0),
        wiring,
        MOTIONS,
        ModeChain(CHAIN, DT),
        np.array(first),
    )
    ports = (*PORTS, "probabilities")
    _, values = run(block, z, np.zeros((EPOCHS, 1, 18)), clock, end=DT * (EPOCHS - 1), ports=ports)
    for i in range(TRIALS):
        expected = textbook(x0[i], p0, z[:, i], h, model.noise_covariance(), first)
        sigma = np.sqrt(np.einsum("kii->ki", expected["covariance"]))
        np.testing.assert_allclose(values["estimate"][:, i] / sigma, expected["estimate"] / sigma, rtol=0, atol=1e-10)
        np.testing.assert_allclose(values["prediction"][:, i] / sigma, expected["prediction"] / sigma, atol=1e-10)
        scale = sigma[..., None] * sigma[..., None, :]
        np.testing.assert_allclose(values["covariance"][:, i] / scale, expected["covariance"] / scale, atol=1e-10)
        np.testing.assert_allclose(values["probabilities"][:, i], expected["probabilities"], rtol=0, atol=1e-10)
        np.testing.assert_allclose(values["nis"][:, i], expected["nis"], rtol=1e-9)
    if missing == "none":
        # who moves how is found out: in the middle of each third, for the first round
        found = values["probabilities"].mean(axis=1)
        assert found[12, 0] > 0.5 and found[25, 1] > 0.5


# ------------------------------------------------------------------------------------------- trials that are lost


def test_a_lost_trial_and_a_lost_model_harm_no_other():
    """Trial 1 starts nowhere; of trial 2 one model's filter is lost in the middle, and the others become it again."""
    whole = scene(False)
    options = Imm(models={"calm": AsBelieved(), "agile": AsBelieved(4.0)}, transitions=Sojourn({"calm": 9, "agile": 9}))
    ports = (*PORTS, "probabilities")

    def go(mean, spoil=None):
        start = GivenStart(mean, whole.covariance)
        block = make("imm", options, whole.model, whole.motion, start, whole.trials, whole.clock)
        plain = block.algorithm.predict

        class Spoilt(type(block.algorithm)):
            steps = 0

            def predict(self, mean, covariance, motion, dt):
                moved, spread = IteratedExtendedKalman.predict(self, mean, covariance, motion, dt)
                Spoilt.steps += 1
                if Spoilt.steps == spoil:
                    moved[2] = np.nan
                return moved, spread

        assert plain is not None
        block.algorithm = Spoilt(max_iterations=1)
        return run(block, whole.measurement, whole.platforms, whole.clock, ports=ports)[1]

    sound = go(whole.mean)
    elsewhere = whole.mean.copy()
    elsewhere[1] = np.nan
    lost = go(elsewhere)
    others = [0, *range(2, 7)]
    for port in ports:
        np.testing.assert_array_equal(lost[port][:, others], sound[port][:, others])
    assert np.isnan(lost["estimate"][:, 1]).all()

    half = go(whole.mean, spoil=21)  # the calm one, at the eleventh step: two steps an epoch
    others = [0, 1, *range(3, 7)]
    for port in ports:
        np.testing.assert_array_equal(half[port][:, others], sound[port][:, others])
    assert np.isfinite(half["estimate"]).all()
    at = np.flatnonzero(half["probabilities"][:, 2, 0] == 0)
    assert at.size == 1 and half["probabilities"][at[0] + 1, 2, 0] > 0


# --------------------------------------------------------------------------------------------- chains and motions


def test_chains():
    chain = ModeChain.of_sojourns([20.0, 5.0, 8.0])
    np.testing.assert_allclose(chain.over(1.3) @ chain.over(2.7), chain.over(4.0), atol=1e-14)
    # in the long run a mode's share is its sojourn's where all others follow alike
    np.testing.assert_allclose(chain.long_run(), np.array([20.0, 5.0, 8.0]) / 33, atol=1e-12)
    stays = np.exp(-1e-3 / np.array([20.0, 5.0, 8.0]))
    np.testing.assert_allclose(np.diag(chain.over(1e-3)), stays, atol=1e-7)  # two jumps: of the order of (dt/tau)^2
    steps = ModeChain(CHAIN, DT)
    np.testing.assert_allclose(steps.over(3 * DT), CHAIN @ CHAIN @ CHAIN, atol=1e-15)
    np.testing.assert_allclose(steps.long_run() @ CHAIN, steps.long_run(), atol=1e-12)
    written = expm(3.0 * np.array([[-0.1, 0.1], [0.3, -0.3]]))
    np.testing.assert_allclose(ModeChain(written, 3.0).over(1.0), ModeChain([[-0.1, 0.1], [0.3, -0.3]], None).over(1.0))
    swaps = ModeChain([[0.1, 0.9], [0.9, 0.1]], 1.0)  # its determinant is negative: no chain of half the step is it
    np.testing.assert_allclose(swaps.long_run(), 0.5)
    with pytest.raises(ValueError, match=r"a step of 0\.5 s is not allowed; multiples of 1 s"):
        swaps.over(0.5)
    with pytest.raises(ValueError, match=r"row 2 sums to 0\.9; 1 is needed"):
        ModeChain([[0.5, 0.5], [0.5, 0.4]], 1.0)
    with pytest.raises(ValueError, match=r"-0\.1 is not allowed; probabilities >= 0"):
        ModeChain([[1.1, -0.1], [0.5, 0.5]], 1.0)


@pytest.mark.parametrize("rate", [0.1, -0.5, 0.02, 1e-4])
@pytest.mark.parametrize("axes", [2, 3])
def test_a_coordinated_turn_is_its_equation_integrated(axes, rate):
    """Transition by the exponential of the equation's matrix, noise by quadrature, at angles from 1e-4 to 1.5 rad."""
    dt, density = 3.0, 0.7
    turn = CoordinatedTurn(rate, density, axes)
    n = 2 * axes
    a, g = np.zeros((n, n)), np.zeros((n, axes))
    a[:axes, axes:], g[axes:] = np.eye(axes), np.eye(axes)
    a[axes, axes + 1], a[axes + 1, axes] = -rate, rate
    np.testing.assert_allclose(turn.transition(np.zeros(n), dt), expm(a * dt), rtol=1e-12, atol=1e-12)
    q, _ = quad_vec(lambda s: expm(a * s) @ g @ g.T @ expm(a * s).T, 0, dt, epsabs=1e-13)
    np.testing.assert_allclose(turn.process_noise(np.zeros(n), dt), density * q, rtol=1e-10, atol=1e-11)
    two = turn.transition(np.zeros(n), 1.0)
    step = two @ turn.process_noise(np.zeros(n), 2.0) @ two.T + turn.process_noise(np.zeros(n), 1.0)
    np.testing.assert_allclose(step, turn.process_noise(np.zeros(n), dt), rtol=1e-11, atol=1e-12)


def test_noise_that_is_added():
    plain = WhiteNoiseAcceleration(0.3)
    state = np.zeros((4, 6))
    np.testing.assert_allclose(
        Driven(plain, 0.5).process_noise(state, 2.0), WhiteNoiseAcceleration(0.8).process_noise(state, 2.0), rtol=1e-14
    )
    with pytest.raises(ValueError, match="it must be >= 0"):
        Driven(plain, -1.0)


def test_a_turn_sees_when_it_is_one():
    """Truth from the turn itself: the NIS of the mixture is what it is said to be, and its probability is near 1."""
    rng = np.random.default_rng(3)
    model = Linear(np.eye(3, 6), 100 * np.eye(3))
    trials, epochs = 200, 60
    x0, p0 = np.array([0.0, 0, 0, 30, 0, 0]), np.diag([100.0] * 3 + [4.0] * 3)
    turn = MOTIONS["left"]
    truth = np.tile(x0, (trials, 1)) + rng.normal(size=(trials, 6)) * np.sqrt(np.diag(p0))
    root = np.linalg.cholesky(turn.process_noise(x0, 1.0))
    z = np.empty((epochs, trials, 3))
    for k in range(epochs):
        if k:
            truth = turn.propagate(truth, 1.0) + rng.normal(size=(trials, 6)) @ root.T
        z[k] = truth[:, :3] + 10 * rng.normal(size=(trials, 3))
    chain = Sojourn({"straight": 1e4, "left": 1e4})
    written = {"straight": AsBelieved(), "left": _Left()}
    options = Imm(models=written, transitions=chain)
    block = make("imm", options, model, WhiteNoiseAcceleration(0.01), GivenStart(np.tile(x0, (trials, 1)), p0), trials)
    _, values = run(block, z, np.zeros((epochs, 1, 18)), Periodic(1.0), ports=(*PORTS, "probabilities"))
    assert values["probabilities"][30:, :, 1].mean() > 0.999
    # 200 trials and 30 epochs of 3 rows: the mean of chi-square over its 18000 degrees is within 4 sigma of 1
    assert abs(values["nis"][30:].mean() / 3 - 1) < 4 * np.sqrt(2 / (3 * 200 * 30))


class _Left(AsBelieved):
    """The turn of these tests, in whatever frame."""

    def model(self, believed, where):
        return MOTIONS["left"]
