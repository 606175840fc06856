"""The pages of the catalogue."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from quietfix.diagrams.schema.reading import fields_of
from quietfix.systems.signals import components_of
from tests.laws.cases import MEASUREMENTS, MOTIONS

from . import found
from .ports import ports_of
from .standing import made_by, standing
from .tags import Tag, default_words, examples_of, tags, type_words
from .words import defaults_of, described, has_equation, heading, literal, parameters, plain, table, texts_of

__all__ = ["all_pages", "entries", "equations_of"]

_BLOCK_PAGES = (
    ("plants", "Plants: truth and platforms", ("plants", "playback", "signals")),
    ("sensors", "Sensors, and what impairs them", ("sensors", "late")),
    ("signal_chain", "Signal chain: from I/Q samples to measurements", ("signal_chain",)),
    ("estimator_blocks", "Blocks of estimators", ("estimators", "options", "batch", "lagging")),
    ("records", "Recorders and scores", ("recorder", "statistics")),
)


_YAML_PAGES = (
    ("yaml_places", "YAML: platforms and targets", ("platforms", "target")),
    ("yaml_sensors", "YAML: sensors", ("sensors", "parts")),
    ("yaml_filters", "YAML: what estimators are made of", ("estimators",)),
    ("yaml_others", "YAML: belief, start and the rest", ()),
)


def _stands_under(tag: Tag, roots: tuple[str, ...]) -> bool:
    """Whether a tag of a system of one's own stands first under one of these fields; without any, under no other's."""
    first = re.split(r"[.\[]", next(path for path in tag.where if ": " not in path))[0]
    return first in roots if roots else all(first not in others for _, _, others in _YAML_PAGES)


def all_pages() -> dict[str, str]:
    """Return every page by its name."""
    pages = {name: _block_page(name, title) for name, title, _ in _BLOCK_PAGES}
    pages["measurements"] = _model_page("Measurement models", found.measurements(), _rows(MEASUREMENTS), "row")
    pages["motions"] = _model_page("Motion models", found.motions(), _rows(MOTIONS), "state")
    pages["filters"] = _class_page("Gaussian filters", found.filters())
    pages["starts"] = _class_page("Starts", found.starts())
    pages["clocks"] = _class_page("Clocks", found.clock_kinds())
    pages["estimators"] = _estimator_page()
    for page, title, roots in _YAML_PAGES:
        pages[page] = _tag_page(title, lambda tag, roots=roots: not _foreign(tag) and _stands_under(tag, roots))
    pages["yaml_packaged"] = _tag_page("YAML: fields of the packaged systems", lambda tag: _foreign(tag) == "system")
    pages["yaml_requirements"] = _tag_page("YAML: requirements", lambda tag: _foreign(tag) == "requirements")
    return pages


def _foreign(tag: Tag) -> str:
    """Return where a tag belongs that no system of one's own has; empty of those that it has."""
    roots = [path.partition(": ")[0] if ": " in path else "" for path in tag.where]
    if "" in roots:
        return ""
    return "requirements" if roots[0] == "requirements" else "system"


def entries() -> dict[type, str]:
    """Return the page on which each class has its entry."""
    places = {kind: _page_of(kind) for kind in found.blocks()}
    for page, kinds in (
        ("measurements", found.measurements()),
        ("motions", found.motions()),
        ("filters", found.filters()),
        ("starts", found.starts()),
        ("clocks", found.clock_kinds()),
        ("estimators", found.estimators().values()),
    ):
        places.update(dict.fromkeys(kinds, page))
    return places


def _page_of(kind: type) -> str:
    parts = kind.__module__.split(".")
    for page, _, rooms in _BLOCK_PAGES:
        if kind.__module__.startswith("quietfix.systems.late.rollback"):
            return "estimator_blocks"
        if parts[2] in rooms:
            return page
    raise KeyError(f"{kind.__module__}: no page of the catalogue has the blocks of this room; see _BLOCK_PAGES")


