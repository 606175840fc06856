"""What ``quietfix report`` and ``--report`` do: write a page, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.terminal import done
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.whole_file import replaces, written_beside

__all__ = ["paged", "report_command"]

_SIGNATURE = b'<meta name="generator" content="Quietfix">'
_ENDINGS = (".html", ".htm")
_TELLING = ("results.zarr", "verification.json")


def report_command(result: Path, out: Path | None) -> dict[str, Any]:
    """Write the page of a result, and return which file it is; see ``quietfix report --help``.

    Raises
    ------
    UserError
        If there is no result, or the page may not be written where it is asked for.
    """
    if result.name == "results.zarr":
        result = result.resolve().parent
    if not result.is_dir():
        begun = result.with_name(f"{result.name}.partial")
        hint = f"; {begun} holds what an interrupted one has finished" if result.name and begun.is_dir() else ""
        raise UserError(f"RESULT: {result} is not a result; a folder that run, compare, sweep or verify wrote{hint}")
    from quietfix.diagrams.pages.report import report_page

    path = out or Path(f"{result.resolve().name}.html")
    if path.suffix.lower() not in _ENDINGS:
        raise UserError(f"--out: {path} is not allowed; a file name that ends in .html")
    existed = replaces(path, _SIGNATURE, "--out")
    page = report_page(result)
    with written_beside(path) as beside:
        beside.write_text(page, encoding="utf-8")
    size = len(page.encode())
    done(f"{'replaced' if existed else 'wrote'} {path} ({size / 1e6:.1f} MB)")
    return {"file": str(path), "size_bytes": size, "replaced": existed}


@contextmanager
def paged(wanted: bool, out: Path | None) -> Iterator[None]:
    """Have a command write a page beside each result in its folder, which is named as that, with ``.html``.

    Parameters
    ----------
    wanted : bool
        Whether there is to be one; without it nothing is done.
    out : Path, optional
        The folder that the command writes.

    Raises
    ------
    UserError
        Before the command begins, if it writes no folder, or the page may not be written.
    """
    if not wanted:
        yield
        return
    if out is None:
        raise UserError("--report: it needs --out DIR, whose page is DIR.html")
    replaces(_beside(out), _SIGNATURE, "--report")
    yield
    folders = [out] if any((out / name).exists() for name in _TELLING) else sorted(out.iterdir())
    told = [folder for folder in folders if folder.is_dir() and any((folder / name).exists() for name in _TELLING)]
    tell(reports=[report_command(folder, _beside(folder)) for folder in told])


def _beside(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.html")
