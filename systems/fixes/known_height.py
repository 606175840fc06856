r"""Position from two TDOAs and an assumed height.

With :math:`q = p - s_0`, :math:`D_i = s_i - s_0`, :math:`d_i = c\tau_{i0}`, squaring :math:`r_i = r_0 + d_i` gives
:math:`D_i\cdot q = (|D_i|^2 - d_i^2)/2 - d_i r_0`, so :math:`q = a + b r_0 + t n` with n normal to both baselines.
The sphere :math:`|q + s_0| = R` makes t a quadratic in :math:`r_0`, and :math:`|q| = r_0` then a quartic. Newton's
method on :math:`[c\tau_1, c\tau_2, h]` refines its root from the sphere to the WGS-84 ellipsoid, and stands alone
where the quartic degenerates: satellites in one line, or in one plane with the centre of the Earth.

Those are the delays of one instant. Where they are those of one wave front, `wave_front_fix` takes off what light time
adds to them, some nanoseconds, at the fix of before; the addition changes by 1e-4 of a change of the fix.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef, up, vertical
from quietfix.systems.geometry.lines_of_sight import line_of_sight
from quietfix.systems.kernels.fixing.calls import known_height
from quietfix.systems.linear_algebra import inverses, solve
from quietfix.systems.measurement.base import differenced_covariance
from quietfix.systems.measurement.tdoa import Tdoa

__all__ = [
    "DegenerateFormationError",
    "has_closed_form",
    "known_height_covariance",
    "known_height_fix",
    "position_per_velocity",
    "wave_front_fix",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Method = Literal["auto", "closed_form", "newton"]

_SMALLEST_SINE = 1e-3  # below it the quartic loses more digits than Newton needs
_LARGEST_STEP = 300e3  # m; Newton from the sub-satellite point converges for every visible target with it
_ITERATIONS = 30
_CONVERGED = 1e-5  # m
_WAVE_FRONTS = 3  # each leaves 1e-4 of the 100 m or so that light time moves a fix
_SCALE = 1e6  # m; the quartic's coefficients differ by 1e28 in metres


class DegenerateFormationError(ValueError):
    """The formation has no closed-form solution."""


def has_closed_form(satellites: Array) -> Mask:
    """Return whether three satellites (..., 3, >=3) span a plane that misses the Earth's centre clearly."""
    s = satellites[..., :3]
    d1, d2 = s[..., 1, :] - s[..., 0, :], s[..., 2, :] - s[..., 0, :]
    normal = np.cross(d1, d2)
    size = np.linalg.norm(normal, axis=-1)
    lengths = np.linalg.norm(d1, axis=-1) * np.linalg.norm(d2, axis=-1)
    out_of_plane = np.abs(np.einsum("...i,...i->...", normal, s[..., 0, :]))
    reach = np.linalg.norm(s[..., 0, :], axis=-1) * np.where(size > 0, size, 1.0)
    good: Mask = (size > _SMALLEST_SINE * lengths) & (out_of_plane > _SMALLEST_SINE * reach)
    return good


def known_height_fix(
    delays: Array, satellites: Array, height: Array, method: Method = "auto", start: Array | None = None
) -> Array:
    """Return the Earth-fixed position that two TDOAs and a height mean.

    Parameters
    ----------
    delays : ndarray, shape (trials, 2)
        TDOA of satellites 1 and 2 against satellite 0 [s].
    satellites : ndarray, shape (1 or trials, 3, >= 3)
        Earth-fixed positions first [m].
    height : ndarray, shape (trials,)
        Height above the WGS-84 ellipsoid [m].
    method : {'auto', 'closed_form', 'newton'}
        'auto': the quartic where the formation has one, else Newton from the sub-satellite point.
    start : ndarray, shape (trials, 3), optional
        Where Newton starts (a filter's prediction, say); the quartic is then not needed.

    Returns
    -------
    ndarray, shape (trials, 3)
        NaN where there is no solution from which all three satellites are above the horizon.

    Raises
    ------
    DegenerateFormationError
        For 'closed_form' with a collinear formation, or one in a plane through the Earth's centre.
    """
    delays = np.asarray(delays, dtype=float)
    height = np.broadcast_to(np.asarray(height, dtype=float), delays.shape[:1])
    satellites = np.asarray(satellites, dtype=float)[..., :3]
    if start is None:
        start = _first_guess(delays, satellites, height, method)
    rule = _ITERATIONS, _LARGEST_STEP, _CONVERGED
    return known_height(SPEED_OF_LIGHT * delays, satellites, height, start, rule)


