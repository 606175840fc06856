"""What a user hands over that is not what was meant: one line that names it, and no harm."""

import os
import sys
import time

import numpy as np
import pytest

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.schema.errors import UserError, one_line
from quietfix.diagrams.schema.scenario import dump, load, read_yaml
from quietfix.diagrams.studies.whole import run_study
from quietfix.systems.files import Unreadable, read_bytes, read_text

RUN = {"trials": 2, "set": {"duration_s": 2}}


def refused(capsys, *arguments):
    """Return the one line that a command says, and hold its exit status to 2."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    said = capsys.readouterr().err
    assert ended.value.code == 2, said
    assert said.count("\n") == 1 and len(said) < 2100, said
    return said


# ------------------------------------------------------------------------------------------------------- values

NAMES = ["1", "null", "true", "1.5", "'_x'", "'a b'", "'a/b'", "''", "satellites", "recorder", "score_iekf"]


@pytest.mark.parametrize("name", NAMES)
def test_an_estimator_has_a_name(capsys, name):
    said = refused(capsys, "run", "three_satellite", "--set", f"estimators={{iekf: !Iekf {{}}, {name}: !Iekf {{}}}}")
    assert "estimators: the name" in said and name.strip("'") in said


@pytest.mark.parametrize("name", ["1", "null", "é-2", "0x1", "1e3", "no"])
def test_a_name_in_quotes_is_kept_by_the_printed_scenario(name):
    scenario = load_scenario("three_satellite", settings=[f"estimators={{'{name}': !Iekf {{}}}}"])
    assert list(load(find("three_satellite").system.scenario, [read_yaml(dump(scenario))]).estimators) == [name]


HUGE = [
    ("three_satellite", "truth.sigma_fdoa_hz"),
    ("three_satellite", "belief.sigma_velocity_mps"),
    ("three_satellite", "belief.acceleration_mps2"),
    ("three_satellite", "constants.mu_m3ps2"),
    ("three_satellite", "truth.chain_m"),
    ("bearing_crossing", "truth.observer"),
    ("satellite_ranging", "observer.semi_major_axis_km"),
]


@pytest.mark.parametrize("value", ["1e300", "-1.0e+300", "1e400", "1" + "0" * 320, ".nan", "-.inf"])
@pytest.mark.parametrize(("name", "field"), HUGE)
def test_numbers_have_a_largest_size_by_their_unit(name, field, value):
    settings = {
        "truth.chain_m": f"truth.chain_m=[3.0, {value}]",
        "truth.observer": f"truth.observer=!Straight {{position_km: [0.0, {value}]}}",
    }
    with pytest.raises(UserError, match=rf"^{field}.* is not allowed; a finite number"):
        load_scenario(name, settings=[settings.get(field, f"{field}={value}")])


def test_what_is_divided_by_has_a_smallest_size():
    with pytest.raises(UserError, match=r"truth.sigma_tdoa_ns: .* at least 1e-15"):
        load_scenario("three_satellite", settings=["truth.sigma_tdoa_ns=1.0e-300"])
    with pytest.raises(UserError, match=r"belief.start"):
        load_scenario("three_satellite", settings=["belief.start=7"])


def test_a_scenario_object_is_checked_as_a_file_is():
    scenario = load_scenario("three_satellite")
    scenario.truth.sigma_fdoa_hz = 1e300
    with pytest.raises(UserError, match=r"truth.sigma_fdoa_hz: 1e\+300 is not allowed"):
        run_study("three_satellite", scenario=scenario)
    scenario = load_scenario("three_satellite", settings=["duration_s=2"])
    scenario.truth.height_km = np.float64(9.0)  # NumPy's numbers are numbers
    assert run_study("three_satellite", scenario=scenario, estimators=["iekf"], trials=1).sizes["time"] == 3


BAD_ARGUMENTS = [
    ({"system": None}, "system: None"),
    ({"system": 3}, "system: 3"),
    ({"system": b"three_satellite"}, "system: b'three_satellite'"),
    ({"variant": 3}, "variant of three_satellite: 3"),
    ({"scenario": 3}, "scenario: int is not allowed"),
    ({"scenario": {}}, "scenario: dict is not allowed"),
    ({"scenario": load_scenario("beacon_rocket")}, "scenario: Scenario is not allowed"),
    ({"estimators": "iekf"}, "estimators: 'iekf' is not allowed; a list"),
    ({"estimators": [3]}, "estimators: 3 in it"),
    ({"set": "duration_s=1"}, "set: 'duration_s=1' is not allowed; a list"),
    ({"set": 3}, "set: 3 is not allowed"),
    ({"keep": None}, "keep: None"),
    ({"trials": "3"}, "trials: '3'"),
]


@pytest.mark.parametrize(("argument", "said"), BAD_ARGUMENTS, ids=[said for _, said in BAD_ARGUMENTS])
def test_arguments_of_run_study(argument, said):
    with pytest.raises(UserError, match="^" + said):
        run_study(**{"system": "three_satellite", **RUN, **argument})


def test_arguments_are_text(capsys):
    assert r"argument 3: caf\udce9.yaml is not allowed; text in UTF-8" in refused(
        capsys, "run", "three_satellite", os.fsdecode(b"caf\xe9.yaml")
    )


def test_a_message_is_one_line_of_bounded_length():
    assert one_line("a\nb\x1b[31mc") == "a b\\x1b[31mc"
    assert len(one_line("x" * 10**6)) < 2100


# -------------------------------------------------------------------------------------------------------- files


def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    began = time.monotonic()
    for path in (tmp_path / "fifo", "/dev/zero"):
        with pytest.raises(Unreadable, match="it is not a regular file"):
            read_bytes(path)
    with pytest.raises(Unreadable, match="it is a folder"):
        read_text(tmp_path)
    with pytest.raises(Unreadable, match="No such file"):
        read_text(tmp_path / "absent")
    assert time.monotonic() - began < 5
    (tmp_path / "large").write_bytes(b"x" * 1001)
    with pytest.raises(Unreadable, match="1001 bytes; at most 1000"):
        read_text(tmp_path / "large", largest=1000)
    assert len(read_text(tmp_path / "large", largest=1001)) == 1001
    (tmp_path / "latin").write_bytes(b"caf\xe9")
    with pytest.raises(Unreadable, match="not utf-8: byte 3"):
        read_text(tmp_path / "latin")


@pytest.mark.parametrize("kind", ["fifo", "zero"])
def test_a_scenario_that_is_no_file(tmp_path, capsys, kind):
    os.mkfifo(tmp_path / "fifo")
    path = {"fifo": str(tmp_path / "fifo"), "zero": "/dev/zero"}[kind]
    for arguments in (["run", "three_satellite", "--scenario", path], ["verify", path]):
        assert f"{path} cannot be read (it is not a regular file)" in refused(capsys, *arguments)


_TEN = ", ".join(["*a{0}"] * 10)
BOMBS = {
    "aliases": "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [{_TEN.format(i - 1)}]\n" for i in range(1, 10)),
    "merge keys": "a0: &a0 {x: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [{_TEN.format(i - 1)}]}}\n" for i in range(1, 10)),
    "itself": "truth: &t {a: *t}\n",
    "levels": "a: " + "[" * 1000,
    "length": "#" * 300_000,
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_yaml_is_measured_before_it_is_loaded(bomb):
    began = time.monotonic()
    with pytest.raises(UserError, match=r"is too (large|deep|long)|has no end"):
        read_yaml(BOMBS[bomb])
    assert time.monotonic() - began < 5


def test_an_alias_may_be_used():
    assert read_yaml("a: &a {x: [1, 2]}\nb: *a\n") == {"a": {"x": [1, 2]}, "b": {"x": [1, 2]}}


# ------------------------------------------------------------------------------------------------ users' classes

CLASSES = """
import sys
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

