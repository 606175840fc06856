"""Writing that is whole or not at all, whatever interrupts it."""

from __future__ import annotations

import os
import signal
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from quietfix.diagrams.schema.errors import UserError

__all__ = ["replaces", "undisturbed", "written_beside"]


@contextmanager
def undisturbed() -> Iterator[None]:
    """Hold Ctrl-C back until a write is finished, so that nothing on disk is half-written."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pending
        pending = True

    before = signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pending:
        raise KeyboardInterrupt


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """Yield a name beside a file's, which takes the file's when it is written, or goes when that fails.

    Raises
    ------
    UserError
        If the name is taken by anything but a plain file that can be written, or cannot be written.
    """
    try:
        if path.is_symlink():
            raise UserError(f"--out: {path} is a link to {path.readlink()}; name a file itself")
        if path.exists() and not path.is_file():
            raise UserError(f"--out: {path} exists and is not a file")
        if path.exists() and not path.stat().st_mode & 0o222:
            raise UserError(f"--out: {path} is read-only; choose another file")
        beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        os.close(descriptor)
        try:
            yield beside
            with undisturbed():
                if path.exists():
                    beside.chmod(stat.S_IMODE(path.stat().st_mode))
                beside.replace(path)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise UserError(f"--out: {path} cannot be written ({error.strerror or error})") from error


def replaces(path: Path, signature: bytes, option: str, maker: str = "program") -> bool:
    """Return whether a page is there that is to be replaced, known by a signature in its first 2000 bytes.

    Raises
    ------
    UserError
        If anything else is there.
    """
    if not path.exists():
        return False
    if path.is_file():
        with path.open("rb") as file:
            if signature in file.read(2000):
                return True
    raise UserError(f"{option}: {path} exists and is no page of this {maker}; choose another name")
