"""Where lines come from: standard input, datagrams, a file that grows."""

from __future__ import annotations

import hashlib
import os
import select
import socket
import stat
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from quietfix.diagrams.live.lines import LONGEST
from quietfix.diagrams.schema.errors import UserError, shown

__all__ = ["Datagrams", "Followed", "Source", "Splitter", "StandardInput"]

_PIECE = 1 << 15  # bytes that are read at once
_LOOK = 0.1  # s between two looks at a file
_BEGINNING = 1024  # bytes by which a file is known
_BUFFER = 1 << 22  # bytes that the kernel keeps of datagrams
_TOGETHER = 64  # datagrams
_LARGEST_DATAGRAM = 1 << 16


class Splitter:
    """Cuts bytes into lines; of a line that is too long no more is kept than says so."""

    def __init__(self) -> None:
        self._rest = b""
        self._over = False

    def feed(self, piece: bytes) -> list[bytes]:
        """Return the lines that are complete."""
        *lines, rest = (self._rest + piece).split(b"\n")
        if lines and self._over:
            lines[0] = b" " * (LONGEST + 1) + b"."
            self._over = False
        if len(rest) > LONGEST:
            self._over, rest = True, b""
        self._rest = rest
        return lines

    def end(self) -> list[bytes]:
        """Return the last line, if it has no end."""
        rest, self._rest, over = self._rest, b"", self._over
        self._over = False
        return [b" " * (LONGEST + 1) + b"."] if over else [rest] if rest.strip() else []

    @property
    def waiting(self) -> int:
        """How many bytes there are of a line that is not complete."""
        return len(self._rest)


class Source(Protocol):
    """Where lines come from."""

    def read(self, timeout: float) -> list[bytes] | None:
        """Return lines that have come, none after so many seconds; None at the end."""

    def place(self) -> dict[str, Any]:
        """Return where to go on after a restart."""

    def close(self) -> None:
        """Let go of it."""


class StandardInput:
    """Lines of standard input, or another file descriptor."""

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._splitter = Splitter()
        self._ended = False

    def read(self, timeout: float) -> list[bytes] | None:
        """See `Source.read`."""
        if self._ended:
            return None
        try:
            if not select.select([self._descriptor], [], [], timeout)[0]:
                return []
            piece = os.read(self._descriptor, _PIECE)
        except OSError as error:
            raise UserError(f"standard input: it cannot be read ({_reason(error)})") from error
        if piece:
            return self._splitter.feed(piece)
        self._ended = True
        return self._splitter.end()

    def place(self) -> dict[str, Any]:
        """See `Source.place`."""
        return {}

    def close(self) -> None:
        """See `Source.close`."""


class Datagrams:
    """Lines in datagrams.

    Parameters
    ----------
    address : str
        ``HOST:PORT``, of IPv6 ``[HOST]:PORT``; port 0: any that is free.

    Raises
    ------
    UserError
        If it is none, or cannot be had.
    """

    def __init__(self, address: str) -> None:
        host, colon, port = address.rpartition(":")
        if not colon or not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
            raise UserError(f"--udp: {address} is not allowed; HOST:PORT, a port from 0 to 65535")
        try:
            family, _, _, _, place = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise UserError(f"--udp: {address} cannot be had ({_reason(error)})") from error
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise UserError(f"--udp: {address} cannot be had ({_reason(error)})") from error
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        print(f"quietfix: live: UDP at {host}:{self.port}", file=sys.stderr, flush=True)

    def read(self, timeout: float) -> list[bytes] | None:
        """See `Source.read`; there is no end."""
        if not select.select([self._socket], [], [], timeout)[0]:
            return []
        found: list[bytes] = []
        for _ in range(_TOGETHER):
            try:
                found += self._socket.recv(_LARGEST_DATAGRAM).split(b"\n")
            except BlockingIOError:
                break
            except OSError:  # such as the word of a router on something else
                continue
        return found

    def place(self) -> dict[str, Any]:
        """See `Source.place`."""
        return {}

    def close(self) -> None:
        """See `Source.close`."""
        self._socket.close()


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or str(error)


class Followed:
    """Lines of a file from its beginning, and those that are added; a new file of that name is gone on with.

    Parameters
    ----------
    path : Path
    place : mapping of str to int
        Where to go on, if it is still the same file.

    Raises
    ------
    UserError
        If it cannot be read.
    """

    def __init__(self, path: Path, place: Mapping[str, Any] | None = None) -> None:
        self._path = path
        self._splitter = Splitter()
        try:
            if not stat.S_ISREG(path.stat().st_mode):
                raise UserError(f"--follow: {shown(path)} is not allowed; a file (of a pipe: standard input)")
            self._file = path.open("rb", buffering=0)
        except (OSError, ValueError) as error:
            raise UserError(f"--follow: {shown(path)} cannot be read ({_reason(error)})") from error
        if place:
            self._go_on(place)

    def _go_on(self, place: Mapping[str, Any]) -> None:
        """Go to where it was, if it is still the same file: one of the same number may begin with something else."""
        offset, status = place["offset"], os.fstat(self._file.fileno())
        if place["inode"] == status.st_ino and place["begins"] == self._begins(offset) and offset <= status.st_size:
            self._file.seek(offset)

    def _begins(self, offset: int) -> str:
        first = os.pread(self._file.fileno(), min(offset, _BEGINNING), 0)
        return hashlib.sha256(first).hexdigest()

    def read(self, timeout: float) -> list[bytes] | None:
        """See `Source.read`; there is no end."""
        piece = self._file.read(_PIECE)
        if piece:
            return self._splitter.feed(piece)
        if self._cut():
            self._splitter = Splitter()
            self._file.seek(0)
            return []
        if self._replaced():
            rest = self._splitter.end()
            self._reopen()
            return rest
        time.sleep(min(timeout, _LOOK))
        return []

    def _cut(self) -> bool:
        return os.fstat(self._file.fileno()).st_size < self._file.tell()

    def _replaced(self) -> bool:
        try:
            now = self._path.stat()
        except OSError:
            return False  # until there is another one
        mine = os.fstat(self._file.fileno())
        return (now.st_ino, now.st_dev) != (mine.st_ino, mine.st_dev)

    def _reopen(self) -> None:
        try:
            file = self._path.open("rb", buffering=0)
        except OSError:
            return
        self._file.close()
        self._file = file

    def place(self) -> dict[str, Any]:
        """See `Source.place`."""
        offset = self._file.tell() - self._splitter.waiting
        return {"inode": os.fstat(self._file.fileno()).st_ino, "offset": offset, "begins": self._begins(offset)}

    def close(self) -> None:
        """See `Source.close`."""
        self._file.close()
