"""The catalogue of the site leaves nothing out, and what it shows is what is there."""

import re
import sys

import pytest

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.verification.specification import read_specification
from tests.site.paths import DOCS

from block_catalogue import found, pages  # isort: skip
from block_catalogue.ports import ports_of  # isort: skip
from block_catalogue.standing import standing  # isort: skip
from block_catalogue.tags import examples_of, tags  # isort: skip
from block_catalogue.words import has_equation, texts_of  # isort: skip

PASSED_ON = {
    "ArrivalGate",
    "CheckedTruth",
    "Complete",
    "Constant",
    "HandedRows",
    "Joined",
    "ModeSchedule",
    "Path",
    "PlayedLate",
    "PlayedRows",
    "Preview",
    "Receiver",
    "RecordedFlight",
    "RecordedIq",
    "RecordedMeasurements",
    "RecordedTruth",
    "Recorder",
    "TrackPaths",
    "TrackTruth",
    "Transmitter",
}
"""Blocks that pass numbers on, or play or interpolate records: no equation of their own is asked of them."""

AROUND = {"FedStart"}
"""Models that give what another one gives, with other ports around it."""

MODELS = [
    kind
    for kind in (*found.measurements(), *found.motions(), *found.filters(), *found.starts())
    if kind.__name__ not in AROUND
]
EXAMPLES = DOCS / "catalogue" / "examples"
SHOWN = {path.stem: path for path in EXAMPLES.glob("*.yaml")}
PACKAGED = {path.stem: path for path in (EXAMPLES / "packaged").glob("*.yaml")}


@pytest.fixture(scope="module")
def made():
    return pages.all_pages()


@pytest.mark.parametrize("kind", found.blocks(), ids=lambda kind: kind.__name__)
def test_a_block_has_its_ports_with_units(kind):
    assert kind in standing(), f"no diagram of docs/_ext/block_catalogue/standing.py has a {kind.__name__}"
    ports = ports_of(standing()[kind])
    assert ports
    without = [port.name for port in ports if not port.unit]
    assert not without, f"nobody says the unit of {without}; see WORDS in docs/_ext/block_catalogue/ports.py"


@pytest.mark.parametrize("kind", found.blocks(), ids=lambda kind: kind.__name__)
def test_a_block_has_its_equation(kind):
    if kind.__name__ in PASSED_ON:
        pytest.skip("passes on what it gets")
    assert any(has_equation(text) for text in texts_of(kind)), f"no equation in the docstring of {kind.__name__}"


@pytest.mark.parametrize("kind", MODELS, ids=lambda kind: kind.__name__)
def test_a_model_has_its_equation(kind):
    own = [kind.__doc__ or "", sys.modules[kind.__module__].__doc__ or ""]
    assert any(has_equation(text) for text in own), f"no equation in the docstring of {kind.__name__}"


@pytest.mark.parametrize("name", [name for name in found.estimators() if name != "custom"])
def test_an_estimator_has_its_equation(name):
    assert pages.equations_of(found.estimators()[name]), f"neither {name} nor what it is made of has an equation"


def test_every_class_has_its_entry_and_every_entry_stands_once(made):
    for kind, page in pages.entries().items():
        assert made[page].count(f".. _{found.slug(kind)}:") == 1, kind.__name__
    labels = re.findall(r"^\.\. _([^:]+):$", "\n".join(made.values()), re.M)
    assert len(labels) == len(set(labels))


def test_rows_and_states_have_units(made):
    for page in ("measurements", "motions"):
        table = re.findall(r"\* - ``(\w+)``\n     - ?(.*)", made[page])
        assert len(table) > 50
        assert all(unit for _, unit in table)


def test_every_tag_that_is_chosen_has_an_example():
    missing = sorted(tag.name for tag in tags().values() if tag.chosen and not examples_of(tag))
    assert not missing, f"put one of {missing} into a file of docs/catalogue/examples"


@pytest.mark.parametrize("path", SHOWN.values(), ids=SHOWN.keys())
def test_an_example_is_built(path):
    find(str(path)).system.diagram()


@pytest.mark.parametrize("path", PACKAGED.values(), ids=PACKAGED.keys())
def test_an_example_of_a_packaged_system_is_built(path):
    find(path.name.partition(".")[0]).system.diagram(path)


@pytest.mark.parametrize("path", sorted((EXAMPLES / "requirements").glob("*.yaml")), ids=lambda path: path.stem)
def test_an_example_of_requirements_is_read(path):
    assert read_specification(path).requirements
