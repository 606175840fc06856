"""Where systems are: by name, in a file, in a module, as an object, in an installed package; and what a result says."""

import importlib.metadata
import json
import shutil
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams import System, find, load_scenario, run_study
from quietfix.diagrams.assembly import find as finding
from quietfix.diagrams.experiments.compare import compare
from quietfix.diagrams.experiments.observability import observe
from quietfix.diagrams.experiments.sweep import sweep
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.results import open_result
from quietfix.systems.signals import Draw, set_draw
from tests.diagrams.drone_module import DRONE, Scenario
from tests.diagrams.test_command_line import in_process

SOURCE = (Path(__file__).parent / "drone_module.py").read_text(encoding="utf-8")
OWN = Path(__file__).parents[1] / "own" / "drone.yaml"
SHORT = ("--trials", "3")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A user's folder with a module of his in it; what a test imports from there is forgotten after it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "mine.py").write_text(SOURCE, encoding="utf-8")
    # pictures take seconds, and are those of every system
    for drawing in ("quietfix.diagrams.commands.running._illustrate", "quietfix.diagrams.figures.gdop.draw_gdop"):
        monkeypatch.setattr(drawing, lambda *arguments: None)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def write(result, folder):
    """Write a result as a store."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the type of texts
        result.to_zarr(folder / "results.zarr", consolidated=False)


def fails(capsys, *arguments):
    """Run a command that must end with one line and the status of a user's mistake; return the line."""
    status, _, err = in_process(capsys, *arguments)
    assert status == 2 and err.startswith("quietfix: ") and err.count("\n") == 1, err
    assert "Traceback" not in err
    return err


# ------------------------------------------------------------------------------------------------ all commands


def test_every_form_finds_the_same_system(folder, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    of_file, of_module = find("mine.py:DRONE:noisy"), find("mine:DRONE:noisy")
    for found, reference in ((of_file, "mine.py:DRONE"), (of_module, "mine:DRONE")):
        assert (found.system.name, found.variant, found.reference) == ("drone", "noisy", reference)
        assert found.title == f"{reference}:noisy" and found.slug == "drone_noisy"
        assert found.place == (folder / "mine.py").resolve()
        assert found.system.load(found.variant).sigma_m == 50.0
    assert of_file.fingerprint == of_module.fingerprint != ""
    # the same content is imported once: objects of its classes fit
    assert find("mine.py:DRONE").system is of_file.system is find(str(folder / "mine.py") + ":DRONE").system
    assert find(of_file.system).source == "file" and find(of_module.system).reference == "mine:DRONE"
    packaged = find("three_satellite:coplanar")
    assert packaged.attributes == {} and find(packaged.system).reference == "three_satellite"
    assert find(packaged) == packaged and find("three_satellite", "coplanar").variant == "coplanar"


def test_the_reference_and_the_object_give_the_same_numbers(folder):
    of_object = run_study(DRONE, trials=3, seed=4)
    of_file = run_study("mine.py:DRONE", trials=3, seed=4)
    assert np.array_equal(of_object["estimate"], of_file["estimate"])
    assert of_object.attrs["system"] == "tests.diagrams.drone_module:DRONE"
    assert of_object.attrs["system_fingerprint"] == of_file.attrs["system_fingerprint"]
    assert (of_file.attrs["system"], of_file.attrs["system_source"]) == ("mine.py:DRONE", "file")
    noisy = run_study(DRONE, variant="noisy", trials=3, seed=4)
    assert noisy.attrs["variant"] == "noisy" and "sigma_m: 50.0" in noisy.attrs["scenario"]
    changed = run_study(DRONE, scenario=Scenario(sigma_m=50.0), trials=3, seed=4)
    assert np.array_equal(noisy["estimate"], changed["estimate"])


def test_every_function_takes_the_object():
    assert compare(DRONE, trials=2, estimators=["iekf", "ekf"])["system"] == "tests.diagrams.drone_module:DRONE"
    assert sweep(DRONE, "sigma_m=5,10", trials=2, variant="noisy")["variant"] == "noisy"
    (one,) = observe(DRONE)
    assert one.components[0] == "range" and one.spectrum.rank[-1] == 6
    assert load_scenario(DRONE, "noisy", settings=["period_s=2"]).period_s == 2.0


def test_an_option_of_one_estimator_leaves_the_others_there():
    scenario = load_scenario(DRONE, settings=["estimators.iekf.max_iterations=3"])
    assert list(scenario.estimators) == ["iekf", "ekf"] and scenario.estimators["iekf"].max_iterations == 3


def test_annotations_that_are_texts_are_checked_all_the_same():
    with pytest.raises(UserError, match="sigma_m: 'wide' is not allowed; a number"):
        load_scenario(DRONE, settings=["sigma_m=wide"])


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["list", "mine.py:DRONE"], ["mine.py:DRONE: a drone ranged by four stations", "iekf, ekf", "DRONE:noisy"]),
        (["show", "mine.py:DRONE:noisy", "--set", "period_s=2"], ["# mine.py:DRONE:noisy", "sigma_m: 50.0", "s: 2"]),
        (["run", "mine.py:DRONE", *SHORT], ["mine.py:DRONE, 3 trials", "iekf", "ekf"]),
        (["run", "mine.py:DRONE:noisy", *SHORT, "--estimator", "ukf"], ["mine.py:DRONE:noisy, 3 trials", "ukf"]),
        (["compare", "mine.py:DRONE", *SHORT, "--estimator", "default"], ["mine.py:DRONE, 3 trials", "ukf"]),
        (["sweep", "mine.py:DRONE", "--vary", "sigma_m=5,10", *SHORT], ["sigma_m varied"]),
        (["observe", "mine.py:DRONE"], ["rows range_0", "observable"]),
    ],
)
def test_a_users_system_takes_every_command(capsys, command, said):
    status, out, err = in_process(capsys, *command)
    assert status == 0 and not err, err
    for words in said:
        assert words in out


