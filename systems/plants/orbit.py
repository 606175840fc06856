"""Orbits of satellites, two-body + J2: as continuous state and as a dense function of time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, ContinuousState
from scipy.integrate import OdeSolution

from quietfix.systems.constants import WGS84_ECCENTRICITY_SQUARED
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.plants.solving import solve
from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.gravity import GravityConstants, above_surface, acceleration

__all__ = ["DenseOrbit", "Orbit", "derivative"]

Array = NDArray[np.float64]


def derivative(state: ArrayLike, constants: GravityConstants, j2: bool = True) -> Array:
    """Return the time derivative of inertial orbit states.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Inertial position [m] and velocity [m/s].
    constants : GravityConstants
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.

    Returns
    -------
    ndarray, shape (..., 6)
        Inertial velocity [m/s] and acceleration [m/s^2].
    """
    x = np.asarray(state, dtype=float)
    return np.concatenate([x[..., 3:6], acceleration(x[..., :3], constants, j2)], axis=-1)


def check_initial(initial: ArrayLike, constants: GravityConstants) -> Array:
    """Return the initial states as (trials, satellites, 6), or raise ValueError in the user's words."""
    x = np.array(initial, dtype=float)
    if x.ndim == 2:
        x = x[None]
    if x.ndim != 3 or x.shape[-1] != 6:
        raise ValueError(
            f"orbit initial state: shape {np.shape(initial)} is not allowed; (satellites, 6) or (trials, satellites, 6)"
        )
    if x.shape[1] == 0:
        raise ValueError("orbit initial state: zero satellites; at least one is needed")
    if x.shape[0] == 0:
        raise ValueError("orbit initial state: zero trials; at least one is needed")
    if not np.all(np.isfinite(x)):
        trial, satellite, _ = np.argwhere(~np.isfinite(x))[0]
        raise ValueError(f"orbit initial state: {_which(x, satellite, trial)} has a number that is not finite")
    below = ~above_surface(x[..., :3], constants)
    if below.any():
        trial, satellite = np.argwhere(below)[0]
        raise ValueError(
            f"orbit initial state: {_which(x, satellite, trial)} starts below the Earth's surface, "
            f"{np.linalg.norm(x[trial, satellite, :3]):.0f} m from the centre"
        )
    return x


def _which(states: Array, satellite: int, trial: int) -> str:
    """Return which satellite it is, as far as there are several, and several trials."""
    trials, satellites = states.shape[:2]
    named = f"satellite {satellite}" if satellites > 1 else "the satellite"
    return f"{named} of trial {trial}" if trials > 1 else named


class _OrbitBlock(EnsembleBlock):
    """What the two orbit blocks share: constants, ports, frames."""

    def __init__(self, name: str, initial: ArrayLike, constants: GravityConstants | None, j2: bool) -> None:
        super().__init__(name)
        self.constants = constants or GravityConstants()
        self.j2 = bool(j2)
        self.initial = check_initial(initial, self.constants)
        self.initial.setflags(write=False)
        self.trials, self.satellites, _ = self.initial.shape

    def _states(self, context: Context) -> Array:
        """Return the inertial states (trials, satellites, 6)."""
        raise NotImplementedError

    def _declare_ports(self, ticket: Any, ticket_with_time: set[Any]) -> None:
        width = self.satellites * 6
        self.declare_output("state", self.trials, width, self._earth_fixed, ticket_with_time)
        self.declare_output("inertial", self.trials, width, self._states, {ticket})
        self.declare_output("acceleration", self.trials, self.satellites * 3, self._acceleration, {ticket})

    def _earth_fixed(self, context: Context) -> Array:
        return inertial_to_earth_fixed(self._states(context), context.get_time(), self.constants.earth_rate)

    def _acceleration(self, context: Context) -> Array:
        return acceleration(self._states(context)[..., :3], self.constants, self.j2)


class Orbit(_OrbitBlock):
    r"""Satellites as continuous state, for a fixed-step ``runge_kutta5`` (1 s: 0.01 mm in low orbit).

    Ports, all outputs: ``state`` (trials, satellites * 6) Earth-fixed position [m] and velocity [m/s];
    ``inertial`` the same in inertial axes; ``acceleration`` (trials, satellites * 3) inertial [m/s^2].

    .. math:: \ddot r = \nabla U, \qquad U = \frac{\mu}{r}\Big[1 - J_2 \Big(\frac{R}{r}\Big)^2 \frac{3 s^2 - 1}{2}\Big],
              \quad s = z/r

    Vallado, *Fundamentals of Astrodynamics and Applications*, 4th ed., section 8.6.

    Parameters
    ----------
    initial : array_like, shape (satellites, 6) or (trials, satellites, 6)
        Inertial position [m] and velocity [m/s] at time 0 (from Kepler elements:
        `quietfix.systems.trajectories.kepler.state_of`).
    constants : GravityConstants, optional
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For zero satellites, numbers that are not finite, a start below the Earth's surface.

    Notes
    -----
    Error control couples the trials, and hangs on NaN: keep the step fixed.
    """

    def __init__(
        self,
        initial: ArrayLike,
        constants: GravityConstants | None = None,
        j2: bool = True,
        name: str = "orbit",
    ) -> None:
        super().__init__(name, initial, constants, j2)
        self.DeclareContinuousState(BasicVector(self.initial.ravel()))
        self._declare_ports(self.xc_ticket(), {self.xc_ticket(), self.time_ticket()})

    def _states(self, context: Context) -> Array:
        return context.get_continuous_state_vector().CopyToVector().reshape(self.initial.shape)

    def DoCalcTimeDerivatives(self, context: Context, derivatives: ContinuousState) -> None:
        """Write the derivative of all satellites of all trials."""
        rate = derivative(self._states(context), self.constants, self.j2)
        derivatives.get_mutable_vector().SetFromVector(rate.ravel())


