"""However many threads share the trials, no bit changes: with rows that are missing and with trials that are lost."""

import numpy as np
import pytest

from quietfix.diagrams.experiments.compare import compare
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.verification.verify import verify
from quietfix.systems.kernels import sharing
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.evaluating import linearized
from quietfix.systems.kernels.updating import by_matrix, extended
from tests.diagrams.test_command_line import in_process
from tests.laws.cases import estimators
from tests.laws.rig import Scene, assert_same, with_gaps
from tests.laws.test_batches_packaged import _SHORT, ERRORS, of, run

TRIALS, EPOCHS = 8, 6


@pytest.fixture
def cut(monkeypatch):
    """Pieces however small, and how many there were at each call."""
    counts = []
    whole = sharing.side_by_side
    monkeypatch.setattr(sharing, "_WORTH", 0.0)
    for module in ("sharing", "whole.stepping"):
        name = f"quietfix.systems.kernels.{module}.side_by_side"
        monkeypatch.setattr(name, lambda calls: counts.append(len(calls)) or whole(calls))
    return counts


@pytest.fixture(scope="module")
def scene():
    found = Scene(TRIALS, EPOCHS)
    found.measurement = with_gaps(found.measurement)
    return found


@pytest.mark.parametrize("name", estimators())
def test_an_estimator_has_the_same_bits(scene, cut, name):
    alone = scene.run(name, estimators()[name])
    assert not cut
    for count in (2, 3):
        cut.clear()
        with sharing.threads(count):
            assert_same(scene.run(name, estimators()[name]), alone)
        assert set(cut) <= {count}
        if name in ("ekf", "iekf", "ukf", "pf", "pf_sir"):
            assert cut


@pytest.mark.slow
@pytest.mark.parametrize("name", ERRORS)
def test_a_packaged_system_has_the_same_bits(cut, name):
    alone = run(name, of(name, _SHORT), 4)
    for count in (2, 3):
        cut.clear()
        shared = run(name, of(name, _SHORT), 4, threads=count)
        assert cut and set(cut) <= {2, count}
        for variable, values in alone.data_vars.items():  # the bounds, too: the same trials are in them
            np.testing.assert_array_equal(shared[variable].values, values.values, err_msg=str(variable))


def test_a_lost_trial_and_one_that_cannot_be_done_are_told_alike(scene, cut):
    """What goes wrong names the trial, whichever piece it is in."""
    model, code = scene.model, program(scene.model)
    mean = np.tile(scene.mean[:1], (7, 1))
    spread = np.tile(scene.covariance, (7, 1, 1))
    mean[4] = np.nan
    noise = np.tile(model.noise_covariance(), (7, 1, 1))
    platforms = scene.platforms[0].reshape(-1, 3, 6)
    value = np.tile(model.predict(scene.mean[:1], platforms), (7, 1))

    def update():
        return extended(mean, spread, value, platforms, noise, code, 5, 1e-2)

    alone = update()
    assert np.isnan(alone[0][4]).all() and np.isfinite(alone[0][3]).all()
    with sharing.threads(3):
        for one, other in zip(update(), alone, strict=True):
            np.testing.assert_array_equal(one, other)
        assert cut == [3]
        noise[6] *= -1
        with pytest.raises(ValueError, match="positive definite"):
            update()


def test_pieces_hold_all_trials_once(monkeypatch):
    assert sharing.pieces(1000, 10.0) == [slice(0, 1000)]
    with sharing.threads(3):
        assert sharing.pieces(30, 3.0) == [slice(0, 30)]  # not worth it: 90 us
        assert sharing.pieces(100, 3.0) == [slice(0, 33), slice(33, 66), slice(66, 100)]
        assert sharing.pieces(2, 1e6) == [slice(0, 1), slice(1, 2)]
    assert sharing.pieces(1000, 10.0) == [slice(0, 1000)]


def test_an_answer_names_the_first_trial_of_all(cut):
    """Two pieces go wrong: the first one is told, its trial counted from the beginning."""

    def answer(values, space):
        bad = np.flatnonzero(values)
        return int(bad[0]) * 256 + 7 if bad.size else -1

    parts = sharing.Parts((0,), 1, each=1.0, unit=256, good=-1)
    values = np.zeros(10)
    with sharing.threads(2):
        assert sharing.call(answer, (values, np.empty(1)), 10, parts) == -1
        values[[6, 8]] = 1
        assert sharing.call(answer, (values, np.empty(1)), 10, parts) == 6 * 256 + 7
        values[2] = 1
        assert sharing.call(answer, (values, np.empty(1)), 10, parts) == 2 * 256 + 7


def test_means_that_are_predicted_elsewhere_and_states_over_two_axes(scene, cut):
    rng = np.random.default_rng(1)
    spread = rng.normal(size=(5, 6, 6))
    spread = spread @ spread.swapaxes(1, 2)
    phi, noise = np.eye(6) + np.eye(6, k=3), np.eye(6)
    states = scene.mean[:5, None] + rng.normal(size=(5, 3, 6))
    platforms, code = scene.platforms[0].reshape(-1, 1, 3, 6), program(scene.model)
    alone = by_matrix(None, spread, phi, noise)[1], *linearized(code, states, platforms)
    with sharing.threads(2):
        shared = by_matrix(None, spread, phi, noise)[1], *linearized(code, states, platforms)
    assert cut == [2, 2]
    for one, other in zip(shared, alone, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "bearing_crossing", "--trials", "4"], "a whole number from 1 to 4; they share the trials"),
        (["compare", "bearing_crossing", "--trials", "4"], "a whole number from 1 to 4; they share the trials"),
        (
            ["sweep", "bearing_crossing", "--vary", "duration_s=6,8", "--trials", "4"],
            "a whole number from 1 to 4; they share the trials",
        ),
        (["run", "bearing_crossing", "--trials", "1000"], "a whole number from 1 to 256"),
    ],
)
@pytest.mark.parametrize("value", ["0", "-1", "1001"])
def test_numbers_of_threads_that_are_none(capsys, arguments, said, value):
    status, out, err = in_process(capsys, *arguments, "--threads", value)
    assert status == 2 and not out
    assert err == f"quietfix: threads: {value} is not allowed; {said}\n"


def test_words_and_requirements(capsys, project_root):
    status, _, err = in_process(capsys, "run", "bearing_crossing", "--threads", "a")
    assert status == 2 and "a is not allowed; a whole number" in err and err.count("\n") == 1
    file = str(project_root / "tests" / "requirements" / "bearing_crossing.requirements.yaml")
    status, out, err = in_process(capsys, "verify", file, "--threads", "0")
    assert status == 2 and not out and err.startswith("quietfix: threads: 0 is not allowed; a whole number from 1 to")
    with pytest.raises(UserError, match=r"threads: 1.5 is not allowed; a whole number from 1 to 100"):
        compare("bearing_crossing", threads=1.5)
    with pytest.raises(UserError, match="threads: True is not allowed"):
        verify(file, threads=True)
