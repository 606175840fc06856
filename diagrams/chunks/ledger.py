"""The record of the chunks that an unfinished run has written: one small file for each, made when all of it is there.

A kill, a full disk or a power cut may leave anything of a chunk that is not recorded, and of one that is recorded less
than was written (the file system keeps back what it has promised). So a record says what the files of its chunk are,
and a chunk whose files are not that any more is done again.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan

__all__ = ["CHUNKS", "OWN", "Ledger", "discard", "read_plan"]

Array = NDArray[np.float64]

CHUNKS = ".quietfix-chunks"
"""Folder beside the store of an unfinished run."""
_PLAN = "plan.json"
_TALLY = "tally_"
_NAME = re.compile(r"(plan\.json|\d+\.npz)(\.\d+)?")
_ALSO = "also/"
OWN = re.compile(rf"{re.escape(CHUNKS)}/({_NAME.pattern})?")
"""Names of what it holds, and of itself where it is empty."""


def read_plan(folder: Path) -> Plan | None:
    """Return what the unfinished run in a folder was asked for; None if that is not known."""
    try:
        return Plan.read((folder / CHUNKS / _PLAN).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


class Ledger:
    """The chunks of an unfinished run that are finished.

    Parameters
    ----------
    folder : Path
        Of the unfinished run.
    plan : Plan
        What it is asked for.
    """

    def __init__(self, folder: Path, plan: Plan) -> None:
        self.plan = plan
        self._folder = folder / CHUNKS

    def begin(self) -> None:
        """Make the folder of a run that begins."""
        self._folder.mkdir()
        self._write(_PLAN, self.plan.text().encode())

    def record(self, part: Part, files: Mapping[str, str]) -> None:
        """Say that a chunk is finished: its part of the sums, and the fingerprints of its files by name."""
        tally = {f"{_TALLY}{name}": values for name, values in part.tally.items()}
        self.keep(part.number, part.sums, files, part.also, tally)

    def keep(
        self,
        number: int,
        sums: Array | None,
        files: Mapping[str, str],
        also: Mapping[str, NDArray[Any]],
        tally: Mapping[str, Array] | None = None,
    ) -> None:
        """Say the same of a chunk by its number, and keep `also` that of it."""
        beside = self._folder / f"{number}.npz.{os.getpid()}"
        entry: dict[str, Any] = {f"{_ALSO}{name}": values for name, values in also.items()}
        entry |= {**(tally or {}), "sums": np.zeros(0) if sums is None else sums, "files": json.dumps(dict(files))}
        try:
            with beside.open("wb") as stream:
                np.savez(stream, **entry)
                stream.flush()
                os.fsync(stream.fileno())
            beside.replace(self._folder / f"{number}.npz")
        except BaseException:
            beside.unlink(missing_ok=True)
            raise

    def _write(self, name: str, content: bytes) -> None:
        beside = self._folder / f"{name}.{os.getpid()}"
        beside.write_bytes(content)
        beside.replace(self._folder / name)

    def finished(self) -> list[int]:
        """Return the numbers of the chunks that are recorded."""
        return [number for number in range(self.plan.chunks) if (self._folder / f"{number}.npz").exists()]

    def left(self) -> frozenset[int]:
        """Return the numbers of the others."""
        return frozenset(range(self.plan.chunks)) - frozenset(self.finished())

    def places(self) -> NDArray[np.int64]:
        """Return which trials are in them."""
        spans = [np.arange(*self.plan.place(number)) for number in self.finished()]
        return np.concatenate([np.zeros(0, int), *spans])

    def sums(self) -> Iterator[Array | None]:
        """Yield the sums of the recorded chunks in their order."""
        for number in self.finished():
            yield self.sum_of(number)

    def sum_of(self, number: int) -> Array | None:
        """Return a finished chunk's part of the sums."""
        sums, _ = self._entry(number)
        return sums if sums.size else None

    def kept(self, number: int) -> dict[str, NDArray[Any]]:
        """Return what else is kept of a finished chunk."""
        with np.load(self._folder / f"{number}.npz", allow_pickle=False) as entry:
            return {name.removeprefix(_ALSO): entry[name] for name in entry.files if name.startswith(_ALSO)}

    def tallies(self) -> Iterator[dict[str, Array]]:
        """Yield the sums of errors, NEES and NIS of the recorded chunks in their order, see `Part.tally`."""
        for number in self.finished():
            with np.load(self._folder / f"{number}.npz", allow_pickle=False) as entry:
                names = [name for name in entry.files if name.startswith(_TALLY)]
                yield {name.removeprefix(_TALLY): entry[name] for name in names}

    def _entry(self, number: int) -> tuple[Array, dict[str, str]]:
        with np.load(self._folder / f"{number}.npz", allow_pickle=False) as entry:
            return entry["sums"], json.loads(str(entry["files"]))

    def check(self, fingerprint: Callable[[str], str]) -> None:
        """Forget the chunks whose files are not what was written, and what a kill has left of other records.

        Parameters
        ----------
        fingerprint : callable
            Of a file by its name.
        """
        for number in self.finished():
            try:
                _, files = self._entry(number)
                whole = all(fingerprint(name) == was for name, was in files.items())
            except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
                whole = False
            if not whole:
                (self._folder / f"{number}.npz").unlink()
        for path in self._folder.iterdir():
            if _NAME.fullmatch(path.name) and path.suffix not in (".json", ".npz"):
                path.unlink()


def discard(folder: Path) -> None:
    """Remove the record of a run that is finished, and nothing that somebody else has put there."""
    with suppress(FileNotFoundError):
        for path in (folder / CHUNKS).iterdir():
            if _NAME.fullmatch(path.name):
                path.unlink()
        with suppress(OSError):
            (folder / CHUNKS).rmdir()
