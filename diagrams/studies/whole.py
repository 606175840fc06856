"""A whole study in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.studies.study import Study

__all__ = ["join", "run_study"]


def run_study(
    system: str | System | Found,
    *,
    variant: str | None = None,
    scenario: Any = None,
    estimators: Sequence[str] | None = None,
    trials: int | None = None,
    first_trial: int = 0,
    seed: int = 0,
    set: Sequence[str] | Mapping[str, Any] | None = None,
    keep: str = "estimates",
    every: int = 1,
    chunk: int | None = None,
    threads: int = 1,
    progress: bool = False,
) -> xr.Dataset:
    """Run a Monte Carlo study of several estimators side by side on one stream of measurements.

    Parameters
    ----------
    system : str or System
        ``NAME[:VARIANT]``, ``package.module:OBJECT[:VARIANT]``, ``FILE.py:OBJECT[:VARIANT]``, ``FILE.yaml``, or the
        object; see `quietfix.diagrams.assembly.find.find`.
    variant : str, optional
        Variant, if it is not in `system`.
    scenario : path, str or dataclass, optional
        A user's YAML file laid over the packaged scenario, or a whole scenario object.
    estimators : sequence of str, optional
        Names in the scenario or the registry, or ``package.module:Class``; all of the scenario by default.
    trials, first_trial : int
        How many trials (by default 100; of a recording all its tracks), and the number of the first: trial 37 alone is
        ``first_trial=37, trials=1``.
    seed : int
        Seed of all noise.
    set : sequence of ``KEY=VALUE`` or mapping, optional
        Changes of the scenario, with dotted keys.
    keep : {'estimates', 'covariance', 'measurements', 'all'}
        What of each trial is returned besides truth, NEES and NIS.
    every : int
        Keep every so many epochs (and the last).
    chunk : int, optional
        Trials at once; bounds the memory and changes no number. By default what fits.
    threads : int
        Threads that share the trials of a chunk; changes no bit.
    progress : bool
        Show a progress bar on a terminal if it takes longer than a second.

    Returns
    -------
    xarray.Dataset
        Dimensions estimator, trial, time, state; bounds as ``bound_*`` and ``bound_truth_*``; the coordinate
        ``measured_rows`` (trial): most rows that are measured at once.

    Raises
    ------
    UserError
        For whatever cannot be run, naming the field, the value and what is allowed.

    Notes
    -----
    Drake 1.51 (Python 3.11) never lets go of a block: a process grows by about 2 MB with every call (1.8 MB for the
    five estimators of `three_satellite`). Thousands of short studies in one process are better run on a later Drake, or
    as one study of many trials.
    """
    study = Study(
        system,
        variant=variant,
        scenario=scenario,
        estimators=estimators,
        trials=trials,
        first_trial=first_trial,
        seed=seed,
        set=set,
        keep=keep,
        every=every,
        chunk=chunk,
        threads=threads,
    )
    return join(list(study.chunks(progress)))


def join(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join the chunks of a study; what has no trials (bounds, shared truth) comes from the last one."""
    if len(parts) == 1:
        return parts[0]
    last = parts[-1]
    grows = [part[[name for name in part if "trial" in part[name].dims]] for part in parts]
    whole = xr.concat(grows, "trial", combine_attrs="override")
    return whole.assign({name: last[name] for name in last if "trial" not in last[name].dims})
