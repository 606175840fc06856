"""Where new things go: a kind of measurement, an estimator, a packaged system are one file and at most one line each.

Each case is laid over a copy of the code as a newcomer would write it: the folders ``kind``, ``estimator`` and
``system`` hold its file where it belongs, `CASES` the line. Nothing else is touched, and it runs from the command line.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams import run_study
from tests.laws import test_rooms

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

CASES = {
    "kind": (
        "diagrams/own/fields/sensors.py",
        '        "classes.custom:Custom",',
        '        "kinds.cone_angle:ConeAngle",',
    ),
    "estimator": (
        "systems/registry.py",
        '    "custom": "quietfix.systems.options.custom:Custom",',
        '    "cubature": "quietfix.systems.options.cubature:Cubature",',
    ),
    "system": (
        "diagrams/assembly/find.py",
        '    "dual_satellite": "quietfix.diagrams.library.dual_satellite:SYSTEM",',
        '    "radio_beacons": "quietfix.diagrams.library.radio_beacons:SYSTEM",',
    ),
}
"""The table, a line that is in it, and the new one, which goes before it."""

COMMANDS = """
import contextlib, io, json, sys
from quietfix.diagrams.commands.command_line import main

told = []
for command in json.loads(sys.argv[1]):
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        try:
            status = main(command)
        except SystemExit as ended:
            status = ended.code
    told.append((status or 0, text.getvalue()))
print(json.dumps(told))
"""


def sources(root):
    """Text of every file of the code."""
    found = (path for top in ("systems", "diagrams", "quietfix") for path in (root / top).rglob("*"))
    kept = [path for path in found if path.is_file() and "__pycache__" not in path.parts]
    return {str(path.relative_to(root)): path.read_bytes() for path in kept}


class Tree:
    """A copy of the code with one thing more."""

    def __init__(self, folder, case):
        self.root, self.case = folder, case
        for top in ("systems", "diagrams", "quietfix"):
            shutil.copytree(ROOT / top, folder / top, symlinks=True)
        shutil.copytree(HERE / case, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
        table, line, new = CASES[case]
        text = (folder / table).read_text()
        assert text.count(f"{line}\n") == 1, f"{table} has changed; where does a new line go now?"
        (folder / table).write_text(text.replace(f"{line}\n", f"{new}\n{line}\n"))

    def python(self, *arguments):
        """Run Python on the copy, and return what it prints."""
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONSAFEPATH": "1"}
        command = [sys.executable, *map(str, arguments)]
        done = subprocess.run(command, env=environment, cwd=self.root, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return done.stdout

    def told(self, code, *arguments):
        """Run code on the copy that prints JSON."""
        return json.loads(self.python("-c", code, *arguments))

    def quietfix(self, *commands):
        """Run commands on the copy, one after the other in one process; return the exit status and text of each."""
        return self.told(COMMANDS, json.dumps([[str(word) for word in command] for command in commands]))


@pytest.fixture(scope="module")
def trees(tmp_path_factory):
    made = {}

    def tree(case):
        if case not in made:
            made[case] = Tree(tmp_path_factory.mktemp(case), case)
        return made[case]

    return tree


@pytest.mark.parametrize("case", CASES)
def test_one_file_and_one_line(trees, case):
    before, after = sources(ROOT), sources(trees(case).root)
    assert len(after.keys() - before.keys()) == 1 and not before.keys() - after.keys()
    changed = [name for name in before if before[name] != after[name]]
    assert changed == [CASES[case][0]]
    old, new = (found[changed[0]].decode().splitlines() for found in (before, after))
    assert len(new) == len(old) + 1 and CASES[case][2] in new


@pytest.mark.parametrize("case", CASES)
def test_rooms_stay_as_they_are_asked_to(trees, case, monkeypatch):
    """The laws of rooms on the copy: imports point down, no room is too full, no file too long."""
    before = set(test_rooms.MODULES)
    monkeypatch.setattr(test_rooms, "ROOT", trees(case).root)
    monkeypatch.setattr(test_rooms, "MODULES", test_rooms.modules())
    test_rooms.test_no_circle_of_rooms()
    test_rooms.test_no_circle_of_files()
    for top in ("systems", "diagrams"):
        test_rooms.test_rooms_are_small_and_say_what_they_are_for(top)
    for module in test_rooms.MODULES.keys() - before:
        test_rooms.test_files_and_functions_are_short(module)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "laws", "which", "least"),
    [
        ("kind", ["own/test_kinds.py"], "ConeAngle", 3),
        # a textbook filter, rows that are missing, trials alone and together
        ("estimator", ["laws/test_linear_gaussian.py", "laws/test_missing.py", "laws/test_batches.py"], "cubature", 7),
    ],
)
def test_the_laws_find_it_themselves(trees, case, laws, which, least):
    """What is in a table is tried by the tests of all that is there, and is listed nowhere else."""
    tree = trees(case)
    shutil.copytree(ROOT / "tests", tree.root / "tests", dirs_exist_ok=True)
    quiet = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", "-k", which]
    told = tree.python(*quiet, *(f"tests/{law}" for law in laws))
    assert int(told.rpartition(" passed")[0].split()[-1]) >= least, told


# ------------------------------------------------------------------------------------------------------------- a kind

JACOBIAN = """
import json
import numpy as np
from quietfix.diagrams.own.kinds.cone_angle import ConeAngleModel