def test_draw_and_gdop_write_their_files(capsys, folder):
    assert in_process(capsys, "draw", "mine.py:DRONE:noisy")[0] == 0
    assert "stations" in (folder / "drone_noisy.svg").read_text()
    status, out, err = in_process(capsys, "gdop", "mine.py:DRONE", "--set", "duration_s=1", "--out", "maps")
    assert status == 0, err
    assert "position [m]" in out and (folder / "maps").is_dir()


def test_a_requirements_file_names_a_system_beside_it(capsys, folder, monkeypatch):
    text = (
        "system: SYSTEM\ntrials: 60\ntrial_limit: 60\nlooks: 1\ncases: {plain: {}, loud: {variant: noisy}}\n"
        "requirements:\n"
        "  - {name: a, case: plain, estimator: iekf, metric: !Rmse {time_s: 4}, at_most: 200}\n"
        "  - {name: b, case: loud, estimator: ekf, metric: !Rmse {time_s: 4}, at_most: 900}\n"
    )
    (folder / "inner").mkdir()
    (folder / "mine.py").rename(folder / "inner" / "mine.py")
    file = folder / "inner" / "x.requirements.yaml"
    for reference in ("mine.py:DRONE", "mine:DRONE"):
        file.write_text(text.replace("SYSTEM", reference))
        status, out, err = in_process(capsys, "verify", str(file))
        assert status == 0 and "2 of 2 hold" in out, err
    file.write_text(text.replace("SYSTEM", "mine.py:DRONE").replace("noisy", "silent"))
    line = fails(capsys, "verify", str(file))
    assert "cases.loud.variant: variant of mine.py:DRONE: silent is not known; there are noisy" in line


def test_two_folders_with_modules_of_the_same_name_beside(folder):
    for name, sigma in (("one", 10.0), ("two", 20.0)):
        (folder / name).mkdir()
        (folder / name / "settings.py").write_text(f"SIGMA = {sigma}\n")
        changed = SOURCE.replace("import numpy as np", "import numpy as np\nfrom settings import SIGMA")
        (folder / name / "mine.py").write_text(changed.replace("sigma_m: float = 10.0", "sigma_m: float = SIGMA"))
    assert [load_scenario(f"{name}/mine.py:DRONE").sigma_m for name in ("one", "two", "one")] == [10.0, 20.0, 10.0]
    assert "settings" not in sys.modules and str(folder / "one") not in sys.path


def test_an_edit_within_the_same_second_is_seen(folder):
    assert load_scenario("mine.py:DRONE").sigma_m == 10.0
    (folder / "mine.py").write_text(SOURCE.replace("sigma_m: float = 10.0", "sigma_m: float = 30.0"))
    assert load_scenario("mine.py:DRONE").sigma_m == 30.0


def test_systems_of_one_name_are_not_written_into_one_folder(capsys, folder):
    shutil.copy(folder / "mine.py", folder / "other.py")
    line = fails(capsys, "compare", "mine.py:DRONE", "other.py:DRONE", *SHORT, "--out", "both")
    assert "another one is called drone" in line and not (folder / "both").exists()
    assert "given twice" in fails(capsys, "compare", "mine.py:DRONE", "mine.py:DRONE")


