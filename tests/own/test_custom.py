"""A user's own motion, target and parts in a system of YAML: they do what the built-in ones do, or are named."""

import sys
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.commands.new import new_files
from quietfix.diagrams.experiments.observability import observe
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.motion.custom import CustomMotion
from tests.diagrams.test_command_line import in_process

MODULE = '''
import numpy as np
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.signals import EnsembleBlock

BEGIN = [-5e3, 2e3, 900, 40, 5, 0]


class Circle(LeafSystem):
    """A continuous state: a circle, in every trial of another radius where it is told how many there are."""

    def __init__(self, radius_m=3000.0, speed_mps=60.0, trials=1):
        super().__init__()
        self.radius = radius_m + 100.0 * np.arange(trials)
        self.rate = speed_mps / self.radius
        begin = [[radius, 0, 900, 0, speed_mps, 0] for radius in self.radius]
        state = self.DeclareContinuousState(BasicVector(np.ravel(begin)))
        self.DeclareStateOutputPort("state", state)

    def DoCalcTimeDerivatives(self, context, derivatives):
        x = context.get_continuous_state_vector().CopyToVector().reshape(-1, 6)
        pull = -(self.rate[:, None] ** 2) * x[:, :2]
        derivatives.SetFromVector(np.concatenate([x[:, 3:], pull, 0 * pull[:, :1]], axis=1).ravel())


class One(Circle):
    def __init__(self, radius_m=3000.0):
        super().__init__(radius_m)


class Steps(LeafSystem):
    """A discrete state, more numbers than six, not on the first port, and an input."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("platforms", 24)
        state = self.DeclareDiscreteState(np.array([*BEGIN, 7.0]))
        self.DeclarePeriodicDiscreteUpdateEvent(0.5, 0.0, self.step)
        self.DeclareVectorOutputPort("other", 3, lambda context, output: None)
        self.DeclareStateOutputPort("state", state)

    def step(self, context, discrete):
        x = context.get_discrete_state_vector().value().copy()
        x[:3] += 0.5 * x[3:6]
        discrete.set_value(0, x)


def whole():
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(np.array(BEGIN)))
    builder.ExportOutput(source.get_output_port(), "state")
    return builder.Build()


class Ends(LeafSystem):
    def __init__(self, at_s=3.0):
        super().__init__()
        self.DeclareVectorOutputPort("state", 6, lambda context, output: self.fill(context, output, at_s))

    def fill(self, context, output, at_s):
        output.SetFromVector(np.full(6, np.nan) if context.get_time() >= at_s else np.array(BEGIN))


class Fails(LeafSystem):
    def __init__(self, when="made"):
        super().__init__()
        if when == "made":
            raise RuntimeError("in my constructor")
        self.DeclareVectorOutputPort("state", 6, self.fill)

    def fill(self, context, output):
        return 1 / 0


class Short(LeafSystem):
    def __init__(self, size=5):
        super().__init__()
        self.DeclareVectorOutputPort("state", size, lambda context, output: None)


class NoOutput(LeafSystem):
    pass


class NeedsInput(LeafSystem):
    def __init__(self):
        super().__init__()
        self.DeclareVectorInputPort("steering", 2)
        self.DeclareVectorOutputPort("state", 6, lambda context, output: None)


ONLY = One()
def same():
    return ONLY

def number():
    return 5


class Straight(MotionModel):
    """WhiteNoiseAcceleration without its transition."""

    names = ("x", "y", "z", "vx", "vy", "vz")
    units = ("m",) * 3 + ("m/s",) * 3

    def __init__(self, density=1.0):
        self.model = WhiteNoiseAcceleration(density)

    def propagate(self, state, dt):
        return self.model.propagate(state, dt)

    def process_noise(self, state, dt):
        return self.model.process_noise(state, dt)


class WrongShape(Straight):
    def propagate(self, state, dt):
        return state[..., :3]

class WrongNoise(Straight):
    def process_noise(self, state, dt):
        return -np.eye(6)

class NanNoise(Straight):
    def process_noise(self, state, dt):
        return np.full((6, 6), np.nan)

class NanMotion(Straight):
    def propagate(self, state, dt):
        return state * np.nan

class Text(Straight):
    def propagate(self, state, dt):
        return "here"

class WrongTransition(Straight):
    def transition(self, state, dt):
        return np.eye(5)

class Raises(Straight):
    def propagate(self, state, dt):
        raise KeyError("speed")

class OtherNames(Straight):
    names = ("a", "b", "c", "d", "e", "f")

class NoPropagate(MotionModel):
    names = Straight.names
    units = Straight.units
    def process_noise(self, state, dt):
        return np.eye(6)


class Later(EnsembleBlock):
    def __init__(self, trials, size, metres):
        super().__init__("later")
        self.declare_input("measurement", trials, size)
        self.declare_output(
            "changed", trials, size,
            lambda context: self.read(context, "measurement") + metres, {self.input_ticket("measurement")},
        )

def shifted(bus, metres=0.0):
    bus.add(Later(*bus.shape("measurement"), metres), gives={"measurement": "changed"})

class Shifted:
    def __init__(self, metres):
        self.metres = metres
    def __call__(self, bus):
        shifted(bus, self.metres)

def broken(bus):
    bus["nothing"]
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with a system of YAML and a module beside it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "drone.yaml").write_text(new_files("drone")["drone.yaml"], encoding="utf-8")
    (tmp_path / "own_things.py").write_text(MODULE, encoding="utf-8")
    yield tmp_path
    sys.modules.pop("own_things", None)


def custom(name, **options):
    return f"!Custom {{class: 'own_things:{name}', options: {options}}}".replace("'", '"')


def study(trials=3, **changes):
    return run_study("drone.yaml", trials=trials, set={"duration_s": 20, **changes}, estimators=["ukf"], keep="all")


def circle(times, radius, speed=60.0):
    angle = speed / radius * times
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def test_a_continuous_target_is_integrated_to_a_micrometre():
    """Runge-Kutta of order 5, 0.1 s: a turn of 20 s with 0.02 rad/s is off by far less."""
    result = study(target=custom("One", radius_m=2000.0))
    assert result["truth"].dims == ("time", "state")  # one for all trials
    assert np.abs(result["truth"].values[:, :2] - circle(result["time"].values, 2000.0)).max() < 1e-6
    assert np.isnan(result["bound_truth_position"]).all()  # its motion is none of the models


def test_a_target_that_is_told_the_trials_has_one_for_each_whatever_the_chunk():
    result = study(target=custom("Circle"))
    assert result["truth"].dims == ("trial", "time", "state")
    for trial in range(3):
        expected = circle(result["time"].values, 3000.0 + 100 * trial)
        assert np.abs(result["truth"].values[trial, :, :2] - expected).max() < 1e-6


def test_a_discrete_target_takes_signals_and_gives_the_port_that_is_named():
    there = study(target='!Custom {class: "own_things:Steps", port: state}')
    built_in = study(target="!Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}")
    np.testing.assert_allclose(there["truth"], built_in["truth"], atol=1e-9)
    # the same truth gives the same numbers
    np.testing.assert_allclose(there["estimate"], built_in["estimate"], atol=1e-5)


def test_a_diagram_is_a_target_and_an_oscillator_goes_with_it(folder):
    assert study(target=custom("whole"))["truth"].values[-1, 0] == -5e3
    result = study(target=custom("One"), oscillator="{carrier_mhz: 100, offset_hz: 50, sigma_offset_hz: 10}")
    assert list(result["truth_state"].values if "truth_state" in result else result["state"].values)[-1] == "bias"


def test_a_motion_without_a_transition_is_the_built_in_one_and_says_so_once():
    """Its transition is linear: central differences give it to rounding, 1e-9 of a step of a metre."""
    own, built_in = study(**{"belief.motion": custom("Straight")}), study()
    np.testing.assert_allclose(own["estimate"], built_in["estimate"], rtol=0, atol=1e-5)
    assert own.attrs["note"].count("central differences") == 1 and "belief.motion" in own.attrs["note"]
    truth = {"target": "!RandomMotion {start: !Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}}"}
    random = study(**truth, **{"belief.motion": custom("Straight")})
    np.testing.assert_allclose(random["truth"], study(**truth)["truth"], atol=1e-9)


def test_differences_of_a_bent_motion():
    """A turn of 0.1 rad/s in Earth-fixed coordinates against its derivative; steps of 0.16 m and 1 m/s: 1e-7."""

    class Turn(WhiteNoiseAcceleration):
        def propagate(self, state, dt):
            c, s = np.cos(0.1 * dt), np.sin(0.1 * dt)
            v = np.stack([c * state[..., 3] - s * state[..., 4], s * state[..., 3] + c * state[..., 4]], axis=-1)
            moved = state.copy()
            moved[..., :2] += dt * v * (1 + state[..., :1] * 1e-7)
            moved[..., 3:5] = v
            return moved

    state, dt = np.array([[6.3e6, 1e5, 2e5, 200.0, 30.0, 0.0]]), 2.0
    found = CustomMotion(Turn(1.0), has_transition=False).transition(state, dt)[0]
    c, s = np.cos(0.2), np.sin(0.2)
    turned = np.array([[c, -s], [s, c]])
    expected = np.eye(6)
    expected[3:5, 3:5] = turned
    expected[:2, 3:5] = dt * turned * 1.63
    expected[:2, 0] += dt * turned @ state[0, 3:5] * 1e-7
    expected[2, 5] = 0.0
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_a_transition_that_is_none_is_told():
    class Halved(WhiteNoiseAcceleration):
        def transition(self, state, dt):
            return super().transition(state, 0.5 * dt)

    state = np.array([[4.2e6, 8e5, 4.7e6, 100.0, -30.0, 5.0]])
    assert CustomMotion(WhiteNoiseAcceleration(1.0)).doubt(state, 2.0) == ""
    words = "motion: Halved.transition is 0.5 of the gradient off that of propagate."
    assert CustomMotion(Halved(1.0)).doubt(state, 2.0) == words


def test_parts_change_what_comes_after_them_and_their_signals_are_logged():
    changed = study(parts=f"[{custom('shifted', metres=1.0)}]".replace("!Custom ", ""))
    plain, none = study(), study(parts=f"[{custom('Shifted', metres=0.0)}]".replace("!Custom ", ""))
    np.testing.assert_array_equal(none["estimate"], plain["estimate"])
    assert np.abs(changed["estimate"] - plain["estimate"]).max() > 100  # a second more in every TDOA
    logged = study(parts='[{class: "own_things:shifted", signals: {moved: later.changed}}]')
    assert logged["moved"].shape[:2] == (3, logged.sizes["time"])


def test_observe_takes_a_target_of_ones_own():
    (one,) = observe("drone.yaml", set={"duration_s": 10, "target": custom("Circle")}, estimators=["ukf"])
    assert one.spectrum.rank[-1] == 6


WRONG = [
    ("target", "Nothing", "target.class: module own_things has no Nothing"),
    ("target", "BEGIN", "target.class: own_things:BEGIN is not allowed; what makes a Drake system"),
    ("target", "number", "made int; a Drake system is needed"),
    ("target", "same", "made the same block twice"),
    ("target", "Short", "output state of 5 numbers is not allowed; position and velocity are six"),
    ("target", "NoOutput", "has no vector output"),
    ("target", "NeedsInput", "signal: steering is not there"),
    ("target", "Ends", "at 0 s it puts out a number that is not finite"),
    ("target", "Fails", r"failed with RuntimeError: in my constructor \(own_things.py, line \d+\)"),
    ("target", "Fails:run", r"failed with ZeroDivisionError: division by zero \(own_things.py, line \d+\)"),
    ("target", "One:radius", "target.options: own_things:One says: TypeError"),
    ("belief.motion", "WrongShape", r"WrongShape.propagate: an array of shape \(2, 3\) is not allowed .*; \(2, 6\)"),
    ("belief.motion", "WrongNoise", "process_noise: it must be symmetric and finite, with a diagonal >= 0"),
    ("belief.motion", "NanNoise", "process_noise: it must be symmetric and finite"),
    ("belief.motion", "NanMotion", "propagate: a number that is not finite"),
    ("belief.motion", "Text", "Text.propagate: str is not allowed; an array of numbers"),
    ("belief.motion", "WrongTransition", r"transition: an array of shape \(5, 5\) is not allowed"),
    ("belief.motion", "Raises", r"Raises.propagate failed with KeyError: 'speed' \(own_things.py, line \d+\)"),
    ("belief.motion", "OtherNames", "OtherNames.names"),
    ("belief.motion", "NoPropagate", "lacks propagate"),
    ("belief.motion", "Circle", "a subclass of quietfix.systems.motion.base.MotionModel"),
    ("parts", "broken", r"parts.0: own_things:broken failed with ValueError: signal: nothing is not there"),
    ("parts", "BEGIN", "parts.0.class: own_things:BEGIN is not allowed; a function or a class"),
    ("parts", "Nothing", "parts.0.class: module own_things has no Nothing"),
]
OPTIONS = {"Ends": {"at_s": 0.0}, "Fails:run": {"when": "later"}, "One:radius": {"radius": 5.0}}


@pytest.mark.parametrize(("field", "name", "said"), WRONG)
def test_what_is_wrong_is_one_line(field, name, said):
    value = custom(name.partition(":")[0], **OPTIONS.get(name, {}))
    with pytest.raises(UserError, match=said) as caught:
        study(**{field: f"[{value.removeprefix('!Custom ')}]" if field == "parts" else value})
    assert "\n" not in str(caught.value)


def test_a_target_that_ends_within_the_run_is_told_with_its_time():
    with pytest.raises(UserError, match="own_things:Ends: at 3 s it puts out a number that is not finite"):
        study(target=custom("Ends"))


def test_a_port_that_is_not_there_and_a_signal_that_is_not():
    with pytest.raises(UserError, match=r"target.port: nose is not known; there are other, state"):
        study(target='!Custom {class: "own_things:Steps", port: nose}')
    with pytest.raises(UserError, match=r"parts.0.signals: nose is not there"):
        study(parts='[{class: "own_things:shifted", signals: {moved: nose}}]')


def test_a_result_names_no_code_without_trust(capsys, folder, monkeypatch):
    text = (folder / "drone.yaml").read_text(encoding="utf-8")
    begin, end = text.index("target:"), text.index("sensors:")
    (folder / "mine.yaml").write_text(f"{text[:begin]}target: {custom('One')}\n{text[end:]}", encoding="utf-8")
    monkeypatch.setattr("quietfix.diagrams.commands.running._illustrate", lambda *arguments: None)
    short = ("--trials", "2", "--estimator", "ekf")
    assert in_process(capsys, "run", "mine.yaml", *short, "--set", "duration_s=5", "--out", "res")[0] == 0
    status, _, err = in_process(capsys, "run", "--from", "res", *short)
    assert status == 2 and "target.class: own_things:One is code that the result names" in err
    # from elsewhere, what lies beside the system's file is found
    sys.modules.pop("own_things", None)
    (Path("inner")).mkdir()
    monkeypatch.chdir(folder / "inner")
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(folder))])
    status, out, err = in_process(capsys, "run", "--from", "../res", "--trust", *short)
    assert status == 0 and "ekf" in out, err


def test_modules_of_one_name_beside_two_systems_are_each_system_s_own(folder):
    for name, radius in (("one", 2000), ("two", 3000)):
        (folder / name).mkdir()
        (folder / name / "drone.yaml").write_text((folder / "drone.yaml").read_text(encoding="utf-8"), encoding="utf-8")
        module = MODULE.replace("radius_m=3000.0):", f"radius_m={radius}.0):")
        (folder / name / "own_things.py").write_text(module, encoding="utf-8")
    settings = {"duration_s": 2, "target": custom("One")}
    for name, radius in (("one", 2000), ("two", 3000), ("one", 2000)):
        result = run_study(f"{name}/drone.yaml", trials=1, estimators=["ekf"], set=settings)
        assert result["truth"].values[0, 0] == radius
