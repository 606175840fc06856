"""Gates, heavy tails and being lost: what holds for every Kalman-type filter."""

import numpy as np
import pytest

from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.recovery.gate import Gate, likeliest_scale
from quietfix.systems.filters.recovery.heavy_tails import Huber, HuberRows, Student
from quietfix.systems.filters.recovery.screening import Screened, screen
from quietfix.systems.filters.recovery.surprise import ALARM, surprise
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.iekf_hypotheses import IekfHypotheses
from quietfix.systems.options.mgekf import Mgekf
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.starts.start import GivenStart, Start
from tests.laws.cases import FILTERS
from tests.laws.rig import PORTS, Linear, Scene, assert_same, make, run, textbook, with_gaps

KINDS = {"ekf": Ekf, "iekf": Iekf, "ukf": Ukf, "mgekf": Mgekf}
COUNTS = ("rejected", "releases", "restarts", "lost")
GATED = (*PORTS, *COUNTS)


def spoiled(scene, rate=0.1, seed=5):
    """Return a scene's measurements with gross errors of 30 sigma in so many rows, and gaps."""
    rng = np.random.default_rng(seed)
    gross = rng.normal(size=scene.measurement.shape) * 30 * scene.model.sigmas
    return with_gaps(scene.measurement + np.where(rng.random(gross.shape) < rate, gross, 0.0))


def gated(scene, options, measurement, start=None):
    return run(scene.estimator("gated", options, start), measurement, scene.platforms, scene.clock, ports=GATED)[1]


@pytest.mark.parametrize("per", ["row", "epoch"])
@pytest.mark.parametrize("name", KINDS)
def test_a_gate_that_passes_all_changes_no_bit(name, per):
    scene = Scene(5, 12)
    measurement = spoiled(scene)
    plain = run(scene.estimator(name, KINDS[name]()), measurement, scene.platforms, scene.clock)[1]
    open_ = gated(scene, KINDS[name](gate=Gate(1.0, per)), measurement)
    assert_same(open_, plain)
    assert not open_["rejected"].any() and not open_["releases"].any()


VARIANTS = {
    "per row": {"gate": Gate(0.99, "row", 3)},
    "per epoch": {"gate": Gate(0.99, "epoch", 2)},
    "huber": {"robust": Huber()},
    "student": {"robust": Student()},
    "both": {"gate": Gate(0.999, "row", 2), "robust": Huber(2.0)},
}


class FirstRows(Start):
    """A belief around what the first measurement's first row says, so that gross errors get in."""

    uses_measurement = True

    def __init__(self, mean, covariance):
        self.mean, self.covariance = mean, covariance

    def begin(self, measurement, platforms, inputs):
        able = np.isfinite(measurement[:, :1])
        shift = np.where(able, 1e9 * measurement[:, :1], 0.0)
        mean = self.mean + shift - np.round(shift, -4)
        return np.where(able, mean, np.nan), np.broadcast_to(self.covariance, (len(able), 6, 6))


@pytest.mark.parametrize("begins", ["given", "measured"])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_alone_is_as_in_a_batch(name, variant, begins):
    """Refusals, openings and new beginnings of one trial, too, are nobody else's."""
    whole = Scene(9, 25)
    options = KINDS[name](**VARIANTS[variant], restart=begins == "measured")
    measurement = spoiled(whole, 0.3)
    measurement[12:, 4] += 200 * whole.model.sigmas  # a trial that locks itself out, or is lost
    counts = COUNTS if "gate" in VARIANTS[variant] else (("lost", "restarts") if begins == "measured" else ("lost",))
    found = {}
    for trials in (slice(None), slice(4, 5), slice(2, 7)):
        scene = whole.only(trials)
        start = FirstRows(scene.mean, scene.covariance) if begins == "measured" else None
        block = scene.estimator("one", options, start)
        found[trials.start] = run(block, measurement[:, trials], scene.platforms, scene.clock, ports=(*PORTS, *counts))[
            1
        ]
    for start, trials in ((4, slice(4, 5)), (2, slice(2, 7))):
        for port in (*PORTS, *counts):
            np.testing.assert_array_equal(found[start][port], found[None][port][:, trials], err_msg=port)
    if "gate" in VARIANTS[variant]:
        assert found[None]["rejected"].any() and found[None]["releases"].any()


