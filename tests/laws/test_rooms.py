"""Rooms of the code: what each is for is said in its docstring, and imports point one way, without a circle."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_FILES = 15  # of a room, `__init__` apart
MOST_LINES = 400  # of a file
MOST_STATEMENT_LINES = 60  # of a function, its docstring apart


def modules():
    """Path of every module by its dotted name, the import name `quietfix` left out."""
    found = {}
    for top in ("systems", "diagrams"):
        for path in sorted((ROOT / top).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


MODULES = modules()


def room(module):
    """The room that a module is in: its package."""
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


def imports(module):
    """Modules of ours that a module imports anywhere, within functions and for types too."""
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            parent = node.module.removeprefix("quietfix.")
            for name in node.names:
                yield from (m for m in (f"{parent}.{name.name}", parent) if m in MODULES)
        elif isinstance(node, ast.Import):
            yield from (m for m in (name.name.removeprefix("quietfix.") for name in node.names) if m in MODULES)


def edges():
    """Which room imports from which, with an example; the two top packages only say where things are."""
    found = {}
    for module in MODULES:
        for other in imports(module):
            a, b = room(module), room(other)
            if a != b and b != "diagrams" and module not in ("diagrams", "diagrams.__main__"):
                found.setdefault(a, {})[b] = f"{module} imports {other}"
    return found


@cache
def all_edges():
    """The same for all rooms, worked out once."""
    return edges()


def edges_of(name):
    """Rooms that a room imports from."""
    return all_edges().get(name, {})


def circle(below):
    """What is left of a graph when again and again all that lean on nothing are taken away: its circles."""
    left = set(below)
    while left:
        floor = {a for a in left if not (set(below[a]) & left)}
        if not floor:
            break
        left -= floor
    return left


def test_no_circle_of_rooms():
    found = edges()
    below = {room(module): found.get(room(module), {}) for module in MODULES}
    left = circle(below)
    assert not left, [text for a in left for b, text in below[a].items() if b in left]


def test_no_circle_of_files():
    """Neither within a room nor for types alone."""
    below = {module: set(imports(module)) - {module, "diagrams"} for module in MODULES}
    left = circle(below)
    assert not left, [f"{a} imports {b}" for a in left for b in below[a] & left]


def test_a_circle_would_be_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) == set()
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == {"a", "b", "c"}


def told(name):
    """A room as docstrings name it: by its top one where it is not within the same."""
    return ".".join(name.split(".")[:2])


def permitted(name):
    """What the docstring of a room says that it may import."""
    text = ast.get_docstring(ast.parse(MODULES[name].read_text())).partition("May import: ")[2]
    return set(" ".join(text.split()).removesuffix(".").split(", "))


@pytest.mark.parametrize("name", sorted({room(module) for module in MODULES} - {"systems", "diagrams"}))
def test_a_room_imports_what_it_says(name):
    used = {other if told(other) == told(name) else told(other) for other in edges_of(name)}
    assert used - permitted(name) == set()
    assert permitted(name) - used - {"nothing of ours"} == set()


def figures():
    """Modules that draw."""
    return [module for module in MODULES if module.endswith("_figures") or room(module) == "diagrams.figures"]


def test_figures_know_no_result_class():
    """They are told datasets and arrays, so that each serves whatever has those."""
    assert len(figures()) > 15
    allowed = ("diagrams.figures", "diagrams.quantities", "diagrams.statistics", "systems.")
    found = [
        f"{module} imports {other}"
        for module in figures()
        for other in imports(module)
        if not other.startswith(allowed)
    ]
    assert not found


def test_systems_know_nothing_of_diagrams():
    found = [
        text for a, others in edges().items() if a.startswith("systems") for b, text in others.items() if "dia" in b
    ]
    assert not found


@pytest.mark.parametrize("top", ["systems", "diagrams"])
def test_rooms_are_small_and_say_what_they_are_for(top):
    for folder in [ROOT / top, *sorted((ROOT / top).rglob("*/"))]:
        files = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        if not files and not (folder / "__init__.py").exists():
            continue
        assert len(files) <= MOST_FILES, folder
        docstring = ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))
        assert docstring and len(docstring) > 20, folder


def lengths(path):
    """Lines of every function of a file, docstring apart."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            first = node.body[0]
            documented = isinstance(first, ast.Expr) and isinstance(getattr(first, "value", None), ast.Constant)
            about = first.end_lineno - first.lineno + 1 if documented and isinstance(first.value.value, str) else 0
            yield node.name, node.end_lineno - node.lineno + 1 - about


@pytest.mark.parametrize("module", MODULES)
def test_files_and_functions_are_short(module):
    path = MODULES[module]
    assert len(path.read_text().splitlines()) <= MOST_LINES
    long = [(name, lines) for name, lines in lengths(path) if lines > MOST_STATEMENT_LINES]
    assert not long