def test_an_installed_packages_system_has_a_name(capsys, folder, monkeypatch):
    monkeypatch.syspath_prepend(folder)
    entries = [
        importlib.metadata.EntryPoint(n, v, finding.GROUP) for n, v in (("quad", "mine:DRONE"), ("bad", "x_y:Z"))
    ]
    monkeypatch.setattr(finding, "entry_points", lambda group: entries)
    status, out, _ = in_process(capsys, "list")
    assert status == 0 and "quad: a drone ranged by four stations" in out and "quad:noisy" in out
    assert "system: bad, of an installed package: system: x_y cannot be imported" in out and "dual_satellite" in out
    result = run_study("quad:noisy", trials=2)
    assert (result.attrs["system"], result.attrs["system_source"]) == ("quad", "installed")
    assert "did you mean quad" in fails(capsys, "show", "quat")


# ------------------------------------------------------------------------------------------------- the diagram


def test_the_diagram_is_one_of_drakes():
    diagram = DRONE.diagram(trials=2, set={"duration_s": 2})
    assert diagram.get_name() == "drone" and diagram.HasSubsystemNamed("iekf")
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(1, 0))
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(2.0)
    block = diagram.GetSubsystemByName("ekf")
    estimate = block.GetOutputPort("estimate").Eval(block.GetMyContextFromRoot(context))
    assert estimate.shape == (12,) and np.isfinite(estimate).all()


def test_a_user_goes_on_from_the_assembly():
    builder = DiagramBuilder()
    assembly = DRONE.build(builder, load_scenario(DRONE), ["iekf"], 3)
    builder.ExportOutput(assembly.bus["iekf.estimate"], "estimate")
    assert assembly.bus.shape("measurement") == (3, 4) and builder.Build().GetOutputPort("estimate").size() == 18


# ---------------------------------------------------------------------------------------------- from a result


def test_a_result_finds_its_system_again_and_imports_it_with_trust_alone(capsys, folder, monkeypatch):
    (folder / "mine.py").write_text(SOURCE + "\nfrom pathlib import Path\nPath('ran').touch()\n")
    assert in_process(capsys, "run", "mine.py:DRONE:noisy", *SHORT, "--out", "r")[0] == 0
    first = open_result("r").load()
    for name in [name for name in sys.modules if name.startswith("mine@")]:
        del sys.modules[name]
    (folder / "ran").unlink()
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    line = fails(capsys, "run", "--from", "../r")
    assert "mine.py:DRONE is code that the result names" in line and "--trust" in line
    assert not (folder / "ran").exists() and not Path("ran").exists()
    # the file is where it was, wherever the command is given
    status, _, err = in_process(capsys, "run", "--from", "../r", "--trust", "--out", "again")
    assert status == 0 and not err
    assert first["estimate"].identical(open_result("again")["estimate"].load())
    assert open_result("again").attrs == first.attrs

    (folder / "moved").mkdir()
    (folder / "mine.py").rename(folder / "moved" / "his.py")
    line = fails(capsys, "run", "--from", "../r", "--trust")
    assert "mine.py cannot be read (No such file" in line
    status, out, err = in_process(capsys, "run", "../moved/his.py:DRONE", "--from", "../r", "--set", "period_s=2")
    assert status == 0 and not err and "DRONE:noisy, 3 trials" in out
    (folder / "moved" / "his.py").write_text(SOURCE)
    with pytest.warns(
        UserWarning, match=r"^\.\./moved/his.py:DRONE has changed since ../r was made: it runs as it is now$"
    ):
        assert in_process(capsys, "run", "../moved/his.py:DRONE", "--from", "../r")[0] == 0
    for other in ("three_satellite", str(OWN), "../moved/his.py:DRONE:silent"):
        assert fails(capsys, "run", other, "--from", "../r")


def test_an_object_that_no_module_has_is_to_be_named(capsys, folder):
    system = System("three_satellite", "of this name, and yet another", DRONE.scenario, DRONE.declare)
    result = run_study(system, trials=2)
    assert (result.attrs["system_source"], result.attrs["system"]) == ("object", "three_satellite")
    write(result, folder)
    assert "was an object in Python" in fails(capsys, "run", "--from", "results.zarr", "--trust")
    assert "is not that of" in fails(capsys, "run", "three_satellite", "--from", "results.zarr")