def test_a_gate_by_the_textbook():
    """Rows that are refused are those of a filter written out, and the rest is that filter without them."""
    rng = np.random.default_rng(2)
    trials, epochs, limit = 8, 30, 6.6348966  # chi-square, 1 degree of freedom, 99 %
    h, r = rng.normal(size=(3, 6)), np.diag([1.0, 4.0, 0.25])
    model, motion = Linear(h, r), ConstantVelocity(0.3)
    mean, covariance = rng.normal(size=(trials, 6)), np.diag([4.0] * 3 + [1.0] * 3)
    noise = rng.normal(size=(epochs, trials, 3)) * np.sqrt(np.diag(r))
    noise += np.where(rng.random(noise.shape) < 0.1, 30.0, 0.0)
    measurement = noise + np.zeros(6) @ h.T
    options = Ekf(gate=Gate(0.99, "row", 1000))
    block = make("gated", options, model, motion, GivenStart(mean, covariance), trials)
    values = run(block, measurement, np.zeros((epochs, 1, 18)), block.wiring.clock, ports=GATED)[1]
    phi, q = motion.transition(np.zeros(6), 1.0), motion.process_noise(np.zeros(6), 1.0)
    refused = np.zeros((trials, 3))
    for i in range(trials):
        x, p = mean[i], covariance
        for k in range(epochs):
            move = (phi, q) if k else (np.eye(6), np.zeros((6, 6)))
            before = move[0] @ x, move[0] @ p @ move[0].T + move[1]
            nu, s = measurement[k, i] - h @ before[0], np.diag(h @ before[1] @ h.T + r)
            out = nu**2 > limit * s
            refused[i] += out
            _, (x, p), innovation, _, dof = textbook(x, p, *move, h, r, np.where(out, np.nan, measurement[k, i]))
            # sums of six products, in units of about 1
            np.testing.assert_allclose(values["estimate"][k, i], x, rtol=0, atol=1e-10)
            np.testing.assert_allclose(values["innovation"][k, i], innovation, rtol=0, atol=1e-10)
            assert values["nis_dof"][k, i] == dof
    np.testing.assert_array_equal(values["rejected"][-1], refused)
    assert refused.sum() > 30


def locked_out(release_after, epochs=40, per="row"):
    """Return a run of a filter whose target jumps by 100 sigma, and the error of its position after it."""
    rng = np.random.default_rng(4)
    model, motion = Linear(np.eye(6)[:3], np.eye(3)), ConstantVelocity(0.05)
    measurement = rng.normal(size=(epochs, 20, 3))
    measurement[15:] += 100.0
    start = GivenStart(np.zeros(6), np.eye(6))
    block = make("gated", Ekf(gate=Gate(0.999, per, release_after)), model, motion, start, 20)
    values = run(block, measurement, np.zeros((epochs, 1, 18)), block.wiring.clock, ports=GATED)[1]
    truth = np.where(np.arange(epochs) < 15, 0.0, 100.0)[:, None, None]
    return values, np.abs(values["estimate"][..., :3] - truth).max(axis=(1, 2))


@pytest.mark.parametrize("per", ["row", "epoch"])
def test_a_gate_opens_again(per):
    values, error = locked_out(4, per=per)
    assert error[15:19].min() > 90  # four refusals
    assert error[19] < 6 and error[20:].max() < 15  # the next measurement: sigma 1, of 60 numbers, then a wide speed
    assert (values["releases"][-1] >= 1).all() and (values["releases"][18] == 1).all()
    assert values["rejected"][18].min() >= 4
    never, far = locked_out(1000, per=per)
    assert far[-1] > 90 and (never["releases"] == 0).all() and (never["lost"][-1] == 1).all()


