"""What a station would receive of a satellite that two-line elements tell of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.doppler.elements import UNIX_EPOCH
from quietfix.systems.constants import EARTH_MU, EARTH_RATE, SPEED_OF_LIGHT
from quietfix.systems.earth.celestial import equinox_to_earth_fixed
from quietfix.systems.earth.frames import earth_fixed_to_inertial
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation

__all__ = ["elevations", "satellite_path", "shifts_of"]

Array = NDArray[np.float64]

_DAY = 86400


def satellite_path(satellite: Any, second: int, rest: float, times: Array, ahead: float = 0.0) -> Array | None:
    """Return inertial states (k, 6) of a satellite by SGP4, in the axes that are Earth-fixed at each of the times.

    UTC stands for UT1, and the pole is at the pole, as in `quietfix.diagrams.readers.doptrack_data`.

    Parameters
    ----------
    satellite : sgp4.api.Satrec
    second, rest : int, float
        Seconds since 1970, UTC without leap seconds, that times begin at.
    times : ndarray, shape (k,)
        [s]
    ahead : float
        How far it is ahead of its elements along its orbit [s]; the Earth is not.

    Returns
    -------
    ndarray, shape (k, 6), or None
        None: SGP4 fails.
    """
    day, part = divmod(second, _DAY)
    julian = np.full(times.size, UNIX_EPOCH + day)
    code, position, velocity = satellite.sgp4_array(julian, (part + rest + times + ahead) / _DAY)
    states = 1e3 * np.concatenate([position, velocity], axis=-1)
    if np.any(code) or not np.isfinite(states).all():
        return None
    whole = np.floor(rest + times).astype(np.int64)
    fixed = equinox_to_earth_fixed(states, second + whole, rest + times - whole)
    return earth_fixed_to_inertial(fixed, 0.0)


def shifts_of(states: Array, station: Array) -> Array:
    r"""Return the range rates that a station would take received frequencies for, :math:`c (1 - f/f_0)` [m/s], (k,).

    Both move in inertial axes, and the wave left the satellite :math:`\tau` before, its distance then over c:

    .. math:: f/f_0 = (1 + n \cdot v_r/c) / (1 + n \cdot v_s/c)

    with n from the station to the satellite. The satellite falls freely through :math:`\tau`. Time dilation is left
    out: at most 0.2 m/s, and constant, so that the oscillator's bias takes it.
    """
    position, velocity = states[:, :3], states[:, 3:]
    distance = np.linalg.norm(position, axis=-1, keepdims=True)
    fall = -EARTH_MU / distance**3 * position
    place = station[:3]
    late = np.linalg.norm(position - place, axis=-1, keepdims=True) / SPEED_OF_LIGHT
    for _ in range(2):  # each step leaves v/c of the error before
        then = position - late * velocity + 0.5 * late**2 * fall
        line = then - place
        late = np.linalg.norm(line, axis=-1, keepdims=True) / SPEED_OF_LIGHT
    n = line / (SPEED_OF_LIGHT * late)
    own = np.array([-EARTH_RATE * place[1], EARTH_RATE * place[0], 0.0])
    up, away = n @ own, np.einsum("ki,ki->k", n, velocity - late * fall)
    return (away - up) / (1 + away / SPEED_OF_LIGHT)


def elevations(states: Array, station: Array) -> Array:
    """Return elevations over the horizon of a station, without refraction [rad], shape (k,)."""
    latitude, longitude, _ = (float(one) for one in ecef_to_geodetic(station[:3]))
    line = states[:, :3] - station[:3]
    up = enu_rotation(latitude, longitude)[2]
    return np.arcsin(line @ up / np.linalg.norm(line, axis=-1))
