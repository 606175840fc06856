"""Where it takes place: seen from above and from the side, and where estimates end, as numbers for a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.limits import reach
from quietfix.diagrams.figures.shared.views import ABOVE, error_axes, place_names, views_of
from quietfix.diagrams.pages.coast import coast_within
from quietfix.diagrams.pages.numbers import rounded, thinned
from quietfix.diagrams.quantities.frame import frame_of
from quietfix.diagrams.quantities.states import POSITION

__all__ = ["last_errors", "views"]

Array = NDArray[np.float64]

_MOST_POINTS, _MOST_TRIALS, _MOST_DOTS = 300, 12, 400
_ROUND = 2.0  # deg: coast lines that are kept beyond a map at least, for who zooms out


def views(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return tracks of platforms and targets seen from above and, where heights mean something, from the side.

    Returns
    -------
    list of dict
        ``title``, ``x`` and ``y`` labels, ``stretch`` (unit of y over that of x; None: free), ``tracks``: ``name``,
        ``kind`` ('platform' or 'target'), ``x``, ``y``.
    """
    frame, names = frame_of(dataset), place_names(dataset)
    if len(names) < 2 or "truth" not in dataset:
        return []
    tracks = _tracks(dataset, names)
    known = [place for _, kind, place in tracks if kind == "target"]
    if not known:
        return []
    around = known[0][0]
    found = []
    for title, labels, project, stretch in views_of(frame, len(names), around):
        drawn = []
        for name, kind, place in tracks:
            if place.shape[-1] < len(names):
                continue
            flat = project(place)
            drawn.append({"name": name, "kind": kind, "x": rounded(flat[:, 0]), "y": rounded(flat[:, 1])})
        told = {"title": title, "x": labels[0], "y": labels[1], "stretch": stretch, "tracks": drawn}
        found.append(told | (_coast(drawn) if frame.geodetic and title == ABOVE else {}))
    return found


def _coast(drawn: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what of the coast is around tracks in longitude and latitude, and the part of the map that is shown."""
    ends = []
    for axis in ("x", "y"):
        values = np.concatenate([np.array(track[axis], dtype=float) for track in drawn])
        ends.append((float(values.min()), float(values.max())))
    wide = max(b - a for a, b in ends)
    (west, east), (south, north) = ((a - wide - _ROUND, b + wide + _ROUND) for a, b in ends)
    lines = coast_within(west, east, max(south, -90.0), min(north, 90.0))
    points = [point for line in lines for point in (*rounded(line), [None, None])]
    margin = max(0.06 * wide, 1e-3)
    return {
        "coast": {"x": [x for x, _ in points], "y": [y for _, y in points]},
        "shown": [[rounded(a - margin), rounded(b + margin)] for a, b in ends],
    }


def _tracks(dataset: xr.Dataset, names: list[str]) -> list[tuple[str, str, Array]]:
    tracks = []
    if "platforms" in dataset:
        states = (
            dataset["platforms"] if "trial" not in dataset["platforms"].dims else dataset["platforms"].isel(trial=0)
        )
        axis = next(name for name in states.dims if name in ("time", "epoch"))
        placed = [name for name in POSITION if name in states["coordinate"].values]
        places = states.sel(coordinate=placed).transpose("platform", axis, "coordinate").values
        tracks += [(str(n), "platform", p) for n, p in zip(dataset["platform"].values, places, strict=True)]
    truth = dataset["truth"].sel(state=names)
    if "trial" in truth.dims:
        for trial in range(min(_MOST_TRIALS, dataset.sizes["trial"])):
            name = f"target, trial {int(dataset['trial'].values[trial])}"
            tracks.append((name, "target", np.asarray(truth.isel(trial=trial).values)))
    else:
        tracks.append(("target", "target", np.asarray(truth.values)))
    kept = []
    for name, kind, place in tracks:
        finite = place[np.isfinite(place).all(axis=-1)]
        if len(finite):
            kept.append((name, kind, finite[thinned(len(finite), _MOST_POINTS)]))
    return kept


def last_errors(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return errors along two axes at the last epoch, of at most 400 trials; None where there are none."""
    names = place_names(dataset)
    if len(names) < 2 or "truth" not in dataset or "epoch" in dataset.sizes:
        return None
    labels, rotation = error_axes(frame_of(dataset), len(names))
    trials = thinned(dataset.sizes["trial"], _MOST_DOTS)
    last = dataset[["truth", "estimate"]].isel(time=-1, trial=trials).sel(state=names)
    truth = last["truth"].values
    estimate = last["estimate"].transpose("estimator", "trial", "state").values
    offset = np.einsum("...ij,...j->...i", rotation(np.broadcast_to(truth, estimate.shape)), estimate - truth)[..., :2]
    if not np.isfinite(offset).all(axis=-1).any():
        return None
    edge, beyond = reach(offset)
    clouds = {
        str(name): {"x": rounded(cloud[:, 0]), "y": rounded(cloud[:, 1])}
        for name, cloud in zip(dataset["estimator"].values, offset, strict=True)
    }
    numbers = [int(n) for n in dataset["trial"].values[trials]]
    return {
        "x": f"{labels[0]} [m]",
        "y": f"{labels[1]} [m]",
        "clouds": clouds,
        "trials": numbers,
        "edge": edge,
        "beyond": beyond,
        "left_out": int(dataset.sizes["trial"] - len(trials)),
        "time": rounded(last["time"].values),
    }
