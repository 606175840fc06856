"""A system in Python that declares what cannot be: one line that names the file and what is wrong, before it runs."""

import sys

import pytest

from quietfix.diagrams.commands.new import new_files
from quietfix.diagrams.studies.study import Study
from tests.diagrams.test_command_line import in_process

SOURCE = new_files("mine", python=True)["mine.py"]

MODELS = """
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel


class Own(MeasurementModel):
    names, units = ("a", "b"), ("m", "m")
    broken = ""

    def predict(self, target, platforms):
        value = np.stack([target[..., 0], target[..., 1]], axis=-1)
        if self.broken == "predict":
            return value[..., :1]
        return value.astype(str) if self.broken == "text" else value * (1j if self.broken == "complex" else 1.0)

    def jacobian(self, target, platforms):
        if self.broken == "raises":
            raise KeyError("here")
        size = 5 if self.broken == "jacobian" else 6
        return np.zeros((*target.shape[:-1], 2, size)) + np.eye(2, size)

    def noise_covariance(self):
        return {"noise shape": np.eye(3), "noise nan": np.nan * np.eye(2)}.get(self.broken, 25.0 * np.eye(2))

    def platforms_used(self, platforms):
        return np.ones((2, 1 if self.broken == "used" else platforms), dtype=bool)


class OwnMotion(MotionModel):
    names, units = ("x", "y", "z", "vx", "vy", "vz"), ("m",) * 3 + ("m/s",) * 3
    broken = ""

    def propagate(self, state, dt):
        return state[..., :3] if self.broken == "propagate" else state

    def transition(self, state, dt):
        return np.eye(4) if self.broken == "transition" else np.eye(6)

    def process_noise(self, state, dt):
        return 1.0 if self.broken == "noise" else np.eye(6)
"""

IMPORT = "from quietfix.systems.signals import Constant\n"
RANGES = "ranges = Range(scenario.sigma_m, stations=range(4))"
MODELLED = SOURCE.replace(IMPORT, IMPORT + MODELS)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def changed(text, *changes):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def refused(folder, capsys, text):
    (folder / "mine.py").write_text(text, encoding="utf-8")
    status, out, err = in_process(capsys, "run", "mine.py:SYSTEM", "--trials", "2")
    assert status == 2 and not out and err.count("\n") == 1, err
    return err.removeprefix("quietfix: ").rstrip("\n")


DECLARED = [
    ("scenario.duration_s, 1e4", "0, 1e4", "Model.duration: 0 is not allowed; a finite number > 0"),
    ("scenario.duration_s, 1e4", "'a', 1e4", "Model.duration: 'a' is not allowed"),
    ("scenario.duration_s, 1e4", "float('nan'), 1e4", "Model.duration: nan is not allowed"),
    ("scenario.duration_s, 1e4", "scenario.duration_s, None", "Model.divergence: None is not allowed"),
    ("scenario.duration_s, 1e4", "scenario.duration_s, -1", "Model.divergence: -1 is not allowed"),
    ("Model(clock", "Model(5", "Model.clock: 5 is not allowed; a clock such as Periodic(1.0)"),
    ("parts, assume", "5, assume", "Model.parts: 5 is not allowed; a list of functions of a bus"),
    ("parts, assume", "[5], assume", "Model.parts: 5, number 0, is not allowed"),
    ("parts, assume", "[], assume", "signal: truth is not there; a part must publish it"),
    ("parts, assume", "parts, None", "Model.assume: None is not allowed"),
    ('frame="local"', 'frame="local", rows=["a"]', "Model.rows: ['a'] is not allowed"),
    ("return Assumed(", "return None and (", "iekf: assume returned NoneType"),
    ("Assumed(ranges", "Assumed(None", "iekf: Assumed.model: NoneType is not allowed"),
    ("ranges, motion, G", "ranges, None, G", "iekf: Assumed.motion: NoneType is not allowed"),
    ("GivenStart(mean, covariance), r", "5, r", "iekf: Assumed.start: int is not allowed"),
    ("STATIONS.reshape(1, -1)", "STATIONS[:, :5].reshape(1, -1)", "signal: platforms of 20 numbers is not allowed"),
    ("Platforms(lambda: ", "Platforms(lambda: 5 or ", "block: int is not allowed; a Drake system is needed"),
]


