"""RA: against the same filter written out, causal against looking ahead, gates, gaps, planes that are not found."""

import numpy as np
import pytest

from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.fixes.orbit_plane import common_plane
from quietfix.systems.fixes.ranged_position import RangedPosition
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.options.ranging.ra import Ra, RaPaper
from quietfix.systems.options.ranging.range_decomposed import RangeDecomposed
from quietfix.systems.starts.start import GivenStart
from tests.laws.rig import run
from tests.systems.ranging_scene import EARTH, PRIOR, TARGET, measurements, sensor

CLOCK = Periodic(10.0)
TRIALS = 4


class Scene:
    """Noisy rows over some epochs, and priors."""

    def __init__(self, epochs=40, trials=TRIALS, seed=5):
        self.measured, self.observer, self.truth = measurements(trials, epochs, seed)
        self.mean = TARGET + np.random.default_rng(seed + 1).standard_normal((trials, 6)) * np.sqrt(np.diag(PRIOR))
        self.epochs, self.trials = epochs, trials

    def run(self, options=None, **kinds):
        wiring = Wiring(self.trials, tuple(ROWS), CLOCK, 1)
        start = GivenStart(self.mean, PRIOR)
        motion = OrbitalMotion(EARTH, False)
        if options is not None:
            block = options.make("ra", sensor(), motion, start, wiring)
        else:
            block = RangeDecomposed("ra", sensor(), motion, start, wiring, **kinds)
        inputs = {}
        if block.look_ahead:
            n = block.plane_epochs
            own = np.broadcast_to(self.observer[:n], (self.trials, n, 6))
            ahead = np.concatenate([self.measured[:, :n], own], axis=-1).reshape(1, self.trials, -1)
            inputs["preview"] = np.tile(ahead, (self.epochs, 1, 1))
        return run(
            block,
            self.measured.swapaxes(0, 1),
            self.observer[:, None],
            CLOCK,
            end=10.0 * (self.epochs - 1),
            inputs=inputs,
        )[1]


def written_out(scene, n=20, gate=16.0, gate_after=10):
    """The recipe in plain words, trial by trial; the plane is known from the first n epochs."""
    motion, model = OrbitalMotion(EARTH, False), sensor()
    position = RangedPosition(model)
    equation = position.equation
    estimates = np.empty((scene.epochs, scene.trials, 6))
    covariances = np.empty((scene.epochs, scene.trials, 6, 6))
    for trial in range(scene.trials):
        first = equation.candidates(scene.measured[trial : trial + 1, :n], scene.observer[:n], 100e3)[1]
        normal, count = common_plane(first)[0][0], n
        x, p = scene.mean[trial], PRIOR
        for k in range(scene.epochs):
            if k:
                phi = motion.transition(x, 10.0)
                x, p = motion.propagate(x, 10.0), phi @ p @ phi.T
            z, own = scene.measured[trial, k], scene.observer[k]
            roots = [state for state in equation.candidates(z, own, 100e3)[1] if np.isfinite(state).all()]
            if roots:
                place = min(roots, key=lambda state: abs(state[:3] @ normal))[:3]
                r = position.noise_covariance_at(x, own[None])
                nu, s = place - x[:3], p[:3, :3] + r
                if k < gate_after or nu @ np.linalg.solve(s, nu) <= gate:
                    gain = p[:, :3] @ np.linalg.inv(s)
                    keep = np.eye(6) - gain @ np.eye(3, 6)
                    x, p = x + gain @ nu, keep @ p @ keep.T + gain @ r @ gain.T
                    count += 1
                    h = np.cross(x[:3], x[3:])
                    h /= np.linalg.norm(h)
                    normal = (1 - 1 / count) * normal + np.sign(h @ normal) * h / count
                    normal /= np.linalg.norm(normal)
            estimates[k, trial], covariances[k, trial] = x, p
    return estimates, covariances


def test_it_is_the_filter_that_the_recipe_describes():
    scene = Scene(epochs=60)
    values = scene.run(Ra(look_ahead=True))
    estimates, covariances = written_out(scene)
    scale = np.sqrt(np.diagonal(covariances, axis1=-2, axis2=-1))
    assert np.abs((values["estimate"] - estimates) / scale).max() < 1e-6
    assert np.abs((values["covariance"] - covariances) / (scale[..., None] * scale[..., None, :])).max() < 1e-6