def test_a_system_of_yaml_is_in_its_result_even_when_the_file_is_gone(capsys, folder):
    file = folder / "own.yaml"
    file.write_text(OWN.read_text().replace("duration_s: 200", "duration_s: 6"))
    status, _, err = in_process(capsys, "run", "own.yaml", *SHORT, "--estimator", "ekf", "--out", "r")
    assert status == 0, err
    assert open_result("r").attrs["system_source"] == "yaml"
    first = open_result("r")["estimate"].load()
    status, _, err = in_process(capsys, "run", "--from", "r", "--out", "again")
    assert status == 0 and not err and first.identical(open_result("again")["estimate"].load())
    file.write_text(file.read_text() + "# changed\n")
    with pytest.warns(UserWarning, match=r"^own.yaml has changed since r was made: it runs as it is in the result$"):
        assert in_process(capsys, "run", "own.yaml", "--from", "r")[0] == 0
    file.unlink()
    with pytest.warns(UserWarning, match=r"^own.yaml is not there any more since r was made"):
        assert in_process(capsys, "run", "--from", "r", "--out", "third")[0] == 0
    assert first.identical(open_result("third")["estimate"].load())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("system_source", "network"),
        ("system_source", 3),
        ("system_file", 3),
        ("system_fingerprint", None),
        ("system", "mine.py:NOTHING"),
        ("system", "no_such.py"),
        ("system_file", "/dev/zero"),
        ("variant", "silent"),
    ],
)
def test_an_edited_result_is_one_line(capsys, folder, key, value):
    result = run_study("mine.py:DRONE", trials=2)
    write(result, folder)
    metadata = folder / "results.zarr" / "zarr.json"
    content = json.loads(metadata.read_text())
    content["attributes"][key] = value
    if value == "/dev/zero":
        (folder / "mine.py").unlink()
    metadata.write_text(json.dumps(content))
    assert fails(capsys, "run", "--from", "results.zarr", "--trust")


# ----------------------------------------------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ("three_satelite", "system: three_satelite is not known (did you mean three_satellite?)"),
        ("three_satelite", "or package.module:OBJECT, FILE.py:OBJECT or FILE.yaml"),
        ("three_satelite:coplanar", "did you mean three_satellite?"),
        ("no.such.module:DRONE", "there is no module no.such.module"),
        ("numpy.nothing:DRONE", "system: numpy.nothing cannot be imported: ModuleNotFoundError"),
        ("numpy:pi", "system: numpy:pi is not allowed; it is of type float, an object of quietfix.System is needed"),
        ("mine.py", "system: mine.py: which object in it? mine.py:OBJECT; there are DRONE"),
        ("mine.py:", "which object in it?"),
        ("mine.py:DRON", "system in mine.py: DRON is not known (did you mean DRONE?)"),
        ("mine.py:PLACES", "it is of type list, an object of quietfix.System is needed; there are DRONE"),
        ("mine.py:System", "it is of type class"),
        ("mine.py:DRONE:", "variant of mine.py:DRONE:  is not known; there are noisy"),
        ("mine.py:DRONE:nois", "did you mean noisy"),
        ("there.py:DRONE", "system: there.py cannot be read (No such file or directory)"),
        ("folder.py:DRONE", "system: folder.py cannot be read (it is a folder)"),
        ("there.yaml", "system: there.yaml cannot be read (No such file or directory)"),
        ("empty.yaml", "is empty; platforms, a target, sensors and estimators are needed"),
        ("", "system:  is not known"),
        (":", "system:  is not known"),
    ],
)
def test_what_is_not_there_is_one_line(capsys, folder, reference, said):
    (folder / "folder.py").mkdir()
    (folder / "empty.yaml").write_text("")
    assert said in fails(capsys, "run", reference, *SHORT)
    for command in ("show", "draw", "observe", "compare"):
        assert said in fails(capsys, command, reference)