class Mute(BaseException):
    def __str__(self):
        raise RuntimeError

class Exits(IteratedExtendedKalman):
    def update(self, *arguments):
        sys.exit(0)

class Moves(IteratedExtendedKalman):
    def predict(self, *arguments):
        raise Mute

class Stops(IteratedExtendedKalman):
    def predict(self, *arguments):
        raise GeneratorExit

class Made(IteratedExtendedKalman):
    def __init__(self):
        sys.exit(0)

class Refuses(IteratedExtendedKalman):
    def __init__(self):
        raise ValueError("mine")

class Bounded(KalmanEstimator):
    def __init__(self, name, model, motion, start, wiring):
        super().__init__(name, IteratedExtendedKalman(), model, motion, start, wiring)

    @property
    def bound_model(self):
        sys.exit(0)

class Half(KalmanEstimator):
    def __init__(self, *arguments):
        raise Mute
"""


@pytest.fixture
def classes(tmp_path, monkeypatch):
    (tmp_path / "leaving.py").write_text(CLASSES, encoding="utf-8")
    (tmp_path / "leaving_at_once.py").write_text("import sys\nsys.exit(0)\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("leaving", None)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("leaving:Exits", r"estimators.exits.class: leaving:Exits failed with SystemExit: 0 \(leaving.py, line 12\)"),
        ("leaving:Moves", r"leaving:Moves failed with Mute \(leaving.py, line 16\)"),
        ("leaving:Stops", r"leaving:Stops failed with GeneratorExit"),
        ("leaving:Made", r"leaving:Made failed with SystemExit: 0"),
        ("leaving:Refuses", r"leaving:Refuses failed with ValueError: mine"),
        ("leaving:Bounded", r"leaving:Bounded failed with SystemExit: 0"),
        ("leaving:Half", r"leaving:Half failed with Mute"),
        ("leaving_at_once:Any", r"leaving_at_once:Any cannot be imported \(SystemExit: 0\)"),
    ],
)
def test_a_class_that_ends_the_program_is_named(classes, name, said):
    with pytest.raises(UserError, match=said) as caught:
        run_study("three_satellite", estimators=[name], **RUN)
    assert "\n" not in str(caught.value)


def test_a_class_that_ends_the_program_is_exit_status_2(classes, capsys):
    for command in (["run"], ["compare"], ["sweep", "--vary", "truth.sigma_tdoa_ns=10,20"]):
        arguments = ["three_satellite", "--estimator", "leaving:Exits", "--trials", "2", "--set", "duration_s=2"]
        assert "leaving:Exits failed with SystemExit: 0" in refused(capsys, command[0], *arguments, *command[1:])


def test_ctrl_c_in_a_class_stays_ctrl_c(classes, monkeypatch):
    import leaving

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(leaving.Exits, "update", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_study("three_satellite", estimators=["leaving:Exits"], **RUN)
