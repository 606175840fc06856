"""What every test may ask for."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from quietfix.diagrams.console import tables
from quietfix.diagrams.console.tables import Table

# Also where pytest is started without make; set before NumPy and Matplotlib are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def project_root() -> Path:
    """The folder of pyproject.toml."""
    return ROOT


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of recorded data; the test is skipped where there is none."""
    folder = Path(os.environ.get("QUIETFIX_DATA") or ROOT.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"recorded data not found: no folder {folder} (set QUIETFIX_DATA)")
    return folder


@pytest.fixture(scope="session")
def recorded(data_dir: Path) -> Callable[[str], Path]:
    """A function from the name of a recorded data set to its folder; skips where that set is absent."""

    def folder_of(name: str) -> Path:
        folder = data_dir / name
        if not folder.is_dir():
            pytest.skip(f"recorded data not found: no folder {folder}")
        return folder

    return folder_of


@pytest.fixture(autouse=True)
def _no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Print as into a pipe, whatever terminal the tests are started from (pytest-xdist passes its width on)."""
    for name in ("COLUMNS", "NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def printed_tables(monkeypatch: pytest.MonkeyPatch) -> list[Table]:
    """The tables that the test prints, in their order."""
    found: list[Table] = []
    render = tables.rendered

    def kept(table: Table, *rest: Any) -> list[str]:
        found.append(table)
        return render(table, *rest)

    monkeypatch.setattr(tables, "rendered", kept)
    return found


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the notebooks: the longest of them would otherwise run alone at the end."""
    items.sort(key=lambda item: "test_notebooks" not in item.nodeid)
