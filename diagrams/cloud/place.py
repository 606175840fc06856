"""A place in an object store, by its URL, through `fsspec`, which is imported here and only when one is named."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from quietfix.diagrams.chunks.ledger import CHUNKS
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER

__all__ = ["Place", "is_url"]

_URL = re.compile(r"([a-z][a-z0-9+.-]*):/+(?=[^/])")
_NEEDS = {"s3": "cloud", "s3a": "cloud", "memory": "cloud"}
"""Which extra brings what reaches a store."""


def is_url(path: Path | None) -> bool:
    """Return whether a path is a URL: a path on the command line has lost one of its two slashes."""
    found = None if path is None else _URL.match(str(path))
    return found is not None and not Path(found[0].rstrip("/")).exists()


class Place:
    """A folder in an object store.

    Parameters
    ----------
    url : Path or str
        Such as ``s3://bucket/name``.
    option : str
        What names it, for messages.

    Raises
    ------
    UserError
        If nothing here can reach it, naming the extra that brings what does.
    """

    def __init__(self, url: Path | str, option: str) -> None:
        scheme, rest = _URL.sub(r"\1 ", str(url), count=1).split(" ", 1)
        self.url, self._option = f"{scheme}://{rest.rstrip('/')}", option
        extra = _NEEDS.get(scheme)
        with_ = f"; `pip install quietfix[{extra}]`" if extra else "; s3 or another scheme that is installed for fsspec"
        try:
            from fsspec.core import url_to_fs

            with self.reaching():
                self._files, self._root = url_to_fs(self.url)
        except ImportError as error:
            raise UserError(f"{option}: {self.url} needs {_words(error)}{with_}") from error
        except ValueError as error:
            if isinstance(error, UserError):
                raise
            raise UserError(f"{option}: {self.url} is not allowed ({_words(error)}){with_}") from error

    @contextmanager
    def reaching(self) -> Iterator[None]:
        """Turn what a store raises where it cannot be reached, or does not allow it, into one line."""
        try:
            yield
        except (UserError, ImportError, ValueError):
            raise
        except Exception as error:  # each kind of store has its own errors
            raise UserError(f"{self._option}: {self.url} cannot be reached ({_words(error)})") from error

    def names(self) -> list[str]:
        """Return what lies there, by names within it."""
        with self.reaching():
            self._files.invalidate_cache()
            found = self._files.find(self._root)
        begin = len(self._root.rstrip("/")) + 1
        return sorted(str(name)[begin:] for name in found)

    @property
    def finished(self) -> bool:
        """Whether a finished result is there."""
        names = self.names()
        return MARKER in names and not any(name.startswith(f"{CHUNKS}/") for name in names)

    def put(self, folder: Path, names: Iterable[str]) -> None:
        """Write files of a folder there, in the order that is given; each is there whole or not at all."""
        with self.reaching():
            for name in names:
                self._files.pipe_file(f"{self._root}/{name}", (folder / name).read_bytes())

    def get(self, folder: Path, names: Iterable[str]) -> None:
        """Write files from there into a folder."""
        with self.reaching():
            for name in names:
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(self._files.cat_file(f"{self._root}/{name}"))

    def remove(self, names: Iterable[str]) -> None:
        """Remove files there."""
        with self.reaching():
            for name in names:
                self._files.rm_file(f"{self._root}/{name}")


def _words(error: Any) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
