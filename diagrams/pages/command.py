"""What ``quietfix report`` does: write a page, whole or not at all."""

from __future__ import annotations

from pathlib import Path

from quietfix.diagrams.pages.report import report_page
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.whole_file import written_beside

__all__ = ["report_command"]

_SIGNATURE = b'<meta name="generator" content="Quietfix">'
_ENDINGS = (".html", ".htm")


def report_command(result: Path, out: Path | None) -> None:
    """Write the page of a result; see ``quietfix report --help``.

    Raises
    ------
    UserError
        If there is no result, or the page may not be written where it is asked for.
    """
    if not result.is_dir():
        raise UserError(f"RESULT: {result} is not a result; a folder that run, compare, sweep or verify wrote")
    path = out or Path(f"{result.resolve().name}.html")
    if path.suffix.lower() not in _ENDINGS:
        raise UserError(f"--out: {path} is not allowed; a file name that ends in .html")
    existed = path.exists()
    if existed and not _is_page(path):
        raise UserError(f"--out: {path} exists and is no page of this program; choose another name")
    page = report_page(result)
    with written_beside(path) as beside:
        beside.write_text(page, encoding="utf-8")
    print(f"{'replaced' if existed else 'wrote'} {path} ({len(page.encode()) / 1e6:.1f} MB)")


def _is_page(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return _SIGNATURE in file.read(2000)
