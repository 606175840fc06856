"""The mark of a folder that Quietfix wrote: what tells it from a user's own, and who is writing in it.

A folder is Quietfix's if it holds a readable marker, never because of the names in it. The marker lists every file
that was written, so that what somebody added or changed later is seen before the folder is replaced. Whoever writes in
a folder holds an exclusive `flock` on its marker; the kernel releases that with the process, however it ends.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shutil
import stat
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath

from quietfix.diagrams.chunks.ledger import OWN
from quietfix.diagrams.schema.errors import UserError

__all__ = [
    "MAKING",
    "MARKER",
    "REPLACED",
    "RESERVE",
    "Busy",
    "Mark",
    "check_place",
    "clear",
    "discard",
    "fingerprint_of",
    "gather",
    "listing",
    "lock",
    "plain",
    "read_mark",
    "refuse_changed",
    "refuse_strangers",
    "strangers",
    "sweep_halves",
    "within",
]

MARKER = ".quietfix-result.json"
MAKING = ".quietfix-making"
"""Folder within an unfinished result for what is written once; it gets its place when all of it is there."""
REPLACED = ".quietfix-replaced"
"""Where the earlier result waits within the new one until that has its final name."""
RESERVE = ".quietfix-reserve"
"""Bytes held back, so that a full disk still takes the marker and the store's metadata."""

FORMAT = 1
_LARGEST_MARKER = 1 << 28
_HASHED = 1 << 20  # bytes at the beginning of a file; more would make large results slow to finish
# What a run that was killed may leave before its files are listed: an array's metadata and chunks, also half-written.
_HALF = r"(\.[0-9a-f]{32}\.partial)?"
_STORE = re.compile(rf"results\.zarr(/[\w.-]+)?(/zarr\.json|/zarr{_HALF}|/c(/\d+)*{_HALF})?/?")
_MARKERS = re.compile(re.escape(MARKER) + r"(\.\d+)?")


class Busy(UserError):
    """Another run is writing in the folder."""


@dataclass(frozen=True)
class Mark:
    """What the marker of a folder says.

    Attributes
    ----------
    kind : str
        The command that wrote it.
    finished : bool
        Whether everything is there.
    files : dict, optional
        Fingerprint of every file by its path within the folder; None while they are being written.
    """

    kind: str
    finished: bool = False
    files: dict[str, str] | None = None

    def write(self, folder: Path) -> int:
        """Write the marker into a folder, locked before it is seen; return its open descriptor."""
        text = json.dumps(
            {"format": FORMAT, "kind": self.kind, "version": _version(), "finished": self.finished, "files": self.files}
        )
        beside = folder / f"{MARKER}.{os.getpid()}"
        descriptor = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        try:
            _flock(descriptor, folder)
            with open(descriptor, "w", encoding="utf-8", closefd=False) as stream:
                stream.write(text + "\n")
            os.replace(beside, folder / MARKER)
        except BaseException:
            os.close(descriptor)
            beside.unlink(missing_ok=True)
            raise
        return descriptor


def _version() -> str:
    try:
        return version("quietfix")
    except PackageNotFoundError:
        return "not installed"


def read_mark(folder: Path, option: str = "--out") -> Mark | None:
    """Return what the marker of a folder says, or None if there is none that can be read.

    Parameters
    ----------
    folder : Path
    option : str
        What names the folder, for messages.

    Raises
    ------
    UserError
        If a later version of Quietfix wrote it.
    """
    path = folder / MARKER
    try:
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode) or found.st_size > _LARGEST_MARKER:
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
        form, kind, by, finished, files = (content[key] for key in ("format", "kind", "version", "finished", "files"))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    if type(form) is int and form > FORMAT:
        raise UserError(f"{option}: {folder} was written by a later version of Quietfix; choose another folder")
    texts = all(isinstance(text, str) and text for text in (kind, by))
    if type(form) is not int or form != FORMAT or not texts or not isinstance(finished, bool):
        return None
    if files is not None and not isinstance(files, dict):
        return None
    return Mark(kind, finished, files)


