r"""Fine search: a parabola on the coarse grid, then Newton's iteration on log |A|^2.

The delayed second channel and its derivatives with respect to the delay come from its Fourier transform, exactly.
Their products with the first channel are summed over sub-blocks,

.. math:: q^{(k)}_b = \sum_{n\in b} \bar x_n\, y^{(k)}_n(\tau_0)\, e^{-2\pi j f_0 t_n},\qquad
          A(\tau_0 + \epsilon, f_0 + \delta) = \sum_b \sum_{k=0}^3 \frac{s_b^k}{k!} q^{(k)}_b\, e^{-2\pi j\delta t_b},
          \quad s_b = \epsilon + \dot\tau t_b,

so that an iteration costs a few hundred operations; where it has led far from tau_0, everything is computed anew about
there. The rate of the delay, where it is known, is followed as well.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from quietfix.systems.ambiguity.phasor import phasor

__all__ = ["Peak", "parabola", "refine"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex64]

_SUBBLOCKS = 256
_PASSES = 4
_ITERATIONS = 8
_SETTLED = 0.05  # cells of delay; what the expansion leaves out is then 1e-4 of that
_ORDERS = 4
_STEP = 0.5  # cells; the longest step of an iteration
_FARTHEST = 1.5  # cells; beyond, it is another peak
_FLATTEST = 0.05  # least curvature, of the expected one


class Peak(NamedTuple):
    """A refined peak, over trials.

    Attributes
    ----------
    delay, frequency : ndarray, shape (trials,)
        [samples], [cycles per sample].
    amplitude : ndarray of complex, shape (trials,)
        A there.
    curvature : ndarray, shape (trials, 2)
        Of -log |A|^2 along delay and frequency [1/samples^2], [samples^2], at the peak.
    quadrature, spread, lever, centre : ndarray, shape (trials,)
        Of the cross-spectrum at the peak, turned to the phase of A: sum of the squares of its imaginary part; the same
        weighted by w^2, w from its centre [rad/sample]; its real part weighted by w^2, over A; and that centre.
    lost : ndarray of bool, shape (trials,)
        Whether the iteration has left the cell; delay and frequency are then where it began.
    """

    delay: Array
    frequency: Array
    amplitude: NDArray[np.complex128]
    curvature: Array
    quadrature: Array
    spread: Array
    lever: Array
    centre: Array
    lost: NDArray[np.bool_]


def _quadratic() -> Array:
    """Return the least-squares fit of 1, u, v, u^2, uv, v^2 to nine values about a middle, shape (6, 9)."""
    u, v = np.repeat([-1.0, 0.0, 1.0], 3), np.tile([-1.0, 0.0, 1.0], 3)
    return np.linalg.pinv(np.stack([np.ones(9), u, v, u * u, u * v, v * v], axis=1))


_FIT = _quadratic()


def parabola(power: Array) -> Array:
    """Return where the maximum of a parabola through log powers lies.

    Parameters
    ----------
    power : ndarray, shape (trials, 3, 3)
        About the highest grid point.

    Returns
    -------
    ndarray, shape (trials, 2)
        Offset from the middle [grid steps], at most 1 along each axis; 0 where the parabola has no maximum.
    """
    tiny = np.finfo(np.float64).tiny
    values = np.log(np.maximum(power.reshape(-1, 9).astype(float), tiny))
    _, a, b, aa, ab, bb = np.einsum("ij,nj->in", _FIT, values)
    determinant = 4 * aa * bb - ab * ab
    maximum = (aa < 0) & (determinant > 0)
    determinant = np.where(maximum, determinant, 1.0)
    offset = np.stack([(ab * b - 2 * bb * a) / determinant, (ab * a - 2 * aa * b) / determinant], axis=-1)
    return np.where(maximum[:, None], np.clip(offset, -1.0, 1.0), 0.0)


def refine(
    first: Complex, second: Complex, delay: Array, frequency: Array, cell: Array, curvature: Array, rate: Array
) -> Peak:
    """Return the peaks of |A| near where the parabola has put them.

    Parameters
    ----------
    first, second : ndarray of complex, shape (trials, n)
        The two channels, the second one cut so that the delay left is about one sample at most.
    delay, frequency : ndarray, shape (trials,)
        Where to begin [samples], [cycles per sample].
    cell : ndarray, shape (2,)
        Size of a cell [samples], [cycles per sample].
    curvature : ndarray, shape (2,)
        Expected curvature of -log |A|^2 [1/samples^2], [samples^2].
    rate : ndarray, shape (trials,)
        Rate of the delay [samples per sample].

    Returns
    -------
    Peak
    """
    trials = first.shape[0]
    spectrum = fft.fft(second, axis=-1)
    found = np.stack([delay, frequency], axis=-1)
    start = found.copy()
    lost = np.zeros(trials, dtype=bool)
    amplitude = np.zeros(trials, dtype=complex)
    bend = np.tile(curvature, (trials, 1))
    active = np.arange(trials)
    for _ in range(_PASSES):
        moments = _Moments(first[active], spectrum[active], found[active], rate[active])
        offset, here, curved = _newton(moments, cell, curvature)
        moved = found[active] + offset
        away = np.any(np.abs(moved - start[active]) > _FARTHEST * cell, axis=-1)
        lost[active] = away
        found[active] = np.where(away[:, None], start[active], moved)
        amplitude[active], bend[active] = here, curved
        active = active[~away & (np.abs(offset[:, 0]) > _SETTLED * cell[0])]
        if active.size == 0:
            break
    return Peak(found[:, 0], found[:, 1], amplitude, bend, *_cross_spectrum(first, spectrum, found), lost)


@lru_cache(maxsize=8)
def _angular(size: int) -> Array:
    w: Array = 2 * np.pi * fft.fftfreq(size)
    w.setflags(write=False)
    return w


@lru_cache(maxsize=8)
def _angular_squared(size: int) -> Array:
    ww: Array = np.square(_angular(size))
    ww.setflags(write=False)
    return ww


@lru_cache(maxsize=8)
def _differentiator(size: int) -> Complex:
    table: Complex = (1j * _angular(size)).astype(np.complex64)
    table.setflags(write=False)
    return table


def _ramp(size: int, delay: Array) -> Complex:
    """Return ``exp(j w delay)`` in the order of the transform, shape (trials, size)."""
    half = size // 2
    turned = phasor(delay / size, -half, size)
    return np.concatenate([turned[:, half:], turned[:, :half]], axis=-1)


class _Moments:
    """Sums over sub-blocks about a point: q and its three derivatives, of shape (trials, 4, blocks)."""

    def __init__(self, first: Complex, spectrum: Complex, at: Array, rate: Array) -> None:
        trials, size = first.shape
        length = -(-size // _SUBBLOCKS)
        blocks = -(-size // length)
        turned = np.empty((trials, _ORDERS, size), dtype=np.complex64)
        np.multiply(spectrum, _ramp(size, at[:, 0]), out=turned[:, 0])
        for order in range(1, _ORDERS):
            np.multiply(turned[:, order - 1], _differentiator(size), out=turned[:, order])
        shifted = fft.ifft(turned, axis=-1, overwrite_x=True)
        middle = 0.5 * (size - 1)
        mixed = np.conjugate(first) * phasor(-at[:, 1], -middle, size)
        if blocks * length != size:
            extra = blocks * length - size
            mixed = np.pad(mixed, ((0, 0), (0, extra)))
            shifted = np.pad(shifted, ((0, 0), (0, 0), (0, extra)))
        self.sums = np.einsum(
            "nbl,nkbl->nkb", mixed.reshape(trials, blocks, length), shifted.reshape(trials, _ORDERS, blocks, length)
        ).astype(complex)
        self.time = (np.arange(blocks) + 0.5) * length - 0.5 - middle
        self.drift = rate[:, None] * self.time

    def derivatives(self, offset: Array) -> tuple[NDArray[np.complex128], ...]:
        """Return A, A_tau, A_f, A_tautau, A_tauf, A_ff at an offset (trials, 2)."""
        q, q1, q2, q3 = np.moveaxis(self.sums, 1, 0)
        s = offset[:, :1] + self.drift
        turn = np.exp(-2j * np.pi * offset[:, 1:] * self.time)
        value = (q + s * (q1 + s * (q2 / 2 + s * q3 / 6))) * turn
        slope, bend = (q1 + s * (q2 + s * q3 / 2)) * turn, (q2 + s * q3) * turn
        along = -2j * np.pi * self.time
        return (
            value.sum(-1),
            slope.sum(-1),
            (along * value).sum(-1),
            bend.sum(-1),
            (along * slope).sum(-1),
            (along * along * value).sum(-1),
        )


def _gradient(parts: tuple[NDArray[np.complex128], ...]) -> tuple[Array, Array]:
    """Return gradient (trials, 2) and Hessian (trials, 2, 2) of log |A|^2."""
    a = parts[0]
    t, f, tt, tf, ff = (part / np.where(a == 0, 1.0, a) for part in parts[1:])
    gradient = 2 * np.stack([t.real, f.real], axis=-1)
    hessian = 2 * np.stack([(tt - t * t).real, (tf - t * f).real, (tf - t * f).real, (ff - f * f).real], axis=-1)
    return gradient, hessian.reshape(-1, 2, 2)


def _newton(moments: _Moments, cell: Array, curvature: Array) -> tuple[Array, NDArray[np.complex128], Array]:
    """Return offset (trials, 2), A and the curvature (trials, 2) at the maximum next to the middle.

    Where the Hessian has an eigenvalue that is not clearly negative, a least curvature takes its place: the step then
    still leads uphill.
    """
    trials = moments.sums.shape[0]
    offset = np.zeros((trials, 2))
    going = np.ones((trials, 1), dtype=bool)
    floor = _FLATTEST * float(np.min(curvature * np.square(cell)))
    for _ in range(_ITERATIONS):
        gradient, hessian = _gradient(moments.derivatives(offset))
        # in cells, so that the two axes compare
        values, vectors = np.linalg.eigh(-hessian * cell[:, None] * cell)
        along = np.einsum("nij,ni->nj", vectors, gradient * cell) / np.maximum(values, floor)
        step = np.einsum("nij,nj->ni", vectors, along)
        longest = np.abs(step).max(axis=-1, keepdims=True)
        step *= np.minimum(1.0, _STEP / np.maximum(longest, _STEP))
        offset += np.where(going, step * cell, 0.0)
        going &= longest >= 1e-9  # each trial stops by itself
        if not going.any():
            break
    parts = moments.derivatives(offset)
    _, hessian = _gradient(parts)
    return offset, parts[0], -np.stack([hessian[:, 0, 0], hessian[:, 1, 1]], axis=-1)


def _cross_spectrum(first: Complex, spectrum: Complex, at: Array) -> tuple[Array, Array, Array, Array]:
    size = first.shape[-1]
    x = fft.fft(first * phasor(at[:, 1], -0.5 * (size - 1), size), axis=-1)
    cross = np.conjugate(x, out=x) * spectrum
    cross *= _ramp(size, at[:, 0])
    total = cross.sum(axis=-1, dtype=complex)
    length = np.abs(total)
    cross *= (np.conjugate(total) / np.where(length == 0, 1.0, length)).astype(np.complex64)[:, None]
    w, ww = _angular(size), _angular_squared(size)
    # a transform of n samples: sums over bins are n times sums over samples
    real, imag = cross.real.astype(float), np.square(cross.imag, dtype=float) / size**2
    scale = np.where(length == 0, 1.0, real.sum(axis=-1))
    middle = (w * real).sum(axis=-1) / scale
    lever = (ww * real).sum(axis=-1) / scale - np.square(middle)
    quadrature = imag.sum(axis=-1)
    spread = (ww * imag).sum(axis=-1) - 2 * middle * (w * imag).sum(axis=-1) + np.square(middle) * quadrature
    return quadrature, spread, lever, middle