@pytest.mark.parametrize(("old", "new", "said"), DECLARED)
def test_what_is_declared(folder, capsys, old, new, said):
    assert refused(folder, capsys, changed(SOURCE, (old, new))).startswith(f"mine.py:SYSTEM: {said}")


ARRAYS = [
    ("Own", "predict", "an array of shape (3, 1) is not allowed for arguments of (3, 6), (3, 4, 6); (3, 2)"),
    ("Own", "text", "real numbers"),
    ("Own", "complex", "an array of complex128 is not allowed; real numbers"),
    ("Own", "jacobian", "an array of shape (3, 2, 5) is not allowed"),
    ("Own", "noise shape", "an array of shape (3, 3) is not allowed; (2, 2)"),
    ("Own", "noise nan", "[[nan, nan], [nan, nan]] is not allowed; a covariance"),
    ("Own", "used", "an array of shape (2, 1) is not allowed; (2, 4)"),
    ("OwnMotion", "propagate", "an array of shape (3, 3) is not allowed for arguments of (3, 6); (3, 6)"),
    ("OwnMotion", "transition", "an array of shape (4, 4) is not allowed"),
    ("OwnMotion", "noise", "an array of shape () is not allowed"),
]
METHOD = {"text": "predict", "complex": "predict", "used": "platforms_used", "noise": "process_noise"}
METHOD |= {"noise shape": "noise_covariance", "noise nan": "noise_covariance"}


@pytest.mark.parametrize(("kind", "broken", "said"), ARRAYS)
def test_arrays_of_a_wrong_shape_or_kind(folder, capsys, kind, broken, said):
    believed = ("Own()", "motion") if kind == "Own" else ("ranges", "OwnMotion()")
    new = f"Assumed({believed[0]}, {believed[1]},"
    text = changed(MODELLED, ("Assumed(ranges, motion,", new), ('    broken = ""', f'    broken = "{broken}"'))
    line = refused(folder, capsys, text)
    assert line.startswith(f"mine.py:SYSTEM: iekf: {kind}.{METHOD.get(broken, broken)}: ") and said in line, line


def test_what_raises_is_named_with_its_line(folder, capsys):
    text = changed(MODELLED, (RANGES, "ranges = Own()"), ('    broken = ""', '    broken = "raises"'))
    number = next(i for i, line in enumerate(text.splitlines(), 1) if "raise KeyError" in line)
    assert refused(folder, capsys, text) == f"mine.py:SYSTEM: KeyError: 'here' (mine.py, line {number})"


def test_models_that_are_right_run_and_a_row_that_is_never_measured_is_said(folder):
    text = changed(MODELLED, (RANGES, "ranges = Own()"), ("Assumed(ranges, motion,", "Assumed(ranges, OwnMotion(),"))
    (folder / "mine.py").write_text(text, encoding="utf-8")
    (chunk,) = Study("mine.py:SYSTEM", trials=2).chunks()
    assert chunk.sizes["trial"] == 2
    text = changed(text, ("np.stack([target[..., 0],", "np.stack([target[..., 0] * np.nan,"))
    (folder / "mine.py").write_text(text, encoding="utf-8")
    with pytest.warns(UserWarning, match="a: never measured in this run"):
        list(Study("mine.py:SYSTEM", trials=2).chunks())


def test_a_default_that_is_wrong_is_told_with_the_system(folder, capsys):
    said = refused(folder, capsys, changed(SOURCE, ("sigma_m: float = 10.0", 'sigma_m: float = "x"')))
    assert said == "System mine: Scenario: sigma_m: 'x' is not allowed; a number"
    said = refused(folder, capsys, changed(SOURCE, ("period_s: float = 1.0", "period_s: float = 0.0")))
    assert "period_s: 0 is not allowed" in said


def test_a_syntax_error_says_its_line_once(folder, capsys):
    said = refused(folder, capsys, changed(SOURCE, ("def declare(", "def declare((")))
    assert said.count("(mine.py, line") == 1
