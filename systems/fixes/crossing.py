r"""Position from lines of bearing: crossing of two lines, least squares of all, weighted instrumental variable.

Huang, *Bearing cross location algorithm based on piecewise linear Kalman filter*, Modern Defence Technology 45 (2017)
no. 1, 113-118, doi 10.3969/j.issn.1009-086x.2017.01.020. The formulae (1) to (3) are lost in the accessible text; they
are derived here, without tangents, so that no direction is special. Azimuths are counter-clockwise from x [rad].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.linear_algebra import dot

__all__ = [
    "Lines",
    "crossing",
    "crossing_covariance",
    "crossing_sigma",
    "instrumental_variable",
]

Array = NDArray[np.float64]

_PARALLEL = 1e-9  # sine of the crossing angle
_SINGULAR = 1e-14  # determinant of the information over the square of half its trace


def crossing(first: Array, azimuth_first: Array, second: Array, azimuth_second: Array) -> Array:
    r"""Return where two lines of bearing cross, equation (1).

    .. math:: r_A = \frac{(x_B - x_A)\sin\theta_B - (y_B - y_A)\cos\theta_B}{\sin(\theta_B - \theta_A)}, \qquad
              x = x_A + r_A\cos\theta_A, \qquad y = y_A + r_A\sin\theta_A

    Parameters
    ----------
    first, second : ndarray, shape (..., >= 2)
        Positions A and B [m].
    azimuth_first, azimuth_second : ndarray, shape (...)
        Azimuths from A and B [rad].

    Returns
    -------
    ndarray, shape (..., 2)
        NaN where the positions are equal or the lines parallel. The point may lie behind A or B: noise at a small
        crossing angle does that.
    """
    base = second[..., :2] - first[..., :2]
    sine = np.sin(azimuth_second - azimuth_first)
    undefined = (np.abs(sine) < _PARALLEL) | ~(np.abs(base).sum(axis=-1) > 0)
    reach = base[..., 0] * np.sin(azimuth_second) - base[..., 1] * np.cos(azimuth_second)
    distance = reach / np.where(undefined, np.nan, sine)
    return first[..., :2] + distance[..., None] * _unit(azimuth_first)


def crossing_covariance(
    position: Array,
    first: Array,
    second: Array,
    variance_first: ArrayLike,
    variance_second: ArrayLike,
    sigma_position: float = 0.0,
) -> Array:
    r"""Return the covariance of a crossing, to first order.

    The target obeys :math:`n_i^T (x - p_i) = 0` with :math:`n_i = [-\sin\theta_i, \cos\theta_i]`; an error
    :math:`\delta\theta_i` moves the line by :math:`r_i\,\delta\theta_i`, an error of the position by
    :math:`n_i^T\delta p_i`. So, with :math:`N = [n_A^T; n_B^T]`,

    .. math:: P = N^{-1}\,\mathrm{diag}(r_i^2\sigma_i^2 + \sigma_{xy}^2)\,N^{-T}

    Its trace is the square of formula (3), `crossing_sigma`. Linear: it holds for crossing angles that are large
    against the bearings' errors; else the error has heavy tails and no variance at all.

    Parameters
    ----------
    position, first, second : ndarray, shape (..., >= 2)
        Crossing, and positions A and B [m].
    variance_first, variance_second : array_like, shape (...)
        Variances of the azimuths [rad^2].
    sigma_position : float
        Standard deviation of the platform's position per axis, independent at A and B [m].

    Returns
    -------
    ndarray, shape (..., 2, 2)
        NaN where the crossing is.
    """
    lines = []
    for place, variance in ((first, variance_first), (second, variance_second)):
        offset = position[..., :2] - place[..., :2]
        square = np.einsum("...i,...i->...", offset, offset)
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = np.stack([-offset[..., 1], offset[..., 0]], axis=-1) / np.sqrt(square)[..., None]
        lines.append((normal, square * np.asarray(variance) + sigma_position**2))
    (a, spread_a), (b, spread_b) = lines
    sine = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    # Columns of the inverse of [a; b].
    with np.errstate(divide="ignore", invalid="ignore"):
        of_a = np.stack([b[..., 1], -b[..., 0]], axis=-1) / sine[..., None]
        of_b = np.stack([-a[..., 1], a[..., 0]], axis=-1) / sine[..., None]
    return sum(
        spread[..., None, None] * column[..., :, None] * column[..., None, :]
        for spread, column in ((spread_a, of_a), (spread_b, of_b))
    )


def crossing_sigma(
    first: Array, second: Array, target: Array, sigma_azimuth: ArrayLike, sigma_position: ArrayLike = 0.0
) -> Array:
    r"""Return the standard deviation of a crossing's position, formulae (2) and (3).

    .. math:: \sigma_r = \frac{\sqrt{\sigma_\theta^2 (r_A^2 + r_B^2) + 2\sigma_{xy}^2}}{|\sin(\theta_B - \theta_A)|}
              = \frac{1}{|\sin\gamma|}\sqrt{\frac{\sigma_\theta^2 D^2 (\sin^2 a_A + \sin^2 a_B)}{\sin^2\gamma}
              + 2\sigma_{xy}^2}

    D is the distance AB, :math:`a_A, a_B` the angles of the triangle at A and B, :math:`\gamma` the crossing angle.

    Parameters
    ----------
    first, second, target : ndarray, shape (..., >= 2)
        Positions [m].
    sigma_azimuth : array_like, shape (...)
        Standard deviation of both azimuths [rad].
    sigma_position : array_like, shape (...)
        Standard deviation of the platform's position per axis [m].

    Returns
    -------
    ndarray, shape (...)
        [m]; infinite where the lines are parallel.
    """
    a, b = target[..., :2] - first[..., :2], target[..., :2] - second[..., :2]
    square_a, square_b = np.einsum("...i,...i->...", a, a), np.einsum("...i,...i->...", b, b)
    cross = np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    top = np.square(sigma_azimuth) * (square_a + square_b) + 2 * np.square(sigma_position)
    with np.errstate(divide="ignore"):
        return np.sqrt(top) * np.sqrt(square_a * square_b) / cross


def _unit(azimuth: Array) -> Array:
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


class Lines(NamedTuple):
    r"""Sums over lines of bearing, from which their least-squares point follows; recursive, ten numbers a trial.

    .. math:: \hat x = A^{-1} b, \qquad A = \sum_i n_i n_i^T, \quad b = \sum_i n_i n_i^T p_i

    the point with the least sum of squared distances from the lines (pseudo-linear estimate; Lingren and Gong,
    *Position and velocity estimation via bearing observations*, IEEE Trans. Aerospace and Electronic Systems 14 (1978)
    564-577). It is biased: n_i holds the noise that the distance holds. Covariance, for independent errors and to first
    order, :math:`A^{-1} [\sum_i (r_i^2\sigma_i^2 + \sigma_{xy}^2)\,n_i n_i^T] A^{-1}`.

    Attributes
    ----------
    information : ndarray, shape (..., 2, 2)
        A.
    vector : ndarray, shape (..., 2)
        b [m].
    weight : ndarray, shape (..., 2, 2)
        :math:`\sum\sigma_i^2 n_i n_i^T`.
    moment : ndarray, shape (..., 2, 2, 2)
        :math:`\sum\sigma_i^2 n_i n_i^T p_i`, last axis that of p.
    square : ndarray, shape (..., 2, 2)
        :math:`\sum\sigma_i^2 |p_i|^2 n_i n_i^T`.
    """

    information: Array
    vector: Array
    weight: Array
    moment: Array
    square: Array

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> Lines:
        """Return sums without a line, over leading axes `shape`."""
        return cls(*(np.zeros((*shape, *tail)) for tail in ((2, 2), (2,), (2, 2), (2, 2, 2), (2, 2))))

    @classmethod
    def unflatten(cls, flat: Array) -> Lines:
        """Return the sums held in (..., 22) numbers."""
        lead = flat.shape[:-1]
        parts = np.split(flat, [4, 6, 10, 18], axis=-1)
        tails = ((2, 2), (2,), (2, 2), (2, 2, 2), (2, 2))
        return cls(*(part.reshape(*lead, *tail) for part, tail in zip(parts, tails, strict=True)))

    def flatten(self) -> Array:
        """Return all numbers, shape (..., 22)."""
        lead = self.vector.shape[:-1]
        return np.concatenate([part.reshape(*lead, -1) for part in self], axis=-1)

    def add(self, place: Array, azimuth: Array, variance: ArrayLike) -> Lines:
        """Return the sums with one more line; where its azimuth or its place is NaN, as they are.

        Parameters
        ----------
        place : ndarray, shape (..., >= 2)
            Platform [m]; count from a point near the track to lose no digits.
        azimuth : ndarray, shape (...)
            [rad]
        variance : array_like, shape (...)
            Of the azimuth [rad^2].
        """
        p = np.broadcast_to(place[..., :2], (*azimuth.shape, 2))
        there = np.isfinite(azimuth) & np.isfinite(p).all(axis=-1)
        p = np.where(there[..., None], p, 0.0)
        angle = np.where(there, azimuth, 0.0)
        n = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        outer = np.where(there[..., None, None], n[..., :, None] * n[..., None, :], 0.0)
        scaled = outer * np.where(there, variance, 0.0)[..., None, None]
        return Lines(
            self.information + outer,
            self.vector + np.einsum("...ij,...j->...i", outer, p),
            self.weight + scaled,
            self.moment + scaled[..., None] * p[..., None, None, :],
            self.square + scaled * np.einsum("...i,...i->...", p, p)[..., None, None],
        )

    def fix(self, sigma_position: float = 0.0) -> tuple[Array, Array]:
        """Return the point (..., 2) and its covariance (..., 2, 2); NaN for fewer than two directions."""
        a = self.information
        determinant = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
        trace = a[..., 0, 0] + a[..., 1, 1]
        usable = determinant > _SINGULAR * (0.25 * trace * trace)
        inverse = np.empty_like(a)
        inverse[..., 0, 0], inverse[..., 1, 1] = a[..., 1, 1], a[..., 0, 0]
        inverse[..., 0, 1], inverse[..., 1, 0] = -a[..., 0, 1], -a[..., 1, 0]
        inverse = inverse / np.where(usable, determinant, np.nan)[..., None, None]
        x = np.einsum("...ij,...j->...i", inverse, self.vector)
        distant = (
            np.einsum("...i,...i->...", x, x)[..., None, None] * self.weight
            - 2 * np.einsum("...ijk,...k->...ij", self.moment, x)
            + self.square
            + sigma_position**2 * a
        )
        return x, inverse @ distant @ inverse


def instrumental_variable(
    azimuth: Array, variance: Array, places: Array, start: Array, iterations: int = 3, sigma_position: float = 0.0
) -> tuple[Array, Array]:
    r"""Return the weighted instrumental-variable point of all lines of bearing.

    .. math:: \hat x = (G^T W A)^{-1} G^T W b, \qquad W = \mathrm{diag}\frac{1}{r_i^2\sigma_i^2 + \sigma_{xy}^2}

    Rows of A are the measured normals :math:`n(\theta_i)`, those of G the normals towards the last estimate: nearly
    without the noise of A, which takes away the bias of least squares. Dogancay, *Passive emitter localization using
    weighted instrumental variables*, Signal Processing 84 (2004) 487-497.

    Parameters
    ----------
    azimuth, variance : ndarray, shape (..., k)
        [rad], [rad^2]; a line with a NaN azimuth is left out.
    places : ndarray, shape (..., k, >= 2)
        Platforms [m].
    start : ndarray, shape (..., 2)
        First estimate [m], such as that of `Lines`.
    iterations : int
        How often the instruments are renewed.
    sigma_position : float
        Error of a platform's position per axis [m].

    Returns
    -------
    position : ndarray, shape (..., 2)
    covariance : ndarray, shape (..., 2, 2)
        :math:`(G^T W G)^{-1}` of the last instruments; NaN where there is no solution.
    """
    place = places[..., :2]
    there = np.isfinite(azimuth) & np.isfinite(place).all(axis=-1)
    angle = np.where(there, azimuth, 0.0)
    place = np.where(there[..., None], place, 0.0)
    sine, cosine = np.sin(angle), np.cos(angle)
    distance_of_line = cosine * place[..., 1] - sine * place[..., 0]
    x = np.array(start, dtype=float)
    covariance = np.full((*x.shape, 2), np.nan)
    gap = None if there.all() else ~there
    for _ in range(iterations):
        dx, dy = x[..., None, 0] - place[..., 0], x[..., None, 1] - place[..., 1]
        square = dx * dx + dy * dy
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = 1 / (square * variance + sigma_position**2)
            scaled = weight / np.sqrt(square)
        if gap is not None:
            weight, scaled = np.where(gap, 0.0, weight), np.where(gap, 0.0, scaled)
        with np.errstate(invalid="ignore"):  # an estimate on a platform: no direction, and no solution at this epoch
            gx, gy = -dy * scaled, dx * scaled
        m00, m01, m10, m11 = -dot(gx, sine), dot(gx, cosine), -dot(gy, sine), dot(gy, cosine)
        b0, b1 = dot(gx, distance_of_line), dot(gy, distance_of_line)
        # G^T W G: the unit normals are g over their weight.
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = scaled / weight if gap is None else np.where(gap, 0.0, scaled / weight)
            nx, ny = -dy * weight, dx * weight
            i00, i01, i11 = dot(gx, nx), dot(gx, ny), dot(gy, ny)
            determinant = m00 * m11 - m01 * m10
            x = np.stack([m11 * b0 - m01 * b1, m00 * b1 - m10 * b0], axis=-1) / determinant[..., None]
    determinant = i00 * i11 - i01 * i01
    determinant = np.where(determinant > _SINGULAR * (i00 + i11) ** 2, determinant, np.nan)
    covariance[..., 0, 0], covariance[..., 1, 1] = i11 / determinant, i00 / determinant
    covariance[..., 0, 1] = covariance[..., 1, 0] = -i01 / determinant
    return x, covariance
