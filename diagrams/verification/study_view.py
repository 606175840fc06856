"""What a requirement sees of a study: what is known before it runs, and a chunk of its result with the errors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.quantities.frame import UNITS, Frame
from quietfix.diagrams.quantities.states import shared
from quietfix.diagrams.statistics.state_errors import NEEDED, axis_errors, errors

__all__ = ["StudyFacts", "StudyView"]

Array = NDArray[np.float64]


class StudyFacts:
    """What is known of a study before it has run.

    Parameters
    ----------
    wired : Assembly
        The diagram of the study.
    """

    def __init__(self, wired: Assembly) -> None:
        self.epochs: Array = np.asarray(wired.clock.ticks(wired.duration), dtype=float)
        self.divergence = wired.model.divergence
        self.threshold = wired.model.convergence
        self.estimators = list(wired.estimators)
        # as a study has it: the states that estimator and truth both have
        models = {name: estimator.motion.reported for name, estimator in wired.estimators.items()}
        self.units = {state: u for m in models.values() for state, u in zip(m.names, m.units, strict=True)}
        judged = shared(wired.estimated_names, wired.truth_names)
        self.states = {name: list(shared(motion.names, judged)) for name, motion in models.items()}
        self.quantities = {name: _quantities(states, judged, wired.model.axes) for name, states in self.states.items()}

    def unit(self, of: str) -> str:
        """Return the unit of a quantity or component."""
        return UNITS.get(of) or self.units.get(of, "")


def _quantities(states: Sequence[str], judged: Sequence[str], frame: Frame) -> list[str]:
    """Return what `state_errors` finds of those components, where the study judges more."""
    found = [of for of in frame.quantities(judged) if set(shared(NEEDED[of], judged)) <= set(states)]
    return list(dict.fromkeys([*found, *states]))


class StudyView:
    """A chunk of a study with its errors, computed once for all requirements.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `quietfix.diagrams.studies.study.Study.chunks`.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset = dataset

    @cached_property
    def _errors(self) -> xr.Dataset:
        return errors(self.dataset)

    @cached_property
    def _axes(self) -> xr.DataArray:
        return axis_errors(self.dataset)

    def error(self, estimator: str, of: str, epochs: NDArray[np.int_]) -> Array:
        """Return the error (trials, epochs); infinite in a lost trial, NaN where no truth is known."""
        if of in self._errors:
            found = self._errors[of].sel(estimator=estimator)
        else:
            found = self._axes.sel(estimator=estimator, state=of)
        return found.transpose("trial", "time").values[:, epochs]

    def number(self, name: str, estimator: str, epochs: NDArray[np.int_]) -> Array:
        """Return ``nees``, ``nis`` or ``nis_dof`` (trials, epochs)."""
        return self.dataset[name].sel(estimator=estimator).transpose("trial", "time").values[:, epochs]

    def lost(self, estimator: str, epochs: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return in which trials the estimate is not finite at the last of the epochs; it may begin late."""
        return np.isinf(self.error(estimator, "position", epochs[-1:])[:, 0])