def _title(name: str, label: str, line: str = "-") -> str:
    return f".. _{label}:\n\n{heading(name, line)}"


def _source(kind: Any) -> str:
    return f"| **Code** ``{kind.__module__}.{kind.__qualname__}``\n"


def _module_words(kind: Any) -> str:
    """Return the equations that stand at the head of a class's file, where the class itself has none."""
    text = sys.modules[kind.__module__].__doc__ or ""
    if has_equation(kind.__doc__ or "") or not has_equation(text):
        return ""
    _, _, rest = text.partition("\n\n")
    return literal(rest.strip()) + "\n"


def _parameter_table(kind: Any) -> str:
    rows, default = [], defaults_of(kind)
    for names, sort, meaning in parameters(kind):
        given = [default[one] for name in names.split(",") if (one := name.strip()) in default]
        shown = ", ".join(dict.fromkeys(f"``{value}``" for value in given))
        rows.append([f"``{names}``", sort.split(", default")[0], shown, meaning])
    return table(("Parameter", "Type", "Default", "Meaning"), rows, (18, 18, 14, 50)) if rows else ""


def _block_page(page: str, title: str) -> str:
    kinds = [kind for kind in found.blocks() if _page_of(kind) == page]
    return heading(title, "=") + "\n" + "\n".join(_block(kind) for kind in kinds)


def _block(kind: type) -> str:
    one = standing().get(kind)
    if one is None:
        raise KeyError(f"{kind.__name__}: in no diagram of docs/_ext/block_catalogue/standing.py; put it into one")
    where = f"in {one.where}" if one.where else "put into a diagram by hand"
    ports = ports_of(one)
    rows = [[p.direction, f"``{p.name}``", p.shape, p.meaning, p.unit, p.frame, p.feeds] for p in ports]
    block = one.block
    held = [
        "continuous state" if block.num_continuous_states() else "",
        "discrete state, stored at the ticks of its clock" if block.num_discrete_state_groups() else "",
    ]
    state = "; ".join(word for word in held if word) or "none: what it puts out is a function of time and inputs"
    parts = [
        _title(kind.__name__, found.slug(kind)),
        _source(kind) + f"| **State** {state}\n",
        described(kind) + "\n",
        _module_words(kind),
        f"Ports ({where}: ``{one.name}``); the last column says what an output follows at once:\n",
        table(("", "Port", "Shape", "Carries", "Unit", "Frame", "Follows"), rows, (5, 18, 13, 26, 14, 12, 12)),
        _parameter_table(kind),
    ]
    return "\n".join(part for part in parts if part) + "\n"


def _rows(cases: dict[str, tuple[Any, Any]]) -> dict[type, Any]:
    """Return an example of each class, the first that the laws are tried on."""
    found_: dict[type, Any] = {}
    for model, _ in cases.values():
        found_.setdefault(type(model), model)
    return found_


def _model_page(title: str, kinds: Sequence[type], cases: dict[type, Any], what: str) -> str:
    return heading(title, "=") + "\n" + "\n".join(_model(kind, cases[kind], what) for kind in kinds)


def _model(kind: type, example: Any, what: str) -> str:
    rows = [[f"``{name}``", unit] for name, unit in components_of(example)]
    shown = rows if len(rows) <= 10 else [*rows[:10], ["...", ""]]
    tagged = [tag for tag in tags().values() if tag.name == kind.__name__ and not _foreign(tag)]
    parts = [
        _title(kind.__name__, found.slug(kind)),
        _source(kind),
        described(kind) + "\n",
        _module_words(kind),
        table((f"{what.capitalize()} (of an example)", "Unit"), shown, (60, 40)),
        _parameter_table(kind),
        f"In YAML: :ref:`!{tagged[0].name} <{_tag_label(tagged[0])}>`.\n" if tagged else "",
    ]
    return "\n".join(part for part in parts if part) + "\n"


def _class_page(title: str, kinds: Iterable[type]) -> str:
    return heading(title, "=") + "\n" + "\n".join(_plain(kind) for kind in kinds)


