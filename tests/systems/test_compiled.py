"""Compiled kernels: what is refused, what is kept on disk, and what a kernel of a user's own may do to others."""

import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams.console import compiling as telling
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.kernels import compiling
from quietfix.systems.kernels.calling import address_of, kernel
from quietfix.systems.kernels.equations import equations_of, of_kernel, program
from quietfix.systems.kernels.evaluating import linearized, values
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.particles.calls import residuals
from quietfix.systems.kernels.progress import on_compiling
from quietfix.systems.measurement.custom import CustomMeasurement
from quietfix.systems.measurement.distance import Range
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.motion.custom import CustomMotion
from tests.oracle.ranges import NumpyRange

PLATFORMS = np.array([[[0.0, 0, 0, 0, 0, 0], [1e4, 0, 0, 0, 0, 0], [0, 1e4, 0, 0, 0, 0]]])
STATES = np.array([[3e3, 4e3, 1e3, 10, 20, 0], [-5e3, 2e3, 2e3, 0, 5, 1], [1e3, 7e3, 500, -3, 0, 0]])

ITERATED = IteratedExtendedKalman(3)


@kernel
def squares(state, platforms, parameters, value, jacobian):
    for k in range(value.shape[0]):
        i = int(parameters[k])
        for axis in range(3):
            away = state[axis] - platforms[i, axis]
            value[k] += away * away  # it comes filled with zeros
            if jacobian.shape[0] > 0:
                jacobian[k, axis] = 2 * away
        if state[0] < -1e6:
            raise ValueError("too far west")
        if state[1] < -1e6:
            value[k] = np.nan


@kernel
def scribbling(state, platforms, parameters, value, jacobian):
    squares(state, platforms, parameters, value, jacobian)
    if state[0] < 0.0:
        for i in range(state.shape[0]):
            state[i] = -1.0


class Squares(NumpyRange):
    """Squared ranges: a kernel, and the same in NumPy."""

    shares_sight = False

    def __init__(self, stations):
        super().__init__(1e5, stations)
        self.names = tuple(f"square_{i}" for i in self.stations)

    def predict(self, target, platforms):
        return super().predict(target, platforms) ** 2

    def linearize(self, target, platforms):
        value, jacobian = super().linearize(target, platforms)
        return value**2, 2 * value[..., None] * jacobian

    def equations(self):
        return of_kernel(squares, self.stations, self.size, states=3, platforms=self.stations)


class Scribbling(Squares):
    """A kernel that writes into the state where that is in the west."""

    def equations(self):
        return of_kernel(scribbling, self.stations, self.size, states=3, platforms=self.stations)


class Longer(Range):
    """A subclass that changes what is measured and says nothing of its equations."""

    def predict(self, target, platforms):
        return super().predict(target, platforms) + 1e3


def updated(model, states=STATES, platforms=PLATFORMS, seen=None, algorithm=ITERATED):
    mean = states + np.array([50.0, -30, 20, 1, 0, -1])
    covariance = np.tile(np.diag([1e4] * 3 + [25.0] * 3), (len(mean), 1, 1))
    value = model.predict(states if seen is None else seen, platforms)
    told = Observation(value, platforms, Whitener(model.noise_covariance()))
    return algorithm.update(mean, covariance, told, model)


