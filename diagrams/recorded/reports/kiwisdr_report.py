"""What a run of the KiwiSDR recordings tells: time differences of the pairs, and how far off the fixes are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.parts.iq_comparison import PairResult, pair_result
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.readers.kiwisdr_data import KiwiData
from quietfix.diagrams.recorded.settings.kiwisdr_settings import Settings
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation
from quietfix.systems.fixes.snapshot import snapshot_fix, starts_around
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["KiwiReport", "MastFix", "report"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MastFix:
    """What an estimator found.

    Attributes
    ----------
    name : str
        Of the estimator.
    mast : ndarray, shape (3,)
        Where the transmitter is.
    estimate, covariance : ndarray, shape (samples, 3), (samples, 3, 3)
        Earth-fixed position [m] after each comparison, and what the estimator believes of it.
    nis : float
        Sum of the normalised innovations squared.
    nis_dof : int
        Their degrees of freedom.
    """

    name: str
    mast: Array
    estimate: Array
    covariance: Array
    nis: float
    nis_dof: int

    def local(self, position: Array) -> Array:
        """Return east, north, up [m] from the mast of positions (..., 3)."""
        turn = enu_rotation(*ecef_to_geodetic(self.mast)[:2])
        return np.einsum("ij,...j->...i", turn, position - self.mast)

    @property
    def error(self) -> float:
        """Horizontal distance of the fix from the mast [m]."""
        return float(np.hypot(*self.local(self.estimate[-1])[:2]))

    def horizontal_covariance(self) -> Array:
        """Return what the estimator believes at the end, east and north [m^2], shape (2, 2)."""
        turn = enu_rotation(*ecef_to_geodetic(self.estimate[-1])[:2])
        return (turn @ self.covariance[-1] @ turn.T)[:2, :2]

    @property
    def sigma(self) -> float:
        """Root of the trace of `horizontal_covariance` [m]."""
        return float(np.sqrt(np.trace(self.horizontal_covariance())))

    def notes(self) -> list[str]:
        """Return it in words."""
        latitude, longitude, _ = ecef_to_geodetic(self.estimate[-1])
        east, north = self.local(self.estimate[-1])[:2] / 1e3
        lines = [
            f"fix: latitude {math.degrees(latitude):.4f} deg, longitude {math.degrees(longitude):.4f} deg: "
            f"{self.error / 1e3:.2f} km from the mast (east {east:+.2f} km, north {north:+.2f} km)",
            f"the covariance, from the scatter within the windows alone, claims {self.sigma / 1e3:.2f} km",
            "the scatter understates the error: the sky wave, and delays within the receivers, shift all windows alike",
        ]
        if self.nis_dof:
            lines.append(
                f"normalised innovations squared: {self.nis / self.nis_dof:.2f} per degree of freedom; above 1, "
                "windows differ by more than the noise in them"
            )
        return lines

    def numbers(self) -> dict[str, float | None]:
        """Return it as numbers."""
        latitude, longitude, _ = ecef_to_geodetic(self.estimate[-1])
        covariance = self.horizontal_covariance()
        found = {
            "latitude_deg": math.degrees(latitude),
            "longitude_deg": math.degrees(longitude),
            "horizontal_error_m": self.error,
            "sigma_horizontal_m": self.sigma,
            "sigma_east_m": float(np.sqrt(covariance[0, 0])),
            "sigma_north_m": float(np.sqrt(covariance[1, 1])),
            "nis_per_dof": self.nis / max(self.nis_dof, 1),
        }
        return {key: _finite(float(value)) for key, value in found.items()}


def report(
    result: xr.Dataset,
    data: KiwiData,
    settings: Settings,
    pairs: Sequence[tuple[int, int]],
    rows: Sequence[str],
    model: MeasurementModel,
) -> KiwiReport:
    """Return what is told of a study's result; `model`: of one comparison alone, by the names of its rows."""
    one = result.isel(trial=0)
    fixes = []
    for name in map(str, result["estimator"].values):
        found = one.sel(estimator=name)
        own = found["covariance"].sel(state=list(POSITION)).isel(state_=slice(3))
        fixes.append(
            MastFix(
                name,
                data.mast,
                found["estimate"].sel(state=list(POSITION)).transpose("time", "state").values,
                own.transpose("time", "state", "state_").values,
                float(np.nansum(found["nis"])),
                int(np.nansum(found["nis_dof"])),
            )
        )
    columns = [list(rows).index(name) for name in model.names]
    measured = one["measurement"].transpose("time", "row").values[:, columns]
    noise = one["noise_covariance"].transpose("time", ...).values.reshape(-1, len(rows), len(rows))
    noise = noise[:, columns][:, :, columns].copy()
    noise[:, -1, -1] = settings.sigma_altitude_m**2
    singly = snapshot_fix(measured, data.still, model, noise, starts_around(data.still, np.array(0.0)))
    compared = {pair: pair_result(data.names, pair, result) for pair in pairs}
    return KiwiReport(data, settings, result["time"].values, compared, fixes, singly.position)


