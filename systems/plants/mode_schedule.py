"""When a rocket's transponder is locked, station by station."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock

__all__ = ["ModeSchedule"]

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # s; a sample meant for the instant of a switch may be an ulp early


class ModeSchedule(EnsembleBlock):
    """Port ``mode`` (1, stations): 0 where a station receives the beacon, 1 where it receives the transponder.

    Parameters
    ----------
    windows : sequence of (float, float)
        From when to when the transponder is locked [s]; they must not overlap.
    delays : array_like, shape (stations,)
        How much later than the rocket each station switches [s], >= 0.
    stations : sequence of str, optional
        Their names.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        windows: Sequence[tuple[float, float]],
        delays: ArrayLike,
        stations: Sequence[str] | None = None,
        name: str = "mode",
    ) -> None:
        super().__init__(name)
        ends = np.array(windows, dtype=float).reshape(-1, 2)
        for i, (begin, end) in enumerate(ends):
            if not (np.isfinite(begin) and end > begin):
                raise ValueError(f"transponder window {i}: {begin:g} to {end:g} s is not allowed; it must end later")
        if np.any(ends[1:, 0] <= ends[:-1, 1]):
            raise ValueError("transponder windows: they must follow one another without overlap")
        self._delays = np.array(delays, dtype=float)
        if self._delays.ndim != 1 or not np.all(np.isfinite(self._delays)) or np.any(self._delays < 0):
            raise ValueError(f"mode delays: {self._delays.tolist()} is not allowed; one number >= 0 s per station")
        self._ends = ends
        named = None if stations is None else [(station, "1") for station in stations]
        self.declare_output("mode", 1, self._delays.size, self._mode, {self.time_ticket()}, named)

    def _mode(self, context: Context) -> Array:
        time = context.get_time() - self._delays[:, None] + _ROUNDING
        locked = (time >= self._ends[:, 0]) & (time < self._ends[:, 1])
        return locked.any(axis=-1).astype(float)[None]
