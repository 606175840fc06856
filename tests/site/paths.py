"""Where the site's own code and pages are."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
if str(DOCS / "_ext") not in sys.path:
    sys.path.append(str(DOCS / "_ext"))


def pages():
    """Return the pages of the site, and those beside it that name them."""
    inside = [page for page in DOCS.rglob("*.md") if not {"_build", "_ext"} & set(page.relative_to(DOCS).parts)]
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted(inside)]
