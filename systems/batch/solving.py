"""Levenberg-Marquardt over a window, with rows left out that do not fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.batch.window import Path, Window
from quietfix.systems.filters.observation import Linearised

__all__ = ["Rule", "Solution", "solve"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FIRST_DAMPING, _GROWS, _MOST_DAMPING = 1e-3, 10.0, 1e8
_EDITS = 4  # times at most that rows are chosen anew


@dataclass(frozen=True)
class Rule:
    """When to stop, and what is left out.

    Attributes
    ----------
    max_iterations : int
        Steps at most, those that are refused too.
    tolerance : float
        A step that makes J smaller by less than this is the last one; J is counted in squared sigmas.
    edit_sigmas : float, optional
        Rows further off the solution than so many sigmas of their noise are left out; None: none.
    """

    max_iterations: int = 20
    tolerance: float = 1e-6
    edit_sigmas: float | None = None


class Solution(NamedTuple):
    """The best path, its states, the covariance of the last one, and what is left out.

    Attributes
    ----------
    path : Path
    states : list of ndarray, shape (trials, n)
    covariance : ndarray, shape (trials, n, n)
    edited : ndarray of bool, shape (trials, epochs, m)
    """

    path: Path
    states: list[Array]
    covariance: Array
    edited: Mask


def solve(window: Window, path: Path, rule: Rule) -> Solution:
    """Return the path of least J, from a first guess.

    Every trial is damped, stops and leaves out rows by itself; none changes another's result.

    Parameters
    ----------
    window : Window
    path : Path
        First guess.
    rule : Rule
    """
    whole = window
    edited: Mask = np.zeros((len(window.mean), len(window.steps), window.model.size), dtype=bool)
    everyone: Mask = np.ones(len(window.mean), dtype=bool)
    path = _descend(window, path, rule, everyone)
    sigmas = np.stack(np.broadcast_arrays(*(one.sigmas for one in whole.observations)), axis=-2)
    for _ in range(_EDITS if rule.edit_sigmas is not None else 0):
        off = np.stack([_off(one) for one in whole.looked_at(whole.states(path))], axis=1)
        chosen = np.abs(off) > (rule.edit_sigmas or np.inf) * sigmas
        changed: Mask = np.any(chosen != edited, axis=(-1, -2))
        if not changed.any():
            break
        edited = chosen
        left = [one.without(edited[:, k]) for k, one in enumerate(whole.observations)]
        window = replace(whole, observations=left)
        path = _descend(window, path, rule, changed)
    states = window.states(path)
    _, covariance = window.step(path, states, window.looked_at(states), np.zeros(len(window.mean)))
    return Solution(path, states, covariance, edited)


def _off(one: Linearised) -> Array:
    """Return innovations with NaN, which is beyond no limit, where rows are missing."""
    return one.innovation if one.missing is None else np.where(one.missing, np.nan, one.innovation)


def _descend(window: Window, path: Path, rule: Rule, active: Mask) -> Path:
    """Return the path of least J of the trials that are `active`; others stay where they are."""
    states = window.states(path)
    seen = window.looked_at(states)
    cost, rows = window.cost(path, seen)
    damping = np.zeros(len(cost))
    active = active & np.isfinite(cost)
    for _ in range(rule.max_iterations):
        if not active.any():
            break
        tried, _ = window.step(path, states, seen, damping)
        there = window.states(tried)
        looked = window.looked_at(there)
        new, used = window.cost(tried, looked)
        # a path where the model has no value for a row that it had before is none
        better = active & np.isfinite(new) & (new <= cost) & (used >= rows)
        done = (better & (cost - new < rule.tolerance)) | (~better & (damping > _MOST_DAMPING))
        # at the minimum rounding may make a step that is nearly nothing look worse
        done |= ~better & np.isfinite(new) & (used >= rows) & (new - cost < 1e-9 * (1 + cost)) & (damping == 0)
        path = Path(*(_chosen(better, a, b) for a, b in zip(tried, path, strict=True)))
        states = [_chosen(better, a, b) for a, b in zip(there, states, strict=True)]
        seen = [_mixed(better, a, b) for a, b in zip(looked, seen, strict=True)]
        cost, rows = np.where(better, new, cost), np.where(better, used, rows)
        eased = np.where(damping > _FIRST_DAMPING, damping / _GROWS, 0.0)
        damping = np.where(better, eased, np.maximum(damping * _GROWS, _FIRST_DAMPING))
        active = active & ~done
    return path


def _chosen(which: Mask, one: Any, other: Any) -> Any:
    return np.where(which.reshape(-1, *[1] * (one.ndim - 1)), one, other)


def _mixed(which: Mask, one: Linearised, other: Linearised) -> Linearised:
    """Return of some trials one linearisation, of the rest another."""
    if which.all():
        return one
    none = np.zeros(one.innovation.shape, dtype=bool)
    missing = [none if part.missing is None else part.missing for part in (one, other)]
    rows = one.innovation.shape[-1]
    weights = [np.broadcast_to(part.weight, (len(which), rows, rows)) for part in (one, other)]
    return Linearised(
        _chosen(which, one.innovation, other.innovation),
        _chosen(which, one.jacobian, other.jacobian),
        _chosen(which, *weights),
        _chosen(which, *missing),
    )
