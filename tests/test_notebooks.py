"""Every notebook runs from top to bottom in a fresh kernel, and prints what is kept in it, which the site shows."""

import re
from pathlib import Path

import pytest

from tests.site.paths import ROOT

from example_blocks import differing_line  # isort: skip

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MOST_BYTES = 500_000
OF_THE_MACHINE = re.compile(r"\d ms a step")


def read(path: Path):
    """A notebook, or the test is skipped where there is nothing to read it with."""
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    return notebook


def printed(cell):
    """Lines that a cell prints, those on how fast the machine is apart."""
    text = "".join(output.text for output in cell.get("outputs", []) if output.output_type == "stream")
    return [line for line in text.splitlines() if not OF_THE_MACHINE.search(line)]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_shows_what_came_out(path):
    cells = [cell for cell in read(path).cells if cell.cell_type == "code"]
    assert all(cell.outputs for cell in cells if "print(" in cell.source and "def " not in cell.source)
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)
    assert not any(output.output_type == "error" for cell in cells for output in cell.outputs)
    assert path.stat().st_size < MOST_BYTES


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, tmp_path):
    nbclient = pytest.importorskip("nbclient")
    notebook = read(path)
    kept = [printed(cell) for cell in notebook.cells]
    client = nbclient.NotebookClient(
        notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    for number, (cell, shown) in enumerate(zip(notebook.cells, kept, strict=True)):
        wrong = differing_line(shown, printed(cell))
        assert wrong is None, f"cell {number} does not print {wrong!r} any more, but: {printed(cell)}"
