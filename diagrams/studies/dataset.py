"""The logs of a run as an xarray Dataset in which states, rows and platforms go by their names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.quantities.states import POSITION, VELOCITY, columns, shared
from quietfix.diagrams.studies.described import UNKNOWN
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.shown import Shown
from quietfix.systems.signals import Component, EnsembleBlock, components_of

__all__ = ["BIAS_PORTS", "Shape", "states_of"]

Array = NDArray[np.float64]
Coordinates = dict[str, Any]

BIAS_PORTS = ("biases", "bias_sigmas")
"""Ports of estimators that know of biases; they are always kept."""

_BIASES = dict(zip(BIAS_PORTS, ("bias_estimate", "bias_sigma"), strict=True))
_BY_STATE = ("estimator", "trial", "time", "state")


def states_of(log: Array, count: int) -> Array:
    """Return a log of platforms (time, trials or 1, 6 p) as states (trials or 1, time, p, 6) of the first trials."""
    platforms = log.swapaxes(0, 1)[:count]
    return platforms.reshape(*platforms.shape[:2], -1, 6)


class Shape:
    """How the logs of a study become a Dataset.

    Parameters
    ----------
    wired : Assembly
        What is logged.
    keeps : callable
        Says of ``covariance``, ``prediction``, ``innovation``, ``measurement`` and each signal whether it is there.
    shared : collection of str
        Signals that all trials have in common; they have no dimension ``trial``.
    """

    def __init__(self, wired: Assembly, keeps: Callable[[str], bool], shared: Collection[str]) -> None:
        self._wired, self._keeps, self._shared = wired, keeps, shared
        self._blocks = list(wired.estimators.values())
        self._states, self._truth_states = wired.estimated_names, wired.truth_names
        self._platforms = wired.platform_names
        self._places = [columns(self._states, block.motion.reported.names) for block in self._blocks]
        self._rows = [_distinct(components_of(block.model)) for block in self._blocks]
        # of each estimator: the biases that stand behind its state, and whether they are estimated
        self._biases = [dict(_biases_of(block)) for block in self._blocks]
        # estimators that use other rows have them at the same place by their names
        self._innovations = list({row.name: row for rows in self._rows for row in rows}.values())

    def dataset(self, times: Array, signals: Mapping[str, Array], first: int, count: int) -> xr.Dataset:
        """Return a run's log as a Dataset, without the trials that only filled the batch.

        Parameters
        ----------
        times : ndarray, shape (time,) or (trials, epochs)
            Epochs [s]; of tracks of unequal length those of each, NaN beyond its end. The dimension of the Dataset is
            then ``epoch``, and ``time`` a coordinate (trial, epoch).
        signals : mapping of str to ndarray, shape (time, trials or 1, size)
            Logs by name.
        first, count : int
            Number of the first trial, and how many there are.
        """
        data = self._judged(signals, count) if self._blocks else {}
        epochs = times.shape[-1]
        coordinates = self._names(times if times.ndim == 1 else np.arange(float(epochs)), first, count)
        if self._keeps("covariance") and self._blocks:
            data["covariance"] = ((*_BY_STATE, "state_"), self._covariance(signals, count, epochs))
            coordinates["state_"] = list(self._states)
        if self._keeps("measurement"):
            log = signals["measurement"].swapaxes(0, 1)[:count]
            data["measurement"] = self._of_trials("measurement", log, ("time", "row"))
            coordinates |= _named("row", self._stream(log.shape[-1]))
        tallies = self._wired.tallies
        for name, port in {**self._wired.signals, **tallies}.items():
            if name in tallies or self._keeps(name):
                log = signals[name].swapaxes(0, 1)[:count]
                carried = _carried(port, log.shape[-1])
                about = {"long_name": f"{port.get_name().replace('_', ' ')} of {port.get_system().get_name()}"}
                if len(carried) == 1:
                    about["units"] = carried[0].unit or UNKNOWN
                else:
                    coordinates |= _named(f"{name}_row", carried)
                data[name] = (*self._of_trials(name, log, ("time", f"{name}_row")), about)
        if self._keeps("prediction") and self._blocks:
            data["prediction"] = (_BY_STATE, self._by_state("prediction", signals, count))
        if self._keeps("innovation") and self._blocks:
            data["innovation"] = ((*_BY_STATE[:3], "innovation_row"), self._innovation(signals, count))
            coordinates |= _named("innovation_row", self._innovations)
            owned = [{row.name for row in rows} for rows in self._rows]
            has = [[row.name in own for row in self._innovations] for own in owned]
            coordinates["in_innovation"] = (("estimator", "innovation_row"), has)
        dataset = xr.Dataset(data, coordinates)
        if times.ndim == 1:
            return dataset
        return dataset.drop_vars("time").rename_dims(time="epoch").assign_coords(time=(("trial", "epoch"), times))

    def _judged(self, signals: Mapping[str, Array], count: int) -> dict[str, Any]:
        """Return the truth, what the estimators made of it, and the platforms."""
        return {
            "truth": self._of_trials("truth", self._truth(signals, count), ("time", "state")),
            "estimate": (_BY_STATE, self._by_state("estimate", signals, count)),
            **{
                port: (_BY_STATE[:3], self._numbers(port, signals, count))
                for port in ("nees", "nis", "nis_dof", "lost")
            },
            **self._of_biases(signals, count),
            "platforms": self._of_trials(
                "platforms", states_of(signals["platforms"], count), ("time", "platform", "coordinate")
            ),
        }

    def _names(self, times: Array, first: int, count: int) -> Coordinates:
        when: Coordinates = {"trial": np.arange(first, first + count), "time": ("time", times)}
        if not self._blocks:
            return when
        motions = [block.motion.reported for block in self._blocks]
        units = {state: unit for motion in motions for state, unit in zip(motion.names, motion.units, strict=True)}
        axes = [*((axis, "m") for axis in POSITION), *((axis, "m/s") for axis in VELOCITY)]
        return {
            "estimator": list(self._wired.estimators),
            **when,
            "state": list(self._states),
            "state_units": ("state", [units[state] for state in self._states]),
            "in_truth": ("state", [state in self._truth_states for state in self._states]),
            "in_estimate": (
                ("estimator", "state"),
                [[state in motion.names for state in self._states] for motion in motions],
            ),
            "causal": ("estimator", [block.causal for block in self._blocks]),
            **self._bias_names(),
            "platform": list(self._platforms),
            **_named("coordinate", [Component(*axis) for axis in axes]),
        }

    def _stream(self, size: int) -> list[Component]:
        """Return names and units of the rows of the measurement stream."""
        named: Sequence[str] = self._wired.stream or ()
        if len(named) != size:
            streams = (block.wiring.stream for block in self._blocks)
            named = next((stream for stream in streams if len(stream) == size), [str(i) for i in range(size)])
        units = self._wired.row_units
        return [Component(name, units.get(name, "")) for name in named]

    def _bias_names(self) -> Coordinates:
        every = list(dict.fromkeys(one for own in self._biases for one in own))
        if not every:
            return {}
        estimated = [[own.get(one, False) for one in every] for own in self._biases]
        return {**_named("bias_row", every), "bias_estimated": (("estimator", "bias_row"), estimated)}

    # ---- values

    def _of_biases(self, signals: Mapping[str, Array], count: int) -> dict[str, Any]:
        """Return means and standard deviations of the biases; NaN where an estimator has none of that name."""
        every = list(dict.fromkeys(one for own in self._biases for one in own))
        if not every:
            return {}
        found = {
            name: np.full((len(self._blocks), count, len(signals["truth"]), len(every)), np.nan) for name in _BIASES
        }
        for i, (name, own) in enumerate(zip(self._wired.estimators, self._biases, strict=True)):
            for port, whole in found.items() if own else ():
                whole[i][..., [every.index(one) for one in own]] = signals[f"{name}/{port}"].swapaxes(0, 1)[:count]
        return {_BIASES[port]: ((*_BY_STATE[:3], "bias_row"), whole) for port, whole in found.items()}

    def _of_trials(self, signal: str, log: Array, dims: Sequence[str]) -> tuple[tuple[str, ...], Array]:
        """Return dimensions and values of a log (trials or 1, time, ...): the trials left out where all share it."""
        return (tuple(dims), log[0]) if signal in self._shared else (("trial", *dims), log)

    def _logs(self, port: str, signals: Mapping[str, Array], count: int) -> list[tuple[Estimator, Array]]:
        """Return the logs (trial, time, k) of a port of every estimator."""
        named = self._wired.estimators.items()
        return [(block, signals[f"{name}/{port}"].swapaxes(0, 1)[:count]) for name, block in named]

    def _truth(self, signals: Mapping[str, Array], count: int) -> Array:
        """Return the truth (trials or 1, time, state); it may lack states of the estimators, and the other way."""
        logged = signals["truth"].swapaxes(0, 1)[:count]
        both = shared(self._states, self._truth_states)
        truth = np.full((*logged.shape[:2], len(self._states)), np.nan)
        truth[..., columns(self._states, both)] = logged[..., columns(self._truth_states, both)]
        return truth

    def _numbers(self, port: str, signals: Mapping[str, Array], count: int) -> Array:
        return np.stack([log[..., 0] for _, log in self._logs(port, signals, count)])

    def _by_state(self, port: str, signals: Mapping[str, Array], count: int) -> Array:
        return self._placed(port, signals, count, self._places, len(self._states))

    def _innovation(self, signals: Mapping[str, Array], count: int) -> Array:
        names = [row.name for row in self._innovations]
        places = [columns(names, [row.name for row in rows]) for rows in self._rows]
        return self._placed("innovation", signals, count, places, len(names))

    def _placed(
        self, port: str, signals: Mapping[str, Array], count: int, places: Sequence[slice | list[int]], size: int
    ) -> Array:
        """Return (trial, time, n) logs of a port by the names of their components, (estimator, trial, time, size)."""
        logs = self._logs(port, signals, count)
        stacked = np.full((len(logs), *logs[0][1].shape[:2], size), np.nan)
        for i, (_, log) in enumerate(logs):
            stacked[i][..., places[i]] = log
        return stacked

    def _covariance(self, signals: Mapping[str, Array], count: int, epochs: int) -> Array:
        size = len(self._states)
        square = np.full((len(self._blocks), count, epochs, size, size), np.nan)
        for i, (_, log) in enumerate(self._logs("covariance", signals, count)):
            here = np.arange(size)[self._places[i]]
            square[i][..., here[:, None], here] = log.reshape(count, epochs, here.size, here.size)
        return square


def _biases_of(block: Estimator) -> list[tuple[Component, bool]]:
    """Return the biases behind an estimator's state, and of each whether it is estimated."""
    motion, shown = block.motion, Shown(block.motion)
    return [(one, shown.size + i not in motion.considered) for i, one in enumerate(shown.biases)]


def _named(dimension: str, components: Sequence[Component]) -> Coordinates:
    """Return the coordinates of a dimension: names, and their units under ``DIMENSION_units``."""
    return {
        dimension: [one.name for one in components],
        f"{dimension}_units": (dimension, [one.unit for one in components]),
    }


def _carried(port: Any, size: int) -> list[Component]:
    """Return what the numbers on a port are; by their place, where its block does not say it."""
    block = port.get_system()
    found = block.components(port.get_name()) if isinstance(block, EnsembleBlock) else ()
    return _distinct(found) if len(found) == size else [Component(str(i), "") for i in range(size)]


def _distinct(components: Sequence[Component]) -> list[Component]:
    """Return components none of which has the name of another; a user's own model may repeat one."""
    found: dict[str, Component] = {}
    for one in components:
        name, again = one.name, 2
        while name in found:
            name, again = f"{one.name}_{again}", again + 1
        found[name] = Component(name, one.unit)
    return list(found.values())