def lock(folder: Path) -> int:
    """Lock the marker of a folder and return its open descriptor; closing it releases the lock.

    Raises
    ------
    Busy
        If another run holds it.
    OSError
        If there is no marker.
    """
    while True:
        descriptor = os.open(folder / MARKER, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            _flock(descriptor, folder)
            # the marker is replaced when it is written: a lock on the one before says nothing
            if os.path.samestat(os.fstat(descriptor), (folder / MARKER).lstat()):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _flock(descriptor: int, folder: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise Busy(f"--out: another run is writing in {folder}; wait for it or choose another folder") from error
    except OSError as error:  # some network file systems
        warnings.warn(f"--out: {folder} cannot be locked ({error.strerror}); keep other runs out of it", stacklevel=2)


# --------------------------------------------------------------------------------------------------- what is there


def listing(folder: Path) -> dict[str, str]:
    """Return the fingerprint of what was written in a folder, by its path there once all that is made has its place.

    What somebody else has put beside it is not listed, and so is known as a stranger.
    """
    found = {}
    for name, path in _walk(folder):
        top, _, within = name.partition("/")
        if _STORE.fullmatch(name) or (top == MAKING and within):
            found[within if top == MAKING else name] = fingerprint_of(path)
    return found


def strangers(folder: Path, mark: Mark) -> list[str]:
    """Return what lies in a marked folder and was not written by Quietfix, or was changed since.

    Parameters
    ----------
    folder : Path
        A folder with a marker.
    mark : Mark
        What that says.
    """
    found = []
    earlier = read_mark(folder / REPLACED)
    # a removal that was cut short leaves folders empty
    folders = {f"{above.as_posix()}/" for name in mark.files or () for above in PurePosixPath(name).parents}
    for name, path in _walk(folder):
        top = name.partition("/")[0]
        if _MARKERS.fullmatch(name) or OWN.fullmatch(name) or top in (RESERVE, MAKING) or name == f"{REPLACED}/":
            continue
        if top == REPLACED and earlier is not None:
            continue
        if mark.files is None:
            if not _STORE.fullmatch(name):
                found.append(name)
        elif name in folders:
            continue
        elif name not in mark.files:
            found.append(name)
        elif mark.files[name] != fingerprint_of(path):
            found.append(f"{name}, which was changed")
    if earlier is not None:
        found += [f"{REPLACED}/{name}" for name in strangers(folder / REPLACED, earlier)]
    return found


def _walk(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield files, links and empty folders (their names end in ``/``); links are not followed."""

    def fail(error: OSError) -> None:
        raise error

    for where, folders, files in os.walk(folder, onerror=fail):
        here = Path(where)
        links = [name for name in folders if (here / name).is_symlink()]
        for name in sorted([*files, *links]):
            yield (here / name).relative_to(folder).as_posix(), here / name
        if not folders and not files and here != folder:
            yield here.relative_to(folder).as_posix() + "/", here


def fingerprint_of(path: Path) -> str:
    """Return size and hash of a file's beginning, or what else it is; nothing where it is not there."""
    try:
        found = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return ""
    if not stat.S_ISREG(found.st_mode):
        return "folder" if stat.S_ISDIR(found.st_mode) else "link or device"
    with path.open("rb") as stream:
        return f"{found.st_size}:{hashlib.sha256(stream.read(_HASHED)).hexdigest()[:32]}"


def sweep_halves(folder: Path) -> None:
    """Remove what a kill has left half-written, or half-removed, in the store of an unfinished result."""
    for name, path in _walk(folder):
        if _STORE.fullmatch(name) and name.endswith(".partial"):
            path.unlink()
    for array in folder.glob("results.zarr/*/"):
        if not (array / "zarr.json").exists():
            shutil.rmtree(array)


def discard(folder: Path) -> None:
    """Remove a marked folder, its marker last: what is left of it by a kill is still known as Quietfix's."""
    clear(folder)
    (folder / MARKER).unlink(missing_ok=True)
    folder.rmdir()


def clear(folder: Path, keep: Collection[str] = ()) -> None:
    """Remove all but the marker, and what is to be kept, from a folder."""
    for path in sorted(folder.iterdir()):
        if path.name == MARKER or path.name in keep:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def plain(path: Path) -> Path:
    """Return the path without ``..``, which would lead elsewhere when a folder on the way is made or renamed."""
    return Path(os.path.realpath(path.parent)) / path.name if ".." in path.parent.parts else path


def within(path: Path, folder: Path) -> bool:
    """Return whether a path is a folder, or leads into it."""
    whole, inside = Path(os.path.realpath(folder)), Path(os.path.realpath(path))
    return whole == inside or whole in inside.parents


def gather(folder: Path) -> None:
    """Move what was made to its place."""
    making = folder / MAKING
    if making.is_dir():
        for path in sorted(making.iterdir()):
            path.replace(folder / path.name)
        making.rmdir()


def check_place(final: Path) -> None:
    """Refuse what can be no new folder, and no earlier result."""
    if final.name in ("", ".."):
        raise UserError(f"--out: {str(final)!r} is not allowed; the name of a new folder or an earlier result")
    if final.is_symlink():
        raise UserError(f"--out: {final} is a link to {final.readlink()}; name a folder itself")
    if os.path.lexists(final) and not final.is_dir():
        raise UserError(f"--out: {final} exists and is not a folder")
    whole, here = Path(os.path.realpath(final)), Path.cwd()
    if whole == here or whole in here.parents:
        raise UserError(f"--out: {final} is the current folder, or holds it; name a folder within it")
    if os.path.ismount(final):
        raise UserError(f"--out: {final} is a mount point; name a folder within it")
    for above in whole.parents:
        if read_mark(above) is not None:
            raise UserError(f"--out: {final} lies in the result {above}; choose another folder")


def refuse_strangers(folder: Path, mark: Mark) -> None:
    """Refuse a folder in which a file was added or changed."""
    if others := strangers(folder, mark):
        raise UserError(f"--out: {folder} holds other files ({', '.join(others[:3])}); choose a new folder")


def refuse_changed(folder: Path, command: str, shown: Path | None = None) -> None:
    """Refuse a result of which an array is missing, or is not what was written; one without a marker passes.

    Parameters
    ----------
    folder : Path
    command : str
        Which command wants it, for messages.
    shown : Path, optional
        How it was named; by default as `folder`.

    Raises
    ------
    UserError
        Naming the first such file.
    """
    mark = read_mark(folder, command)
    for name, was in ((mark.files if mark is not None else None) or {}).items():
        if name.startswith("results.zarr/") and (now := fingerprint_of(folder / name)) != was:
            how = "was changed" if now else "is missing"
            raise UserError(f"{command}: {shown or folder} is damaged: {name} {how} since it was written")
