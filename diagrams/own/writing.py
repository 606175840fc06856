"""The measurements of a simulated study as a table that can be read back, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.own.declaring.sensing import placed_sensors
from quietfix.diagrams.own.fed.measured import believed_noise
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.own.system import places_of
from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.schema.errors import UserError

__all__ = ["write_measurements", "write_truth"]

Array = NDArray[np.float64]

_HEAD = "time_s,target,kind,receiver,reference,value,unit,sigma\n"


def write_measurements(dataset: xr.Dataset, scenario: object, path: FilePath) -> int:
    """Write ``measurements.csv`` of a study: each trial is a target, whose name is its number.

    Values are in SI units with all digits, and sigma is what the estimators believe. A sensor that heard nothing has a
    row without a value, so that reading it back gives the same epochs.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result of a study that kept its measurements.
    scenario : OwnScenario
        What was simulated.
    path : Path
        The file.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    UserError
        If it is no system of a user's own.
    """
    if not isinstance(scenario, OwnScenario):
        raise UserError(
            f"--write-measurements: {dataset.attrs['system']} is not allowed; a system of one's own in YAML"
        )
    places = places_of(scenario)
    kinds = [kind for one in placed_sensors(scenario, places) for kind in one.kinds]
    rows = [row for kind in kinds for row in kind.rows]
    sigmas = np.sqrt(np.diagonal(believed_noise(kinds)))
    times = dataset["time"].values
    owners = [kind for kind in kinds for model in (kind.real, *kind.links) for _ in model.names]
    on = np.array([[kind.clock.index(float(t)) is not None for kind in owners] for t in times])
    stream = "raw" if "raw" in dataset else "measurement"
    logged = dataset[stream].transpose("trial", "time", ...)
    count = 0
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(_HEAD)
        for k, trial in enumerate(dataset["trial"].values):
            for line in _lines(times, str(int(trial)), logged[k].values, rows, sigmas, on):
                file.write(line)
                count += 1
    return count


def write_truth(dataset: xr.Dataset, path: FilePath) -> None:
    """Write ``truth.csv`` of a study: where the target of each trial was, by the number of the trial."""
    names = [name for name in (*POSITION, *VELOCITY) if name in dataset["state"].values]
    truth = dataset["truth"].sel(state=names)
    head = [f"{name}_mps" if name in VELOCITY else f"{name}_m" for name in names]
    times = dataset["time"].values.tolist()
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"time_s,target,{','.join(head)}\n")
        for k, trial in enumerate(dataset["trial"].values):
            one = truth.isel(trial=k) if "trial" in truth.dims else truth
            for time, state in zip(times, one.transpose("time", "state").values.tolist(), strict=True):
                file.write(f"{time!r},{int(trial)},{','.join(map(repr, state))}\n")


def _lines(
    times: Array, target: str, values: Array, rows: Sequence[Row], sigmas: Array, on: NDArray[np.bool_]
) -> Iterator[str]:
    middles = [f",{target},{row.kind},{row.receiver},{row.reference}," for row in rows]
    ends = [f",{row.unit},{float(sigma)!r}\n" for row, sigma in zip(rows, sigmas, strict=True)]
    for time, measured, there in zip(times.tolist(), values.tolist(), on, strict=True):
        for i in np.flatnonzero(there):
            value = measured[i]
            yield f"{time!r}{middles[i]}{'' if value != value else repr(value)}{ends[i]}"
