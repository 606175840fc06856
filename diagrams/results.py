"""Results on disk: chunks as they finish, a final name only when all is there."""

from __future__ import annotations

import json
import os
import shutil
import signal
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import xarray as xr

from diagrams.errors import UserError

__all__ = ["OutputFolder", "open_result", "write_summary"]

# beside figures (*.png)
_OURS = (
    "results.zarr",
    "summary.json",
    "comparison.json",
    "sweep.json",
    "verification.json",
    "diagram.svg",
    "differences.csv",
)


@contextmanager
def _undisturbed() -> Iterator[None]:
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


class OutputFolder:
    """A folder that gets its final name only when everything in it is finished.

    Work goes to ``DIR.partial``. If the run ends early, finished chunks stay there, and an empty one is removed.

    Parameters
    ----------
    folder : path
        Final name.
    overwrite : bool
        Whether an earlier result of that name may be replaced.

    Raises
    ------
    UserError
        If the folder exists (and is not an earlier result, or `overwrite` is not given), or cannot be written.
    """

    def __init__(self, folder: Path | str, overwrite: bool = False) -> None:
        self.final = Path(folder)
        self.check(self.final, overwrite)
        self.partial = self.final.with_name(self.final.name + ".partial")
        try:
            if self.partial.exists():
                shutil.rmtree(self.partial)
            self.partial.mkdir(parents=True)
            probe = self.partial / ".write"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise UserError(f"--out: {self.final} cannot be written ({error.strerror or error})") from error
        self.chunks = 0

    @staticmethod
    def check(final: Path, overwrite: bool) -> None:
        """Raise a `UserError` if the folder has no name, or exists and may not be replaced."""
        if final.name in ("", ".."):
            raise UserError(f"--out: {str(final)!r} is not allowed; the name of a new folder or an earlier result")
        if not final.exists():
            return
        if not final.is_dir():
            raise UserError(f"--out: {final} exists and is not a folder")
        others = [p.name for p in final.iterdir() if p.name not in _OURS and p.suffix != ".png"]
        if others:
            raise UserError(f"--out: {final} holds other files ({', '.join(sorted(others)[:3])}); choose a new folder")
        if any(final.iterdir()) and not overwrite:
            raise UserError(f"--out: {final} holds an earlier result; add --overwrite or choose another folder")

    @property
    def store(self) -> Path:
        """Where the Dataset goes."""
        return self.partial / "results.zarr"

    def append(self, chunk: xr.Dataset, along: str = "trial") -> None:
        """Write one chunk of trials, or of what `along` names."""
        with _undisturbed(), warnings.catch_warnings():
            # zarr warns that its text type is not in the v3 specification yet; xarray reads it all the same.
            warnings.simplefilter("ignore")
            if self.chunks == 0:
                chunk.to_zarr(self.store, mode="w", consolidated=False)
            else:
                grows = chunk[[name for name in chunk if along in chunk[name].dims]]
                grows.drop_vars([c for c in grows.coords if along not in grows[c].dims]).to_zarr(
                    self.store, append_dim=along, consolidated=False
                )
                fresh = [name for name in chunk if str(name).startswith("bound_") and name not in grows]
                if fresh:
                    chunk[fresh].to_zarr(self.store, mode="a", consolidated=False)
            self.chunks += 1

    def finish(self) -> None:
        """Give the folder its final name."""
        with _undisturbed():
            if self.final.exists():
                old = self.final.with_name(f"{self.final.name}.old.{os.getpid()}")
                self.final.rename(old)
                self.partial.rename(self.final)
                shutil.rmtree(old)
            else:
                self.partial.rename(self.final)

    def __enter__(self) -> OutputFolder:
        """Begin."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Keep finished chunks, remove what holds none."""
        if kind is not None and self.partial.exists() and self.chunks == 0:
            shutil.rmtree(self.partial)


def open_result(path: Path | str) -> xr.Dataset:
    """Open a result by its folder or its ``results.zarr``; arrays are read when they are used.

    Raises
    ------
    UserError
        If there is no result.
    """
    folder = Path(path)
    store = folder if folder.suffix == ".zarr" else folder / "results.zarr"
    if not store.is_dir():
        raise UserError(f"result: {path} is not a result; a folder with results.zarr, or results.zarr itself")
    try:
        return xr.open_zarr(store, consolidated=False, chunks=None)
    except Exception as error:  # zarr and xarray raise a dozen kinds for a damaged store
        raise UserError(f"result: {store} cannot be read ({' '.join(str(error).split())})") from error


def write_summary(path: Path, dataset: xr.Dataset, estimators: dict[str, Any], began: float) -> dict[str, Any]:
    """Write ``summary.json`` and return what is in it."""
    summary = {
        "system": dataset.attrs["system"],
        "variant": dataset.attrs["variant"] or None,
        "seed": int(dataset.attrs["seed"]),
        "first_trial": int(dataset.attrs["first_trial"]),
        "trials": int(dataset.sizes["trial"]),
        "version": dataset.attrs["version"],
        "run_seconds": round(time.monotonic() - began, 3),
        "time_s": [float(t) for t in dataset["time"].values],
        "estimators": estimators,
    }
    path.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return summary