def test_what_is_missing_is_neither_refused_nor_passed():
    scene = Scene(4, 20)
    measurement = scene.measurement.copy()
    measurement[6:12] = np.nan
    measurement[[4, 5, 12, 13]] += 100 * scene.model.sigmas
    rejected = gated(scene, Iekf(gate=Gate(release_after=1000)), measurement)["rejected"].sum(axis=-1)
    assert (rejected[5] > 8).all()
    np.testing.assert_array_equal(rejected[11], rejected[5])
    assert (rejected[13] > rejected[11]).all()


class FromPosition(Start):
    """Position as measured, speed zero."""

    uses_measurement = True

    def begin(self, measurement, platforms, inputs):
        mean = np.concatenate([measurement, np.zeros_like(measurement)], axis=-1)
        return mean, np.broadcast_to(np.diag([1.0] * 3 + [4.0] * 3), (len(mean), 6, 6))


def test_a_start_that_took_a_gross_error_is_begun_again():
    """100 sigma at the first epoch: two refusals later the trial begins from the measurement of then."""
    rng = np.random.default_rng(7)
    model = Linear(np.eye(6)[:3], np.eye(3))
    measurement = rng.normal(size=(20, 10, 3))
    measurement[0, :5, 0] += 100.0
    block = make("gated", Iekf(gate=Gate()), model, ConstantVelocity(0.05), FromPosition(), 10)
    values = run(block, measurement, np.zeros((20, 1, 18)), block.wiring.clock, ports=GATED)[1]
    np.testing.assert_array_equal(values["restarts"][-1].ravel(), [1.0] * 5 + [0.0] * 5)
    error = np.abs(values["estimate"][..., 0])
    assert error[1, :5].min() > 90 and error[2:].max() < 5
    assert not values["releases"].any()


def test_lost_trials_begin_again_or_say_so():
    """Without a gate, in a filter that believes that its target stands nearly still: 3 sigma a second of drift."""
    rng = np.random.default_rng(8)
    model = Linear(np.eye(6)[:3], np.eye(3))
    measurement = rng.normal(size=(60, 6, 3))
    measurement[30:] += 60.0
    for restart in (False, True):
        options = Ekf(restart=restart)
        ports = (*PORTS, "lost", "restarts") if restart else (*PORTS, "lost")
        block = make("one", options, model, ConstantVelocity(1e-4), FromPosition(), 6)
        values = run(block, measurement, np.zeros((60, 1, 18)), block.wiring.clock, ports=ports)[1]
        flag, error = values["lost"][..., 0], np.abs(values["estimate"][..., :3] - 60).max(axis=-1)
        assert not flag[:40].any()  # ten epochs are too few
        if restart:
            assert (values["restarts"][-1] == 1).all() and not flag[-1].any()
            assert error[45:].max() < 5
        else:
            assert flag[40:45].all() and error[40].min() > 5


def test_a_beginning_needs_a_start_from_measurements():
    scene = Scene(1, 2)
    with pytest.raises(
        ValueError, match=r"estimators\.one\.restart: true is not allowed where the start is a prior, .*measurements"
    ):
        scene.estimator("one", Ekf(restart=True))
    with pytest.raises(ValueError, match=r"estimators\.one\.gate: it is not allowed here; null"):
        scene.estimator("one", IekfHypotheses(gate=Gate()))


def test_false_alarms_are_as_rare_as_is_said():
    """1000 runs of 2000 epochs of chi-square numbers: at most 2e6 e^-h = 0.2 expected, by Ville's inequality."""
    rng = np.random.default_rng(1)
    highest = 0.0
    for rows in (1, 6):
        total, most = np.zeros(1000), np.zeros(1000)
        for _ in range(2000):
            surprise(rng.chisquare(rows, 1000), np.full(1000, float(rows)), total)
            most = np.maximum(most, total)
        highest = max(highest, most.max())
        # the bound itself, where it can be seen: 2000 e^-8 = 0.67 at 8
        assert np.mean(most > 8) < 2000 * np.exp(-8.0)
    assert 8 < highest < ALARM


