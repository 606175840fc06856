"""What a run of LocaRDS tells: horizontal errors message by message, with and without the gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.readers.locards_data import AircraftTrack, LocardsSet
from quietfix.diagrams.recorded.settings.locards_scores import METHODS, Scores, score
from quietfix.diagrams.recorded.settings.locards_settings import FALLBACK_M, Settings
from quietfix.diagrams.recorded.settings.locards_sigma import LEAST_MESSAGES
from quietfix.diagrams.writers.estimates import estimate_columns, write_estimates
from quietfix.diagrams.writers.tracks import write_tracks
from quietfix.systems.estimators.arrival_gate import KEPT, REFUSED

__all__ = ["LocardsReport", "Piece", "report"]

Array = NDArray[np.float64]

_EVERY, _MANY = "all", "5+"


class Piece(NamedTuple):
    """A track as it is played.

    Attributes
    ----------
    name : str
    set : int
        Which set it is of.
    track : AircraftTrack
        The messages.
    size : int
        Messages of the aircraft in the whole set.
    sigma : float
        What is believed of a time difference, as a length [m].
    """

    name: str
    set: int
    track: AircraftTrack
    size: int
    sigma: float


def report(
    result: xr.Dataset, sets: Sequence[LocardsSet], pieces: Sequence[Piece], settings: Settings
) -> LocardsReport:
    """Return what is told of a study's result.

    The tracks with faults are a second trial beside those as recorded, where the result has both of all of them.
    """
    names = [str(name) for name in result["estimator"].values]
    numbers = [int(number) for number in result["trial"].values]
    sound = len(pieces) // settings.trials
    first = [number for number in numbers if number < sound]
    paired = settings.trials == 2 and [number + sound for number in first] == numbers[len(first) :]
    if not first:
        first, sound = numbers, 0
    played = {number: _played(result.sel(trial=number), names, pieces[number].track.times.size) for number in numbers}
    scores: dict[int, list[Scores]] = {}
    for number in first:
        together = [number, number + sound] if paired else [number]
        estimates = np.concatenate([played[one][0] for one in together], axis=2)
        excluded = np.concatenate([played[one][1] for one in together], axis=1)
        piece = pieces[number]
        sigma = np.array([pieces[one].sigma for one in together])
        scores.setdefault(piece.set, []).append(score(piece.track, piece.size, estimates, excluded, sigma))
    found = [Scores.join(scores[i]) for i in scores]
    return LocardsReport(settings, names, [sets[i] for i in scores], found, result)


def _played(one: xr.Dataset, names: Sequence[str], messages: int) -> tuple[Array, Array]:
    """Return positions (estimators, messages, 1, 3) and what the first gate left out, (messages, 1), of a track."""
    own = one.isel(epoch=slice(messages))
    estimates = own["estimate"].sel(state=list(POSITION)).transpose("estimator", "epoch", "state").values.copy()
    excluded = np.full((messages, 1), float(KEPT))
    for i, name in reversed(list(enumerate(names))):
        if f"excluded_{name}" in own:
            excluded = own[f"excluded_{name}"].values.reshape(messages, 1)
            estimates[i][excluded[:, 0] == REFUSED] = np.nan
    return estimates[:, :, None], excluded


@dataclass(frozen=True)
class LocardsReport:
    """Scores of all sets.

    Attributes
    ----------
    settings : Settings
    names : list of str
        The estimators.
    sets : list of LocardsSet
        Those of which there are tracks in the result.
    scores : list of Scores
        One per set.
    result : xarray.Dataset
        What it is about, with covariances.
    """

    settings: Settings
    names: list[str]
    sets: list[LocardsSet]
    scores: list[Scores]
    result: xr.Dataset

    @property
    def trials(self) -> int:
        """1 as recorded, 2 with faults beside it."""
        return int(self.all.error.shape[2])

    @property
    def gated(self) -> bool:
        """Whether it is one estimator, with the gate and without it."""
        return (
            self.names[1:]
            == [f"{self.names[0]}_no_gate"]
            == [name for name in self.names if name in self.settings.without_gate]
        )

    @property
    def methods(self) -> tuple[str, ...]:
        """What the errors are of, for ``summary.json``."""
        return METHODS if self.gated else tuple(self.names)

    @property
    def labels(self) -> tuple[str, ...]:
        """The same for figures."""
        return ("with the gate", "without") if self.gated else tuple(self.names)

    @property
    def all(self) -> Scores:
        """The messages of all sets."""
        return Scores.join(self.scores)

    def groups(self) -> list[tuple[str, str, dict[str, Any]]]:
        """Return set, which aircraft and summary, of each row of the table."""
        parts = [(data.name, 0, scores) for data, scores in zip(self.sets, self.scores, strict=True)]
        parts.append(("all sets", 0, self.all))
        if self.trials > 1:
            parts.append(("faults", 1, self.all))
        return [
            (name, who, scores.summary(trial, which, self.methods))
            for name, trial, scores in parts
            for who, which in ((_EVERY, None), (_MANY, scores.many))
        ]

    def table(self) -> Table:
        """See `Report.table`."""
        who = f"{self.names[0]} in metres, with / without the gate" if self.gated else " / ".join(self.names)
        title = f"LocaRDS: horizontal error of {who}" + ("" if self.gated else " in metres")
        heads = ("messages", "with fix, %", "50 %", "90 %", "99 %")
        table = Table(title, [Column("set"), Column("aircraft"), *heads], keys=2)
        for name, who, row in self.groups():
            pair = [row[method] for method in self.methods]
            shares = " / ".join(
                "-" if r["share_with_fix"] is None else f"{100 * r['share_with_fix']:.3g}" for r in pair
            )
            errors = [" / ".join(_metres(r[f"p{p}_m"]) for r in pair) for p in (50, 90, 99)]
            table.add(name, who, str(row["messages"]), shares, *errors)
        return table

    def notes(self) -> list[str]:
        """See `Report.notes`."""
        scores = self.all
        aside, ahead = (np.abs(part[0, :, 0]) for part in (scores.across, scores.along))
        lines = ["5+: aircraft with at least five messages in their set; percentiles are over the messages with a fix"]
        lines.append("arrival times are those of the receivers' clocks: the files name no scale and no date")
        if np.isfinite(aside).any():
            lines.append(
                f"{self.labels[0]}, across the course: {np.nanmedian(aside):.0f} m (50 %), "
                f"{np.nanpercentile(aside, 90):.0f} m (90 %); along it: {np.nanmedian(ahead):.0f} m, "
                f"{np.nanpercentile(ahead, 90):.0f} m, and {np.nanmedian(scores.along[0, :, 0]):+.0f} m in the median: "
                "the positions that aircraft report are a fraction of a second old"
            )
        lines += [*self._sigmas(), *self._heights()]
        if not scores.known.all():
            fixed = np.isfinite(scores.fix[~scores.known]).all(axis=-1)
            lines.append(
                f"{fixed.size} of {scores.known.size} messages report no position, which nothing here can judge; they "
                f"are not in the table. {100 * fixed.mean():.3g} % of them have a fix {self._first}"
            )
        if self.trials > 1:
            lines.append(
                f"faults: {self.settings.fault_m:g} m added at one receiver in "
                f"{100 * self.settings.fault_share:g} % of the messages"
            )
        return lines

    def _heights(self) -> list[str]:
        """Return lines on heights that nobody says."""
        tracks = [track for data in self.sets for track in data.tracks]
        silent = sum(int(np.isnan(track.altitude).sum()) for track in tracks)
        lines = [f"{data.name}: {note}" for data in self.sets for note in data.notes]
        if not silent:
            return lines
        assumed, sigma = self.settings.assumed_altitude_m, self.settings.sigma_assumed_altitude_m
        return [
            *lines,
            f"{silent} of {sum(track.times.size for track in tracks)} messages report no altitude: {assumed:g} m is "
            f"assumed, with a standard deviation of {sigma:g} m over their whole track",
        ]

    @property
    def _first(self) -> str:
        return "with the gate" if self.gated else f"of {self.names[0]}"

    def _sigmas(self) -> list[str]:
        believed = [f"{data.name} {one.sigma[0, 0]:.0f}" for data, one in zip(self.sets, self.scores, strict=True)]
        if self.settings.sigma_tdoa_m:
            return [f"sigma of a time difference: {self.settings.sigma_tdoa_m:g} m, as it was set"]
        lines = [
            f"sigma of a time difference, from the residuals of each set as a whole: {', '.join(believed)} m",
        ]
        guessed = [d.name for d, one in zip(self.sets, self.scores, strict=True) if one.sigma[0, 0] == FALLBACK_M]
        if guessed:
            lines.append(
                f"{', '.join(guessed)}: fewer than {LEAST_MESSAGES} messages tell no sigma; {FALLBACK_M:g} m is assumed"
            )
        return lines

    def summary(self) -> dict[str, Any]:
        """See `Report.summary`."""
        keys = {_EVERY: "all_aircraft", _MANY: "five_messages_or_more"}
        result: dict[str, Any] = {"dataset": "locards", "settings": self._settings(), "sets": {}}
        for name, who, row in self.groups():
            place = result if name in ("all sets", "faults") else result["sets"]
            place.setdefault(name.replace(" ", "_"), {})[keys[who]] = row
        for data, scores in zip(self.sets, self.scores, strict=True):
            result["sets"][data.name]["sigma_tdoa_m"] = float(scores.sigma[0, 0])
        silent = ~self.all.known
        result["without_position"] = {
            "messages": int(np.count_nonzero(silent)),
            "with_fix": int(np.count_nonzero(np.isfinite(self.all.fix[silent]).all(axis=-1))),
        }
        return result

    def _settings(self) -> dict[str, Any]:
        told = {one.name: getattr(self.settings, one.name) for one in fields(self.settings)}
        del told["data"], told["estimators"]
        return told | {"estimator": self.names[0]}

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`; the estimates are written beside the figures."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.locards_figures import draw_errors, draw_map, draw_track_errors

        scores, known = self.all, self.all.known
        error = scores.horizontal[:, known]
        fault, percent = self.settings.fault_m / 1e3, 100 * self.settings.fault_share
        titles = ("as recorded", f"{fault:g} km added at one receiver in {percent:g} % of the messages")[: self.trials]
        tracks = [track for data in self.sets for track in data.tracks]
        stations = np.concatenate([track.platforms[..., :3].reshape(-1, 3) for track in tracks])
        stations = np.unique(stations[np.isfinite(stations).all(axis=-1)], axis=0)
        figures = {
            "errors": draw_errors(error, scores.many[known], self.labels, titles, self.names[0]),
            "along_across": draw_track_errors(scores.along[0, :, 0], scores.across[0, :, 0], self.labels[0]),
            "map": draw_map(stations, scores.place[known], error[0, :, 0], scores.fix[~known]),
        }
        drawn = [save(figure, folder / f"{name}.png") for name, figure in figures.items()]
        return [
            *drawn,
            *write_estimates(estimate_columns(self.result), folder),
            *write_tracks(self.result, None, folder),
        ]


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"