rng = np.random.default_rng(5)
model = ConeAngleModel(0.01, [0, 2])
target = rng.normal(size=(50, 7)) * [3e3, 3e3, 1e3, 10, 10, 10, 1]
platforms = rng.normal(size=(50, 3, 6)) * [3e3, 3e3, 1e3, 10, 10, 10]
steps = 1e-2 * np.eye(7)
columns = [(model.predict(target + s, platforms) - model.predict(target - s, platforms)) / 2e-2 for s in steps]
off = np.abs(model.jacobian(target, platforms) - np.stack(columns, axis=-1)).max()
angle = model.predict(np.array([[1e3, 1e3, 0, 0, 0, 0]]), np.array([[[0, 0, 0, 0, 5, 0.0]] * 3]))
print(json.dumps({"off": off, "largest": np.abs(model.jacobian(target, platforms)).max(), "angle": angle.tolist()}))
"""

STUDY = """
import json, sys
from quietfix import run_study

result = run_study({file!r}, trials={trials}, seed=3, estimators={estimators})
half = result.isel(time=slice(result.sizes["time"] // 4, None))
error = (half["estimate"] - half["truth"]).sel(state=["x", "y", "z"])
rmse = ((error**2).sum("state").mean("trial")) ** 0.5
print(json.dumps({{
    "ratio": (rmse / half["bound_position"]).mean("time").values.tolist(),
    "nees": result["nees"].mean("trial").isel(time=-1).values.tolist(),
    "estimate": result["estimate"].isel(time=-1).values.tolist(),
    "truth": result["truth"].isel(time=-1).values.tolist(),
}}))
"""


def test_a_kind_has_the_right_derivative(trees):
    """Central differences of 1 cm at some kilometres: good to 1e-8 of the derivative, and to rounding, 1e-13 rad/m."""
    found = trees("kind").told(JACOBIAN)
    assert found["off"] < 1e-6 * found["largest"]
    np.testing.assert_allclose(found["angle"], [[np.pi / 4] * 2], rtol=1e-12)


@pytest.mark.slow
def test_a_kind_is_consistent_and_at_its_bound(trees):
    trials = 60
    found = trees("kind").told(STUDY.format(file=str(HERE / "cone.yaml"), trials=trials, estimators=["iekf", "ukf"]))
    low, high = chi2.ppf([0.0005, 0.9995], 6 * trials) / trials  # two looks at 1e-3
    assert all(low < one < high for one in found["nees"]), found["nees"]
    # 60 trials: a root mean square of three axes is good to some 5 %, the angles are not quite linear
    assert all(0.85 < one < 1.2 for one in found["ratio"]), found["ratio"]


SPEAKING = """
import json, sys
from pathlib import Path
import numpy as np
from quietfix import run_study
from quietfix.diagrams.commands.json_schema import schema_text
from quietfix.diagrams.schema.errors import UserError

file, folder = Path(sys.argv[1]), Path(sys.argv[2])
wrong = []
for old, new in (("cone: !ConeAngle", "cone: !ConeAngel"), ("sigma_deg: 0.5", "sigma_deg: -1")):
    (folder / "wrong.yaml").write_text(file.read_text().replace(old, new))
    try:
        run_study(str(folder / "wrong.yaml"), trials=1)
    except UserError as error:
        wrong.append(str(error))
titles = [one["title"] for one in json.loads(schema_text(None))["$defs"].values()]
print(json.dumps({"tags": titles.count("!ConeAngle"), "wrong": wrong}))
"""


@pytest.mark.slow
def test_a_kind_is_known_by_its_tag(trees, tmp_path):
    found = trees("kind").told(SPEAKING, HERE / "cone.yaml", tmp_path)
    assert found["tags"] == 2  # with a clock as a sensor, without one in a !Joint
    tag, sigma = found["wrong"]
    assert "sensors.cone: !ConeAngel is not known (did you mean !ConeAngle?)" in tag
    assert "sensors.cone.sigma_deg: -1 is not allowed; a finite number > 0" in sigma


def in_degrees(line):
    """A row of a table with its angle, and the sigma of it, in degrees."""
    row = line.split(",")
    if row[2] == "cone_angle":
        row[5:] = [repr(np.degrees(float(row[5])).item()), "deg", repr(np.degrees(float(row[7])).item())]
    return ",".join(row)


@pytest.mark.slow
def test_a_kind_is_written_and_read_by_its_names(trees, tmp_path):
    tree, file, table = trees("kind"), HERE / "cone.yaml", tmp_path / "made" / "measurements.csv"
    start = "start=!Given {at: !Straight {position_km: [1, 1, 0.3], velocity_mps: [8, -5, 0]}}"
    run = ["run", file, "--estimator", "ukf", "--set", start]
    ((status, told),) = tree.quietfix([*run, "--trials", 1, "--out", tmp_path / "made", "--write-measurements"])
    assert status == 0, told
    head, *rows = table.read_text().splitlines()
    assert {tuple(row.split(",")[2:4]) for row in rows} == {
        ("cone_angle", "tug"), ("cone_angle", "buoy"), ("cone_angle", "plane"), ("altitude", "")
    }  # fmt: skip
    turned = tmp_path / "degrees.csv"
    turned.write_text("\n".join([head, *map(in_degrees, rows)]) + "\n")
    again = [[*run, "--measurements", one, "--out", tmp_path / one.stem] for one in (table, turned)]
    assert [status for status, _ in tree.quietfix(*again)] == [0, 0]
    plain, degrees = (
        np.genfromtxt(tmp_path / one / "estimates.csv", delimiter=",", names=True)
        for one in ("measurements", "degrees")
    )
    assert plain.size > 50
    for name in ("x_m", "y_m", "z_m"):
        assert np.isfinite(plain[name]).all()
        np.testing.assert_allclose(degrees[name], plain[name], rtol=0, atol=1e-6)  # rounding of degrees


# ------------------------------------------------------------------------------------------------------- an estimator


@pytest.mark.slow
def test_an_estimator_is_reached_by_its_name(trees):
    """The cubature rule is what the defaults of `ukf` are, written otherwise: 1e-6 m is rounding after 200 epochs."""
    file = str(ROOT / "tests" / "own" / "drone.yaml")
    found = trees("estimator").told(STUDY.format(file=file, trials=5, estimators=["cubature", "ukf"]))
    cubature, ukf = np.array(found["estimate"])
    np.testing.assert_allclose(cubature, ukf, rtol=0, atol=1e-6)
    assert np.abs(cubature - found["truth"]).max() > 1e-3


@pytest.mark.slow
def test_an_estimator_takes_part_in_a_comparison(trees):
    file = ROOT / "tests" / "own" / "drone.yaml"
    compare = ["compare", file, "three_satellite", "--estimator", "cubature", "--trials", 2]
    (_, listed), (status, told) = trees("estimator").quietfix(["list"], compare)
    assert "cubature" in listed and status == 0, told
    assert told.count("cubature") >= 2


# ----------------------------------------------------------------------------------------------------------- a system


@pytest.mark.slow
def test_a_system_is_found_by_its_name(trees, tmp_path):
    run = ["run", "radio_beacons:noisy", "--trials", 40, "--out", tmp_path / "out"]
    (_, listed), (status, told) = trees("system").quietfix(["list"], run)
    assert "an aircraft ranges four ground beacons" in listed and status == 0, told
    found = json.loads((tmp_path / "out" / "summary.json").read_text())["estimators"]["iekf"]
    assert 0.8 < found["rmse_position_m"][-1] / found["bound_position_m"][-1] < 1.25  # 40 trials: good to some 6 %
    low, high = chi2.ppf([0.0005, 0.9995], 6 * 40) / 40
    assert low < found["nees_mean"][-1] < high


def test_a_system_of_ones_own_needs_no_line():
    """The same file where it lies: nothing of the code is touched. So it is with a YAML file (`tests.own`)."""
    file = HERE / "system" / "diagrams" / "library" / "radio_beacons.py"
    result = run_study(f"{file}:SYSTEM", trials=2)
    assert np.isfinite(result["estimate"].isel(time=-1)).all()
