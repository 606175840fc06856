"""Folders that are written: under their final name only when all is there, and never over a user's own."""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.chunks import ledger as record
from quietfix.diagrams.chunks.ledger import CHUNKS, Ledger, read_plan
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import (
    MAKING,
    MARKER,
    REPLACED,
    RESERVE,
    Busy,
    Mark,
    check_place,
    clear,
    discard,
    fingerprint_of,
    gather,
    listing,
    lock,
    plain,
    read_mark,
    refuse_strangers,
    strangers,
    sweep_halves,
    within,
)
from quietfix.diagrams.studies.store import add, consolidate, cut, files_of, write
from quietfix.diagrams.writers.whole_file import undisturbed

__all__ = ["Finished", "OutputFolder"]

Array = NDArray[np.float64]

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
_RESERVED = 256 << 10  # bytes
_STORE = "results.zarr"
_NOTED = ("sweep", "verify")
"""Commands that keep what is made of chunks, and not these."""


class Finished(UserError):
    """The run that is to be resumed was finished; its folder has its final name now."""


class OutputFolder:
    """A folder that gets its final name only when everything in it is finished.

    Work goes to ``DIR.partial``, which one run at a time holds. If the run ends early, finished chunks stay there
    until the next run of that name, and one without any is removed. A folder counts as an earlier result by its
    marker (`quietfix.diagrams.studies.marker`) alone; with ``overwrite`` it is replaced at the end, in two renames: it
    moves into the new folder, and that takes its name. A kill between them leaves both in ``DIR.partial``, and the next
    run of that name gives it its final name before anything else.

    Parameters
    ----------
    folder : path
        Final name.
    overwrite : bool
        Whether an earlier result of that name may be replaced.
    kind : str
        The command that writes, for the marker.
    reads : path, optional
        An earlier result that the run reads, which it must not remove.
    plan : Plan, optional
        What is asked for, of a run whose chunks are written by `write`.
    resume : bool
        Whether chunks that an interrupted run of the same plan has finished are kept.

    Raises
    ------
    UserError
        If the run to be resumed has another plan; if the folder exists (and is not an earlier result, or `overwrite` is
        not given), is a link, is the current folder, lies in another result, is written by another run, or cannot be
        written.
    """

    def __init__(
        self,
        folder: Path | str,
        overwrite: bool = False,
        kind: str = "run",
        reads: Path | str | None = None,
        plan: Plan | None = None,
        resume: bool = False,
    ) -> None:
        self.final = plain(Path(folder))
        self.chunks = 0
        self._size, self._width = 0, 0
        self._resume = resume
        self._noted = plan is not None and plan.asked.get("command") in _NOTED
        self._along = "chunk" if self._noted else "trial"
        self._above: list[Path] = []
        self._kind, self._overwrite = kind, overwrite
        self._finished = False
        self._lock: int | None = None
        try:
            check_place(self.final)
            self.partial = self.final.with_name(self.final.name + ".partial")
            self.ledger = None if plan is None else Ledger(self.partial, plan)
            if reads is not None and within(Path(reads), self.partial):
                raise UserError(f"--from: {reads} is where --out {self.final} works; choose another folder")
            with undisturbed():
                self._begin()
        except OSError as error:
            self._release()
            raise UserError(f"--out: {self.final} cannot be written ({error.strerror or error})") from error
        except BaseException:
            self._release()
            raise

    # ---- beginning

    @classmethod
    def check(cls, final: Path, overwrite: bool) -> None:
        """Raise a `UserError` if the folder cannot be one to write, or exists and may not be replaced."""
        final = plain(final)
        try:
            check_place(final)
            if not os.path.lexists(final):
                return
            cls._check_content(final, overwrite)
            if not final.stat().st_mode & 0o222:
                raise UserError(f"--out: {final} is read-only; choose another folder")
        except OSError as error:
            raise UserError(f"--out: {final} cannot be written ({error.strerror or error})") from error

    @staticmethod
    def _check_content(final: Path, overwrite: bool) -> None:
        mark = read_mark(final)
        if mark is None:
            if others := sorted(path.name for path in final.iterdir()):
                raise UserError(
                    f"--out: {final} holds other files ({', '.join(others[:3])}) and no mark of an earlier result "
                    f"({MARKER}); choose a new folder, or remove it yourself"
                )
            return
        if mark.files is None:
            raise UserError(f"--out: {final} is the unfinished work of another run; choose another folder")
        refuse_strangers(final, mark)
        if not overwrite:
            raise UserError(f"--out: {final} holds an earlier result; add --overwrite or choose another folder")

    def _begin(self) -> None:
        found = self._take()
        if found is not None and found.finished and not os.path.lexists(self.final):
            self._place()  # an earlier run was killed between its two renames
            print(f"quietfix: {self.partial} was finished by an earlier run; it is {self.final} now", file=sys.stderr)
            self._release()
            found = None
            if self._resume:
                raise Finished(f"{self.final} is finished")
        self.check(self.final, self._overwrite)
        if found is None:
            self._make()
        else:
            self._keep_finished()
            self._remark(Mark(self._kind))
        (self.partial / MAKING).mkdir()
        (self.partial / RESERVE).write_bytes(os.urandom(_RESERVED))
        if self.ledger is not None and not self.chunks:
            self.ledger.begin()

    def _keep_finished(self) -> None:
        """Keep the finished chunks of an earlier run that is to be resumed; remove all else that it left."""
        earlier = read_plan(self.partial) if self._resume and self.ledger is not None else None
        if self.ledger is not None and earlier is not None:
            earlier.refuse_other(self.ledger.plan)
            self.ledger.check(lambda name: fingerprint_of(self.store / name))
            self.chunks, self._size = len(self.ledger.finished()), len(self.ledger.places())
        kept = (CHUNKS,) if self._noted else (CHUNKS, _STORE)
        clear(self.partial, kept if self.chunks else ())
        sweep_halves(self.partial)

    def _take(self) -> Mark | None:
        """Lock what an earlier run left, and return its mark; None if there is nothing."""
        for patience in (5, 4, 3, 2, 1, 0):
            if not os.path.lexists(self.partial):
                return None
            if self.partial.is_symlink() or not self.partial.is_dir():
                break
            try:
                self._lock = lock(self.partial)
            except (FileNotFoundError, NotADirectoryError):
                if patience:  # another run may be making it just now
                    time.sleep(0.02)
                continue
            mark = read_mark(self.partial)
            if mark is None:
                break
            refuse_strangers(self.partial, mark)
            return mark
        raise UserError(
            f"--out: {self.partial} is needed for the work and was not made by this program; choose another folder, or "
            "move it away"
        )

    def _make(self) -> None:
        self._above = [path for path in self.partial.parents if not path.exists()]
        try:
            self.partial.mkdir(parents=True)
        except FileExistsError as error:
            raise Busy(f"--out: another run is writing in {self.partial}; choose another folder") from error
        try:
            self._remark(Mark(self._kind))
        except BaseException:
            self.partial.rmdir()
            raise

    def _remark(self, mark: Mark) -> None:
        before, self._lock = self._lock, mark.write(self.partial)
        if before is not None:
            os.close(before)

    # ---- writing

    @property
    def store(self) -> Path:
        """Where the Dataset goes."""
        return self.partial / _STORE

    @property
    def work(self) -> Path:
        """Where all else goes: files that are written once."""
        return self.partial / MAKING

    @property
    def trials(self) -> int:
        """How many trials, or what else is counted, are written."""
        return self._size

    @property
    def along(self) -> str:
        """What is counted: trials, points, chunks."""
        return self._along

    @property
    def left(self) -> frozenset[int]:
        """Which chunks of the plan are not finished."""
        return frozenset() if self.ledger is None else self.ledger.left()

    def append(self, chunk: xr.Dataset, along: str = "trial") -> None:
        """Write one chunk of trials, or of what `along` names, behind the others; one that fails leaves no trace."""
        with undisturbed():
            size = self._size + chunk.sizes[along]
            self._width = self._width or chunk.sizes[along]
            try:
                write(self.store, chunk, along, self._size, size, self._width)
            except OSError:
                if self.chunks:
                    (self.partial / RESERVE).unlink(missing_ok=True)
                    cut(self.store, chunk, along, self._size)
                raise
            self.chunks, self._size, self._along = self.chunks + 1, size, along

    def write(self, part: Part) -> None:
        """Write one chunk of the plan at its place; in any order. One that fails is not finished, and done again."""
        assert self.ledger is not None
        plan = self.ledger.plan
        begin, end = plan.place(part.number)
        with self._careful():
            write(self.store, part.dataset, self._along, begin, plan.trials, plan.chunk)
            names = files_of(self.store, self._along, begin, end)
            self.ledger.record(part, {name: fingerprint_of(self.store / name) for name in names})
            self.chunks, self._size = self.chunks + 1, self._size + end - begin

    def note(self, number: int, sums: Array | None, also: Mapping[str, NDArray[Any]]) -> None:
        """Keep what is made of a chunk of a plan whose chunks themselves are not kept."""
        assert self.ledger is not None
        with self._careful():
            self.ledger.keep(number, sums, {}, also)
            self.chunks, self._size = self.chunks + 1, self._size + 1

    def put(self, datasets: Sequence[xr.Dataset], along: str) -> None:
        """Write all of a store, each dataset at its place."""
        with self._careful():
            for place, dataset in enumerate(datasets):
                write(self.store, dataset, along, place, len(datasets), 1)

    @contextmanager
    def _careful(self) -> Iterator[None]:
        with undisturbed():
            try:
                yield
            except OSError:
                (self.partial / RESERVE).unlink(missing_ok=True)
                raise

    def add(self, variables: xr.Dataset) -> None:
        """Write variables that are no chunk's."""
        with undisturbed():
            add(self.store, variables)

    # ---- ending

    def finish(self) -> None:
        """Give the folder its final name.

        Raises
        ------
        UserError
            If something of that name has appeared, or changed, since the beginning; the result stays in ``partial``.
        """
        with undisturbed():
            (self.partial / RESERVE).unlink(missing_ok=True)
            if self.chunks and self.store.exists():
                with suppress(OSError):  # the result is whole without it
                    consolidate(self.store)
            self._settle(finished=True)
            self._finished = True
            try:
                self.check(self.final, self._overwrite)
            except UserError as error:
                raise UserError(f"{error}; {self.kept}") from error
            self._place()

    def _settle(self, finished: bool) -> None:
        """List what was written in the marker, and give what was made its place."""
        (self.partial / RESERVE).unlink(missing_ok=True)
        self._remark(Mark(self._kind, finished, listing(self.partial)))
        gather(self.partial)

    def _place(self) -> None:
        """Turn the finished ``partial`` into the final folder."""
        gather(self.partial)
        record.discard(self.partial)
        replaced = self.partial / REPLACED
        if read_mark(self.final) is not None:
            self.final.rename(replaced)
            try:
                self.partial.rename(self.final)
            except OSError:
                replaced.rename(self.final)
                raise
        else:
            self.partial.rename(self.final)
        if (self.final / REPLACED).exists():
            with suppress(OSError):  # the result is there; what cannot be removed is known by its marker
                discard(self.final / REPLACED)

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> OutputFolder:
        """Begin."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Keep finished chunks, remove what holds none; a full disk is one line."""
        try:
            if kind is not None and not self._finished:
                with undisturbed():
                    self._end_early()
        finally:
            self._release()
        if isinstance(error, OSError) and (error.errno in _FULL or within(Path(str(error.filename)), self.partial)):
            raise self.refusal(error) from error

    def refusal(self, error: OSError) -> UserError:
        """Return that the folder cannot be written, and what is kept."""
        return UserError(f"--out: {self.final} cannot be written ({error.strerror or error}); {self.kept}")

    @property
    def kept(self) -> str:
        """What is kept of a run that ends early, in words."""
        if self._finished:
            return f"the finished result is kept in {self.partial}"
        if self.chunks:
            return f"{self._size} {self._along}{'s are' if self._size > 1 else ' is'} kept in {self.partial}"
        return "nothing is kept"

    def _end_early(self) -> None:
        with suppress(OSError):  # what made the run end may be that nothing can be written
            if self.chunks or strangers(self.partial, Mark(self._kind)):
                self._settle(finished=False)
            else:
                discard(self.partial)
                for path in self._above:
                    path.rmdir()