@dataclass(frozen=True, eq=False)
class KiwiReport:
    """What came out.

    Attributes
    ----------
    data : KiwiData
    settings : Settings
    times : ndarray, shape (samples,)
        Middle of each comparison [s].
    pairs : mapping of (int, int) to PairResult
        By the places of the receivers.
    fixes : list of MastFix
        One per estimator; `fix` is the first.
    singly : ndarray, shape (samples, 3)
        The fix of each comparison alone.
    """

    data: KiwiData
    settings: Settings
    times: Array
    pairs: Mapping[tuple[int, int], PairResult]
    fixes: list[MastFix]
    singly: Array

    @property
    def fix(self) -> MastFix:
        """What the first estimator found."""
        return self.fixes[0]

    def true_difference(self, pair: tuple[int, int]) -> float:
        """Return the TDOA of a pair by the straight lines from the mast [s]."""
        distance = np.linalg.norm(self.data.stations[list(pair)] - self.data.mast, axis=-1)
        return float((distance[1] - distance[0]) / SPEED_OF_LIGHT)

    def _median(self, pair: tuple[int, int]) -> float:
        found = self.pairs[pair]
        return float(np.median(found.tdoa[found.good])) if found.good.any() else math.nan

    def table(self) -> Table:
        """See `Report.table`."""
        seconds, length = self.settings.integration_s, self.times.size
        title = f"{self.data.transmitter}, time differences of {length} windows of {seconds:g} s"
        heads = ("median, us", "scatter, us", "predicted sigma, us", "true, us", "off by, us", "windows")
        table = Table(title, [Column("pair"), *heads])
        for pair, found in self.pairs.items():
            median, true = self._median(pair), self.true_difference(pair)
            table.add(
                f"{found.auxiliary} - {found.main}",
                f"{1e6 * median:.1f}",
                f"{1e6 * np.nanstd(found.tdoa):.1f}",
                f"{1e6 * np.nanmedian(found.sigma_tdoa):.1f}",
                f"{1e6 * true:.1f}",
                f"{1e6 * (median - true):+.1f}",
                f"{np.count_nonzero(found.good)}",
            )
        return table

    def notes(self) -> list[str]:
        """See `Report.notes`."""
        lines = []
        for fix in self.fixes:
            named = f"{fix.name}: " if len(self.fixes) > 1 else ""
            lines += [f"{named}{line}" for line in fix.notes()]
        lines += [
            f"{found.auxiliary} - {found.main}: flagged: {reasons}"
            for found in self.pairs.values()
            if (reasons := found.reasons())
        ]
        return list(dict.fromkeys(lines))

    def summary(self) -> dict[str, Any]:
        """See `Report.summary`."""
        return {
            "windows": int(self.times.size),
            "integration_s": self.settings.integration_s,
            "receivers": {
                name: {"sample_rate_hz": one.sample_rate, "stale_stamps": one.stale, "stamp_scatter_s": one.scatter}
                for name, one in zip(self.data.names, self.data.recordings, strict=True)
            },
            "pairs": {
                f"{found.auxiliary} - {found.main}": {
                    "tdoa_s": _finite(self._median(pair)),
                    "scatter_s": _finite(float(np.nanstd(found.tdoa))),
                    "sigma_s": _finite(float(np.nanmedian(found.sigma_tdoa))),
                    "true_s": self.true_difference(pair),
                    "windows": int(np.count_nonzero(found.good)),
                }
                for pair, found in self.pairs.items()
            },
            "fix": self.fix.numbers(),
            "estimators": {fix.name: fix.numbers() for fix in self.fixes},
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`: time differences against time, and the map."""
        from quietfix.diagrams.figures.style import save
        from quietfix.diagrams.recorded.reports.kiwisdr_figures import draw_differences, draw_map

        fix, who = self.fix, self.data.transmitter
        pairs = {
            f"{found.auxiliary} - {found.main}": (found.tdoa, found.sigma_tdoa, self.true_difference(pair))
            for pair, found in self.pairs.items()
        }
        windows = f"windows of {self.settings.integration_s:g} s"
        against_time = draw_differences(f"{who}: time differences of arrival, {windows}", self.times, pairs)
        place = draw_map(
            f"{who}: fix {fix.error / 1e3:.2f} km from the mast; the scatter alone claims {fix.sigma / 1e3:.2f} km",
            self.data.names,
            self.data.stations,
            {name: (pair, self._median(pair)) for name, pair in zip(pairs, self.pairs, strict=True)},
            self.data.mast,
            fix.estimate[-1],
            (fix.local(self.singly)[:, :2], fix.local(fix.estimate[-1])[:2], fix.horizontal_covariance()),
        )
        return [save(against_time, folder / "time_differences.png"), save(place, folder / "map.png")]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
