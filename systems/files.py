"""Reading a user's file: only a regular one, and not more of it than the memory holds."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from quietfix.systems.counting import tally

__all__ = ["Unreadable", "read_bytes", "read_text", "regular_size"]

_LARGEST = 32_000_000


class Unreadable(ValueError):
    """A file that cannot be read; the message names it and says why."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path} cannot be read ({reason})")
        self.path = path
        self.reason = reason


def _open(path: Path) -> tuple[int, int]:
    """Return descriptor and size of a regular file."""
    try:
        # without O_NONBLOCK a FIFO waits until somebody writes to it
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise Unreadable(path, getattr(error, "strerror", None) or str(error)) from error
    status = os.fstat(descriptor)
    if stat.S_ISDIR(status.st_mode) or not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise Unreadable(path, "it is a folder" if stat.S_ISDIR(status.st_mode) else "it is not a regular file")
    return descriptor, status.st_size


def regular_size(path: Path | str) -> int:
    """Return the size of a file [bytes].

    Raises
    ------
    Unreadable
        If it is missing, may not be read, or is a folder, a device, a FIFO or a socket.
    """
    descriptor, size = _open(Path(path))
    os.close(descriptor)
    return size


def read_bytes(path: Path | str, largest: int = _LARGEST) -> bytes:
    """Return what is in a regular file.

    Parameters
    ----------
    path : path
        The file.
    largest : int
        How large it may be [bytes].

    Raises
    ------
    Unreadable
        As of `regular_size`, and if it is larger.
    """
    tally("read")
    file = Path(path)
    descriptor, size = _open(file)
    try:
        with os.fdopen(descriptor, "rb") as stream:
            # The size of a file in /proc is 0, whatever is in it.
            content = b"" if size > largest else stream.read(largest + 1)
    except OSError as error:
        raise Unreadable(file, error.strerror or str(error)) from error
    if max(size, len(content)) > largest:
        raise Unreadable(file, f"{max(size, len(content))} bytes; at most {largest} are allowed")
    return content


def read_text(path: Path | str, largest: int = _LARGEST, encoding: str = "utf-8", errors: str = "strict") -> str:
    """Return the text of a regular file, its line ends as they are; see `read_bytes`.

    Raises
    ------
    Unreadable
        As of `read_bytes`, and if it is not text in that encoding.
    """
    content = read_bytes(path, largest)
    try:
        return content.decode(encoding, errors)
    except UnicodeDecodeError as error:
        raise Unreadable(Path(path), f"not {error.encoding}: byte {error.start}: {error.reason}") from error
