"""Data into dataclasses: what is unsaid, what is in order, what a user's own class says."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from quietfix.diagrams.commands.json_schema import json_schema
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.reading import check_annotations, read
from quietfix.diagrams.schema.scenario import check_object, dump, load, read_yaml


@dataclass(frozen=True)
class Mast:
    height_m: float
    guys: int = 3

    def __post_init__(self) -> None:
        if self.guys < 3:
            raise ValueError(f"guys: {self.guys} do not hold it")


@dataclass
class Ball:
    height_m: float = 100.0
    gas: str = "helium"


@dataclass
class Site:
    carrier: Mast | Ball = field(default_factory=lambda: Ball(gas="air"))
    others: dict[str, Ball | Mast] = field(default_factory=dict)
    rows: list[Mast | Ball] | None = None
    note: Any = None


def of(text):
    return load(Site, [read_yaml(text)])


def test_a_mapping_of_the_defaults_tag_leaves_the_rest_of_the_default():
    assert of("carrier: !Ball {height_m: 5}").carrier == Ball(5.0, "air")
    assert of("carrier: {height_m: 5}").carrier == Mast(5.0)  # without a tag the first kind, whatever the default
    assert of("others: {b: !Ball {height_m: 5}}").others == {"b": Ball(5.0, "helium")}


def test_names_stay_in_the_order_of_the_file_and_come_back_from_print():
    text = (
        "others: {b: !Ball {}, c: !Mast {height_m: 1e1}, a: !Ball {gas: 'on'}}\nrows: [!Ball {}, !Mast {height_m: 2}]\n"
    )
    site = of(text)
    assert list(site.others) == ["b", "c", "a"]
    assert site.rows == [Ball(), Mast(2.0)]
    assert of(dump(site)) == site and list(of(dump(site)).others) == list(site.others)
    check_object(Site, site)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("carrier: !Mast {}", "carrier.height_m: it is missing, and has no default"),
        ("others: {a: !Mast {height_m: 3, guys: 2}}", "others.a: guys: 2 do not hold it"),
        (
            "others: {a: !Mask {height_m: 3}}",
            "others.a: !Mask is not known (did you mean !Mast?); there are !Ball, !Mast",
        ),
        ("rows: [!Ball {}, !Mast {height: 3}]", "rows.1.height: height is not known (did you mean height_m?)"),
        ("rows: [3]", "rows.0: 3 is not allowed; a mapping of fields"),
    ],
)
def test_mistakes_name_the_field(text, message):
    with pytest.raises(UserError) as caught:
        of(text)
    assert str(caught.value).startswith(message)


def test_an_editor_is_told_what_is_required():
    found = json_schema(Site, "site")
    assert found["$defs"]["Mast"]["required"] == ["height_m"]
    assert "required" not in found and "required" not in found["$defs"]["Ball"]


def test_any_value_is_a_copy():
    data = {"note": {"a": [1, 2]}}
    note = read(Site, data).note
    assert note == {"a": [1, 2]} and note is not data["note"]


@dataclass
class Unfillable:
    pair: tuple[float, float] = (0.0, 0.0)


@dataclass
class Unknown:
    gas: Helium = None  # noqa: F821


def test_a_type_that_no_file_fills_is_refused_where_it_is_declared():
    with pytest.raises(ValueError, match=r"Unfillable.pair: the type tuple.* is not allowed; bool, int, float"):
        check_annotations(Unfillable)
    with pytest.raises(ValueError, match="annotations of Unknown: name 'Helium' is not defined"):
        check_annotations(Unknown)


def test_a_new_name_says_its_kind():
    """Else a typing error in a setting made one more of the first kind, and nobody was told."""
    tall = {"others": {"tall": {"_tag": "!Mast", "height_m": 5}}}
    assert load(Site, [tall, {"others": {"tall": {"height_m": 7}}}]).others["tall"] == Mast(7.0)
    with pytest.raises(UserError, match=r"others.tal: it has no tag \(did you mean tall\?\); .* of !Ball, !Mast"):
        load(Site, [tall, {"others": {"tal": {"height_m": 5}}}])
