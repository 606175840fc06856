"""Archives of recordings: what is in them, if it is not too much."""

from __future__ import annotations

import lzma
import tarfile
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

from quietfix.systems.files import Unreadable, regular_size

__all__ = ["members_of"]

_LARGEST = 200_000_000  # bytes
_MOST = 10_000  # files


def members_of(archive: Path) -> dict[str, bytes]:
    """Return the files in an archive (tar, also packed by gzip or xz, or zip) by their names.

    Raises
    ------
    Unreadable
        If it is none, is cut off, or unpacked is larger than 200 MB.
    """
    size = regular_size(archive)
    if size > _LARGEST:
        raise Unreadable(archive, f"{size} bytes; at most {_LARGEST} are allowed")
    try:
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as packed:
                infos = [one for one in packed.infolist() if not one.is_dir()]
                _check(archive, [one.file_size for one in infos])
                return {one.filename: packed.read(one) for one in infos}
        return _tar(archive)
    except Unreadable:
        raise
    except (OSError, EOFError, ValueError, RuntimeError, tarfile.TarError, zipfile.BadZipFile) as error:
        raise Unreadable(archive, f"no archive, or cut off: {' '.join(str(error).split())[:120]}") from error
    except (lzma.LZMAError, zlib.error, NotImplementedError) as error:
        raise Unreadable(archive, f"no archive, or cut off: {' '.join(str(error).split())[:120]}") from error


def _tar(archive: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    total = 0
    with tarfile.open(archive) as tar:
        for member in tar:  # one after the other: what a packed file becomes is known only then
            total += max(member.size, 0)
            _check(archive, [total])
            if len(found) > _MOST:
                raise Unreadable(archive, f"more than {_MOST} files are not allowed")
            stream = tar.extractfile(member) if member.isfile() else None
            if stream is not None:
                content = stream.read()
                if len(content) != member.size:
                    raise Unreadable(archive, f"{member.name[:80]} is cut off")
                found[member.name.removeprefix("./")] = content
    return found


def _check(archive: Path, sizes: Sequence[int]) -> None:
    if sum(sizes) > _LARGEST:
        raise Unreadable(archive, f"{sum(sizes)} bytes unpacked; at most {_LARGEST} are allowed")
