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
from quietfix.diagrams.readers.kiwisdr.folder import KiwiData
from quietfix.diagrams.recorded.reports.kiwisdr_sky import SkyWave, sky_wave
from quietfix.diagrams.recorded.settings.kiwisdr_settings import Settings
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_offset, enu_rotation
from quietfix.systems.fixes.snapshot import snapshot_fix, starts_on_ground
from quietfix.systems.geometry.wave_path import WavePath
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["AS_WELL", "KiwiReport", "MastFix", "report"]

Array = NDArray[np.float64]

AS_WELL = 9.0  # of chi-square, by which places that fit may differ
_SIGMAS = 5.0
_SHOWN = 6  # pairs in the figures
_ANOTHER = 50e3  # m; how far another place is at least


@dataclass(frozen=True, eq=False)
class MastFix:
    """What an estimator found.

    Attributes
    ----------
    name : str
        Of the estimator.
    transmitter : str
        Its name; empty: nobody knows where it is.
    mast : ndarray, shape (3,)
        Where it is.
    estimate, covariance : ndarray, shape (samples, 3), (samples, 3, 3)
        Earth-fixed position [m] after each comparison, and what the estimator believes of it.
    nis : float
        Sum of the normalised innovations squared.
    nis_dof : int
        Their degrees of freedom.
    """

    name: str
    transmitter: str
    mast: Array
    estimate: Array
    covariance: Array
    nis: float
    nis_dof: int

    def local(self, position: Array) -> Array:
        """Return east, north, up [m] of positions (..., 3) from the transmitter, or the fix if that is not known."""
        return enu_offset(position, self.mast if self.transmitter else self.estimate[-1])

    @property
    def error(self) -> float:
        """Horizontal distance of the fix from the transmitter [m]; NaN: nobody knows where it is."""
        return float(np.hypot(*self.local(self.estimate[-1])[:2])) if self.transmitter else math.nan

    def horizontal_covariance(self) -> Array:
        """Return what the estimator believes at the end, east and north [m^2], shape (2, 2)."""
        turn = enu_rotation(*ecef_to_geodetic(self.estimate[-1])[:2])
        return (turn @ self.covariance[-1] @ turn.T)[:2, :2]

    @property
    def sigma(self) -> float:
        """Root of the trace of `horizontal_covariance` [m]."""
        return float(np.sqrt(np.trace(self.horizontal_covariance())))

    @property
    def found(self) -> bool:
        """Whether there is a fix."""
        return bool(np.isfinite(self.estimate[-1]).all() and np.isfinite(self.covariance[-1]).all())

    def notes(self) -> list[str]:
        """Return it in words."""
        if not np.isfinite(self.estimate[-1]).all():
            return ["no fix: the differences do not meet anywhere on the ground; see the table of pairs"]
        latitude, longitude, _ = ecef_to_geodetic(self.estimate[-1])
        place = f"fix: latitude {math.degrees(latitude):.4f} deg, longitude {math.degrees(longitude):.4f} deg"
        if self.transmitter:
            east, north = self.local(self.estimate[-1])[:2] / 1e3
            place += f": {self.error / 1e3:.2f} km from {self.transmitter} (east {east:+.2f} km, north {north:+.2f} km)"
        lines = [
            place,
            f"the covariance, from the scatter within the windows alone, claims {self.sigma / 1e3:.2f} km",
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
                data.transmitter,
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
    singly = snapshot_fix(
        measured, data.still, model, noise, starts_on_ground(data.still, np.array(0.0)), as_well=AS_WELL
    )
    compared = {pair: pair_result(data.names, pair, result) for pair in pairs}
    means, sigmas = _means(measured[:, :-1], noise[:, :-1, :-1])
    sky = sky_wave(data, fixes[0].estimate[-1], means, sigmas, settings.path) if fixes[0].found else None
    spread = np.diag(np.append(np.square(sigmas), settings.sigma_altitude_m**2))
    others = _others(fixes[0], np.append(means, measured[-1, -1]), spread, data, model) if sky else []
    return KiwiReport(data, settings, result["time"].values, compared, fixes, singly.position, sky, others)


def _means(measured: Array, noise: Array) -> tuple[Array, Array]:
    """Return means of the windows and their standard deviations, as predicted or as they scatter if that is more."""
    variance = np.where(np.isfinite(measured), np.einsum("kii->ki", noise), np.nan)
    count = np.isfinite(measured).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.where(np.isfinite(variance), 1 / variance, 0.0)
        mean = np.nansum(measured * weight, axis=0) / weight.sum(axis=0)
        predicted = 1 / weight.sum(axis=0)
        scatter = np.nansum(np.square(weight * (measured - mean)), axis=0) / np.square(weight.sum(axis=0))
    sigma = np.sqrt(np.where(count > 1, np.maximum(predicted, scatter), predicted))
    return np.where(count > 0, mean, np.nan), np.where(count > 0, sigma, np.nan)


def _others(fix: MastFix, mean: Array, noise: Array, data: KiwiData, model: MeasurementModel) -> list[Array]:
    """Return places on the ground that the differences fit as well as the fix."""
    noise = np.where(np.isfinite(noise), noise, np.where(np.eye(len(noise)) > 0, 1.0, 0.0))
    starts = starts_on_ground(data.still, np.array(0.0))
    tried = snapshot_fix(mean, data.still, model, noise, starts[:, None])
    best = np.nanmin(tried.cost) if np.isfinite(tried.cost).any() else np.nan
    found: list[Array] = [fix.estimate[-1]]
    for position, cost in zip(tried.position, tried.cost, strict=True):
        if cost < best + AS_WELL and min(np.linalg.norm(position - one) for one in found) > _ANOTHER:
            found.append(position)
    return found[1:]


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
    sky : SkyWave or None
        What is known of the sky wave; None: there is no fix.
    others : list of ndarray, shape (3,)
        Other places that the differences fit as well.
    """

    data: KiwiData
    settings: Settings
    times: Array
    pairs: Mapping[tuple[int, int], PairResult]
    fixes: list[MastFix]
    singly: Array
    sky: SkyWave | None
    others: list[Array]

    @property
    def fix(self) -> MastFix:
        """What the first estimator found."""
        return self.fixes[0]

    def true_difference(self, pair: tuple[int, int]) -> float:
        """Return the TDOA of a pair of the wave from the transmitter [s]; NaN: nobody knows where it is."""
        distance = np.linalg.norm(self.data.stations[list(pair)] - self.data.mast, axis=-1)
        way = self.settings.path.length(distance)
        return float((way[1] - way[0]) / SPEED_OF_LIGHT)

    def _longest(self, pair: tuple[int, int]) -> float:
        """Return the largest difference that a wave along the ground can have [s]."""
        apart = np.linalg.norm(self.data.stations[pair[0]] - self.data.stations[pair[1]])
        return float(WavePath().length(apart) / SPEED_OF_LIGHT)

    def _median(self, pair: tuple[int, int]) -> float:
        found = self.pairs[pair]
        return float(np.median(found.tdoa[found.good])) if found.good.any() else math.nan

    def table(self) -> Table:
        """See `Report.table`."""
        seconds, length = self.settings.integration_s, self.times.size
        heard = self.data.transmitter or f"{self.data.frequency / 1e3:.10g} kHz"
        title = f"{heard}, time differences of {length} windows of {seconds:g} s"
        judged = ("true, us", "off by, us") if self.data.transmitter else ()
        heads = ("median, us", "scatter, us", "predicted sigma, us", *judged, "windows")
        table = Table(title, [Column("pair"), *heads])
        for pair, found in self.pairs.items():
            median, true = self._median(pair), self.true_difference(pair)
            cells = [f"{1e6 * one:.1f}" for one in (median, found.scatter, found.typical_sigma)]
            cells += [f"{1e6 * true:.1f}", f"{1e6 * (median - true):+.1f}"] if judged else []
            table.add(f"{found.auxiliary} - {found.main}", *cells, f"{np.count_nonzero(found.good)}")
        return table

    def notes(self) -> list[str]:
        """See `Report.notes`."""
        lines = []
        for fix in self.fixes:
            named = f"{fix.name}: " if len(self.fixes) > 1 else ""
            lines += [f"{named}{line}" for line in fix.notes()]
        if self.sky is not None:
            lines[2:2] = self.sky.notes(self.data, self.fix.sigma, self.settings.path)
        for other in self.others:
            latitude, longitude, _ = np.degrees(ecef_to_geodetic(other))
            lines.append(
                f"the differences fit latitude {latitude:.3f} deg, longitude {longitude:.3f} deg as well; the fix is "
                "the place nearest to the receivers"
            )
        for pair, found in self.pairs.items():
            named = f"{found.auxiliary} - {found.main}"
            beyond = abs(self._median(pair)) - self._longest(pair)
            if beyond > _SIGMAS * found.typical_sigma:
                lines.append(
                    f"{named}: its delay is {1e6 * beyond:.3g} us longer than the ground wave allows between the two, "
                    f"{1e6 * self._longest(pair):.1f} us: a sky wave, or a clock that is off"
                )
            if reasons := found.reasons():
                lines.append(f"{named}: flagged: {reasons}")
        lines.append("times are GPS seconds of the week, as the receivers stamp them")
        return list(dict.fromkeys([*lines, *self.data.left_out]))

    def summary(self) -> dict[str, Any]:
        """See `Report.summary`."""
        return {
            "windows": int(self.times.size),
            "integration_s": self.settings.integration_s,
            "receivers": {
                name: {
                    "sample_rate_hz": one.sample_rate,
                    "stale_stamps": one.stale,
                    "false_stamps": one.false,
                    "parts": len(one.parts),
                    "stamp_scatter_s": one.scatter,
                }
                for name, one in zip(self.data.names, self.data.recordings, strict=True)
            },
            "pairs": {
                f"{found.auxiliary} - {found.main}": {
                    "tdoa_s": _finite(self._median(pair)),
                    "scatter_s": _finite(found.scatter),
                    "sigma_s": _finite(found.typical_sigma),
                    "true_s": _finite(self.true_difference(pair)),
                    "windows": int(np.count_nonzero(found.good)),
                }
                for pair, found in self.pairs.items()
            },
            "frequency_hz": self.data.frequency,
            "fix": self.fix.numbers(),
            "sigma_horizontal_with_sky_wave_m": None
            if self.sky is None
            else _finite(float(np.sqrt(np.trace(self.sky.covariance) + self.fix.sigma**2))),
            "estimators": {fix.name: fix.numbers() for fix in self.fixes},
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`: time differences against time, and the map."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.kiwisdr_figures import draw_differences, draw_map

        fix = self.fix
        if not fix.found:
            return []
        who = self.data.transmitter or f"{self.data.frequency / 1e3:.10g} kHz"
        shown = {pair: one for pair, one in list(self.pairs.items())[:_SHOWN] if one.good.any()}
        pairs = {
            f"{one.auxiliary} - {one.main}": (one.tdoa, one.sigma_tdoa, self.true_difference(pair))
            for pair, one in shown.items()
        }
        windows = f"windows of {self.settings.integration_s:g} s"
        against_time = draw_differences(f"{who}: time differences of arrival, {windows}", self.times, pairs)
        found = f"{fix.error / 1e3:.2f} km from it" if self.data.transmitter else "nobody knows where it is"
        place = draw_map(
            f"{who}: the fix, {found}; the scatter alone claims {fix.sigma / 1e3:.2f} km",
            dict(zip(self.data.names, self.data.stations, strict=True)),
            {name: (pair, self._median(pair)) for name, pair in zip(pairs, shown, strict=True)},
            self.settings.path,
            self.data.mast,
            fix.estimate[-1],
            (fix.local(self.singly)[:, :2], fix.local(fix.estimate[-1])[:2], fix.horizontal_covariance()),
        )
        return [save(against_time, folder / "time_differences.png"), save(place, folder / "map.png")]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
