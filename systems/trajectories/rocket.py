"""A rocket of several stages in a launch frame that turns with a spherical Earth: equations of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from quietfix.systems.constants import EARTH_MU, EARTH_RATE

__all__ = ["LaunchSite", "RocketModel", "Stage"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LaunchSite:
    """Launch frame: origin at the site on a sphere, X down-range, Y up, Z = X x Y; it turns with the Earth.

    Parameters
    ----------
    latitude, longitude : float
        Of the site [rad].
    azimuth : float
        Of X, clockwise from north [rad].
    radius : float
        Of the Earth [m], > 0.
    earth_rate : float
        Rotation of the Earth [rad/s].
    """

    latitude: float
    longitude: float
    azimuth: float
    radius: float = 6371e3
    earth_rate: float = EARTH_RATE

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise ValueError(f"earth radius: {self.radius} is not allowed; it must be > 0 m")
        for name in ("latitude", "longitude", "azimuth", "earth_rate"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"launch site {name}: {getattr(self, name)} is not allowed; a finite number")
        if abs(self.latitude) > math.pi / 2:
            raise ValueError(f"launch site latitude: {math.degrees(self.latitude):g} deg is not allowed; -90 to 90")

    @property
    def axes(self) -> Array:
        """Rows X, Y, Z in Earth-fixed (equatorial) axes, shape (3, 3)."""
        sla, cla = math.sin(self.latitude), math.cos(self.latitude)
        slo, clo = math.sin(self.longitude), math.cos(self.longitude)
        east = np.array([-slo, clo, 0.0])
        north = np.array([-sla * clo, -sla * slo, cla])
        up = np.array([cla * clo, cla * slo, sla])
        ahead = math.cos(self.azimuth) * north + math.sin(self.azimuth) * east
        return np.stack([ahead, up, np.cross(ahead, up)])

    @property
    def centre(self) -> Array:
        """Centre of the Earth in the launch frame [m]."""
        return np.array([0.0, -self.radius, 0.0])

    @property
    def rotation(self) -> Array:
        """Rotation vector of the Earth in the launch frame [rad/s]."""
        return self.earth_rate * self.axes[:, 2]

    def from_geodetic(self, latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
        """Return launch-frame positions [m], shape (..., 3), of places on the sphere [rad, rad, m]."""
        lat, lon, h = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (latitude, longitude, height)))
        up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
        return np.einsum("ij,...j->...i", self.axes, (self.radius + h)[..., None] * up) + self.centre

    def from_track(self, down: ArrayLike, cross: ArrayLike, height: ArrayLike) -> Array:
        """Return launch-frame positions [m], shape (..., 3).

        Parameters
        ----------
        down : array_like
            Distance along the great circle of the launch azimuth [m].
        cross : array_like
            Distance along the great circle across it, towards +Z [m].
        height : array_like
            Above the sphere [m].
        """
        a, b, h = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (down, cross, height)))
        a, b = a / self.radius, b / self.radius
        up = np.stack([np.sin(a) * np.cos(b), np.cos(a) * np.cos(b), np.sin(b)], axis=-1)
        return (self.radius + h)[..., None] * up + self.centre

    def height(self, position: Array) -> Array:
        """Return the height above the sphere [m] of launch-frame positions (..., 3)."""
        return np.linalg.norm(position - self.centre, axis=-1) - self.radius


@dataclass(frozen=True)
class Stage:
    """One stage.

    Parameters
    ----------
    dry_mass, propellant : float
        [kg], > 0.
    thrust : float
        In vacuum [N], > 0.
    mass_flow : float
        At full thrust [kg/s], > 0.
    ignition, cutoff : float
        When the thrust begins to rise and to fall [s]; an infinite cut-off means when the propellant is used up.
    nozzle_area : float
        Pressure loss is this times the air pressure [m^2].
    """

    dry_mass: float
    propellant: float
    thrust: float
    mass_flow: float
    ignition: float
    cutoff: float = math.inf
    nozzle_area: float = 0.0


@dataclass(frozen=True, eq=False)
class RocketModel:
    r"""Equations of motion in the launch frame.

    .. math:: \dot v = \frac{(F - pA_e)\,u}{m} - \frac{\rho v c_d A}{2m} V - \frac{\mu d}{|d|^3}
              - 2\,\omega\times v - \omega\times(\omega\times d), \quad d = r - (0, -R, 0)

    Exponential atmosphere at rest in the launch frame; :math:`c_d = 0.3 + 0.35\,e^{-((v/300 - 1.1)/0.35)^2}`. The
    thrust points along a program of pitch (above the X-Z plane) and yaw (from X towards -Z).

    Parameters
    ----------
    site : LaunchSite
    stages : sequence of Stage
        In the order of their burning.
    payload, fairing : float
        [kg].
    fairing_drop : float
        When the fairing is dropped [s].
    pitch_times, pitch : array_like, shape (knots,)
        [s] and [rad]; in between by monotone cubic (PCHIP) interpolation.
    yaw : float
        Final yaw [rad]; it is turned in linearly from 12 s to 42 s.
    reference_area : float
        A [m^2].
    ramp : float
        The thrust rises from ignition and falls from cut-off within this time [s]; the first stage is held down
        until its thrust is full.
    separation : float
        A burnt-out stage is dropped this long after cut-off [s].
    mu, sea_level_density, density_scale, sea_level_pressure, pressure_scale : float
        [m^3/s^2], [kg/m^3], [m], [Pa], [m].

    Raises
    ------
    ValueError
        For stages that overlap, masses or thrusts that are not positive, more propellant burnt than there is, a
        rocket that does not lift off.
    """

    site: LaunchSite
    stages: Sequence[Stage]
    payload: float
    fairing: float
    fairing_drop: float
    pitch_times: ArrayLike
    pitch: ArrayLike
    yaw: float = 0.0
    reference_area: float = 8.8
    ramp: float = 0.2
    separation: float = 1.0
    mu: float = EARTH_MU
    sea_level_density: float = 1.225
    density_scale: float = 7200.0
    sea_level_pressure: float = 101325.0
    pressure_scale: float = 7000.0
    _pitch: PchipInterpolator = field(init=False, repr=False)
    _cutoffs: tuple[float, ...] = field(init=False, repr=False)
    _turn: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not self.stages:
            raise ValueError("stages: none is given; a rocket needs at least one")
        cutoffs = []
        for i, s in enumerate(self.stages):
            for name in ("dry_mass", "propellant", "thrust", "mass_flow"):
                value = getattr(s, name)
                if not (math.isfinite(value) and value > 0):
                    raise ValueError(f"stages.{i}.{name}: {value} is not allowed; a finite number > 0")
            burnt_out = s.ignition + s.propellant / s.mass_flow
            cutoff = min(s.cutoff, burnt_out) if math.isinf(s.cutoff) else s.cutoff
            if cutoff <= s.ignition + 2 * self.ramp:
                raise ValueError(f"stages.{i}: cut-off at {cutoff:g} s is not after ignition at {s.ignition:g} s")
            if cutoff > burnt_out + 1e-9:
                raise ValueError(
                    f"stages.{i}.propellant: {s.propellant:g} kg is not allowed; burning until {cutoff:g} s takes "
                    f"{s.mass_flow * (cutoff - s.ignition):.0f} kg"
                )
            cutoffs.append(cutoff)
        for i in range(1, len(self.stages)):
            free = cutoffs[i - 1] + max(self.separation, self.ramp)
            if self.stages[i].ignition < free:
                raise ValueError(
                    f"stages.{i}.ignition: {self.stages[i].ignition:g} s is not allowed; stages overlap: stage {i - 1} "
                    f"is dropped at {free:g} s"
                )
        times, angles = np.asarray(self.pitch_times, dtype=float), np.asarray(self.pitch, dtype=float)
        if times.shape != angles.shape or times.ndim != 1 or times.size < 2 or np.any(np.diff(times) <= 0):
            raise ValueError("pitch program: increasing times with one angle each are needed, at least two")
        object.__setattr__(self, "_pitch", PchipInterpolator(times, angles, extrapolate=False))
        object.__setattr__(self, "_cutoffs", tuple(cutoffs))
        x, y, z = self.site.rotation
        object.__setattr__(self, "_turn", np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
        first = self.stages[0]
        start = first.ignition
        lift = (first.thrust - self.sea_level_pressure * first.nozzle_area) / self.mass(start)
        if lift <= self.mu / self.site.radius**2:
            raise ValueError(
                f"stages.0.thrust: {first.thrust:g} N is not allowed; it accelerates {self.mass(start):.0f} kg by "
                f"{lift:.2f} m/s^2, less than gravity"
            )

    # ---- the program of events

    def events(self) -> Array:
        """Return the times at which anything jumps or bends [s], increasing: the ends of smooth segments."""
        bends = {float(self.fairing_drop), 12.0, 42.0, *np.asarray(self.pitch_times, dtype=float).tolist()}
        for s, cutoff in zip(self.stages, self._cutoffs, strict=True):
            bends |= {s.ignition, s.ignition + self.ramp, cutoff, cutoff + self.ramp, cutoff + self.separation}
        return np.array(sorted(bends))

    def stage(self, time: float) -> int:
        """Return which stage is the lowest that is still attached, 0 for the first."""
        return min(sum(time >= c + self.separation for c in self._cutoffs), len(self.stages) - 1)

    def _burnt(self, i: int, time: float) -> float:
        s = self.stages[i]
        return s.mass_flow * max(0.0, min(time, self._cutoffs[i]) - s.ignition)

    def mass(self, time: float, attached: float | None = None) -> float:
        """Return the mass of what is together [kg]; propellant flows at full rate from ignition to cut-off.

        `attached` is an instant inside the smooth segment that decides what is attached, by default `time`.
        """
        at = time if attached is None else attached
        total = self.payload + (self.fairing if at < self.fairing_drop else 0.0)
        return total + sum(
            self.stages[i].dry_mass + self.stages[i].propellant - self._burnt(i, time)
            for i in range(self.stage(at), len(self.stages))
        )

    def throttle(self, time: float, attached: float | None = None) -> float:
        """Return the thrust of the burning stage over its full thrust; `attached` as in `mass`."""
        i = self.stage(time if attached is None else attached)
        rise = 1.0 if i == 0 else min(max((time - self.stages[i].ignition) / self.ramp, 0.0), 1.0)
        return rise * min(max(1 - (time - self._cutoffs[i]) / self.ramp, 0.0), 1.0)

    def direction(self, time: float) -> Array:
        """Return the direction of the thrust, shape (3,)."""
        times = np.asarray(self.pitch_times, dtype=float)
        pitch = float(self._pitch(np.clip(time, times[0], times[-1])))
        yaw = self.yaw * float(np.clip((time - 12.0) / 30.0, 0.0, 1.0))
        level = math.cos(pitch)
        return np.array([level * math.cos(yaw), math.sin(pitch), -level * math.sin(yaw)])

    # ---- dynamics

    def acceleration(self, time: float, state: Array, program_time: float | None = None) -> Array:
        """Return the acceleration relative to the launch frame [m/s^2].

        Parameters
        ----------
        time : float
            [s].
        state : ndarray, shape (6,)
            Position [m] and velocity [m/s].
        program_time : float, optional
            Instant that decides which stage and masses are attached (a time inside the smooth segment); by default
            `time`.
        """
        attached = time if program_time is None else program_time
        r, v = state[:3], state[3:6]
        d = r - self.site.centre
        distance = math.sqrt(float(d @ d))
        h = distance - self.site.radius
        speed = math.sqrt(float(v @ v))
        s = self.stages[self.stage(attached)]
        mass = self.mass(time, attached)
        pressure = self.sea_level_pressure * math.exp(-h / self.pressure_scale)
        thrust = self.throttle(time, attached) * (s.thrust - pressure * s.nozzle_area)
        drag_coefficient = 0.3 + 0.35 * math.exp(-(((speed / 300 - 1.1) / 0.35) ** 2))
        density = self.sea_level_density * math.exp(-h / self.density_scale)
        drag = 0.5 * density * speed * drag_coefficient * self.reference_area
        turn = self._turn
        return (
            (thrust * self.direction(time) - drag * v) / mass
            - self.mu / distance**3 * d
            - 2 * (turn @ v)
            - turn @ (turn @ d)
        )

    def derivative(self, time: float, state: Array, program_time: float | None = None) -> Array:
        """Return the derivative of the state, shape (6,)."""
        return np.concatenate([state[3:6], self.acceleration(time, state, program_time)])