def test_errors_three_times_as_large_are_noticed():
    rng = np.random.default_rng(2)
    total, first = np.zeros(1000), np.full(1000, np.inf)
    for k in range(100):
        surprise(9 * rng.chisquare(4, 1000), np.full(1000, 4.0), total)
        first = np.where((total > ALARM) & np.isinf(first), k + 1, first)
    assert first.min() >= 11 and np.median(first) < 20 and np.isfinite(first).all()
    before = total.copy()
    surprise(np.full(1000, np.nan), np.zeros(1000), total)
    np.testing.assert_array_equal(total, before)
    for _ in range(100):  # and it is over when the filter has come back
        surprise(rng.chisquare(4, 1000), np.full(1000, 4.0), total)
    assert (total < ALARM).all()


def test_the_scale_is_the_likeliest():
    """Of one row: no other factor of the prediction's covariance has a higher likelihood."""
    seen = Screened(np.array([[12.0]]), np.array([[[2.0]]]), np.array([[[3.0]]]))
    found = likeliest_scale(seen, np.array([[True]]))[0]
    scales = np.linspace(1, 200, 20_000)
    spread = 2.0 * scales + 3.0
    likelihood = -0.5 * (12.0**2 / spread + np.log(spread))
    assert found == pytest.approx(scales[np.argmax(likelihood)], abs=0.01)
    assert likeliest_scale(seen, np.array([[False]]))[0] == 1


@pytest.mark.parametrize("far", [0.5, 3.0, 40.0])
def test_huber_is_the_minimum_of_hubers_loss(far):
    """One row: the mean is where (x - m)^2/p + 2 rho((z - x)/s) is least, found by brute force."""
    p, s, k = 4.0, 1.5, 1.345
    model = Linear(np.eye(1, 6), [[s**2]])
    told = Observation(np.array([[far]]), np.zeros((1, 0, 6)), Whitener(np.array([[s**2]])))
    mean = HuberRows(IteratedExtendedKalman(), k).update(np.zeros((1, 6)), p * np.eye(6)[None], told, model).mean[0, 0]
    x = np.linspace(-1, far + 1, 2_000_001)
    e = np.abs(far - x) / s
    loss = x**2 / p + np.where(e < k, e**2, 2 * k * e - k**2)
    assert mean == pytest.approx(x[np.argmin(loss)], abs=1e-4)  # the grid: 2e-5


def test_screened_rows_are_the_same_without_compiled_equations():
    scene = Scene(6, 5)
    told = Observation(with_gaps(scene.measurement)[1], scene.platforms[1].reshape(-1, 3, 6), Whitener(np.eye(6)))
    covariance = np.broadcast_to(scene.covariance, (6, 6, 6))
    compiled = screen(scene.mean, covariance, told, scene.model)
    value, jacobian = scene.model.linearize(scene.mean, told.platforms)
    there = np.isfinite(told.value)
    np.testing.assert_array_equal(np.isfinite(compiled.innovation), there)
    np.testing.assert_allclose(
        compiled.innovation[there], scene.model.residual(told.value, value)[there], rtol=1e-9, atol=0
    )
    own = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    both = there[:, :, None] & there[:, None, :]
    scale = np.sqrt(np.einsum("...ii,...jj->...ij", own, own))
    np.testing.assert_allclose((compiled.own / scale)[both], (own / scale)[both], rtol=0, atol=1e-12)
    assert not compiled.own[~both].any()


def test_filters_here_are_all_of_them():
    assert {"huber rows", "second minimum", "student rows"} <= set(FILTERS)
