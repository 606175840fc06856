"""What recorded values cannot be where the receivers are, and nearly always are by a unit or a clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.fed.played import Played
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["beyond_light"]

Array = NDArray[np.float64]

_LOOKS = 60  # instants at which distances are taken; between them they change little
_SPARE = 1.01
_SIGMAS = 5.0


def beyond_light(
    fed: Played, rows: Sequence[Row], platforms: Mapping[str, int], carriers: Callable[[float], Array]
) -> list[str]:
    r"""Return notes on differences of arrival times that are larger than light needs between two receivers.

    From wherever a signal comes, :math:`c\,|t_i - t_j| \le |p_i - p_j|` (the triangle inequality), but for noise.

    Parameters
    ----------
    fed : Played
    rows : sequence of Row
        Of its values.
    platforms : mapping of str to int
        Number of each platform.
    carriers : callable
        States (6 p,) of all of them at a time [s].
    """
    ticks = fed.clock.ticks(np.inf)
    looks = ticks[:: max(1, len(ticks) // _LOOKS)]
    places = np.array([carriers(float(t)).reshape(-1, 6)[:, :3] for t in looks])
    sigmas = np.sqrt(np.diagonal(fed.noise_covariance))
    notes = []
    for i, row in enumerate(rows):
        if not row.compares_clocks:
            continue
        apart = np.linalg.norm(places[:, platforms[row.receiver]] - places[:, platforms[row.reference]], axis=-1)
        most = float(np.nanmax(apart)) / SPEED_OF_LIGHT
        values = np.concatenate([track.value[:, i] for track in fed.tracks])
        beyond = int((np.abs(values) > _SPARE * most + _SIGMAS * sigmas[i]).sum())
        if beyond:
            of = int(np.isfinite(values).sum())
            notes.append(
                f"{row.name}: {beyond} of {of} values are larger than the {1e6 * most:.4g} us that light takes between "
                "the two; unit, or clocks?"
            )
    return notes
