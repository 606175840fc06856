"""Precise orbits in the Standard Product 3 (SP3-a, SP3-c) format."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.frames import earth_fixed_to_inertial, inertial_to_earth_fixed
from quietfix.systems.files import read_text
from quietfix.systems.plants.recorded import hermite
from quietfix.systems.plants.sp3_records import Records, elapsed, read_records
from quietfix.systems.trajectories.polynomial import ORBIT_ORDER, polynomial_states

__all__ = ["PreciseOrbit", "read_sp3"]

Array = NDArray[np.float64]

_LARGEST_FILE = 64_000_000  # bytes; 32 satellites for a week at 30 s
_VELOCITY_UNITS = {"dm/s": 0.1, "m/s": 1.0, "km/s": 1e3}
_TIME_SYSTEMS = ("GPS", "UTC", "TAI", "GLO", "GAL", "QZS", "BDT", "IRN")
_FEWEST = 10  # positions in a row that give velocities: order 9
_KNOWN = 0.1  # m/s, a velocity from positions that may be worse than this is not given
_OFF = 1.0  # m/s between a velocity in the file and the positions around it: more is a mistake
_GAP = 1.5  # of the median step
_COARSE, _FINE = 0.5, 0.01  # m, error of a cubic spline between samples: the most, and what samples between leave


@dataclass(frozen=True, eq=False)
class PreciseOrbit:
    """One satellite's record.

    Attributes
    ----------
    satellite : str
        Its identification in the file.
    times : ndarray, shape (samples,)
        Seconds since the first epoch; leap seconds that the file passes are counted.
    states : ndarray, shape (samples, 6)
        Earth-fixed position [m] and velocity [m/s] relative to the Earth; NaN where the file has none. Velocities
        that the file does not have are those of polynomials through its positions; see `read_sp3`.
    first_epoch : datetime
        Of the file, in `time_system`.
    time_system : str
        GPS, TAI, UTC ...
    coordinate_system : str
        As in the header: ITR05, IGS14 ...
    velocity_unit : str
        In which the file's velocities really are; "none": it has none. The standard says dm/s; some files have m/s.
    """

    satellite: str
    times: Array
    states: Array
    first_epoch: datetime
    time_system: str
    coordinate_system: str
    velocity_unit: str

    def inertial(self, start: float = 0.0, earth_rate: float = EARTH_RATE) -> tuple[Array, Array]:
        """Return times [s] since `start` and inertial states (samples, 6) from then on.

        The axes are Earth-fixed at `start`; the Earth turns about its z-axis at a constant rate (precession and
        nutation turn the pole by less than 0.3 arcseconds in a day, 10 m at 7700 km, and are left out).

        A cubic Hermite spline through what is returned is within 0.5 m of the orbit: where the file's own epochs are
        too far apart for that (GPS at 900 s: 20 m), epochs between them are filled in from polynomials. A NaN stands
        in every gap, and where polynomials of order 10 and 8 are 0.5 m apart.

        Raises
        ------
        ValueError
            If fewer than two samples are left.
        """
        kept = self.times >= start
        if np.count_nonzero(kept) < 2:
            raise ValueError(
                f"start of the recorded orbit: {start:g} s is not allowed; the record is {self.times[-1]:g} s long"
            )
        times = self.times[kept] - start
        return _fill_in(times, earth_fixed_to_inertial(self.states[kept], times, earth_rate))


def _gap(times: Array) -> float:
    """Return the longest step between samples that is none [s]."""
    return _GAP * float(np.median(np.diff(times))) if times.size > 1 else 0.0


def _fill_in(times: Array, states: Array) -> tuple[Array, Array]:
    """Add samples where a cubic Hermite spline needs them, and a NaN in each gap."""
    middles, steps = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    longest = _gap(times)
    gap = steps > longest
    exact = polynomial_states(times, states[:, :3], middles, longest_step=longest)
    spline = np.array([hermite(times, states, middle)[0][:3] for middle in middles])
    off = np.linalg.norm(spline - exact[:, :3], axis=-1)[~gap]
    worst = float(np.max(off[np.isfinite(off)], initial=0.0))
    more, filled = middles[gap], np.full((np.count_nonzero(gap), 6), np.nan)
    if worst > _COARSE:
        parts = int(np.ceil((worst / _FINE) ** 0.25))  # the spline's error falls with the fourth power of the step
        share = np.arange(1, parts) / parts
        between = (times[:-1, None] + share * steps[:, None])[~gap].ravel()
        more = np.concatenate([more, between])
        more_states = polynomial_states(times, states[:, :3], between, longest_step=longest)
        lower = polynomial_states(times, states[:, :3], between, ORBIT_ORDER - 2, longest_step=longest)
        more_states[np.linalg.norm((more_states - lower)[:, :3], axis=-1) > _COARSE] = np.nan
        filled = np.concatenate([filled, more_states])
    if not more.size:
        return times, states
    order = np.argsort(all_times := np.concatenate([times, more]))
    return all_times[order], np.concatenate([states, filled])[order]


def read_sp3(path: Path | str, satellite: str | None = None) -> PreciseOrbit:
    """Read one satellite from an SP3 file.

    Parameters
    ----------
    path : path
        The file.
    satellite : str, optional
        Identification, such as L27, or G05 (in SP3-a: 5); not needed where the file has one satellite only.

    Returns
    -------
    PreciseOrbit

    Raises
    ------
    ValueError
        For a file that is no SP3, ends in the middle, has an epoch twice or out of order, does not hold the satellite,
        whose velocities fit the positions in no known unit or at some epoch not at all, or that has neither velocities
        nor ten positions in a row.

    Notes
    -----
    Positions are in km. The unit of the velocities is found by holding them against central differences of the
    positions.

    A velocity that is not in the file is that of the polynomial of order 10 through the nearest positions, in axes
    that do not turn. Against the velocities of files that have them: Jason-2 at 60 s 0.3 mm/s at most and 0.6 mm/s at
    the ends of the record, at 180 s 0.4 and 3.4 mm/s; LAGEOS-2 at 120 s 0.1 and 0.5 mm/s. GPS at 900 s is within
    0.2 mm/s, at the ends 3 mm/s, of free fall with J2 through the neighbouring positions, which neglects the Moon. The
    polynomial of order 8 says how well the velocity is known: where the two differ by more than 0.1 m/s (a low orbit
    at 600 s, a manoeuvre) it is NaN.
    """
    path = Path(path)
    lines = read_text(path, _LARGEST_FILE, encoding="ascii", errors="replace").splitlines()
    if not lines or not lines[0].startswith("#") or len(lines[0]) < 60 or lines[0][1] not in "abcd":
        raise ValueError(f"{path.name}: not an SP3 file: the first line must begin with #a, #b, #c or #d")
    try:
        expected = int(lines[0][32:39])
    except ValueError as error:
        raise ValueError(f"{path.name}: the number of epochs cannot be read from {lines[0][:80]!r}") from error
    satellites = {_identification(own): own for own in _satellites(lines)}
    named = _identification(satellite) if satellite else next(iter(satellites), "") if len(satellites) == 1 else ""
    if named not in satellites:
        there = f"there are {', '.join(satellites)}"
        raise ValueError(f"{path.name}: satellite {satellite or 'not named'} is not in it; {there}")
    system = next((line[9:12] for line in lines if line.startswith("%c")), "ccc")
    if system not in _TIME_SYSTEMS:
        system = "GPS"  # SP3-a names none, and means GPS

    records = read_records(path, lines, satellites[named], expected)
    times = elapsed(records.epochs, system)
    states, unit = _states(path, times, records)
    return PreciseOrbit(named, times, states, records.epochs[0], system, lines[0][46:51].strip(), unit)


def _satellites(lines: list[str]) -> list[str]:
    found: list[str] = []
    for line in lines:
        if line.startswith("+ "):
            fields = [line[9 + 3 * i : 12 + 3 * i].strip() for i in range(17)]
            found += [field for field in fields if field not in ("", "0")]
    return found


def _identification(satellite: str) -> str:
    """Return the three characters of SP3-c; SP3-a has numbers, of GPS satellites."""
    return f"G{int(satellite):02d}" if satellite.isdecimal() else satellite


def _states(path: Path, times: Array, records: Records) -> tuple[Array, str]:
    """Return Earth-fixed states and the unit of the velocities in the file, or "none"."""
    written, unit = records.velocities, "none"
    if np.isfinite(written).any():
        unit = _velocity_unit(path, times, records.positions, written)
        written = _VELOCITY_UNITS[unit] * written
    known, doubt = _from_positions(times, records.positions)
    off = np.linalg.norm(written - known, axis=-1) - 10 * doubt
    if np.any(off > _OFF):
        at = int(np.nanargmax(off))
        raise ValueError(
            f"{path.name}: epoch {at + 1}, {records.epochs[at]}: its velocity is {off[at]:.3g} m/s off what the "
            "positions around it say"
        )
    trusted = np.where((doubt <= _KNOWN)[:, None], known, np.nan)
    velocity = np.where(np.isfinite(written), written, trusted)
    if not np.isfinite(velocity).any():
        raise ValueError(
            f"{path.name}: it has no velocities, and its positions give none to {_KNOWN:g} m/s: at least {_FEWEST} in "
            "a row are needed, close enough together"
        )
    return np.concatenate([records.positions, velocity], axis=-1), unit


def _from_positions(times: Array, positions: Array) -> tuple[Array, Array]:
    """Return Earth-fixed velocities, and how far those of the next lower even order are from them [m/s]."""
    fixed = np.concatenate([positions, np.zeros_like(positions)], axis=-1)
    places = earth_fixed_to_inertial(fixed, times)[:, :3]  # in axes that do not turn there are fewer frequencies
    longest = _gap(times)
    found = polynomial_states(times, places, times, ORBIT_ORDER, _FEWEST, longest)
    lower = polynomial_states(times, places, times, ORBIT_ORDER - 2, longest_step=longest)
    return inertial_to_earth_fixed(found, times)[:, 3:], np.linalg.norm((found - lower)[:, 3:], axis=-1)


def _velocity_unit(path: Path, times: Array, positions: Array, written: Array) -> str:
    """Return the unit in which the velocities agree with differences of the positions."""
    moved = np.linalg.norm((positions[2:] - positions[:-2]) / (times[2:] - times[:-2])[:, None], axis=-1)
    ratios = moved / np.linalg.norm(written[1:-1], axis=-1)
    ratios = ratios[np.isfinite(ratios)]
    if not ratios.size:
        raise ValueError(f"{path.name}: {len(times)} epochs are too few to tell the unit of the velocities")
    ratio = np.median(ratios)
    for unit, factor in _VELOCITY_UNITS.items():
        if abs(ratio / factor - 1) < 0.1:
            return unit
    raise ValueError(
        f"{path.name}: velocities and positions do not fit: their ratio is {ratio:g}, where dm/s gives 0.1 and m/s 1"
    )
