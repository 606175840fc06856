"""Errors of estimates against the positions that aircraft report themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.locards_data import AircraftTrack
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef

__all__ = ["METHODS", "Scores", "headings", "score"]

Array = NDArray[np.float64]

METHODS = ("gate", "no_gate")
_MANY = 5  # messages of an aircraft
_NEAR, _FAR = 2.0, 60.0  # s; between them another position tells the course
_SLOWEST = 30.0  # m/s


@dataclass(frozen=True)
class Scores:
    """Errors, message by message.

    Attributes
    ----------
    error : ndarray, shape (estimates, messages, trials, 2)
        East and north error of each, such as the two `METHODS` [m]; NaN where there is no fix.
    heading : ndarray, shape (messages, 2)
        Unit vector of the course (east, north); NaN where no other position is near enough in time.
    excluded : ndarray, shape (messages, trials)
        What the gate left out, see `ArrivalGate`.
    place : ndarray, shape (messages, 2)
        Latitude and longitude that the aircraft reported [rad].
    known : ndarray of bool, shape (messages,)
        Whether the aircraft has reported a position.
    size : ndarray of int, shape (messages,)
        Messages of the same aircraft in the set.
    fix : ndarray, shape (messages, 2)
        Latitude and longitude of the first estimate, as recorded [rad]; NaN where there is none.
    sigma : ndarray, shape (messages, trials)
        What was believed of a time difference, as a length [m].
    """

    error: Array
    heading: Array
    excluded: Array
    place: Array
    known: NDArray[np.bool_]
    size: NDArray[np.int_]
    fix: Array
    sigma: Array

    @staticmethod
    def join(parts: Sequence[Scores]) -> Scores:
        """Return the messages of several scores together."""
        axes = {"error": 1}
        return Scores(
            **{
                field.name: np.concatenate([getattr(part, field.name) for part in parts], axis=axes.get(field.name, 0))
                for field in fields(Scores)
            }
        )

    @property
    def horizontal(self) -> Array:
        """Horizontal error [m], shape (estimates, messages, trials)."""
        return np.hypot(self.error[..., 0], self.error[..., 1])

    @property
    def along(self) -> Array:
        """Error along the course [m], ahead positive, shape (estimates, messages, trials)."""
        return np.einsum("kmti,mi->kmt", self.error, self.heading)

    @property
    def across(self) -> Array:
        """Error across the course [m], to the right positive, shape (estimates, messages, trials)."""
        right = np.stack([self.heading[:, 1], -self.heading[:, 0]], axis=-1)
        return np.einsum("kmti,mi->kmt", self.error, right)

    @property
    def many(self) -> NDArray[np.bool_]:
        """Which messages are of aircraft with at least five."""
        return self.size >= _MANY

    def summary(
        self, trial: int, which: NDArray[np.bool_] | None = None, methods: Sequence[str] = METHODS
    ) -> dict[str, Any]:
        """Return counts, shares and percentiles of some messages in one trial; null where there are none.

        Parameters
        ----------
        trial : int
            0 as recorded, 1 with faults.
        which : ndarray of bool, shape (messages,), optional
            All, if not given.
        methods : sequence of str
            Names of the estimates.
        """
        chosen = self.known if which is None else self.known & which
        result: dict[str, Any] = {"messages": int(np.count_nonzero(chosen))}
        for k, method in enumerate(methods):
            error = self.horizontal[k, chosen, trial]
            found = error[np.isfinite(error)]
            result[method] = {
                "share_with_fix": found.size / error.size if error.size else None,
                **{f"p{p}_m": float(np.percentile(found, p)) if found.size else None for p in (50, 90, 95, 99)},
            }
        return result


def headings(track: AircraftTrack) -> Array:
    """Return the course of an aircraft at each of its messages, from the position it reports at another one.

    Parameters
    ----------
    track : AircraftTrack

    Returns
    -------
    ndarray, shape (messages, 2)
        Unit vector (east, north); of the other positions between 2 and 60 s away, the nearest in time serves.
    """
    place = geodetic_to_ecef(*track.reported.T)
    elapsed = track.times[None, :] - track.times[:, None]
    usable = (np.abs(elapsed) >= _NEAR) & (np.abs(elapsed) <= _FAR) & np.isfinite(place).all(axis=-1)
    nearest = np.argmin(np.where(usable, np.abs(elapsed), np.inf), axis=1)
    rows = np.arange(len(track.times))
    to_local = enu_rotation(track.reported[:, 0], track.reported[:, 1])
    dt = np.where(usable[rows, nearest], elapsed[rows, nearest], np.nan)
    velocity = np.einsum("mij,mj->mi", to_local, place[nearest] - place)[:, :2] / dt[:, None]
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    return np.where(speed >= _SLOWEST, velocity / np.maximum(speed, _SLOWEST), np.nan)


def score(track: AircraftTrack, size: int, estimates: Array, excluded: Array, sigma: Array) -> Scores:
    """Compare estimates with the reported positions.

    Parameters
    ----------
    track : AircraftTrack
        The messages.
    size : int
        Messages of the aircraft in the whole set.
    estimates : ndarray, shape (estimates, messages, trials, 3)
        Earth-fixed positions; NaN where there is no fix.
    excluded : ndarray, shape (messages, trials)
        What the gate left out.
    sigma : ndarray, shape (trials,)
        What was believed of a time difference [m].
    """
    latitude, longitude, height = track.reported.T
    # the height only carries the vertical part of the error, which is not looked at
    place = geodetic_to_ecef(latitude, longitude, np.where(np.isfinite(height), height, track.altitude))
    local = np.einsum("mij,kmtj->kmti", enu_rotation(latitude, longitude), estimates - place[:, None])
    known = np.all(np.isfinite(place), axis=-1)
    messages = len(track.times)
    return Scores(
        local[..., :2],
        headings(track),
        excluded,
        track.reported[:, :2],
        known,
        np.full(messages, size),
        np.stack(ecef_to_geodetic(estimates[0, :, 0])[:2], axis=-1),
        np.broadcast_to(sigma, (messages, *sigma.shape)),
    )