class DenseOrbit(_OrbitBlock):
    r"""Satellites as a dense function of time: SciPy's DOP853, solved once when the block is made.

    For truth that all trials share (trials = 1): cheaper than `Orbit`, and as exact between steps as on them.
    Ports as `Orbit`.

    .. math:: \ddot r = \nabla U(r)

    with U as of `Orbit`.

    Parameters
    ----------
    initial : array_like, shape (satellites, 6) or (1, satellites, 6)
        Inertial position [m] and velocity [m/s] at time 0.
    end : float
        Last time that can be asked for [s], > 0.
    constants : GravityConstants, optional
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.
    name : str
        Name of the block.
    solution : scipy.integrate.OdeSolution, optional
        Of just these, where it is known; see `again`.

    Raises
    ------
    ValueError
        As `Orbit`; for more than one trial; when asked before 0 or beyond `end`; when no solution exists up
        to `end`, or a satellite falls onto the Earth before.
    """

    def __init__(
        self,
        initial: ArrayLike,
        end: float,
        constants: GravityConstants | None = None,
        j2: bool = True,
        name: str = "orbit",
        solution: OdeSolution | None = None,
    ) -> None:
        super().__init__(name, initial, constants, j2)
        if self.trials != 1:
            raise ValueError(
                f"orbit initial state: {self.trials} trials are not allowed, a dense orbit is shared by all; "
                "use Orbit, whose step is fixed"
            )
        if not (np.isfinite(end) and end > 0):
            raise ValueError(f"orbit end: {end} is not allowed; it must be finite and > 0 s")
        self.end = float(end)
        self._slack = 1e-9 * self.end
        self._solution = self._solve(name) if solution is None else solution
        self._at = self.declare_cached("inertial", DenseOrbit._evaluate, {self.time_ticket()})
        ticket = self.cached_ticket(self._at)
        self._declare_ports(ticket, {ticket})

    def again(self) -> DenseOrbit:
        """Return such a block for another diagram; nothing is solved again."""
        return DenseOrbit(self.initial, self.end, self.constants, self.j2, self.get_name(), self._solution)

    def _solve(self, name: str) -> OdeSolution:
        def ground(t: float, x: Array) -> float:
            return float(self._heights(x).min())

        ground.terminal = True  # type: ignore[attr-defined]
        solved = solve(
            f"orbit of {name}",
            lambda t, x: derivative(x.reshape(-1, 6), self.constants, self.j2).ravel(),
            0.0,
            self.end,
            self.initial.ravel(),
            method="DOP853",
            rtol=1e-12,
            atol=1e-9,
            events=ground,
        )
        if solved.status == 1:
            lowest = int(np.argmin(self._heights(solved.y[:, -1])))
            which = _which(self.initial, lowest, 0)
            raise ValueError(f"orbit of {name}: {which} falls onto the Earth after {solved.t[-1]:.0f} s")
        return solved.sol

    def _heights(self, state: Array) -> Array:
        """Return heights above the ellipsoid as shares of the equatorial radius, near the surface."""
        scaled = state.reshape(-1, 6)[:, :3] / self.constants.radius
        scaled[:, 2] /= np.sqrt(1 - WGS84_ECCENTRICITY_SQUARED)
        return np.asarray(np.linalg.norm(scaled, axis=-1) - 1, dtype=float)

    def at(self, time: ArrayLike) -> Array:
        """Return the inertial states.

        Parameters
        ----------
        time : array_like, shape (...)
            0 <= time <= end [s].

        Returns
        -------
        ndarray, shape (..., satellites, 6)
            Inertial position [m] and velocity [m/s].
        """
        t = np.asarray(time, dtype=float)
        if not np.all((t >= -self._slack) & (t <= self.end + self._slack)):
            raise ValueError(
                f"{self.get_name()}: solved from 0 to {self.end} s, asked for {np.ravel(t)[0]} s; "
                "make it with a later `end`"
            )
        # a scalar stays one: the solution evaluates it six times faster than an array of one
        if t.ndim == 0:
            return self._solution(float(t)).reshape(self.satellites, 6)
        return np.moveaxis(self._solution(t.ravel()), 0, -1).reshape(*t.shape, self.satellites, 6)

    def _evaluate(self, context: Context) -> Array:
        return self.at(context.get_time())[None]

    def _states(self, context: Context) -> Array:
        return self.cached(context, self._at)
