"""The JSON Schema of scenarios: it takes every file that we have, and refuses what the loader refuses."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import quietfix.diagrams
from quietfix.diagrams.assembly.find import systems
from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.commands.json_schema import schema_text
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import load, read_yaml

OWN = sorted(path for path in Path(__file__).parent.glob("*.yaml") if ".requirements" not in path.suffixes)
PACKAGED = sorted((Path(quietfix.diagrams.__file__).parent / "library" / "scenarios").glob("*.yaml"))


def untagged(data):
    """What an editor sees: a tag is no key."""
    if isinstance(data, dict):
        return {key: untagged(value) for key, value in data.items() if key != "_tag"}
    return [untagged(item) for item in data] if isinstance(data, list) else data


def validator(reference):
    return Draft202012Validator(json.loads(schema_text(reference)))


@pytest.mark.parametrize("file", OWN, ids=lambda file: file.name)
def test_our_own_files_fit(file):
    validator(str(file)).validate(untagged(read_yaml(file)))


@pytest.mark.parametrize("name", systems())
def test_packaged_files_fit(name):
    Draft202012Validator.check_schema(json.loads(schema_text(name)))
    files = [file for file in PACKAGED if file.name.split(".")[0] == name]
    assert files
    for file in files:
        validator(name).validate(untagged(read_yaml(file)))


@pytest.mark.parametrize(
    "text",
    [
        "duration_s: 0",
        "duration_s: long",
        "frame: flat",
        "durations: 3",
        "platforms: []",
        "platforms: {a: !Kepler {eccentricity: 0.95}}",
        "platforms: {a: !Kepler {excentricity: 0.1}}",
        "sensors: {a: !Tdoa {sigma_ns: -1}}",
        "sensors: {a: !Tdoa {receivers: b}}",
        "sensors: {a: !Bearing {sigma_elevation_deg: true}}",
        "estimators: {a: !Iekf {max_iterations: 0}}",
        "sensors: {a: !Joint {kinds: {t: !Tdoa {sigma_ns: -1}}}}",
        "sensors: {a: !Joint {kinds: {t: !Tdoa {every_s: 2}}}}",
        "map: {plane: tilted}",
        "map: {centre: here}",
    ],
)
def test_it_refuses_what_the_loader_refuses(text):
    data = read_yaml(text)
    with pytest.raises(UserError):
        load(OwnScenario, [data])
    assert not validator(None).is_valid(untagged(data))


def test_the_command_prints_it(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["show", "--schema"])
    assert ended.value.code == 0
    found = json.loads(capsys.readouterr().out)
    tags = {found["$defs"][one["$ref"].rpartition("/")[2]]["title"] for one in found["properties"]["start"]["anyOf"]}
    assert tags == {"!Prior", "!Given", "!Snapshot", "!KnownHeight"}
    assert found["properties"]["duration_s"]["exclusiveMinimum"] == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show"], "SYSTEM: none is given; see `quietfix list`"),
        (["show", "no_such", "--schema"], "system: no_such is not known"),
        (["show", "--schema", "--set", "a=1"], "--schema: it is not allowed with --set"),
    ],
)
def test_mistakes_are_one_line(capsys, arguments, words):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    shown = capsys.readouterr().err
    assert words in shown and shown.count("\n") == 1
