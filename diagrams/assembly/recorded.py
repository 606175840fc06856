"""What makes a model a recording: the tracks that were recorded, and what it says of a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.clocks import Clock

if TYPE_CHECKING:
    import xarray as xr

    from quietfix.diagrams.console.tables import Table

__all__ = ["Recorded", "Report"]


class Report(Protocol):
    """What is to be said of a recording beside what is said of every study."""

    def table(self) -> Table:
        """Return the table that is printed."""

    def notes(self) -> list[str]:
        """Return lines for below the table."""

    def summary(self) -> Mapping[str, Any]:
        """Return numbers for ``summary.json``; null where undefined.

        What is under ``estimators`` is added to the estimators there, by name.
        """

    def draw(self, folder: Path) -> list[Path]:
        """Draw the figures into a folder and return their paths."""


@dataclass(frozen=True)
class Recorded:
    """What makes a model a recording.

    Attributes
    ----------
    tracks : sequence of str
        Names of the tracks; each is a trial of a study. One: the clock of the model is its own.
    clocks : sequence of Clock
        Where there are several, when each is played; blocks that play them are
        `quietfix.systems.playback.tracks.Tracked`.
    times : sequence of ndarray
        The same epochs in the time of the recording [s].
    report : callable, optional
        ``(result) -> Report``.
    keeps : sequence of str
        What of a result the report needs: ``covariance``, ``measurement``, names of the model's signals.
    bounds : bool
        Whether a bound along the recorded truth means something.
    truth : bool
        Whether anybody knows where the targets were.
    """

    tracks: Sequence[str] = ("recorded",)
    clocks: Sequence[Clock] = ()
    times: Sequence[NDArray[np.float64]] = ()
    report: Callable[[xr.Dataset], Report] | None = None
    keeps: Sequence[str] = ()
    bounds: bool = False
    truth: bool = True

    def __post_init__(self) -> None:
        """Check that names, clocks and times are of the same tracks.

        Raises
        ------
        ValueError
            If they are not.
        """
        several = len(self.clocks) or 1
        if len(self.tracks) != several or len(self.times) != len(self.clocks):
            raise ValueError(
                f"recorded: {len(self.tracks)} tracks with {len(self.clocks)} clocks and {len(self.times)} times are "
                "not allowed; as many of each, or one track that has the clock of the model"
            )
