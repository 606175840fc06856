"""A Sphinx extension that writes the catalogue of blocks, models and tags from the code itself.

Ports are those of blocks in diagrams that are really built; rows, states and units those of models that the laws in
``tests/laws/cases.py`` are tested on; fields, defaults and limits those that a scenario is read by; examples are cut
out of files that are loaded while the site is made.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

__all__ = ["setup", "write_pages"]

MADE = "made"
"""Folder beside the catalogue's own pages that is written anew."""


def write_pages(folder: Path) -> dict[str, str]:
    """Write all pages of the catalogue into a folder, and return them by name; what has not changed stays as it is."""
    from .pages import all_pages

    folder.mkdir(parents=True, exist_ok=True)
    pages = all_pages()
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in folder.glob("*.rst"):
        if path.stem not in pages:
            path.unlink()
    return pages


def setup(app: Any) -> dict[str, Any]:
    """Write the pages before Sphinx looks for its documents."""
    app.connect("builder-inited", lambda app: write_pages(Path(app.srcdir) / "catalogue" / MADE) and None)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