BREAKS = {
    "syntax": ("def declare(scenario):", "def declare(scenario:", "SyntaxError", "def declare"),
    "import": (
        "from quietfix.diagrams import System",
        "import no_such_module",
        "No module named 'no_such_module'",
        None,
    ),
    "at import": ("PLACES = ", "PLACES = 1 / 0, ", "ZeroDivisionError: division by zero", None),
    "exit at import": ("PLACES = ", "raise SystemExit(7)\nPLACES = ", "SystemExit: 7", "raise"),
    "no dataclass": ("@dataclass\n", "", "scenario: <class", "DRONE = "),
    "no estimators": ("    estimators: dict", "    filters: dict", "lacks the field estimators", "DRONE = "),
    "an annotation": ("sigma_m: float", "sigma_m: flout", "name 'flout' is not defined", "DRONE = "),
    "a name": ('System("drone"', 'System("my drone"', "name: 'my drone' is not allowed", "DRONE = "),
    "a type of the scenario": (
        "float = 10.0",
        "complex = 10.0",
        "Scenario.sigma_m: the type complex is not allowed",
        "DRONE = ",
    ),
    "declare raises": ("    clock, motion", "    {}['key']\n    clock, motion", "KeyError: 'key'", "{}['key']"),
    "declare exits": ("    clock, motion", "    raise SystemExit(7)\n    clock, motion", "SystemExit: 7", "raise"),
    "declare gives nothing": ("    return Model(", "    Model(", "it returned NoneType", None),
    "a block refuses": (
        "Periodic(scenario.period_s)",
        "Periodic(-1.0)",
        "clock period: -1.0 is not allowed",
        "Periodic(-",
    ),
    "too long": ("duration=scenario.duration_s", "duration=1e9", "at most 1000000 epochs", None),
    "a part raises": ('lambda: Constant("stations", stations)', "lambda: 1 / 0", "ZeroDivisionError", "lambda: 1 / 0"),
    "no measurement": (
        'gives=["measurement"]',
        'gives=["measured"]',
        "iekf: it needs measurement, which nothing in this system gives",
        None,
    ),
    "two of a name": ('TargetSensor("sensor"', 'TargetSensor("stations"', "the name stations is not allowed", None),
    "assume raises": ("        return Assumed(", "        return Assumed[", "SyntaxError", "return Assumed["),
    "assume lacks": (
        "        return Assumed(",
        "        {}[name]\n        return Assumed(",
        "KeyError: 'iekf'",
        "{}[name]",
    ),
    "model raises": (
        "        offset = ",
        "        raise OSError('by hand')\n        offset = ",
        "OSError: by hand",
        "raise OS",
    ),
    "predict exits": (
        "        return np.linalg.norm(",
        "        raise SystemExit(3)\n        np.linalg.norm(",
        "SystemExit: 3",
        "raise S",
    ),
    "wrong shape": (
        "axis=-1)\n\n    def jacobian",
        "axis=-1)[..., :2]\n\n    def jacobian",
        "Ranges.predict: an array of shape (3, 2) is not allowed",
        None,
    ),
    "names": ('names = ("range_0", ', "names = (", "mine.py:DRONE", None),
    "covariance": ("np.diag([1e4, 1e4, 1e4, 25, 25, 25.0])", "np.eye(5)", "mine.py:DRONE", None),
}


@pytest.mark.parametrize("name", BREAKS)
def test_a_module_that_is_wrong_is_one_line_with_file_and_line(capsys, folder, name):
    old, new, said, line = BREAKS[name]
    assert SOURCE.count(old) >= 1
    broken = SOURCE.replace(old, new, 1)
    (folder / "mine.py").write_text(broken)
    err = fails(capsys, "run", "mine.py:DRONE", *SHORT, "--out", "r")
    assert said in err and "mine.py" in err
    if line is not None:
        number = next(i for i, text in enumerate(broken.splitlines(), 1) if line in text)
        assert f"(mine.py, line {number})" in err
    assert {path.name for path in folder.iterdir()} <= {"mine.py", "r.partial"}


def test_an_estimator_that_a_system_cannot_take_is_left_out_of_a_comparison(capsys, folder):
    refusing = "        {'iekf': 1, 'ekf': 2}[name]\n        return Assumed("
    (folder / "mine.py").write_text(SOURCE.replace("        return Assumed(", refusing))
    status, out, err = in_process(capsys, "compare", "mine.py:DRONE", *SHORT)
    assert status == 0, err
    assert "left out: ukf: KeyError: 'ukf' (mine.py, line" in out


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": ""}, "name: ''"),
        ({"title": "two\nlines"}, "one line of text"),
        ({"scenario": Scenario()}, "a dataclass"),
        ({"declare": None}, "a function of a scenario"),
        ({"base": "a.yaml"}, "base: 'a.yaml' is not allowed; a mapping, or a Path"),
        ({"variants": {"a b": {}}}, "variant: 'a b'"),
        ({"variants": {"a": 3}}, "variants.a: 3"),
    ],
)
def test_a_system_checks_its_arguments(change, said):
    good = {"name": "drone", "title": "", "scenario": DRONE.scenario, "declare": DRONE.declare}
    with pytest.raises(ValueError, match=said.replace(".", r"\.")):
        System(**good | change)
