"""Which of several candidate orbits is the true one: their planes are clustered, and the true plane stays put."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import linkage
from scipy.spatial.distance import pdist, squareform

__all__ = ["Pattern", "cluster_centre", "common_plane", "normal_of_pattern", "plane_distance", "plane_normal"]
__all__ += ["plane_pattern"]

Array = NDArray[np.float64]
Pattern = Literal["slopes", "normal"]


def plane_pattern(states: Array) -> Array:
    r"""Return (a, b) of the orbit plane :math:`a x + b y = z`.

    Eq. (28) of Wu, Xin and Wan: :math:`a = -h_x/h_z`, :math:`b = -h_y/h_z` with the angular momentum h. It
    diverges for an orbit over the poles.

    Parameters
    ----------
    states : ndarray, shape (..., 6)
        Inertial position and velocity.

    Returns
    -------
    ndarray, shape (..., 2)
    """
    h = np.cross(states[..., :3], states[..., 3:6])
    return -h[..., :2] / h[..., 2:]


def plane_normal(states: Array) -> Array:
    """Return the unit vector of the angular momentum of states (..., 6), shape (..., 3)."""
    h = np.cross(states[..., :3], states[..., 3:6])
    return h / np.linalg.norm(h, axis=-1, keepdims=True)


def normal_of_pattern(pattern: Array) -> Array:
    """Return a unit normal, up to its sign, of planes given by (a, b)."""
    normal = np.concatenate([-pattern, np.ones_like(pattern[..., :1])], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def plane_distance(positions: Array, normal: Array) -> Array:
    """Return the distances [m] of positions (..., m, 3) from planes through the centre with `normal` (..., 3)."""
    return np.abs(np.einsum("...mi,...i->...m", positions, normal))


def cluster_centre(patterns: Array) -> tuple[Array, int]:
    """Return the centre of the largest cluster of patterns, and how many patterns are in it.

    Agglomerative clustering as in section 3.1 of Wu, Xin and Wan, by SciPy's `linkage`: the two nearest clusters are
    merged until one of them has a member from every epoch. Patterns of one epoch exclude each other (at most one of
    them is true), so their distance is set larger than any other, and clusters are as far apart as their farthest
    members.

    Parameters
    ----------
    patterns : ndarray, shape (epochs, roots, size)
        NaN where there is no root.

    Returns
    -------
    centre : ndarray, shape (size,)
        Mean of the cluster; NaN if there is no pattern at all.
    members : int
        If no cluster reaches every epoch that has a root, this is the largest one, of several the narrowest.
    """
    epochs, roots, size = patterns.shape
    flat = patterns.reshape(-1, size)
    good = np.isfinite(flat).all(axis=-1)
    points, epoch = flat[good], np.repeat(np.arange(epochs), roots)[good]
    if len(points) == 0:
        return np.full(size, np.nan), 0
    if len(points) == 1:
        return points[0], 1
    apart = pdist(points)
    excluded = 2 * apart.max() + 1.0
    square = squareform(apart)
    square[epoch[:, None] == epoch[None, :]] = excluded
    np.fill_diagonal(square, 0.0)
    merges = linkage(squareform(square, checks=False), method="complete")
    clusters = [[i] for i in range(len(points))]
    wanted = np.unique(epoch).size
    best = clusters[0]
    for left, right, height, _ in merges:
        if height >= excluded:
            break
        joined = clusters[int(left)] + clusters[int(right)]
        clusters.append(joined)
        if len(joined) > len(best):
            best = joined
        if len(best) == wanted:
            break
    return points[best].mean(axis=0), len(best)


def common_plane(states: Array, pattern: Pattern = "slopes") -> tuple[Array, Array]:
    """Return the plane in which candidates of several epochs agree best.

    Parameters
    ----------
    states : ndarray, shape (trials, epochs, roots, 6)
        Inertial states of the candidates; NaN where there is none.
    pattern : {'slopes', 'normal'}
        What is clustered: (a, b) as in the paper, or the unit normal.

    Returns
    -------
    normal : ndarray, shape (trials, 3)
        Unit normal in the sense of the angular momentum; NaN in a trial without candidates.
    members : ndarray, shape (trials,)
        Epochs that agree.
    """
    if pattern not in ("slopes", "normal"):
        raise ValueError(f"pattern: {pattern} is not allowed; slopes or normal")
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = plane_normal(states)
        patterns = normals if pattern == "normal" else plane_pattern(states)
    found = [cluster_centre(each) for each in patterns]
    centres = np.array([centre for centre, _ in found])
    members = np.array([count for _, count in found])
    if pattern == "normal":
        return centres / np.linalg.norm(centres, axis=-1, keepdims=True), members
    normal = normal_of_pattern(centres)
    # the slopes do not know which way round the orbit is gone; most candidates near the plane do
    side = np.einsum("teri,ti->ter", normals, normal)
    votes = np.nansum(np.where(np.abs(side) > 0.9, np.sign(side), 0.0), axis=(1, 2))
    return normal * np.where(votes < 0, -1.0, 1.0)[:, None], members
