"""What a comparison of I/Q recordings tells: TDOA and FDOA against time."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.recorded import Report
from quietfix.diagrams.console.tables import Column, Table
from quietfix.diagrams.parts.iq_comparison import PairResult
from quietfix.diagrams.recorded.locating.position import FOLDER, Located
from quietfix.diagrams.recorded.locating.rows import Rows, write_rows
from quietfix.diagrams.recorded.settings.iq_settings import Settings

__all__ = ["IqReport", "rows_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class IqReport:
    """What came out of a comparison of recordings.

    Attributes
    ----------
    settings : Settings
    dated : bool
        Whether the files say when they begin; otherwise they were taken to begin together.
    length : float
        Integration time [s].
    times : ndarray, shape (samples,)
        Middle of each comparison at the first receiver, since the first sample of all [s].
    pairs : list of PairResult
        Each recording against the first.
    gaps : list of str
        What of the recordings was not compared, in words, and what is doubtful.
    began : (int, float), optional
        First sample of all in seconds of TAI since 1970.
    phases : list of Rows
        Between channels of one recording.
    located : Located, optional
        Where the emitter is; None: nobody knows where the receivers are.
    written : TemporaryDirectory, optional
        That of the system that located it.
    """

    settings: Settings
    dated: bool
    length: float
    times: Array
    pairs: list[PairResult] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)
    began: tuple[int, float] | None = None
    phases: list[Rows] = field(default_factory=list)
    located: Located | None = None
    written: TemporaryDirectory[str] | None = None

    @property
    def further(self) -> list[Report]:
        """Reports that are printed below this one: that of the position."""
        return [] if self.located is None or self.located.report is None else [self.located.report]

    def rows(self) -> list[Rows]:
        """Return what was measured as rows of a table."""
        return rows_of(self.pairs) + self.phases

    def table(self) -> Table:
        """See `Report.table`."""
        heads = ("TDOA, us", "scatter", "sigma", "FDOA, Hz", "scatter", "sigma", "peak, dB", "found")
        title = f"{self.times.size} comparisons of {1e3 * self.length:.4g} ms with {self.pairs[0].main}"
        table = Table(title, [Column("recording"), *heads])
        for pair in self.pairs:
            good = pair.good
            if not good.any():
                table.add(pair.auxiliary, *["-"] * 7, f"0 of {good.size}")
                continue
            table.add(
                pair.auxiliary,
                f"{1e6 * np.median(pair.tdoa[good]):.4f}",
                f"{1e6 * pair.tdoa[good].std():.4f}",
                f"{1e6 * np.median(pair.sigma_tdoa[good]):.4f}",
                f"{np.median(pair.fdoa[good]):.3f}",
                f"{pair.fdoa[good].std():.3f}",
                f"{np.median(pair.sigma_fdoa[good]):.3f}",
                f"{10 * np.log10(np.median(pair.peak[good])):.1f}",
                f"{np.count_nonzero(good)} of {good.size}",
            )
        return table

    def notes(self) -> list[str]:
        """See `Report.notes`."""
        lines = [f"differences: that recording minus {self.pairs[0].main}; medians over time"]
        if not self.dated:
            lines.append("the files do not say when they begin (core:datetime); they were taken to begin together")
        else:
            lines.append("the files' dates (core:datetime) are UTC")
        lines += self.gaps
        lines += [_phase_line(one) for one in self.phases]
        lines += [f"{pair.auxiliary}: flagged: {reasons}" for pair in self.pairs if (reasons := pair.reasons())]
        return lines + ([] if self.located is None else self.located.notes)

    def summary(self) -> Mapping[str, Any]:
        """See `Report.summary`."""
        return {
            "integration_s": self.length,
            "settings": asdict(self.settings),
            "gaps": self.gaps,
            "time_s": self.times.tolist(),
            **({} if self.located is None else {"position": self._position()}),
            "pairs": {
                f"{pair.auxiliary} - {pair.main}": {
                    **_medians(pair),
                    "tdoa_s": _listed(pair.tdoa),
                    "sigma_tdoa_s": _listed(pair.sigma_tdoa),
                    "fdoa_hz": _listed(pair.fdoa),
                    "sigma_fdoa_hz": _listed(pair.sigma_fdoa),
                    "peak_to_noise": _listed(pair.peak),
                    "flag": pair.flag.tolist(),
                }
                for pair in self.pairs
            },
        }

    def _position(self) -> dict[str, Any]:
        """Return what is known of the place, for ``summary.json``."""
        assert self.located is not None
        told = [] if self.located.report is None else self.located.report.summary()["targets"]
        return {"notes": self.located.notes, "estimates": told}

    def draw(self, folder: Path) -> list[Path]:
        """See `Report.draw`: figure, the same numbers as CSV, measurements as a table, and what the position gave."""
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.recorded.reports.iq_figures import draw_differences

        pairs = {
            f"{pair.auxiliary} minus {pair.main}": (
                ("TDOA [us]", 1e6 * pair.tdoa, 1e6 * pair.sigma_tdoa),
                ("FDOA [Hz]", pair.fdoa, pair.sigma_fdoa),
            )
            for pair in self.pairs
        }
        found = [
            save(draw_differences(pairs, self.times, self.length), folder / "differences.png"),
            self._write(folder / "differences.csv"),
            folder / "measurements.csv",
        ]
        write_rows(found[-1], self.began, self.times, self.rows())
        if self.written is not None:
            found.append(Path(copytree(self.written.name, folder / FOLDER)))
        return found + [path for one in self.further for path in one.draw(folder)]

    def _write(self, path: Path) -> Path:
        with path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(
                ["time_s", "main", "auxiliary", "tdoa_s", "sigma_tdoa_s", "fdoa_hz", "sigma_fdoa_hz", "flag"]
            )
            for pair in self.pairs:
                columns = (pair.tdoa, pair.sigma_tdoa, pair.fdoa, pair.sigma_fdoa)
                for k, time in enumerate(self.times):
                    numbers = [f"{column[k]:.12g}" if np.isfinite(column[k]) else "" for column in columns]
                    writer.writerow([f"{time:.9f}", pair.main, pair.auxiliary, *numbers, int(pair.flag[k])])
        return path


def rows_of(pairs: Sequence[PairResult]) -> list[Rows]:
    """Return TDOA, then FDOA, of all pairs as rows of a table."""
    tdoa = [Rows("tdoa", one.auxiliary, one.main, "s", one.tdoa, one.sigma_tdoa) for one in pairs]
    return tdoa + [Rows("fdoa", one.auxiliary, one.main, "Hz", one.fdoa, one.sigma_fdoa) for one in pairs]


def _phase_line(one: Rows) -> str:
    found = one.there
    if not found.any():
        return f"{one.receiver}: no phase against {one.reference}"
    mean = np.angle(np.exp(1j * one.value[found]).mean(), deg=True)
    sigma = np.degrees(np.median(one.sigma[found]))
    return (
        f"{one.receiver}: phase against {one.reference} {mean:.2f} deg (mean of {np.count_nonzero(found)}; one has a "
        f"sigma of {sigma:.2g} deg)"
    )


def _listed(values: Array) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def _medians(pair: PairResult) -> dict[str, float | int | None]:
    """Return the numbers of the table: medians over time, and scatters about them, of what is good."""
    good = pair.good
    found: dict[str, float | int | None] = {"found": int(np.count_nonzero(good))}
    for name, unit in (("tdoa", "s"), ("fdoa", "hz")):
        values, sigmas = getattr(pair, name)[good], getattr(pair, f"sigma_{name}")[good]
        found[f"median_{name}_{unit}"] = float(np.median(values)) if good.any() else None
        found[f"scatter_{name}_{unit}"] = float(values.std()) if good.any() else None
        found[f"median_sigma_{name}_{unit}"] = float(np.median(sigmas)) if good.any() else None
    return found
