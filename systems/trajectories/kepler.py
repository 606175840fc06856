"""Kepler orbits: elements to position and velocity and back, vectorised, elliptic."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["KeplerElements", "eccentric_anomaly", "mean_anomaly", "mean_motion", "state_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KeplerElements:
    """Elements of one or many elliptic orbits; the fields broadcast.

    Parameters
    ----------
    semi_major_axis : array_like
        [m], > 0.
    eccentricity : array_like
        In [0, 1).
    inclination, raan, argument_of_perigee, mean_anomaly : array_like
        [rad]; `raan` is the right ascension of the ascending node. For a circular orbit put 0 for the
        argument of perigee: the mean anomaly is then the argument of latitude.
    perigee_above : float
        If given, the perigee must lie above this radius [m] (put the Earth's radius there).

    Raises
    ------
    ValueError
        If an element is not finite or not allowed.
    """

    semi_major_axis: ArrayLike
    eccentricity: ArrayLike
    inclination: ArrayLike
    raan: ArrayLike
    argument_of_perigee: ArrayLike
    mean_anomaly: ArrayLike
    perigee_above: float | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        for field in fields(self)[:6]:
            value = np.asarray(getattr(self, field.name), dtype=float)
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{field.name}: {value} is not allowed; it must be finite")
        a = np.asarray(self.semi_major_axis, dtype=float)
        e = np.asarray(self.eccentricity, dtype=float)
        if np.any(a <= 0):
            raise ValueError(f"semi_major_axis: {np.min(a)} is not allowed; it must be > 0 m")
        if np.any((e < 0) | (e >= 1)):
            bad = e[(e < 0) | (e >= 1)][0]
            raise ValueError(f"eccentricity: {bad} is not allowed; 0 <= eccentricity < 1 (an ellipse)")
        if self.perigee_above is not None and np.any(a * (1 - e) <= self.perigee_above):
            raise ValueError(
                f"semi_major_axis, eccentricity: the perigee is {np.min(a * (1 - e)):.0f} m from the "
                f"centre of the Earth, below its surface ({self.perigee_above:.0f} m)"
            )

    def arrays(self) -> tuple[Array, ...]:
        """Return the six elements as arrays of one shape, in the order of the fields."""
        values = [np.asarray(getattr(self, field.name), dtype=float) for field in fields(self)[:6]]
        return tuple(np.broadcast_arrays(*values))


def mean_motion(semi_major_axis: ArrayLike, mu: float) -> Array:
    """Return the mean motion sqrt(mu/a^3).

    Parameters
    ----------
    semi_major_axis : array_like, shape (...)
        [m].
    mu : float
        Gravitational parameter [m^3/s^2].

    Returns
    -------
    ndarray, shape (...)
        [rad/s]; a revolution takes 2 pi divided by it, and the mean anomaly is it times the time since
        perigee.
    """
    return np.sqrt(mu / np.asarray(semi_major_axis, dtype=float) ** 3)


def eccentric_anomaly(mean_anomaly: ArrayLike, eccentricity: ArrayLike) -> Array:
    """Solve Kepler's equation E - e sin E = M.

    Parameters
    ----------
    mean_anomaly : array_like, shape (...)
        M [rad], any number of revolutions.
    eccentricity : array_like, shape (...)
        In [0, 1); the two broadcast.

    Returns
    -------
    ndarray, shape (...)
        E [rad], in the revolution of M.

    Notes
    -----
    Newton's iteration from E = M + 0.85 e sign(sin M) (Danby, *Fundamentals of Celestial Mechanics*, 1988,
    section 6.6), all anomalies at once with a step limited to 1 rad; each anomaly keeps its value once it has
    converged, so that its result does not depend on the others.
    """
    m, e = np.broadcast_arrays(np.asarray(mean_anomaly, dtype=float), np.asarray(eccentricity, dtype=float))
    turns = 2 * np.pi * np.round(m / (2 * np.pi))
    m = m - turns
    anomaly = m + 0.85 * e * np.sign(np.sin(m))
    open_ = np.ones(m.shape, dtype=bool)
    for _ in range(60):
        step = (anomaly - e * np.sin(anomaly) - m) / (1 - e * np.cos(anomaly))
        anomaly = anomaly - np.where(open_, np.clip(step, -1.0, 1.0), 0.0)
        open_ = open_ & (np.abs(step) > 1e-14 * (1 + np.abs(anomaly)))
        if not open_.any():
            break
    return anomaly + turns


def mean_anomaly(true_anomaly: ArrayLike, eccentricity: ArrayLike) -> Array:
    r"""Return the mean anomaly of a true one.

    .. math:: E = \nu + 2\operatorname{atan2}(-\beta\sin\nu,\, 1 + \beta\cos\nu), \quad
              \beta = e/(1 + \sqrt{1 - e^2}), \qquad M = E - e\sin E

    Broucke and Cefola, *A note on the relations between true and eccentric anomalies in the two-body problem*,
    Celestial Mechanics 7 (1973) 388-389: without a half angle, and exactly nu for a circle.

    Parameters
    ----------
    true_anomaly : array_like, shape (...)
        nu [rad], any number of revolutions.
    eccentricity : array_like, shape (...)
        In [0, 1); the two broadcast.

    Returns
    -------
    ndarray, shape (...)
        M [rad], in the revolution of nu.
    """
    nu, e = np.asarray(true_anomaly, dtype=float), np.asarray(eccentricity, dtype=float)
    beta = e / (1 + np.sqrt(1 - e * e))
    eccentric = nu - 2 * np.arctan2(beta * np.sin(nu), 1 + beta * np.cos(nu))
    return eccentric - e * np.sin(eccentric)


def state_of(elements: KeplerElements, mu: float) -> Array:
    """Return position and velocity of Kepler elements.

    Parameters
    ----------
    elements : KeplerElements
        Elements of shape (...).
    mu : float
        Gravitational parameter [m^3/s^2].

    Returns
    -------
    ndarray, shape (..., 6)
        Inertial position [m] and velocity [m/s].

    Notes
    -----
    Perifocal coordinates from the eccentric anomaly, turned by Rz(raan) Rx(i) Rz(argument of perigee)
    (Vallado, 4th ed., algorithm 10).
    """
    a, e, i, node, perigee, m = elements.arrays()
    anomaly = eccentric_anomaly(m, e)
    c, s, root = np.cos(anomaly), np.sin(anomaly), np.sqrt(1 - e**2)
    rate = mean_motion(a, mu) / (1 - e * c)
    cw, sw, cn, sn, ci, si = (f(x) for x in (perigee, node, i) for f in (np.cos, np.sin))
    p = np.stack([cn * cw - sn * sw * ci, sn * cw + cn * sw * ci, sw * si], axis=-1)
    q = np.stack([-cn * sw - sn * cw * ci, -sn * sw + cn * cw * ci, cw * si], axis=-1)
    position = (a * (c - e))[..., None] * p + (a * root * s)[..., None] * q
    velocity = (-a * rate * s)[..., None] * p + (a * rate * root * c)[..., None] * q
    return np.concatenate([position, velocity], axis=-1)
