"""Two-line elements of objects of one's own, and what a station receives of one of them: by a way of its own."""

import numpy as np
from sgp4.api import Satrec

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_to_ecef

STATION = (48.1, 11.6, 520.0)
START = 1_583_100_000  # 2020-03-01T22:00:00Z
CARRIER = 437.2e6
_TURN = 7.292115e-5


def checked(line):
    """A line with its check sum."""
    return line + str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)


def lines_of(number, node=0.0, anomaly=0.0, inclination=97.5, motion=15.21, epoch="20061.50000000"):
    """Two lines of a low orbit; epoch 2020-03-01T12:00:00Z."""
    shape = f"{node % 360:8.4f} 0010000 240.0000 {anomaly % 360:8.4f}"
    return (
        checked(f"1 {number:05d}U 18004A   {epoch}  .00000500  00000-0  25000-4 0  999"),
        checked(f"2 {number:05d} {inclination:8.4f} {shape} {motion:11.8f}00001"),
    )


def _sidereal(seconds):
    """Greenwich mean sidereal time [rad], IAU 1982, of seconds since 1970."""
    days = seconds / 86400.0 + 2440587.5 - 2451545.0
    century = np.floor(days + 0.5) - 0.5
    t = century / 36525.0
    at_midnight = 24110.54841 + 8640184.812866 * t + 0.093104 * t**2 - 6.2e-6 * t**3
    return 2 * np.pi * ((at_midnight + 1.00273790935 * 86400.0 * (days - century)) / 86400.0 % 1.0)


def _places(lines, seconds):
    """Positions in TEME [m] of seconds since 1970."""
    satellite = Satrec.twoline2rv(*lines)
    day = np.floor(seconds / 86400.0)
    return 1e3 * satellite.sgp4_array(2440587.5 + day, seconds / 86400.0 - day)[1]


def path_length(lines, times, ahead=0.0, station=STATION):
    """Length of the way of light that arrives at these times after START [m]."""
    place = geodetic_to_ecef(np.radians(station[0]), np.radians(station[1]), station[2])
    angle = _sidereal(START + times)
    c, s = np.cos(angle), np.sin(angle)
    heard_at = np.stack([c * place[0] - s * place[1], s * place[0] + c * place[1], np.full_like(c, place[2])], axis=1)
    way = np.zeros_like(times)
    for _ in range(4):
        way = np.linalg.norm(_places(lines, START + times + ahead - way / SPEED_OF_LIGHT) - heard_at, axis=1)
    return way


def range_rates(lines, times, ahead=0.0, station=STATION):
    """Rate of that way [m/s]: f / f0 is the rate of the time of emission, 1 - rate / c."""
    return (path_length(lines, times + 0.5, ahead, station) - path_length(lines, times - 0.5, ahead, station)) / 1.0


def received(lines, times, noise=5.0, bias=400.0, drift=0.3, ahead=0.0, seed=0):
    """Frequencies less the carrier [Hz]; noise in m/s, an oscillator's bias [m/s] and drift [m/s^2]."""
    rate = range_rates(lines, times, ahead) + bias + drift * (times - times.mean())
    return -CARRIER / SPEED_OF_LIGHT * (rate + noise * np.random.default_rng(seed).standard_normal(times.size))