def test_causal_is_the_prior_until_the_plane_is_known_and_then_the_same():
    scene = Scene(epochs=45)
    ahead, causal = scene.run(Ra(look_ahead=True)), scene.run(Ra())
    motion, x, p = OrbitalMotion(EARTH, False), scene.mean, np.tile(PRIOR, (TRIALS, 1, 1))
    for k in range(19):
        np.testing.assert_allclose(causal["estimate"][k], x, rtol=1e-12)
        np.testing.assert_allclose(causal["covariance"][k], p, rtol=1e-9)
        assert not causal["nis_dof"][k].any()
        phi = motion.transition(x, 10.0)
        x, p = motion.propagate(x, 10.0), phi @ p @ phi.swapaxes(-1, -2)
    for port in ("estimate", "covariance", "nis"):
        np.testing.assert_allclose(causal[port][19:], ahead[port][19:], rtol=1e-9)
    np.testing.assert_allclose(causal["prediction"][19], x, rtol=1e-12)  # before the stored epochs are used
    error = np.linalg.norm((ahead["estimate"][-1] - scene.truth[-1])[:, :3], axis=-1)
    assert np.all(error < 150e3)


def test_the_future_is_not_used():
    """Epochs after k change nothing up to k; looking ahead they do: without them there is no plane."""
    scene, other = Scene(epochs=20), Scene(epochs=20)
    other.measured = scene.measured.copy()
    other.measured[:, 5:, 5] = -50.0
    for options, same in ((Ra(), True), (Ra(look_ahead=True), False)):
        a, b = scene.run(options)["estimate"][:5], other.run(options)["estimate"][:5]
        assert np.array_equal(a, b) == same


def test_a_window_without_any_root_is_waited_out():
    scene, whole = Scene(epochs=60), Scene(epochs=60)
    scene.measured = scene.measured.copy()
    scene.measured[1, :20, 5] = -50.0  # a radial acceleration that no distance explains
    values = scene.run(Ra())
    assert np.isfinite(values["estimate"]).all()
    assert not values["nis_dof"][:39, 1].any() and values["nis_dof"][39, 1] == 3
    error = np.linalg.norm((values["estimate"] - scene.truth[:, None])[..., :3], axis=-1)
    assert error[38, 1] > 300e3 > error[-1, 1]
    clean = whole.run(Ra())
    others = [0, 2, 3]
    np.testing.assert_allclose(values["estimate"][:, others], clean["estimate"][:, others], rtol=1e-12)
    ahead = scene.run(Ra(look_ahead=True))
    assert not ahead["nis_dof"][:19, 1].any() and ahead["nis_dof"][39, 1] == 3


def test_an_epoch_without_a_root_or_with_a_wild_one_is_only_predicted():
    scene = Scene()
    scene.measured = scene.measured.copy()
    scene.measured[0, 30, 5] = -50.0
    scene.measured[1, 31, 0] += 0.3
    values = scene.run(Ra())
    for trial, k in ((0, 30), (1, 31)):
        np.testing.assert_array_equal(values["estimate"][k, trial], values["prediction"][k, trial])
        assert values["nis_dof"][k, trial] == 0 and np.isnan(values["nis"][k, trial])
    assert values["nis_dof"][30, 1] == 3 and values["nis_dof"][32, 0] == 3


def test_as_printed_it_has_no_gate_and_takes_every_root():
    scene = Scene()
    scene.measured = scene.measured.copy()
    scene.measured[1, 31, 0] += 0.3
    values = scene.run(RaPaper())
    assert values["nis_dof"][31, 1] == 3 and values["nis"][31, 1] > 100
    assert np.all(values["nis_dof"] == 3)


def test_both_patterns_and_trackings_find_the_target():
    scene = Scene(epochs=60)
    for kinds in ({"pattern": "normal", "plane_epochs": 40}, {"track": "slopes"}, {"covariance_at": "root"}):
        values = scene.run(**kinds)
        error = np.linalg.norm((values["estimate"][-1] - scene.truth[-1])[:, :3], axis=-1)
        assert np.all(error < 200e3), kinds


def test_it_needs_the_six_rows():
    wiring = Wiring(1, tuple(ROWS), CLOCK, 1)
    start = GivenStart(TARGET, PRIOR)
    with pytest.raises(ValueError, match="ranging needs all rows"):
        Ra().make("ra", RelativeKinematics({"azimuth": 1e-3}, EARTH), OrbitalMotion(EARTH), start, wiring)