def wave_front_fix(
    tdoa: Tdoa,
    delays: Array,
    platforms: Array,
    height: Array,
    method: Method = "auto",
    start: Array | None = None,
    velocity: Array | None = None,
) -> Array:
    """Return the position that the two TDOAs of a model and a height mean, with the model's light time.

    Parameters
    ----------
    tdoa : Tdoa
        Two TDOAs, with light time or without.
    delays : ndarray, shape (trials, 2)
        Its rows [s].
    platforms : ndarray, shape (1 or trials, p, 6)
        Its platforms, Earth-fixed.
    height, method, start
        See `known_height_fix`.
    velocity : ndarray, shape (trials, 3), optional
        Earth-fixed velocity of the target [m/s]; by default it is at rest, see `position_per_velocity`.

    Returns
    -------
    ndarray, shape (trials, 3)
        As `known_height_fix`.
    """
    satellites = platforms[..., [tdoa.reference, *tdoa.receivers], :]
    fix = known_height_fix(delays, satellites, height, method, start)
    if not tdoa.light_time:
        return fix
    for _ in range(_WAVE_FRONTS):
        target = np.concatenate([fix, np.zeros_like(fix) if velocity is None else velocity], axis=-1)
        travel = line_of_sight(target, satellites).distance / SPEED_OF_LIGHT
        addition = tdoa.predict(target, platforms) - (travel[..., 1:] - travel[..., :1])
        fix = known_height_fix(delays - addition, satellites, height, method, fix)
    return fix


def position_per_velocity(tdoa: Tdoa, target: Array, platforms: Array) -> Array:
    r"""Return dp/dv at given delays and height, shape (..., 3, 3) [s].

    Light time makes a delay depend on the velocity: the emitter moves on while the signal travels, as seen from two
    sides. :math:`-G^{-1} c\,\partial\tau/\partial v`, G as in `known_height_covariance`; 0 without light time.

    Parameters
    ----------
    tdoa : Tdoa
    target : ndarray, shape (..., 6)
    platforms : ndarray, shape (..., p, 6)
    """
    if not tdoa.light_time:
        return np.zeros((*target.shape[:-1], 3, 3))
    gradient = _gradient(target, platforms[..., [tdoa.reference, *tdoa.receivers], :])
    change = np.zeros((*gradient.shape[:-2], 3, 3))
    change[..., :2, :] = SPEED_OF_LIGHT * tdoa.jacobian(target, platforms)[..., 3:6]
    finite = np.all(np.isfinite(gradient), axis=(-1, -2))[..., None, None]
    return np.where(finite, -solve(np.where(finite, gradient, np.eye(3)), change), np.nan)


def _first_guess(delays: Array, satellites: Array, height: Array, method: Method) -> Array:
    """Return where Newton starts: the quartic's root in every trial whose formation has one, else below satellite 0."""
    guess = np.broadcast_to(_below(satellites[:, 0, :], height), (delays.shape[0], 3))
    if method == "newton":
        return guess
    closed = has_closed_form(satellites)
    known = np.all(np.isfinite(satellites), axis=(-1, -2))
    if method == "closed_form" and np.any(known & ~closed):
        raise DegenerateFormationError(
            "the satellites are collinear, or in one plane with the Earth's centre: this formation has no "
            "closed form; use method 'newton' or 'auto'"
        )
    if not closed.any():
        return guess
    # The quartic has no value for the others, and they must not stop it for these.
    somewhere = satellites[np.argmax(closed)]
    root = _quartic(delays, np.where(closed[:, None, None], satellites, somewhere), height)
    return np.where(closed[:, None], root, guess)


def _below(satellite: Array, height: Array) -> Array:
    latitude, longitude, _ = ecef_to_geodetic(satellite)
    return geodetic_to_ecef(latitude, longitude, height)


