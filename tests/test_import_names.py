"""What `import quietfix` gives, and that no other package's names are in the way."""

import subprocess
import sys
import venv
from pathlib import Path

import pytest

import quietfix

ROOT = Path(__file__).parents[1]
OTHERS = {"diagrams": "Diagram = 1\n", "systems": "raise ImportError('not ours')\n"}
RUN = (
    "import sys, quietfix, diagrams; "
    "quietfix.run_study('three_satellite', trials=1, estimators=['ekf'], set={'duration_s': 2}); "
    "print(sorted(name for name in sys.modules if name.partition('.')[0] in ('diagrams', 'systems')))"
)


def run(arguments, folder):
    """Run Python where only `quietfix` and what lies in a folder can be imported."""
    path = f"{folder / 'ours'}:{folder}"
    environment = {"PYTHONPATH": path, "PATH": "/usr/bin:/bin", "MPLBACKEND": "Agg"}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.fixture
def beside(tmp_path):
    """A folder with a link to ours, and with packages of the names that ours have on the disk."""
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "quietfix").symlink_to(ROOT / "quietfix")
    return tmp_path


def test_all_names_are_there():
    assert sorted(quietfix.__all__) == list(quietfix.__all__)
    assert all(getattr(quietfix, name) is not None for name in quietfix.__all__)
    with pytest.raises(AttributeError, match="module 'quietfix' has no attribute 'walk'"):
        _ = quietfix.walk


def test_names_of_other_packages_are_not_in_the_way(beside):
    for name, text in OTHERS.items():
        (beside / name).mkdir()
        (beside / name / "__init__.py").write_text(text)
    assert run(["-c", RUN], beside).strip() == "['diagrams']"


def test_import_brings_nothing_that_takes_long(beside):
    probe = "import sys, quietfix; print([m for m in ('pydrake', 'numpy', 'xarray', 'matplotlib') if m in sys.modules])"
    assert run(["-c", probe], beside).strip() == "[]"


@pytest.mark.slow
def test_beside_the_package_diagrams(beside):
    """The real one, whose `import diagrams` used to win or lose by the order of the path."""
    venv.create(beside / "venv", with_pip=True)
    command = [str(beside / "venv" / "bin" / "python"), "-m", "pip", "install", "-qq", "--no-deps", "diagrams==0.24.4"]
    done = subprocess.run([*command, "--target", str(beside)], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"diagrams cannot be installed here: {done.stderr.strip().splitlines()[-1:]}")
    (beside / "jinja2").mkdir(exist_ok=True)  # what it imports at once, and is of no concern here
    (beside / "jinja2" / "__init__.py").write_text("Environment = FileSystemLoader = Template = object\n")
    (beside / "graphviz.py").write_text("Digraph = object\n")
    assert "diagrams" in run(["-c", RUN], beside)
