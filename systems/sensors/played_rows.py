"""Rows of a table of measurements in the place of sensors: whatever was measured at a tick, the others missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Times
from quietfix.systems.playback.tracks import Tracked

__all__ = ["PlayedRows", "TableTrack"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TableTrack:
    """What was measured of one target.

    Attributes
    ----------
    clock : Times
        When anything was.
    value : ndarray, shape (ticks, rows)
        SI units; NaN where a row is missing.
    scale : ndarray, shape (ticks, rows), or None
        Standard deviation of each over the one that the estimators believe in; None: all are 1.
    arrival : ndarray, shape (ticks, rows), or None
        When each came, if the table is in the order in which they did [s]; infinite where a row is missing.
    """

    clock: Times
    value: Array
    scale: Array | None = None
    arrival: Array | None = None


class PlayedRows(Tracked):
    r"""A block that plays tables of rows; port ``measurement`` (1, rows), and ``noise_covariance`` where it is scaled.

    With D the diagonal matrix of the scales of a tick the noise is :math:`D R D`: each row has the standard deviation
    that the table says, and correlations stay.

    Parameters
    ----------
    tracks : sequence of TableTrack
        Of one target each; all or none have scales.
    noise_covariance : ndarray, shape (rows, rows)
        R, where no scale says anything else.
    name : str
        Name of the block.
    """

    def __init__(self, tracks: Sequence[TableTrack], noise_covariance: Array, name: str = "recorded") -> None:
        super().__init__(name, [track.clock for track in tracks])
        self._rows = list(tracks)
        self._noise = np.array(noise_covariance, dtype=float)
        size = len(self._noise)
        self._gap = np.full((1, size), np.nan)
        self.declare_output("measurement", 1, size, self._measurement, self.track_tickets)
        if any(track.scale is not None for track in tracks):
            self.declare_output("noise_covariance", 1, size * size, self._covariance, self.track_tickets)

    def _measurement(self, context: Context) -> Array:
        track, tick = self.playing(context)
        return self._gap if tick is None else self._rows[track].value[tick][None]

    def _covariance(self, context: Context) -> Array:
        track, tick = self.playing(context)
        scale = self._rows[track].scale
        noise = self._noise
        if tick is not None and scale is not None:
            noise = scale[tick][:, None] * noise * scale[tick]
        return noise.reshape(1, -1)