def _quartic(delays: Array, satellites: Array, height: Array) -> Array:
    """Return the visible root of the quartic on a sphere, corrected once towards the ellipsoid."""
    s0 = satellites[:, 0, :] / _SCALE
    base = (satellites[:, 1:, :] - satellites[:, :1, :]) / _SCALE
    d = SPEED_OF_LIGHT * delays / _SCALE
    gram = base @ np.swapaxes(base, -1, -2)
    normal = np.cross(base[:, 0], base[:, 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    right = np.stack([0.5 * (np.einsum("...ij,...ij->...i", base, base) - d**2), -d], axis=-1)
    solved = solve(np.broadcast_to(gram, (d.shape[0], 2, 2)), right)
    a, b = np.einsum("tki,tkj->jti", np.broadcast_to(base, (d.shape[0], 2, 3)), solved)

    position = np.full((d.shape[0], 3), np.nan)
    below = _below(satellites[:, 0, :], np.zeros(1))
    radius = (np.linalg.norm(below, axis=-1) + height) / _SCALE
    for _ in range(2):  # the second time with the Earth's radius under the first solution
        r0, t = _roots(a, b, normal, s0, radius)
        q = a[:, None, :] + b[:, None, :] * r0[..., None] + t[..., None] * normal[:, None, :]
        p = (q + s0[:, None, :]) * _SCALE
        position = _visible_root(p, r0, satellites, delays)
        error = height - vertical(position)[1]
        radius = np.where(np.isfinite(error), (np.linalg.norm(position, axis=-1) + error) / _SCALE, radius)
    return position


def _roots(a: Array, b: Array, n: Array, s0: Array, radius: Array) -> tuple[Array, Array]:
    """Return the four r0 and t of each trial; NaN where a root is complex or not positive."""

    def dot(x: Array, y: Array) -> Array:
        return np.einsum("...i,...i->...", x, y)

    # t = t2 r0^2 + t1 r0 + t0 from the sphere, then |a + b r0|^2 + t^2 = r0^2.
    scale = 2 * dot(s0, n)
    t2, t1 = -1 / scale, -2 * dot(s0, b) / scale
    t0 = (radius**2 - dot(s0, s0) - 2 * dot(s0, a)) / scale
    t2 = np.broadcast_to(t2, t0.shape)
    lead = t2**2
    rest = np.stack(
        [
            2 * t2 * t1,
            t1**2 + 2 * t2 * t0 + dot(b, b) - 1,
            2 * t1 * t0 + 2 * dot(a, b),
            t0**2 + dot(a, a),
        ],
        axis=-1,
    )
    finite = np.all(np.isfinite(rest), axis=-1)
    companion = np.zeros((*t0.shape, 4, 4))
    companion[..., 1:, :3] = np.eye(3)
    companion[..., 0, :] = np.where(finite[..., None], -rest / lead[..., None], 1.0)
    roots = np.linalg.eigvals(companion)
    good = (np.abs(roots.imag) < 1e-6 * np.abs(roots)) & (roots.real > 0) & finite[..., None]
    r0 = np.where(good, roots.real, np.nan)
    return r0, t2[..., None] * r0**2 + t1[..., None] * r0 + t0[..., None]


def _visible_root(p: Array, r0: Array, satellites: Array, delays: Array) -> Array:
    """Pick the root that solves the unsquared equations and sees all satellites."""
    offset = p[:, :, None, :] - satellites[:, None, :, :]
    distance = np.linalg.norm(offset, axis=-1)
    misfit = np.abs(distance[..., 1:] - distance[..., :1] - SPEED_OF_LIGHT * delays[:, None, :]).sum(axis=-1)
    seen = np.all(np.einsum("...i,...i->...", -offset, p[:, :, None, :]) > 0, axis=-1)
    cost = np.where(np.isfinite(misfit) & seen & (misfit < 1.0), misfit, np.inf)
    best = np.argmin(cost, axis=-1)
    rows = np.arange(p.shape[0])
    return np.where(np.isfinite(cost[rows, best])[:, None], p[rows, best], np.nan)


def known_height_covariance(
    position: Array,
    satellites: Array,
    sigma_delay: float,
    sigma_height: float,
    sigma_satellite: float = 0.0,
    correlated: bool = False,
) -> Array:
    r"""Return the covariance P1 of the known-height fix.

    .. math:: P_1 = G^{-1} C\, G^{-T}, \qquad G = [u_1 - u_0;\ u_2 - u_0;\ \text{up}], \qquad
       C = \operatorname{diag}(c^2 R_\tau + \sigma_s^2 (I + 1 1^T),\ \sigma_h^2)

    u is the unit vector from satellite to target; :math:`R_\tau` as in `differenced_covariance`. Derived by
    differentiating the three equations; satellite 0's error is in both differences.

    Parameters
    ----------
    position : ndarray, shape (..., >= 3)
        Earth-fixed position of the fix [m].
    satellites : ndarray, shape (..., 3, 6)
        Satellites' Earth-fixed states.
    sigma_delay : float
        Standard deviation of one TDOA [s].
    sigma_height : float
        Standard deviation of the assumed height [m].
    sigma_satellite : float
        Standard deviation of a satellite's position per axis [m].
    correlated : bool
        TDOA errors correlated through the reference.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    gradient = _gradient(position, satellites)
    c = np.zeros((3, 3))
    c[:2, :2] = SPEED_OF_LIGHT**2 * differenced_covariance(sigma_delay, 2, correlated)
    c[:2, :2] += sigma_satellite**2 * (np.eye(2) + np.ones((2, 2)))
    c[2, 2] = sigma_height**2
    finite = np.all(np.isfinite(gradient), axis=(-1, -2))
    inverse = inverses(np.where(finite[..., None, None], gradient, np.eye(3)))
    # The square root of C keeps the product symmetric and definite although it is nearly of rank one.
    half = inverse @ np.linalg.cholesky(c)
    return np.where(finite[..., None, None], half @ np.swapaxes(half, -1, -2), np.nan)


def _gradient(position: Array, satellites: Array) -> Array:
    """Return the derivative G (..., 3, 3) of range differences and height."""
    target = np.concatenate([position[..., :3], np.zeros_like(position[..., :3])], axis=-1)
    u = line_of_sight(target, satellites).direction
    return np.concatenate([u[..., 1:, :] - u[..., :1, :], up(target[..., :3])[..., None, :]], axis=-2)
