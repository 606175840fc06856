"""When in a recording each epoch is shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.scenes.stage import step_below

__all__ = ["Timing", "timing_of"]

Array = NDArray[np.float64]

_LONGEST = 25.0  # s of a recording
_MOST_FRAMES = 3000


@dataclass(frozen=True, eq=False)
class Timing:
    """How a recording runs.

    Attributes
    ----------
    start : float
        Time of its first frame [s].
    pace : float
        Seconds that pass in one second of the recording.
    frames_per_second : float
    seconds : list of float
        Of each epoch, in the recording; within the frame that is nearest to it.
    """

    start: float
    pace: float
    frames_per_second: float
    seconds: list[float]


def timing_of(times: Array) -> Timing:
    """Return the timing of epochs (n,), ascending [s].

    A recording has whole frames. One frame is the shortest step between epochs, so that epochs at equal steps have one
    each; where there would be more than 3000, it is longer. It plays in at most 25 s.
    """
    start, length = float(times[0]), float(times[-1] - times[0])
    if length <= 0:
        return Timing(start, 1.0, 1.0, [0.0] * len(times))
    pace = 1 / step_below(_LONGEST / length) if length > _LONGEST else 1.0
    steps = np.diff(times)
    frame = max(float(steps[steps > 0].min()), length / _MOST_FRAMES)
    rate = pace / frame
    # half a frame on, as Meshcat rounds down
    return Timing(start, pace, rate, [float(s) for s in (np.round((times - start) / frame) + 0.25) / rate])
