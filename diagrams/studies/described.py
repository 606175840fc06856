"""What the variables and coordinates of a study's result are: the attributes ``units`` and ``long_name`` of each."""

from __future__ import annotations

import xarray as xr

from quietfix.diagrams.quantities.frame import UNITS, frame_of

__all__ = ["UNKNOWN", "described"]

UNKNOWN = "unknown"
"""The unit of what a user's own block measures without saying it."""

_COUNT = "1"
_BY = "as {}_units says"

_ABOUT = {
    "estimator": (_COUNT, "name of the estimator"),
    "trial": (_COUNT, "number of the trial"),
    "time": ("s", "time since the start of the run"),
    "state": (_COUNT, "component of the state"),
    "state_": (_COUNT, "component of the state"),
    "state_units": (_COUNT, "SI units of the components of the state"),
    "in_truth": (_COUNT, "whether the truth has the component"),
    "in_estimate": (_COUNT, "whether the estimator's state has the component"),
    "causal": (_COUNT, "whether the estimator uses no measurement before it is made"),
    "platform": (_COUNT, "name of what carries sensors"),
    "coordinate": (_COUNT, "axis of the place and the velocity of a platform"),
    "coordinate_units": (_COUNT, "SI units of these axes"),
    "track": (_COUNT, "name of the recorded track"),
    "row": (_COUNT, "row of the measurement"),
    "row_units": (_COUNT, "SI units of the rows of the measurement"),
    "innovation_row": (_COUNT, "row of the innovation; NaN where an estimator does not have it"),
    "innovation_row_units": (_COUNT, "SI units of the rows of the innovation"),
    "in_innovation": (_COUNT, "whether the estimator's innovation has the row"),
    "measured_rows": (_COUNT, "most rows that are measured at once in the trial"),
    "dropped_rows": (_COUNT, "rows that came too late for the estimator's buffer in the trial"),
    "truth": (_BY.format("state"), "state of the target, {frame} axes"),
    "estimate": (_BY.format("state"), "estimated state of the target, {frame} axes"),
    "prediction": (_BY.format("state"), "state predicted before the measurement of the epoch, {frame} axes"),
    "covariance": ("products of state_units", "covariance that the estimator states"),
    "platforms": (_BY.format("coordinate"), "states of the platforms as they are, {frame} axes"),
    "measurement": (_BY.format("row"), "what the estimators get"),
    "innovation": (_BY.format("innovation_row"), "measurement less its prediction"),
    "bias_row": (_COUNT, "bias that estimators know of"),
    "bias_row_units": (_COUNT, "SI units of the biases"),
    "bias_estimated": (_COUNT, "whether the estimator estimates the bias; it considers it, or knows nothing of it"),
    "bias_estimate": (_BY.format("bias_row"), "estimated bias"),
    "bias_sigma": (_BY.format("bias_row"), "standard deviation of the bias that the estimator states"),
    "nees": (_COUNT, "normalised estimation error squared"),
    "nis": (_COUNT, "normalised innovation squared"),
    "nis_dof": (_COUNT, "degrees of freedom of the normalised innovation squared"),
    "lost": (_COUNT, "whether the estimator's innovations say that it is lost"),
    # of a sweep
    "point": ("as the field that is varied", "value of the field that is varied"),
    "position_error": ("m", "length of the error of the position"),
    "diverged": (_COUNT, "whether the trial is lost at the end"),
    "not_started": (_COUNT, "whether the estimator never started in the trial"),
    "states": (_COUNT, "number of components that the estimator is judged by"),
    "at": ("s", "time of the errors"),
}

_BOUNDS = {
    "bound": "posterior Cramer-Rao bound of the {}, with the filter's process noise",
    "bound_truth": "posterior Cramer-Rao bound of the {}, with the process noise of the true motion",
}
_ABOUT |= {
    f"{kind}_{what}": (unit, words.format("horizontal speed" if what == "speed" else what))
    for kind, words in _BOUNDS.items()
    for what, unit in UNITS.items()
}


def described(dataset: xr.Dataset) -> xr.Dataset:
    """Return a study's result whose variables and coordinates all have ``units`` and ``long_name``.

    A variable along a dimension of components in different units says so; the coordinate ``DIMENSION_units`` then has
    the unit of each.
    """
    axes = str(frame_of(dataset))
    for name in dataset.variables:
        of = dataset[name]
        units, words = _ABOUT.get(str(name)) or _signal(of)
        each = [f"{dim}_units" for dim in of.dims if f"{dim}_units" in dataset.coords]
        if units.startswith("as ") and each:
            units = _one_unit(dataset, each[0]) or units
        of.attrs |= {"units": units, "long_name": words.format(frame=axes)}
    return dataset


def _one_unit(dataset: xr.Dataset, coordinate: str) -> str | None:
    """Return the unit that all components have, if it is the same one."""
    units = {str(unit) for unit in dataset[coordinate].values}
    return units.pop() or UNKNOWN if len(units) == 1 else None


def _signal(of: xr.DataArray) -> tuple[str, str]:
    """Return units and words of a signal that only some systems or estimators have, or of its coordinates."""
    name = str(of.name)
    if name.endswith("_row_units"):
        return _COUNT, f"SI units of the components of {name.removesuffix('_row_units')}"
    if name.endswith("_row"):
        return _COUNT, f"component of {name.removesuffix('_row')}"
    return of.attrs.get("units", _BY.format(f"{name}_row")), of.attrs.get("long_name", name.replace("_", " "))
