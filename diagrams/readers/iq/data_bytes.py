"""Bytes of samples, in a file or in memory: only what is needed of them is read."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.files import Unreadable, regular_size

__all__ = ["BytesData", "Data", "FileData"]

_AT_ONCE = 1 << 22


class Data(ABC):
    """Bytes.

    Attributes
    ----------
    size : int
        How many.
    """

    size: int

    @abstractmethod
    def numbers(self, dtype: np.dtype[np.generic], first: int, count: int) -> NDArray[np.generic]:
        """Return numbers of a type, from a byte on; `first` and `count` within what there is."""

    @abstractmethod
    def sha512(self) -> str:
        """Return the checksum of all, in small hexadecimal digits."""


class BytesData(Data):
    """Bytes in memory."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self.size = len(content)

    def numbers(self, dtype: np.dtype[np.generic], first: int, count: int) -> NDArray[np.generic]:
        """See `Data.numbers`."""
        return np.frombuffer(self._content, dtype, count, first) if count else np.zeros(0, dtype)

    def sha512(self) -> str:
        """See `Data.sha512`."""
        return hashlib.sha512(self._content).hexdigest()


class FileData(Data):
    """Bytes of a regular file; `Unreadable` is raised for any other."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.size = regular_size(path)

    def numbers(self, dtype: np.dtype[np.generic], first: int, count: int) -> NDArray[np.generic]:
        """See `Data.numbers`."""
        try:
            return np.fromfile(self._path, dtype, count, offset=first)
        except OSError as error:
            raise Unreadable(self._path, error.strerror or str(error)) from error

    def sha512(self) -> str:
        """See `Data.sha512`."""
        found = hashlib.sha512()
        try:
            with self._path.open("rb") as stream:
                while part := stream.read(_AT_ONCE):
                    found.update(part)
        except OSError as error:
            raise Unreadable(self._path, error.strerror or str(error)) from error
        return found.hexdigest()
