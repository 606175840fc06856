"""The project files agree with each other and with what is installed."""

import importlib.metadata
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

PACKAGES = ("systems", "diagrams")
PYTHONS = ("3.11", "3.12", "3.13")
LARGEST_FILE = 1_000_000


@pytest.fixture(scope="module")
def project(project_root):
    return tomllib.loads((project_root / "pyproject.toml").read_text())["project"]


def pins_for(root: Path, python: str) -> dict[str, Version]:
    """What constraints.txt pins under a version of Python."""
    pins: dict[str, Version] = {}
    for line in (root / "constraints.txt").read_text().splitlines():
        if not (line := line.partition("#")[0].strip()):
            continue
        requirement = Requirement(line)
        if requirement.marker and not requirement.marker.evaluate({"python_version": python}):
            continue
        name = canonicalize_name(requirement.name)
        (specifier,) = requirement.specifier
        assert specifier.operator == "==", f"{line}: not a pin"
        assert name not in pins, f"{name} is pinned twice for Python {python}"
        pins[name] = Version(specifier.version)
    return pins


def test_installed_version_is_that_of_the_project(project):
    try:
        installed = importlib.metadata.version(project["name"])
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("quietfix is not installed in this environment")
    assert installed == project["version"]


@pytest.mark.parametrize("python", PYTHONS)
def test_constraints_pin_every_dependency(project, project_root, python):
    pins = pins_for(project_root, python)
    extras = project["optional-dependencies"].values()
    for text in [*project["dependencies"], *(text for extra in extras for text in extra)]:
        requirement = Requirement(text)
        pin = pins.get(canonicalize_name(requirement.name))
        assert pin is not None, f"{requirement.name} is not pinned for Python {python}"
        assert pin in requirement.specifier, f"{requirement} does not allow the pinned {pin}"


def test_constraints_pin_what_the_dependencies_need(project, project_root):
    """Nothing that an installation brings along is left to float."""
    pins = pins_for(project_root, f"{sys.version_info.major}.{sys.version_info.minor}")
    extras = project["optional-dependencies"].values()
    pending = [Requirement(text) for text in project["dependencies"]]
    pending += [Requirement(text) for extra in extras for text in extra]
    seen: set[tuple[str, frozenset[str]]] = set()
    floating = set()
    while pending:
        requirement = pending.pop()
        name, wanted = canonicalize_name(requirement.name), frozenset(requirement.extras)
        if (name, wanted) in seen:
            continue
        seen.add((name, wanted))
        if name not in pins:
            floating.add(name)
        try:
            needs = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            continue  # an extra that is not installed here
        for text in needs:
            need = Requirement(text)
            if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in wanted | {""}):
                pending.append(need)
    assert not floating


def test_every_source_folder_is_a_package(project_root):
    """A folder without ``__init__.py`` is imported from a clone, but is missing from the wheel."""
    bare = [
        str(folder.relative_to(project_root))
        for package in PACKAGES
        for folder in {path.parent for path in (project_root / package).rglob("*.py")}
        if not (folder / "__init__.py").is_file()
    ]
    assert not bare


def test_no_large_file_is_tracked(project_root):
    if shutil.which("git") is None or not (project_root / ".git").exists():
        pytest.skip("not a git checkout")
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=project_root, capture_output=True, check=True, text=True
    ).stdout
    paths = [project_root / name for name in listing.split("\0") if name]
    large = [str(path) for path in paths if path.is_file() and path.stat().st_size > LARGEST_FILE]
    assert not large


@pytest.mark.slow
def test_wheel_holds_every_module_and_scenario(project, project_root, tmp_path):
    if Version(importlib.metadata.version("setuptools")) < Version("77"):
        pytest.skip("setuptools 77 or newer is needed to build")
    source = tmp_path / "source"
    source.mkdir()
    for name in ("pyproject.toml", "LICENSE", "README.md"):
        shutil.copy(project_root / name, source)
    for package in ("quietfix", *PACKAGES):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(project_root / package, source / package, symlinks=True, ignore=ignored)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "."]
    subprocess.run(command, cwd=source, check=True, stdin=subprocess.DEVNULL)
    (wheel,) = source.glob("*.whl")
    assert wheel.name == f"{project['name']}-{project['version']}-py3-none-any.whl"
    held = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"quietfix/{path.relative_to(source).as_posix()}"
        for package in PACKAGES
        for pattern in ("*.py", "scenarios/*.yaml", "templates/*")
        for path in (source / package).rglob(pattern)
    }
    assert expected | {"quietfix/__init__.py", "quietfix/__main__.py"} <= held
    assert not any(name.startswith(("tests", "systems", "diagrams")) for name in held)
