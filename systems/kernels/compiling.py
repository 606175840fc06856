"""How the functions of this room are compiled, and where their machine code is kept for the next run."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, cast

import numba
from numba.core import caching, config
from numba.core.sigutils import normalize_signature

from quietfix.systems.kernels.progress import noting_loading, say_compiled, say_compiling, say_uncached

__all__ = ["compiled", "inlined", "load", "part_of_loops", "summing"]

_ROOM = Path(__file__).parent

_ALWAYS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}
_INNER: dict[str, Any] = {**_ALWAYS, "no_cpython_wrapper": True}

_LOOPS = "quietfix.systems.kernels.particles."
_one_at_a_time = threading.RLock()

_njit = cast(Any, numba.njit)  # its type does not list all of its options


@contextmanager
def _neighbours_together(wanted: bool) -> Iterator[None]:
    """Have what is the same for numbers side by side done in one instruction, or not, within this block.

    numba leaves that off by default; it changes no sum's order, and no bit. For all else that a process compiles with
    numba the setting stays what it was.
    """
    settings = cast(Any, config)
    before = settings.SLP_VECTORIZE
    settings.SLP_VECTORIZE = int(wanted)
    try:
        yield
    finally:
        settings.SLP_VECTORIZE = before


def _part(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator of a function that becomes part of others, whichever of them has it compiled first."""

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = _njit(**{**_INNER, **options}, forceinline=True)(function)
        compile_it = dispatcher.compile

        def one_by_one(signature: Any) -> Any:
            # Pairs would be in it for good, and no loop that it becomes part of be done several steps at a time.
            with _neighbours_together(False):
                return compile_it(signature)

        dispatcher.compile = one_by_one
        return dispatcher

    return decorate


inlined = _part(_nrt=False)
"""Decorator of a function that is only called from compiled ones and becomes part of them; it allocates nothing.

Forced, because a call hands over every array as seven numbers, which costs more than the work of most of them.
"""

summing = _part(fastmath={"reassoc", "nsz"}, _nrt=False)
"""Decorator of an `inlined` function in which sums may be taken in another order: in the lanes of a vector unit.

The order is that of the machine, of the length and of the compiled function that it becomes part of. Were it called,
a process that has just compiled it would call that code, and one that has its caller from the cache the caller's own,
which was optimised once more: sums in another order.
"""


def part_of_loops(function: Callable[..., Any], careful: bool) -> Any:
    """Return a function that becomes part of every compiled one that calls it, however long it is; see `compiled`."""
    return _part(_nrt=careful, boundscheck=careful)(function)


def compiled(
    signature: Any, from_python: bool = True, careful: bool = False, apart: bool = False
) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator: the function is compiled for that signature alone, by `load`, and kept on disk.

    One that is not `from_python` is called by its address; a `careful` one may allocate, and raises where an index is
    beyond the end of an array. With `apart` its arguments share no memory: loops over them are then done several steps
    at a time.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        options = _ALWAYS if from_python else _INNER
        dispatcher = _njit(**options, _nrt=careful, boundscheck=careful)(function)
        dispatcher.declared = signature
        dispatcher.declared_types = normalize_signature(signature)[0]
        dispatcher.kept_as = function, ""
        # Pairs within a step of a loop keep the compiler from doing whole steps side by side, four at a time.
        dispatcher.neighbours = not function.__module__.startswith(_LOOPS)
        if apart:
            dispatcher._compiler._customize_flags = _apart
        return dispatcher

    return decorate


def _apart(flags: Any) -> Any:
    flags.noalias = True
    return flags


def load(dispatcher: Any) -> Any:
    """Compile a `compiled` function, or take its machine code from the cache; return it, ready to be called."""
    if dispatcher._can_compile:
        with _one_at_a_time:
            _compile(dispatcher)
    return dispatcher


def _compile(dispatcher: Any) -> None:
    if not dispatcher._can_compile:  # another thread has done it
        return
    dispatcher._cache = _cache_of(*dispatcher.kept_as)
    try:
        with noting_loading(), _neighbours_together(dispatcher.neighbours):
            dispatcher.compile(dispatcher.declared)
    finally:
        if dispatcher._cache.told:
            say_compiled()
    dispatcher.disable_compile()


@lru_cache
def _sources(folder: Path) -> str:
    """Return a digest of all sources of a room: a function is stale when one that it is inlined from has changed."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class _Locator(caching._CacheLocator):
    """The first folder that can be written: NUMBA_CACHE_DIR, ``__pycache__`` beside the source, the user's cache."""

    def __init__(self, function: Callable[..., Any], file: str, folder: Path) -> None:
        self._py_file, self._folder = file, folder
        self._line = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return _sources(_ROOM) + hashlib.sha256(Path(self._py_file).read_bytes()).hexdigest()

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator | None:
        if not os.path.exists(file):  # typed in somewhere
            return None
        for folder in _folders(Path(file).absolute()):
            try:
                folder.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=folder).close()
            except OSError:
                continue
            return cls(function, file, folder)
        say_uncached("no folder for it can be written; NUMBA_CACHE_DIR may name one")
        return None


def _folders(file: Path) -> list[Path]:
    own = f"{file.parent.name}_{hashlib.sha256(str(file.parent).encode()).hexdigest()[:16]}"
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    folder: str = getattr(config, "CACHE_DIR", "")
    chosen = [Path(folder) / own] if folder else []
    return [*chosen, file.parent / "__pycache__", home / "quietfix" / own]


class _Implementation(caching.CompileResultCacheImpl):
    def __init__(self, function: Callable[..., Any], name: str) -> None:
        self._locator_classes = cast(Any, [_Locator])
        super().__init__(function)
        self._filename_base += name


class _Cache(caching.FunctionCache):
    """A cache that can fail: a damaged file is compiled anew, a full disk leaves the code in memory."""

    told = False

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        self._impl_class = cast(Any, partial(_Implementation, name=name))
        super().__init__(function)

    def load_overload(self, signature: Any, context: Any) -> Any:
        try:
            found = super().load_overload(signature, context)
        except (OSError, EOFError, pickle.UnpicklingError, ValueError, AttributeError, ImportError, RuntimeError):
            found = None
        if found is None:
            self.told = True
            say_compiling(self._py_func.__name__)
        return found

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError as error:
            say_uncached(str(error))


class _Memory(caching.NullCache):
    told = True

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = function.__name__

    def load_overload(self, signature: Any, context: Any) -> None:
        say_compiling(self._name)


def _cache_of(function: Callable[..., Any], name: str) -> Any:
    """Return where the machine code of a function is kept, or, under another name, what is made of it."""
    try:
        return _Cache(function, name)
    except RuntimeError:  # no locator
        return _Memory(function)