def _plain(kind: type) -> str:
    parts = [
        _title(kind.__name__, found.slug(kind)),
        _source(kind),
        described(kind) + "\n",
        _module_words(kind),
        _parameter_table(kind),
    ]
    return "\n".join(part for part in parts if part) + "\n"


# ------------------------------------------------------------------------------------------------ estimators


def behind(kind: type) -> list[type]:
    """Return the filters and the block that do the work of an estimator, where the options only choose them."""
    kinds = [base for base in kind.__mro__ if base in found.filters()]
    block = made_by(kind)
    return [*kinds, block] if block else kinds


def equations_of(kind: type) -> list[str]:
    """Return all texts with equations that the entry of an estimator shows or leads to."""
    texts = [text for one in (kind, *behind(kind)) for text in texts_of(one)]
    return [text for text in texts if has_equation(text)]


def _estimator_page() -> str:
    intro = (
        "What may stand under ``estimators:``. The name is that of ``--estimator NAME``, the tag chooses the class in "
        "YAML. All have the :ref:`common ports <catalogue-systems-estimators-kalman-KalmanEstimator>`.\n"
    )
    parts = [_estimator(name, kind) for name, kind in found.estimators().items()]
    return heading("Estimators", "=") + "\n" + intro + "\n" + "\n".join(parts)


def _estimator(name: str, kind: type) -> str:
    links = ", ".join(f":ref:`{one.__name__} <{found.slug(one)}>`" for one in behind(kind))
    parts = [
        _title(f"{name}: !{kind.__name__}", found.slug(kind)),
        _source(kind) + (f"| **Equations** {links}\n" if links else ""),
        described(kind) + "\n",
        _module_words(kind),
        _field_table(kind),
        _example(kind),
    ]
    return "\n".join(part for part in parts if part) + "\n"


# ------------------------------------------------------------------------------------------------------ YAML


def _tag_label(tag: Tag) -> str:
    if tag.kind in found.estimators().values():
        return found.slug(tag.kind)
    return f"yaml-{tag.kind.__module__.removeprefix('quietfix.').replace('.', '-').replace('_', '-')}-{tag.name}"


def _field_table(kind: type) -> str:
    rows = []
    for key, field in fields_of(kind).items():
        allowed = field.allowed.words if field.allowed else type_words(field.type)
        rows.append([f"``{key}``", plain(allowed), default_words(field), literal(plain(field.doc))])
    return table(("Field", "Allowed", "Default", "Meaning"), rows, (18, 24, 14, 44)) if rows else ""


def _example(kind: type) -> str:
    shown = examples_of(tags()[kind])
    if not shown:
        return ""
    lines = "\n".join(f"   {line}".rstrip() for line in shown[0].text.split("\n")[:30])
    return f"From ``{shown[0].file}``, which is loaded when this site is made:\n\n.. code-block:: yaml\n\n{lines}\n"


def _tag_page(title: str, wanted: Any) -> str:
    chosen = [tag for tag in tags().values() if wanted(tag) and tag.kind not in found.estimators().values()]
    seen: set[type] = set()
    parts = []
    for tag in chosen:
        if tag.kind not in seen:
            seen.add(tag.kind)
            parts.append(_tag(tag))
    return heading(title, "=") + "\n" + "\n".join(parts)


def _tag(tag: Tag) -> str:
    named = f"!{tag.name}" if tag.chosen else tag.name
    places = ", ".join(f"``{path}``" for path in tag.where[:4])
    doc = (tag.kind.__doc__ or "") if dataclasses.is_dataclass(tag.kind) else ""
    parts = [
        _title(named, _tag_label(tag)),
        f"Stands at {places}.\n",
        described(tag.kind) + "\n" if doc else "",
        _field_table(tag.kind),
        _example(tag.kind) if tag.chosen else "",
    ]
    return "\n".join(part for part in parts if part) + "\n"
