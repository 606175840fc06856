"""A result of a system of YAML says what it was made of, and whether that has changed, gone or moved."""

import json
import shutil
import sys
import warnings

import pytest
import xarray as xr

from quietfix.diagrams.commands.new import new_files
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.rerun import ask_again
from quietfix.diagrams.studies.study import Study

TRACK = "time_s,x_m,y_m,z_m\n0,1,2,3\n200,5,6,7\n"
MODULE = """
from quietfix.systems.measurement.altitude import Altitude

class Height(Altitude):
    def __init__(self):
        super().__init__(30.0, "height")
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A system whose platform has a track and whose sensor is a class of one's own, a result of it, and a copy."""
    there, kept = tmp_path_factory.mktemp("from"), tmp_path_factory.mktemp("kept") / "kept"
    text = new_files("drone")["drone.yaml"]
    lines = {"  alpha:": "  alpha: !Track {file: track.csv}", "  barometer:": "  own: !Custom {class: a_height:Height}"}
    for begin, line in lines.items():
        (old,) = [one for one in text.splitlines() if one.startswith(begin)]
        text = text.replace(old, line)
    for name, content in {"own.yaml": text, "track.csv": TRACK, "a_height.py": MODULE}.items():
        (there / name).write_text(content, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", list(sys.path))
        patch.chdir(there)
        study = Study("own.yaml", estimators=["ekf"], trials=2, set={"duration_s": 2})
        with OutputFolder("res") as folder:
            for chunk in study.chunks():
                folder.append(chunk)
            folder.finish()
    shutil.copytree(there, kept)
    return there, kept


@pytest.fixture
def folder(made, monkeypatch):
    there, kept = made
    shutil.rmtree(there)
    shutil.copytree(kept, there)
    monkeypatch.chdir(there)
    monkeypatch.setattr(sys, "path", list(sys.path))
    sys.modules.pop("a_height", None)
    yield there
    sys.modules.pop("a_height", None)


@pytest.fixture
def result(folder):
    return folder / "res"


def again(result, system=None):
    """Ask for the system of a result, and declare it; return what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found, options = ask_again(result, system, {}, trust=True)
        try:
            found.model(options["scenario"])
        except UserError as error:
            caught.append(error)
    return [str(getattr(one, "message", one)) for one in caught]


def test_what_is_as_it_was_is_not_spoken_of_and_the_store_opens_without_a_warning(result):
    assert again(result) == []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        attributes = xr.open_zarr(result / "results.zarr").attrs
    assert set(json.loads(attributes["system_files"])) == {"track.csv", "a_height.py"}


@pytest.mark.parametrize("name", ["own.yaml", "track.csv", "a_height.py"])
def test_what_has_changed_is_named(result, folder, name):
    with (folder / name).open("a") as stream:
        stream.write("\n")
    (line,) = again(result)
    assert line.startswith(f"{name} has changed since {result} was made: it ")
    assert line.endswith("in the result" if name == "own.yaml" else "now")


def test_what_is_gone_is_named(result, folder):
    (folder / "own.yaml").unlink()
    (folder / "track.csv").unlink()
    track, system, error = again(result)
    assert track == f"track.csv is not there any more since {result} was made"
    assert system == f"own.yaml is not there any more since {result} was made: it runs as it is in the result"
    assert error == "platforms.alpha.file: track.csv cannot be read (No such file or directory)"


def test_a_column_that_was_renamed_is_named(result, folder):
    (folder / "track.csv").write_text(TRACK.replace("z_m", "zz_m"))
    track, error = again(result)
    assert track.startswith("track.csv has changed") and "columns ['time_s', 'x_m', 'y_m', 'zz_m']" in error


def test_a_system_that_has_moved_is_found_where_the_user_names_it(result, folder):
    (folder / "moved").mkdir()
    for name in ("own.yaml", "track.csv", "a_height.py"):
        shutil.move(folder / name, folder / "moved" / name)
    sys.modules.pop("a_height", None)
    assert again(result, "moved/own.yaml") == []


@pytest.mark.parametrize("value", [None, "", 5, [], True])
def test_a_marker_whose_version_is_missing_or_odd_is_none(result, value):
    marker = json.loads((result / MARKER).read_text())
    marker["version"] = value
    if value is None:
        del marker["version"]
    (result / MARKER).write_text(json.dumps(marker))
    with pytest.raises(UserError, match="is damaged, or no marker"):
        ask_again(result, None, {}, trust=True)


@pytest.mark.parametrize(
    ("key", "value"), [("version", ""), ("version", 5), ("system_files", "{"), ("system_files", 1)]
)
def test_attributes_that_are_odd_are_named(result, key, value):
    store = result / "results.zarr" / "zarr.json"
    content = json.loads(store.read_text())
    content["attributes"][key] = value
    store.write_text(json.dumps(content))
    with pytest.raises(UserError, match=f"--from: .*: {key}: "):
        ask_again(result, None, {}, trust=True)
