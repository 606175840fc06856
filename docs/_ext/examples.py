"""Sphinx: the examples of all pages are run before the pages are read; one that fails is a warning at its line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from example_runs import PLACE
from sphinx.application import Sphinx
from sphinx.util import logging

__all__ = ["setup"]

_logger = logging.getLogger(__name__)
_RUNNER = Path(__file__).with_name("example_runs.py")


def _run(app: Sphinx) -> None:
    """Run the examples in a process of their own, which forks, and say what is wrong.

    ``-D run_examples=0`` leaves them as the last build made them: for who writes.
    """
    if not app.config.run_examples:
        return
    docs = Path(app.srcdir)
    pages = sorted(page for page in docs.rglob("*.md") if not {"_build", "_ext"} & set(page.relative_to(docs).parts))
    subprocess.run([sys.executable, str(_RUNNER), *map(str, pages)], stdout=subprocess.DEVNULL, check=False)
    for page in pages:
        result = (PLACE / page.relative_to(docs)).with_suffix(".json")
        if not result.exists():
            continue
        for line, wrong in json.loads(result.read_text())["wrong"]:
            _logger.warning("%s", wrong, location=f"{os.fspath(page)}:{line}", type="example")


def _keep_reports(app: Sphinx, error: Exception | None) -> None:
    """Put the HTML pages that examples made beside the site's own, where links find them."""
    if error is None and app.builder.name == "html":
        for report in PLACE.rglob("*.html"):
            place = Path(app.outdir) / "examples" / report.relative_to(PLACE)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(report, place)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_config_value("run_examples", True, "", [bool])
    app.connect("builder-inited", _run, priority=100)  # figures are there before pages are read
    app.connect("build-finished", _keep_reports)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
