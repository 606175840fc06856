"""Folders that are mirrored in an object store chunk by chunk, and results that are fetched from one.

The work is done in a folder of this machine. Of each finished chunk the files go to the store, and its record after
them: a run that is killed anywhere goes on from there, on any machine. The marker of a finished result goes last.
An object store renames nothing and locks nothing: an earlier result is never replaced, and it is for the user to keep
two runs at a time out of one URL.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from quietfix.diagrams.chunks.ledger import CHUNKS
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.cloud.place import Place
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER, Mark
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.store import files_of

__all__ = ["MirroredFolder", "fetched", "workplace"]

_STORE = "results.zarr"


@contextmanager
def workplace(url: Path, option: str, overwrite: bool, resume: bool) -> Iterator[tuple[Path, Place]]:
    """Yield a folder of this machine in which a result is made that belongs to a URL, and that place.

    What an interrupted run has finished there is fetched if it is to be resumed.

    Raises
    ------
    UserError
        If something is there that may not be replaced, or it cannot be reached.
    """
    place = Place(url, option)
    names = place.names()
    if overwrite and names:
        raise UserError(
            f"--overwrite: it is not allowed for {place.url}: nothing there is replaced; choose another name"
        )
    if names and not any(name.startswith(f"{CHUNKS}/") for name in names):
        what = "holds an earlier result" if MARKER in names else f"holds other files ({', '.join(names[:3])})"
        raise UserError(f"{option}: {place.url} {what}; choose another name")
    if names and not resume:
        raise UserError(f"{option}: {place.url} holds an interrupted run; `quietfix run --resume {place.url}` goes on")
    with TemporaryDirectory(prefix="quietfix-") as work:
        final = Path(work) / "result"
        if names:
            partial = final.with_name("result.partial")
            place.get(partial, [name for name in names if name != MARKER])
            os.close(Mark("run").write(partial))
        yield final, place


class MirroredFolder(OutputFolder):
    """A folder whose finished chunks are in an object store, too.

    Parameters
    ----------
    place : Place
        Where.
    *arguments, **options
        As of `OutputFolder`.
    """

    def __init__(self, place: Place, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.url = place.url
        self._place_there = place
        self._there: set[str] = set(place.names())

    def write(self, part: Part) -> None:
        """See `OutputFolder.write`; then its files are in the store, its record last."""
        super().write(part)
        assert self.ledger is not None
        begin, end = self.ledger.plan.place(part.number)
        files = [f"{_STORE}/{name}" for name in files_of(self.store, self._along, begin, end)]
        shared = [name for name in self._shared() if name not in self._there]
        record = f"{CHUNKS}/{part.number}.npz"
        names = [*shared, *(name for name in files if (self.partial / name).exists()), record]
        self._place_there.put(self.partial, names)
        self._there |= set(names)

    def _shared(self) -> list[str]:
        """Return what is no chunk's: the plan, descriptions of arrays, and what has no trials."""
        whole = {path.relative_to(self.partial).as_posix() for path in self.store.rglob("*") if path.is_file()}
        plan = self.ledger.plan if self.ledger is not None else None
        chunks = set() if plan is None else {f"{_STORE}/{n}" for n in files_of(self.store, self._along, 0, plan.trials)}
        return [f"{CHUNKS}/plan.json", *sorted(whole - chunks)]

    def finish(self) -> None:
        """See `OutputFolder.finish`; then all is in the store, the marker last."""
        super().finish()
        names = sorted(path.relative_to(self.final).as_posix() for path in self.final.rglob("*") if path.is_file())
        again = [name for name in names if name not in self._there or name.endswith("zarr.json")]
        self._place_there.put(self.final, [name for name in again if name != MARKER])
        self._place_there.put(self.final, [MARKER])
        self._place_there.remove(name for name in self._place_there.names() if name not in names)


def fetched(path: Path, option: str, folder: Path) -> tuple[str, Path]:
    """Copy a result from an object store into a folder; return its URL and where it is now.

    Raises
    ------
    UserError
        If there is nothing, or it cannot be reached.
    """
    place = Place(path, option)
    names = place.names()
    if not names:
        raise UserError(f"{option}: {place.url} is not a result; there is nothing")
    here = folder / place.url.rpartition("/")[2]
    place.get(here, names)
    return place.url, here