def test_a_users_kernel_is_the_model_in_numpy(monkeypatch):
    model = Stack([Squares([0, 2]), Tdoa(1e-8)])
    value, jacobian = linearized(program(model), STATES, PLATFORMS)
    expected, derivative = model.linearize(STATES, PLATFORMS)
    np.testing.assert_allclose(value, expected, rtol=1e-10)
    np.testing.assert_allclose(jacobian, derivative, rtol=1e-10)
    compiled = updated(model)
    monkeypatch.setattr("quietfix.systems.filters.iterated_extended.program", lambda model: None)
    for one, other in zip(compiled, updated(model), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("algorithm", [IteratedExtendedKalman(1), IteratedExtendedKalman(3), UnscentedKalman()])
def test_a_kernel_that_writes_into_the_state_harms_no_other_trial(algorithm):
    stack = [Tdoa(1e-8), Range(1.0, [1])]
    good, bad = (updated(Stack([kind([0, 2]), *stack]), algorithm=algorithm) for kind in (Squares, Scribbling))
    others = STATES[:, 0] > 0
    for one, other in zip(good, bad, strict=True):
        np.testing.assert_array_equal(one[others], other[others])
    assert not np.array_equal(good.mean, bad.mean)


def test_particles_of_a_kernel_that_writes_into_the_state_harm_no_other_trial():
    clouds, measured = np.repeat(STATES[:, :, None], 600, axis=2), np.zeros((3, 2))
    models = Squares([0, 2]), Scribbling([0, 2])
    good, bad = (residuals(program(model), clouds.copy(), measured, PLATFORMS) for model in models)
    others = STATES[:, 0] > 0
    np.testing.assert_array_equal(good.rows[others], bad.rows[others])


def test_a_subclass_that_measures_something_else_is_asked_itself():
    assert equations_of(Range(1.0, [0])) is not None
    assert program(Longer(1.0, [0])) is None
    assert program(Stack([Range(1.0, [1]), Longer(1.0, [0])])) is None
    assert updated(Longer(1.0, [0, 1])).innovation[0, 0] > 500  # of the biased prediction: 1000 m


def test_behind_the_boundary_a_kernel_is_held_against_predict():
    class Off(Squares):
        equations = Squares.equations  # claimed for what the class changes

        def predict(self, target, platforms):
            return super().predict(target, platforms) + 200  # sigma: 1e5; 2e-3

    good, off = (CustomMeasurement(kind([0, 1]), [0, 1]) for kind in (Squares, Off))
    good.check(STATES, PLATFORMS)
    assert program(good) is not None and program(CustomMeasurement(Squares([0]), [1])) is None
    with pytest.raises(ValueError, match=r"equations.*its kernel is 0\.002 sigmas off what predict gives"):
        off.check(STATES, PLATFORMS)


def test_what_is_no_kernel_is_refused():
    with pytest.raises(TypeError, match=r"kernel: four\(state, platforms, parameters, value\) is not allowed"):

        @kernel
        def four(state, platforms, parameters, value):
            value[0] = state[0]

    with pytest.raises(TypeError, match="plain function"):
        kernel(Range)

    @kernel
    def returns(state, platforms, parameters, value, jacobian):
        return state[0]

    with pytest.raises(TypeError, match="kernel: returns returns float64; it must return nothing"):
        address_of(returns)

    @kernel
    def unknown(state, platforms, parameters, value, jacobian):
        value[0] = np.interp(state, state, no_such_thing)  # noqa: F821

    with pytest.raises(TypeError, match=r"kernel: unknown cannot be compiled: "):
        address_of(unknown)


def test_a_kernel_that_raises_is_named_with_the_target():
    with pytest.raises(ValueError, match=r"kernel squares: for a target at \[-1999950.0, .*: ValueError: too far west"):
        updated(Squares([0]), np.array([[0, 0, 1e3, 0, 0, 0], [-2e6, 0, 0, 0, 0, 0.0]]))
    with pytest.raises(ValueError, match=r"kernel squares: for a target at .* too far west"):
        values(program(Squares([0])), np.full((2, 3, 6), -2e6), PLATFORMS)


def test_a_kernel_that_reads_beyond_an_array_raises_instead_of_reading_on():
    class Careless(Squares):
        def equations(self):
            return of_kernel(squares, [7], 1, states=3, platforms=[0])  # there is no platform 7

    with pytest.raises(ValueError, match=r"kernel squares: .*IndexError"):
        values(program(Careless([0])), STATES, PLATFORMS)


def test_nan_of_a_kernel_in_one_trial_harms_no_other():
    model = Squares([0, 1])
    good = updated(model)
    states = STATES.copy()
    states[1, 1] = -2e6
    bad = updated(model, states, seen=STATES)
    assert bad.nis_dof[1] == 0 and np.isnan(bad.nis[1]) and np.isnan(bad.innovation[1]).all()
    for one, other in zip(good, bad, strict=True):
        np.testing.assert_array_equal(one[[0, 2]], other[[0, 2]])


def test_too_few_platforms_or_states_are_refused():
    with pytest.raises(ValueError, match=r"at least 3 and \(3, 6\)"):
        values(program(Tdoa(1e-8)), STATES, PLATFORMS[:, :2])
    with pytest.raises(ValueError, match=r"2 states .* are not allowed"):
        values(program(Tdoa(1e-8)), STATES[:, :2], PLATFORMS)
    with pytest.raises(ValueError, match="platforms: -1 is not allowed"):
        of_kernel(squares, [-1], 1, platforms=[-1])


def test_without_a_folder_for_the_cache_code_is_made_in_memory_and_that_is_said_once(monkeypatch, caplog, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr(compiling, "_folders", lambda file: [blocked / "cache"])
    monkeypatch.setattr("quietfix.systems.kernels.progress._said", set())

    def made(state, platforms, parameters, value, jacobian):
        value[0] = 2 * state[0]

    def more(state, platforms, parameters, value, jacobian):
        value[0] = 3 * state[0]

    with caplog.at_level(logging.WARNING, "quietfix"):
        for factor, function in ((2, made), (3, more)):

            class Own(Range):
                own = kernel(function)

                def equations(self):
                    return of_kernel(self.own, [], 1)

            np.testing.assert_array_equal(
                values(program(Own(1.0, [0])), STATES, PLATFORMS)[:, 0], factor * STATES[:, 0]
            )
    assert [record.message for record in caplog.records] == [
        "compiled code is kept in memory only and made again in every run: no folder for it can be written; "
        "NUMBA_CACHE_DIR may name one"
    ]


def test_full_disk_and_damaged_files(monkeypatch, tmp_path):
    monkeypatch.setattr(compiling, "_folders", lambda file: [tmp_path])
    names = []
    on_compiling(names.append)

    def made(state, platforms, parameters, value, jacobian):
        value[0] = 2 * state[0]

    compiling.load(kernel(made))
    assert names == ["made", ""]
    compiling.load(kernel(made))
    assert names == ["made", ""]  # from the cache
    (data,) = tmp_path.glob("*.nbc")
    data.write_bytes(data.read_bytes()[:100])
    compiling.load(kernel(made))
    assert names == ["made", "", "made", ""]


SCRIPT = """
import sys, numpy as np
from quietfix.systems.kernels.progress import on_compiling
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.evaluating import linearized
from quietfix.systems.measurement.custom import CustomMeasurement
from quietfix.systems.measurement.distance import Range
assert "numba" not in sys.modules
names = []
on_compiling(lambda name: name and names.append(name))
value, jacobian = linearized(program(Range(1.0, [1, 0])), np.arange(6.0) ** 2, np.eye(2, 6))
print(names, value.tolist(), jacobian.tolist())
"""


@pytest.mark.slow
def test_a_second_process_compiles_nothing(tmp_path):
    root = Path(__file__).parents[2]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True, timeout=300
        ).stdout
        for _ in range(2)
    )
    assert first.startswith("['ranges', 'over_axes']") and second.startswith("[]")
    assert first.partition("]")[2] == second.partition("]")[2]
    assert list(tmp_path.rglob("*.nbc"))


