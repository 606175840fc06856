"""Kalman's update without rounding: fractions instead of floating point."""

from fractions import Fraction

import numpy as np

__all__ = ["exact", "exact_update", "solve_exactly"]


def exact(array):
    """Return the very numbers that the doubles are, as fractions."""
    return np.vectorize(Fraction, otypes=[object])(array)


def solve_exactly(a, b):
    """Gauss-Jordan elimination of fractions: no rounding at all."""
    a, b = a.copy(), b.copy()
    for i in range(len(a)):
        pivot = i + int(np.argmax(np.abs(a[i:, i])))
        a[[i, pivot]], b[[i, pivot]] = a[[pivot, i]], b[[pivot, i]]
        a[i], b[i] = a[i] / a[i, i], b[i] / a[i, i]
        for j in range(len(a)):
            if j != i:
                a[j], b[j] = a[j] - a[j, i] * a[i], b[j] - a[j, i] * b[i]
    return b


def exact_update(mean, covariance, h, r, z):
    """Kalman's update without rounding: mean, covariance, normalised innovation squared."""
    mean, covariance, h, r, z = (exact(array) for array in (mean, covariance, h, r, z))
    innovation = z - h @ mean
    s = h @ covariance @ h.T + r
    gain = solve_exactly(s, h @ covariance).T
    nis = innovation @ solve_exactly(s, innovation[:, None])[:, 0]
    return (mean + gain @ innovation).astype(float), (covariance - gain @ s @ gain.T).astype(float), float(nis)
