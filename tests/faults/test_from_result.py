"""``--from`` a result that was edited: one line for each edit, and nothing in a data file runs."""

import json
import shutil
import sys

import pytest

from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.rerun import ask_again
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study
from tests.faults.tree import quietfix

SPY = """
from pathlib import Path
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

Path("ran").touch()

class Spy(IteratedExtendedKalman):
    pass
"""
INFINITE, NAN = float("inf"), float("nan")
MISSING = object()
EDITS = [(key, MISSING) for key in ("system", "variant", "seed", "first_trial", "trials", "keep", "every", "scenario")]
EDITS += [
    ("system", value) for value in ("two_satellite", "", 3, None, ["three_satellite"], "three_satellite:coplanar")
]
EDITS += [("variant", value) for value in ("flat", 0, None, "../three_satellite", {})]
EDITS += [
    (key, value)
    for key in ("seed", "first_trial", "trials", "every")
    for value in (-1, 1.5, INFINITE, -INFINITE, NAN, "many", "3", None, True, [1], 2**53, 10**30)
]
EDITS += [("trials", 0), ("every", 0), ("keep", "nothing"), ("keep", 1), ("keep", None)]
EDITS += [
    ("scenario", value) for value in (1, None, INFINITE, "[1, 2]", "duration_s: .inf", "no_such_field: 1", "a: [")
]
EDITS += [("scenario", value) for value in ("estimators: {x: !Nothing {}}", "x: !!python/object/apply:os.abort []")]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A small result of a real study, without pictures."""
    path = tmp_path_factory.mktemp("from") / "result"
    study = Study("three_satellite", estimators=["iekf"], trials=2, set={"duration_s": 2})
    with OutputFolder(path) as folder:
        for chunk in study.chunks():
            folder.append(chunk)
        folder.finish()
    return path


@pytest.fixture
def copy(result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(result, tmp_path / "copy")


def edit(folder, change):
    """Let a function change the attributes of a result."""
    file = folder / "results.zarr" / "zarr.json"
    content = json.loads(file.read_text())
    change(content["attributes"])
    file.write_text(json.dumps(content))


@pytest.mark.parametrize(("key", "value"), EDITS)
def test_an_edited_attribute_is_one_line_that_names_it(copy, key, value):
    edit(copy, lambda a: a.pop(key) if value is MISSING else a.update({key: value}))
    with pytest.raises(UserError) as caught:
        ask_again(copy, None, {}, trust=True)
    said = str(caught.value)
    assert key in said or (key == "scenario" and "copy" in said)
    assert "\n" not in said and len(said) < 1500
    if value is MISSING:
        assert "it is missing" in said


def test_the_command_says_it_in_one_line(copy, capsys):
    edit(copy, lambda a: a.update(seed=INFINITE))
    assert quietfix("run", "--from", copy, "--out", "x") == 2
    assert capsys.readouterr().err == f"quietfix: --from: {copy}: seed: inf is not allowed; a whole number >= 0\n"


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"zarr_format": 2}', '{"zarr_format": 3, "node_type": "array"}', "[" * 9999]
)
def test_a_store_that_is_none_is_one_line(copy, text):
    (copy / "results.zarr" / "zarr.json").write_text(text)
    for read in (open_result, lambda path: ask_again(path, None, {}, trust=True)):
        with pytest.raises(UserError, match=r"results\.zarr") as caught:
            read(copy)
        assert "\n" not in str(caught.value)


def test_a_variant_that_is_not_the_results_is_refused(copy):
    assert ask_again(copy, "three_satellite", {}, trust=False)[0].title == "three_satellite"
    with pytest.raises(UserError, match="three_satellite:coplanar is not that of"):
        ask_again(copy, "three_satellite:coplanar", {}, trust=False)


def test_a_class_that_a_result_names_is_not_imported_without_trust(copy, tmp_path, capsys, monkeypatch):
    (tmp_path / "spying.py").write_text(SPY)
    monkeypatch.syspath_prepend(tmp_path)
    estimators = "  spy: !Custom\n    class: spying:Spy\n    options: {}\n"
    edit(copy, lambda a: a.update(scenario=a["scenario"] + estimators))
    command = ["run", "--from", copy, "--trials", "1"]
    for extra in ([], ["--estimator", "spy"], ["--estimator", "iekf"], ["--set", "duration_s=1"]):
        assert quietfix(*command, *extra) == 2
        err = capsys.readouterr().err
        assert "estimators.spy.class: spying:Spy" in err and "--trust" in err and err.count("\n") == 1
    assert not (tmp_path / "ran").exists() and "spying" not in sys.modules

    text = json.loads((copy / "results.zarr" / "zarr.json").read_text())["attributes"]["scenario"]
    with pytest.raises(UserError, match="spying:Spy"):
        load_scenario("three_satellite", text=text)

    assert quietfix(*command, "--trust") == 0
    assert "spy" in capsys.readouterr().out and (tmp_path / "ran").exists()
    sys.modules.pop("spying", None)


def test_what_a_user_names_himself_needs_no_trust(copy, tmp_path, capsys, monkeypatch):
    (tmp_path / "spying.py").write_text(SPY)
    monkeypatch.syspath_prepend(tmp_path)
    assert quietfix("run", "--from", copy, "--estimator", "spying:Spy", "--trials", "1") == 0, capsys.readouterr().err
    (tmp_path / "mine.yaml").write_text("duration_s: 1\nestimators: {mine: !Custom {class: spying:Spy}}\n")
    assert quietfix("run", "three_satellite", "--scenario", "mine.yaml", "--trials", "1") == 0, capsys.readouterr().err
    assert quietfix("run", "three_satellite", "--trust", "--trials", "1") == 2
    assert "--trust: it needs --from" in capsys.readouterr().err
    sys.modules.pop("spying", None)


def test_a_result_runs_again_into_itself(copy, capsys, monkeypatch):
    monkeypatch.setattr("quietfix.diagrams.commands.running._illustrate", lambda *arguments: None)
    assert quietfix("run", "--from", "copy", "--out", "copy") == 2
    before = open_result("copy")["estimate"].load()
    assert quietfix("run", "--from", "copy", "--out", "copy", "--overwrite") == 0, capsys.readouterr().err
    assert before.identical(open_result("copy")["estimate"].load())
    assert {path.name for path in copy.iterdir()} == {MARKER, "results.zarr", "summary.json"}


def array_edit(change):
    def edited(folder):
        file = folder / "results.zarr" / "estimate" / "zarr.json"
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))

    return edited


def version_2(folder):
    """Write an array of Zarr 2 whose filter unpickles what is in its chunk."""
    array = folder / "results.zarr" / "estimate"
    shutil.rmtree(array)
    array.mkdir()
    content = {"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "order": "C", "fill_value": None}
    (array / ".zarray").write_text(json.dumps(content | {"compressor": None, "filters": [{"id": "pickle"}]}))
    (array / "0").write_bytes(b"cos\nmkdir\n(S'ran'\ntR.")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (version_2, "cannot be read"),
        (array_edit(lambda c: c["codecs"].insert(0, {"name": "numcodecs.pickle"})), "the codec numcodecs.pickle"),
        (array_edit(lambda c: c.update(codecs=["my_codec"])), "the codec my_codec"),
        (
            array_edit(
                lambda c: c.update(
                    codecs=[{"name": "sharding_indexed", "configuration": {"codecs": [{"name": "json2"}]}}]
                )
            ),
            "the codec json2",
        ),
        (array_edit(lambda c: c.update(codecs=None)), "no list of codecs"),
        (array_edit(lambda c: c.update(data_type={"name": "object"})), "the data type object"),
        (array_edit(lambda c: c.update(storage_transformers=[{"name": "x"}])), "storage transformers"),
        (array_edit(lambda c: c.update(node_type="group")), "not an array"),
        (array_edit(lambda c: c.update(shape="many")), "cannot be read"),
    ],
)
def test_a_store_that_would_run_code_is_not_opened(copy, tmp_path, spoil, said):
    spoil(copy)
    for path in (copy, copy / "results.zarr"):
        with pytest.raises(UserError, match=said) as caught:
            open_result(path)
        assert "\n" not in str(caught.value) and not (tmp_path / "ran").exists()
    # what a study is run again from is text alone
    assert ask_again(copy, None, {}, trust=False)[0].title == "three_satellite"