@pytest.mark.slow
def test_sums_over_particles_are_the_same_bits_where_they_were_just_compiled(tmp_path):
    """A sum that is a function of its own would be one of two, which were optimised in different company."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", SUMS]
    first, second = (
        subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=300).stdout
        for _ in range(2)
    )
    assert first == second and len(first.split()) == 200


SUMS = """
import numpy as np
from quietfix.systems.kernels.loading import ready
random = np.random.default_rng(1)
logarithm = -5.0 * random.chisquare(3, (100, 201))
highest, weight = logarithm.max(-1), random.random((100, 201))
weight /= weight.sum(-1, keepdims=True)
for alike in (True, False):
    chosen = np.empty(100)
    ready("particles.stages:exponents")(logarithm, highest, weight, np.full(100, alike), np.ones(100), 0.5, chosen)
    print(*(x.hex() for x in chosen))
"""


@pytest.mark.slow
def test_two_processes_at_once_fill_one_empty_cache(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[2])}
    both = [
        subprocess.Popen(
            [sys.executable, "-c", SCRIPT], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    told = [one.communicate(timeout=300) for one in both]
    assert [one.returncode for one in both] == [0, 0], told
    assert len({out.partition("]")[2] for out, _ in told}) == 1
    third = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True)
    assert third.stdout.startswith("[]")  # what both have written is whole


@pytest.mark.slow
def test_where_neither_folder_can_be_written_the_users_cache_is_taken(tmp_path):
    """A copy of the package in which a file stands in the place of each folder: root may write everywhere else."""
    root, package = Path(__file__).parents[2], tmp_path / "copy"
    for room in ("systems", "diagrams", "quietfix"):
        leave = shutil.ignore_patterns("__pycache__")
        shutil.copytree(root / room, package / room, symlinks=True, ignore=leave)
    for folder in (package / "systems" / "kernels").rglob("*"):
        if folder.is_dir():
            (folder / "__pycache__").write_text("")
    (package / "systems" / "kernels" / "__pycache__").write_text("")
    (tmp_path / "file").write_text("")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "file"), "PYTHONPATH": str(package)}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}

    def run():
        command = [sys.executable, "-c", SCRIPT]
        return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)

    first, second = run(), run()
    assert first.stdout.startswith("['ranges', 'over_axes']") and second.stdout.startswith("[]")
    assert not first.stderr and list((tmp_path / "cache" / "quietfix").rglob("*.nbc"))
    environment["XDG_CACHE_HOME"] = str(tmp_path / "file")
    third = run()
    assert third.stdout == first.stdout
    assert third.stderr.count("compiled code is kept in memory only") == 1


@pytest.mark.parametrize("arguments", [["--help"], ["show", "three_satellite"]])
def test_help_and_show_do_not_wait_for_numba(arguments):
    script = f"import sys, runpy; sys.argv = {['quietfix', *arguments]!r}\n"
    script += "try: runpy.run_module('quietfix', run_name='__main__')\nexcept SystemExit: pass\n"
    script += "print('numba' in sys.modules)"
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout.splitlines()[-1] == "False"


def test_a_users_model_that_is_asked_in_numpy_is_logged_once(monkeypatch, caplog):
    monkeypatch.setattr("quietfix.systems.kernels.progress._said", set())
    behind = CustomMeasurement(NumpyRange(1.0, [0]), [0], has_jacobian=False)
    with caplog.at_level(logging.INFO, "quietfix"):
        for model in (Longer(1.0, [0]), Stack([Tdoa(1e-8), Longer(1.0, [0])]), behind, Squares([0]), Range(1.0, [0])):
            program(model)
    assert [record.message for record in caplog.records if "no equations" in record.message] == [
        f"{__name__}:Longer: no equations: it is asked in NumPy",
        f"{NumpyRange.__module__}:NumpyRange: no equations: it is asked in NumPy and its derivatives are central "
        "differences",
    ]


def test_a_users_motion_without_a_transition_is_logged_once(monkeypatch, caplog):
    monkeypatch.setattr("quietfix.systems.kernels.progress._said", set())
    motion, path = WhiteNoiseAcceleration(1.0), "mine:Wandering"
    with caplog.at_level(logging.INFO, "quietfix"):
        for has in (True, False, False):
            CustomMotion(motion, has_transition=has, path=path).check(STATES, 1.0)
    line = f"{path}: no transition: its derivatives are central differences"
    assert [record.message for record in caplog.records if "no transition" in record.message] == [line]


@pytest.mark.parametrize("terminal", [False, True])
def test_compiling_is_told_in_one_line_where_there_is_no_terminal(monkeypatch, capsys, terminal):
    monkeypatch.setattr(telling, "_count", 0)
    monkeypatch.setattr(telling, "live", lambda stream: terminal)
    for name in ("one", "two", ""):
        telling._show(name)
    told = capsys.readouterr().err
    if terminal:
        assert told.endswith("once for this machine: 2, two\r\x1b[K") and "\n" not in told
    else:
        assert told == "compiling numerical kernels, once for this machine\n"


def test_ready_gives_the_same_function_again():
    assert ready("extended:update") is ready("extended:update")
