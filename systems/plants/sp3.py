"""Precise orbits in the Standard Product 3 (SP3-a, SP3-c) format."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from systems.frames import EARTH_RATE, earth_fixed_to_inertial

__all__ = ["PreciseOrbit", "read_sp3"]

Array = NDArray[np.float64]

_ABSENT = 0.0  # a position of zeros is a bad or absent one
_VELOCITY_UNITS = {"dm/s": 0.1, "m/s": 1.0, "km/s": 1e3}
_TIME_SYSTEMS = ("GPS", "UTC", "TAI", "GLO", "GAL", "QZS", "BDT", "IRN")


@dataclass(frozen=True, eq=False)
class PreciseOrbit:
    """One satellite's record.

    Attributes
    ----------
    satellite : str
        Its identification in the file.
    times : ndarray, shape (samples,)
        Seconds since the first epoch, in `time_system`; no leap seconds are in them unless that is UTC.
    states : ndarray, shape (samples, 6)
        Earth-fixed position [m] and velocity [m/s] relative to the Earth; NaN where the file has none.
    first_epoch : datetime
        Of the file, in `time_system`.
    time_system : str
        GPS, TAI, UTC ...
    coordinate_system : str
        As in the header: ITR05, IGS14 ...
    velocity_unit : str
        In which the file's velocities really are. The standard says dm/s; some files have m/s.
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
        return times, earth_fixed_to_inertial(self.states[kept], times, earth_rate)


def read_sp3(path: Path | str, satellite: str | None = None) -> PreciseOrbit:
    """Read one satellite from an SP3 file.

    Parameters
    ----------
    path : path
        The file.
    satellite : str, optional
        Identification, such as L27; not needed where the file has one satellite only.

    Returns
    -------
    PreciseOrbit

    Raises
    ------
    ValueError
        For a file that is no SP3, ends in the middle, has an epoch twice or out of order, does not hold the satellite,
        or whose velocities fit the positions in no known unit.

    Notes
    -----
    Positions are in km. The unit of the velocities is found by holding them against central differences of the
    positions.
    """
    path = Path(path)
    lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    if not lines or not lines[0].startswith("#") or len(lines[0]) < 60 or lines[0][1] not in "abcd":
        raise ValueError(f"{path.name}: not an SP3 file: the first line must begin with #a, #b, #c or #d")
    try:
        expected = int(lines[0][32:39])
    except ValueError as error:
        raise ValueError(f"{path.name}: the number of epochs cannot be read from {lines[0]!r}") from error
    has_velocity = lines[0][2] == "V"
    satellites = _satellites(lines)
    if satellite is None and len(satellites) == 1:
        satellite = satellites[0]
    if satellite not in satellites:
        raise ValueError(f"{path.name}: satellite {satellite} is not in it; there are {', '.join(satellites)}")
    system = next((line[9:12] for line in lines if line.startswith("%c")), "ccc")
    if system not in _TIME_SYSTEMS:
        system = "GPS"  # SP3-a names none, and means GPS

    epochs, states, ended = _records(path, lines, satellite)
    if not ended or len(epochs) != expected:
        raise ValueError(
            f"{path.name}: it ends in the middle: {len(epochs)} of {expected} epochs"
            f"{'' if ended else ', and no EOF line'}"
        )
    times = np.array([(epoch - epochs[0]).total_seconds() for epoch in epochs])
    repeated = np.flatnonzero(np.diff(times) <= 0)
    if repeated.size:
        at = int(repeated[0]) + 1
        raise ValueError(
            f"{path.name}: epoch {at + 1}, {epochs[at]}, does not come after the one before, {epochs[at - 1]}"
        )
    unit = "none"
    if has_velocity:
        unit = _velocity_unit(path, times, states)
        states[:, 3:] *= _VELOCITY_UNITS[unit]
    else:
        states[:, 3:] = np.gradient(states[:, :3], times, axis=0, edge_order=2)
    return PreciseOrbit(satellite, times, states, epochs[0], system, lines[0][46:51].strip(), unit)


def _satellites(lines: list[str]) -> list[str]:
    found: list[str] = []
    for line in lines:
        if line.startswith("+ "):
            fields = [line[9 + 3 * i : 12 + 3 * i].strip() for i in range(17)]
            found += [field for field in fields if field not in ("", "0")]
    return found


def _records(path: Path, lines: list[str], satellite: str) -> tuple[list[datetime], Array, bool]:
    """Return epochs, states (position [m], velocity as in the file) and whether the file has its last line."""
    epochs: list[datetime] = []
    states: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if line.startswith("EOF"):
            return epochs, np.array(states).reshape(-1, 6), True
        try:
            if line.startswith("* "):
                year, month, day, hour, minute = (int(part) for part in line[1:20].split())
                epochs.append(datetime(year, month, day, hour, minute) + timedelta(seconds=float(line[20:31])))
                states.append([np.nan] * 6)
            elif line[:1] in "PV" and line[1:4].strip() == satellite and line[:1]:
                values = [float(line[4 + 14 * i : 18 + 14 * i]) for i in range(3)]
                if line[0] == "P":
                    states[-1][:3] = [1e3 * value if any(v != _ABSENT for v in values) else np.nan for value in values]
                else:
                    states[-1][3:] = values
        except (ValueError, IndexError) as error:
            raise ValueError(f"{path.name}: line {number} cannot be read: {line!r}") from error
    return epochs, np.array(states).reshape(-1, 6), False


def _velocity_unit(path: Path, times: Array, states: Array) -> str:
    """Return the unit in which the velocities agree with differences of the positions."""
    if len(times) < 3:
        raise ValueError(f"{path.name}: {len(times)} epochs are too few to tell the unit of the velocities")
    span = (times[2:] - times[:-2])[:, None]
    moved = np.linalg.norm((states[2:, :3] - states[:-2, :3]) / span, axis=-1)
    written = np.linalg.norm(states[1:-1, 3:], axis=-1)
    ratio = np.nanmedian(moved / written)
    for unit, factor in _VELOCITY_UNITS.items():
        if abs(ratio / factor - 1) < 0.1:
            return unit
    raise ValueError(
        f"{path.name}: velocities and positions do not fit: their ratio is {ratio:g}, where dm/s gives 0.1 and m/s 1"
    )
