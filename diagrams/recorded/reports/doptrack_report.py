"""What a run of DopTrack tells: how far off the station is, and whether the oscillators could be believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.recorded.settings.doptrack_settings import Settings
from quietfix.diagrams.recorded.settings.doptrack_stream import Stream, misfit, residual
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_offset, enu_rotation

__all__ = ["DoptrackReport", "report"]

Array = NDArray[np.float64]

_STATES = (("bias", "m/s"), ("drift", "m/s^2"), ("drift rate", "m/s^3"))
_FAR = 4.0  # sigmas: a Gaussian is beyond once in 16 000 times


def report(result: xr.Dataset, stream: Stream, settings: Settings) -> DoptrackReport:
    """Return what is told of a study's result."""
    chosen = result.isel(trial=0)
    estimates, sigmas = {}, {}
    for name in map(str, result["estimator"].values):
        one = chosen.sel(estimator=name)
        estimates[name] = one["estimate"].sel(state=list(POSITION)).values
        covariance = one["covariance"].isel(time=-1).sel(state=list(POSITION)).values[:, :3]
        turn = enu_rotation(*ecef_to_geodetic(estimates[name][-1])[:2])
        sigmas[name] = float(np.sqrt(np.trace((turn @ covariance @ turn.T)[:2, :2])))
    return DoptrackReport(settings, stream, result["time"].values, estimates, sigmas)


def _far_off(stream: Stream, position: Array, sigmas: Sequence[float]) -> list[tuple[float, str]]:
    """Return what lies far outside its prior, the worst first: number of sigmas, and it in words.

    The oscillator's states at the start of each pass by least squares of the misfit at a station: the estimator's own
    are drawn to the prior, and its weights take what the prior cannot be for outliers.
    """
    left, far = misfit(stream, position), []
    for i, one in enumerate(stream.passes):
        rows = stream.which == i
        since = stream.times[rows] - stream.times[rows][0]
        power = np.arange(len(sigmas))
        scale = np.maximum(since[-1], 1.0) ** power
        factorial = np.cumprod(np.maximum(power, 1))
        basis = (since[:, None] / np.maximum(since[-1], 1.0)) ** power / factorial
        states = np.linalg.lstsq(basis, left[rows], rcond=None)[0] / scale
        for state, sigma, (name, unit) in zip(states, sigmas, _STATES, strict=False):
            if abs(state) > _FAR * sigma:
                ratio = float(abs(state) / sigma)
                far.append((ratio, f"pass {one.name}: {name} {state:.4g} {unit}, {ratio:.1f} sigmas"))
    return sorted(far, key=lambda found: -found[0])


@dataclass(frozen=True, eq=False)
class DoptrackReport:
    """What came out of the passes.

    Attributes
    ----------
    settings : Settings
    stream : Stream
        The samples that were used.
    times : ndarray, shape (samples,)
        Since the first sample [s].
    estimates : mapping of str to ndarray, shape (samples, 3)
        Earth-fixed position of the station, per estimator.
    sigmas : mapping of str to float
        Horizontal standard deviation that each estimator believes in at the end [m].
    """

    settings: Settings
    stream: Stream
    times: Array
    estimates: Mapping[str, Array]
    sigmas: Mapping[str, float]

    def errors(self, name: str) -> Array:
        """Return east, north, up errors at every sample [m], shape (samples, 3)."""
        return enu_offset(self.estimates[name], self.stream.passes[0].station)

    def horizontal_error(self, name: str) -> float:
        """Return the horizontal error at the end [m]."""
        return float(np.hypot(*self.errors(name)[-1, :2]))

    def robust_sigma(self, name: str) -> float:
        """Return 1.4826 times the median absolute residual at the final position [m/s]."""
        order = self.settings.order(name)
        left = residual(self.stream, self.estimates[name][-1], order, self.settings.sigma_mps[order - 1])
        return float(1.4826 * np.median(np.abs(left - np.median(left))))

    def table(self) -> Table:
        """Return the table that is printed."""
        heads = ("horizontal error [km]", "its sigma [km]", "height error [km]", "residual [m/s]")
        title = f"Delfi-C3, {len(self.stream.passes)} passes, {self.times.size} samples"
        table = Table(title, [Column("estimator"), *heads])
        for name in self.estimates:
            table.add(
                name,
                f"{1e-3 * self.horizontal_error(name):.2f}",
                f"{1e-3 * self.sigmas[name]:.2f}",
                f"{1e-3 * self.errors(name)[-1, 2]:.2f}",
                f"{self.robust_sigma(name):.1f}",
            )
        return table

    def notes(self) -> list[str]:
        """Return lines for below the table."""
        s = self.settings.selection
        lines = [
            f"passes with a predicted elevation >= {s.elevation_deg:g} deg, {s.span_s:g} s and {s.samples} samples or "
            f"more, {self.stream.left_out} others left out; of each the first sample in {self.settings.every_s:g} s; "
            f"start {self.settings.offset_km:g} km off; residual: 1.4826 times the median absolute one, after the best "
            "oscillator of each pass",
            "an epoch without an offset is taken as UTC",
        ]
        for name, far in self.outside_prior.items():
            more = f", and {len(far) - 1} more" if len(far) > 1 else ""
            lines.append(f"{name}: outside of its prior: {far[0][1]}{more}; the estimate is not to be trusted")
        return lines

    @cached_property
    def outside_prior(self) -> dict[str, list[tuple[float, str]]]:
        """What of each estimator's oscillator is further than 4 sigmas from its prior, the furthest first."""
        settings = self.settings
        found = {
            name: _far_off(self.stream, estimate[-1], settings.sigmas[: settings.order(name)])
            for name, estimate in self.estimates.items()
        }
        return {name: far for name, far in found.items() if far}

    def summary(self) -> dict[str, Any]:
        """Return numbers for ``summary.json``."""
        return {
            "passes": [one.name for one in self.stream.passes],
            "passes_left_out": self.stream.left_out,
            "samples": int(self.times.size),
            "estimators": {
                name: {
                    "horizontal_error_m": self.horizontal_error(name),
                    "sigma_horizontal_m": self.sigmas[name],
                    "height_error_m": float(self.errors(name)[-1, 2]),
                    "residual_mps": self.robust_sigma(name),
                    "outside_prior": [text for _, text in self.outside_prior.get(name, [])],
                }
                for name in self.estimates
            },
        }

    def draw(self, folder: Path) -> list[Path]:
        """Draw the error against the passes into a folder."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.doptrack_figures import draw_station_error

        ends = np.flatnonzero(np.diff(self.stream.which, append=-1))
        errors = {name: np.hypot(*self.errors(name)[ends, :2].T) for name in self.estimates}
        title = f"DopTrack: a station located by Delfi-C3, {ends.size} passes, {self.times.size} samples"
        return [save(draw_station_error(errors, title), folder / "station_error.png")]
