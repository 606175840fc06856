"""The passes of DopTrack as one stream of samples, and what is left of them at a station."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from quietfix.diagrams.readers.doptrack_data import Pass
from quietfix.diagrams.recorded.settings.doptrack_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef

__all__ = ["Stream", "batch_fix", "misfit", "read_stream", "residual", "start_at"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stream:
    """The samples that are used, of all passes in sequence.

    Attributes
    ----------
    times : ndarray, shape (samples,)
        Since the first sample [s].
    range_rate : ndarray, shape (samples,)
        Range rate plus the oscillator's error [m/s].
    satellite : ndarray, shape (samples, 6)
        Earth-fixed states of the satellite.
    which : ndarray of int, shape (samples,)
        Number of the pass.
    passes : list of Pass
        Those that are used.
    left_out : int
        How many others there are.
    """

    times: Array
    range_rate: Array
    satellite: Array
    which: NDArray[np.int64]
    passes: list[Pass]
    left_out: int


def read_stream(passes: Sequence[Pass], settings: Settings) -> Stream:
    """Return the samples of the passes that the settings take.

    Raises
    ------
    UserError
        If they take none.
    """
    used = [one for one in passes if settings.selection.takes(one)]
    if not used:
        raise UserError("doptrack: the selection takes no pass; lower its elevation, span or samples")
    parts: list[tuple[Array, Array, Array, NDArray[np.int64]]] = []
    for i, one in enumerate(used):
        # The first sample in each interval of `every_s`.
        _, first = np.unique(np.floor(one.times / settings.every_s), return_index=True)
        stamp = (one.start - used[0].start) * 86400.0 + one.times[first] - used[0].times[0]
        parts.append((stamp, one.range_rate[first], one.satellite[first], np.full(first.size, i)))
    times, rates, satellites, which = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Stream(times, rates, satellites, which, used, len(passes) - len(used))


def start_at(passes: Sequence[Pass], settings: Settings) -> Array:
    """Return the start: `offset_km` from the station, at the known altitude."""
    latitude, longitude, height = ecef_to_geodetic(passes[0].station)
    course, angle = np.radians(settings.offset_course_deg), settings.offset_km / 6371.0
    moved = latitude + angle * np.cos(course), longitude + angle * np.sin(course) / np.cos(latitude)
    return geodetic_to_ecef(*moved, height)


def _polynomial(times: Array, order: int) -> Array:
    scaled = (times - times.mean()) / 100.0
    return np.stack([scaled**k for k in range(order)], axis=1)


def misfit(stream: Stream, position: Array) -> Array:
    """Return measured minus predicted range rate at a station [m/s], shape (samples,)."""
    offset = position - stream.satellite[:, :3]
    distance = np.linalg.norm(offset, axis=-1)
    left: Array = stream.range_rate + np.einsum("ki,ki->k", offset, stream.satellite[:, 3:]) / distance
    return left


def residual(stream: Stream, position: Array, order: int, scale: float) -> Array:
    """Return measured minus predicted range rate at a station, after the best oscillator of each pass (robust)."""
    left = misfit(stream, position)
    for i in range(len(stream.passes)):
        rows = stream.which == i
        basis = _polynomial(stream.times[rows], order)
        weight = np.ones(basis.shape[0])
        for _ in range(20):
            fit = np.linalg.lstsq(weight[:, None] * basis, weight * left[rows], rcond=None)[0]
            rest = left[rows] - basis @ fit
            weight = 1 / np.sqrt(1 + (rest / (2 * scale)) ** 2)
        left[rows] = rest
    return left


def batch_fix(passes: Sequence[Pass], order: int, settings: Settings | None = None) -> Array:
    """Return the station by least squares over all samples at once, Earth-fixed [m]: the oracle of the replay.

    Robust (soft L1) in latitude, longitude and height; each pass's oscillator is fitted in closed form at every step.
    """
    settings = settings or Settings()
    stream, sigma = read_stream(passes, settings), settings.sigma_mps[order - 1]
    begin = np.array(ecef_to_geodetic(start_at(stream.passes, settings)))
    altitude = stream.passes[0].altitude
    reach = np.array([1e-3, 1e-3, 100.0])

    def weighted(x: Array) -> Array:
        place = begin + reach * x
        left = residual(stream, geodetic_to_ecef(*place), order, sigma) / sigma
        robust = np.sign(left) * np.sqrt(2 * (np.sqrt(1 + left**2) - 1))
        return np.append(robust, (place[2] - altitude) / settings.sigma_altitude_m)

    found = least_squares(weighted, np.zeros(3), diff_step=1e-4)
    return geodetic_to_ecef(*(begin + reach * found.x))
