"""The backward pass of a smoother: covariances and means of every epoch given the later ones too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.clocks import same_instant
from quietfix.systems.linear_algebra import cholesky, inverse_lower, symmetric

__all__ = ["Link", "backward", "ends", "link"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Link(NamedTuple):
    r"""How the belief of one epoch follows from that of the next one.

    .. math:: x^s = x + G\,(x^s_+ - x^-_+), \qquad P^s = B + G P^s_+ G^T

    Attributes
    ----------
    gain : ndarray, shape (..., n, n)
        G.
    rest : ndarray, shape (..., n, n)
        B, what the next state says nothing of.
    """

    gain: Array
    rest: Array


def link(covariance: Array, transition: Array, noise: Array) -> Link:
    r"""Return the link of an epoch to the next one.

    .. math:: G = P A^T (A P A^T + \Lambda)^{-1}, \qquad B = (I - G A) P (I - G A)^T + G \Lambda G^T

    Rauch, Tung and Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA J. 3 (1965) 1445-1450. B is
    :math:`P - G (A P A^T + \Lambda) G^T` written as a sum, as Joseph's form of an update is: what is subtracted there
    is nearly all of P.

    Parameters
    ----------
    covariance : ndarray, shape (..., n, n)
        P, positive definite.
    transition, noise : ndarray, shape (..., n, n) or (n, n)
        A and Lambda.
    """
    moved = transition @ covariance
    predicted = symmetric(moved @ np.swapaxes(transition, -1, -2)) + noise
    # by correlations: metres, metres a second and radians differ by many digits
    scale = 1 / np.sqrt(np.einsum("...ii->...i", predicted))
    inverse = inverse_lower(cholesky(predicted * scale[..., :, None] * scale[..., None, :])) * scale[..., None, :]
    gain = np.swapaxes(np.swapaxes(inverse, -1, -2) @ (inverse @ moved), -1, -2)
    kept = np.eye(covariance.shape[-1]) - gain @ transition
    rest = kept @ covariance @ np.swapaxes(kept, -1, -2) + gain @ noise @ np.swapaxes(gain, -1, -2)
    return Link(gain, symmetric(rest))


def ends(times: Array, lag: float | None) -> NDArray[np.intp]:
    """Return the last epoch whose measurement counts for each epoch, shape (time,).

    Parameters
    ----------
    times : ndarray, shape (time,)
        Epochs [s], increasing.
    lag : float, optional
        How long after it [s]; None: all of them.
    """
    if lag is None:
        return np.full(times.size, times.size - 1)
    last = np.searchsorted(times, times + lag, side="right") - 1
    following = np.minimum(last + 1, times.size - 1)
    near = [same_instant(float(a), float(b)) for a, b in zip(times[following], times + lag, strict=True)]
    return np.where(near, following, last)


def backward(
    covariances: Array,
    links: Link,
    last: NDArray[np.intp],
    means: Array | None = None,
    predicted: Array | None = None,
    linked: Mask | None = None,
) -> tuple[Array | None, Array]:
    """Return what each epoch's state is given the measurements up to another epoch.

    Parameters
    ----------
    covariances : ndarray, shape (time, trials, n, n)
        Given the measurements so far.
    links : Link
        Of each epoch to the next one, shapes (time - 1, trials, n, n).
    last : ndarray of int, shape (time,)
        See `ends`; it does not decrease.
    means : ndarray, shape (time, trials, n), optional
        Given the measurements so far.
    predicted : ndarray, shape (time - 1, trials, n), optional
        What the mean of each epoch makes of the next one.
    linked : ndarray of bool, shape (time - 1, trials), optional
        Where there is a link: without one a trial begins anew, from what it knew then.

    Returns
    -------
    means : ndarray, shape (time, trials, n), or None
    covariances : ndarray, shape (time, trials, n, n)
    """
    epochs = np.arange(len(last))
    ahead = last - epochs
    if (last == last[-1]).all():  # the same end: each epoch follows from its neighbour
        spans = [np.array([k]) for k in epochs[-2::-1]]
        of, mean = covariances.copy(), None if means is None else means.copy()
        sources = [k + 1 for k in spans]
    else:
        spans = [epochs[ahead >= step] for step in range(int(ahead.max()), 0, -1)]
        of, mean = covariances[last], None if means is None else means[last]
        sources = spans
    for i, (span, source) in enumerate(zip(spans, sources, strict=True)):
        # the epoch that the belief has come down to, as seen from the ones in `span`
        at = span if sources is not spans else span + int(ahead.max()) - i - 1
        gain, there = links.gain[at], None if linked is None else linked[at]
        found = links.rest[at] + gain @ of[source] @ np.swapaxes(gain, -1, -2)
        of[span] = found if there is None else np.where(there[..., None, None], found, covariances[at])
        if mean is not None:
            assert means is not None and predicted is not None
            moved = means[at] + (gain @ (mean[source] - predicted[at])[..., None])[..., 0]
            mean[span] = moved if there is None else np.where(there[..., None], moved, means[at])
    return mean, symmetric(of)
