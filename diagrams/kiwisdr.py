"""A long-wave transmitter located by three receivers of hobbyists: I/Q samples of DCF77 from KiwiSDRs with GPS stamps.

The cross-ambiguity block compares the receivers pair by pair, once a second; an estimator makes a fix on the ground of
the time differences against the first receiver. Where the mast stands is used for scoring and nowhere else.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from diagrams.errors import UserError
from diagrams.iq_pairs import PairResult, add_pairs, pair_result, simulate
from diagrams.kiwisdr_settings import Settings
from diagrams.replay import Dataset
from diagrams.tables import Column, Table
from systems.constants import SPEED_OF_LIGHT
from systems.estimators.iekf import Iekf
from systems.estimators.snapshot_start import SnapshotStart
from systems.estimators.wiring import Wiring
from systems.files import read_text
from systems.fixes.snapshot import snapshot_fix, starts_around
from systems.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from systems.iq.kiwi import GpsRecording, common_base, read_kiwi
from systems.measurement.altitude import Altitude
from systems.measurement.stack import Stack
from systems.measurement.tdoa import Tdoa
from systems.motion.constant_velocity import WhiteNoiseAcceleration
from systems.recorder import record
from systems.sensors.joined import JoinedMeasurements, JoinedPart
from systems.signals import Constant

__all__ = ["DATASET", "KiwiData", "KiwiReplay", "Settings", "locate", "read_folder"]

Array = NDArray[np.float64]

_SOURCE = "hcab14/TDoA at 2bb9dc2, iq/20200813T065220Z_77500_*_iq.wav (Christoph Mayer)"
_STATIONS = "stations.csv"
_AT_REST = 1e-3  # m/s; how fast a mast may be


@dataclass(frozen=True, eq=False)
class KiwiData:
    """What is in the folder.

    Attributes
    ----------
    names : list of str
        Of the receivers.
    recordings : list of GpsRecording
    stations : ndarray, shape (p, 3)
        Where the receivers are, on the ellipsoid, Earth-fixed [m].
    mast : ndarray, shape (3,)
        Where the transmitter is; for scoring only.
    transmitter : str
        Its name.
    """

    names: list[str]
    recordings: list[GpsRecording]
    stations: Array
    mast: Array
    transmitter: str


def read_folder(folder: Path) -> KiwiData:
    """Read stations and recordings.

    Raises
    ------
    UserError
        If something is missing or broken; it names file, the ways to name another folder, and the public source.
    """
    try:
        places = _stations(folder / _STATIONS)
        masts = [name for name, (role, _) in places.items() if role == "transmitter"]
        names = [name for name, (role, _) in places.items() if role == "receiver"]
        if len(masts) != 1 or len(names) != 3:
            raise ValueError(
                f"{folder / _STATIONS}: {len(names)} receivers and {len(masts)} transmitters are not allowed; 3 and 1"
            )
        recordings = [read_kiwi(_file(folder, name)) for name in names]
    except (csv.Error, ValueError) as error:
        raise UserError(
            f"data: {error}; name another folder with --data DIR or in the environment variable QUIETFIX_DATA; "
            f"source: {_SOURCE}"
        ) from error
    stations = np.array([places[name][1] for name in names])
    return KiwiData(names, recordings, stations, places[masts[0]][1], masts[0])


def _file(folder: Path, name: str) -> Path:
    found = sorted(folder.glob(f"*_{name}_iq.wav"))
    if len(found) != 1:
        raise ValueError(f"{folder}: {len(found)} files *_{name}_iq.wav are not allowed; one")
    return found[0]


def _stations(file: Path) -> dict[str, tuple[str, Array]]:
    """Return role and Earth-fixed position of every station, by name."""
    columns = ("name", "role", "latitude_deg", "longitude_deg")
    with io.StringIO(read_text(file), newline="") as stream:
        reader = csv.DictReader(stream)
        absent = [column for column in columns if column not in (reader.fieldnames or [])]
        if absent:
            raise ValueError(f"{file}: column {absent[0]} is missing")
        places = {}
        for row in reader:
            try:
                latitude, longitude = (math.radians(float(row[column])) for column in columns[2:])
            except (TypeError, ValueError) as error:
                raise ValueError(f"{file} line {reader.line_num}: latitude and longitude must be numbers") from error
            if not (abs(latitude) <= math.pi / 2 and abs(longitude) <= 2 * math.pi):
                raise ValueError(f"{file} line {reader.line_num}: latitude is -90 to 90, longitude -360 to 360")
            places[row["name"]] = row["role"], geodetic_to_ecef(latitude, longitude, 0.0)
    return places


def locate(data: KiwiData, settings: Settings | None = None) -> KiwiReplay:
    """Compare the receivers and make a fix, in one diagram.

    Parameters
    ----------
    data : KiwiData
        What `read_folder` returned; its mast is not read.
    settings : Settings, optional
        How it is done.
    """
    settings = settings or Settings()
    try:
        blocks, _ = common_base(data.recordings, settings.sample_rate_hz, settings.carrier_hz)
        pairs = list(combinations(range(len(blocks)), 2))
        builder = DiagramBuilder()
        streams = {name: [block] for name, block in zip(data.names, blocks, strict=True)}
        length = settings.integration_s
        compared = add_pairs(builder, streams, pairs, settings.function, settings.window, length, length)
    except ValueError as error:
        raise UserError(f"kiwisdr: {error}") from error

    used = [pair for pair in pairs if pair[0] == 0]
    epochs = compared.clock.ticks(compared.end).size
    # what is known of the altitude is spread over all epochs: in the whole it is known once
    altitude = Altitude(settings.sigma_altitude_m * math.sqrt(epochs))
    model = Stack([Tdoa(1e-6, [j for _, j in used]), altitude])
    parts = {f"pair_{j}{i}": JoinedPart(2) for i, j in used}
    joined = builder.AddSystem(JoinedMeasurements({**parts, "altitude": JoinedPart(1, altitude.noise_covariance())}, 1))
    surface = builder.AddSystem(Constant("surface", [[0.0]]))
    builder.Connect(surface.GetOutputPort("state"), joined.GetInputPort("altitude"))
    for i, j in used:
        sensor = compared.sensors[i, j]
        builder.Connect(sensor.GetOutputPort("measurement"), joined.GetInputPort(f"pair_{j}{i}"))
        builder.Connect(sensor.GetOutputPort("noise_covariance"), joined.GetInputPort(f"pair_{j}{i}_noise_covariance"))
    still = np.concatenate([data.stations, np.zeros_like(data.stations)], axis=1)
    platforms = builder.AddSystem(Constant("stations", still.reshape(1, -1)))
    rows = [name for i, j in used for name in (f"tdoa_{j}{i}", f"fdoa_{j}{i}")] + list(altitude.names)
    wiring = Wiring(1, rows, compared.clock, len(blocks), noise_port=True)
    start = SnapshotStart(model, rows, _AT_REST, 0.0, noise_port=True)
    estimator = builder.AddSystem(Iekf().make("iekf", model, WhiteNoiseAcceleration(1e-12), start, wiring))
    builder.Connect(platforms.GetOutputPort("state"), estimator.GetInputPort("platforms"))
    builder.Connect(joined.GetOutputPort("measurement"), estimator.GetInputPort("measurement"))
    for port in ("noise_covariance", "start_noise_covariance"):
        builder.Connect(joined.GetOutputPort("noise_covariance"), estimator.GetInputPort(port))
    signals = {name: estimator.GetOutputPort(name) for name in ("estimate", "covariance", "nis", "nis_dof")}
    signals |= {name: joined.GetOutputPort(name) for name in ("measurement", "noise_covariance")}
    recorder = record(builder, {**compared.ports(), **signals}, compared.clock)
    times, logs = simulate(builder.Build(), recorder, compared.end)

    columns = [rows.index(name) for name in model.names]
    measured, noise = logs["measurement"][:, 0, columns], logs["noise_covariance"].reshape(-1, len(rows), len(rows))
    singly = snapshot_fix(
        measured,
        still,
        Stack([model.models[0], Altitude(settings.sigma_altitude_m)]),
        _with_altitude(noise[:, columns][:, :, columns], settings.sigma_altitude_m),
        starts_around(still, np.array(0.0)),
    )
    return KiwiReplay(
        data,
        settings,
        times,
        {pair: pair_result(data.names, pair, logs) for pair in pairs},
        logs["estimate"][:, 0, :3],
        logs["covariance"][:, 0].reshape(-1, 6, 6)[:, :3, :3],
        singly.position,
        float(np.nansum(logs["nis"])),
        int(np.nansum(logs["nis_dof"])),
    )


def _with_altitude(noise: Array, sigma: float) -> Array:
    noise = noise.copy()
    noise[:, -1, -1] = sigma**2
    return noise


@dataclass(frozen=True, eq=False)
class KiwiReplay:
    """What came out.

    Attributes
    ----------
    data : KiwiData
    settings : Settings
    times : ndarray, shape (samples,)
        Middle of each comparison [s].
    pairs : mapping of (int, int) to PairResult
        By the places of the receivers.
    estimate, covariance : ndarray, shape (samples, 3), (samples, 3, 3)
        Earth-fixed position [m] after each comparison, and what the estimator believes of it.
    singly : ndarray, shape (samples, 3)
        The fix of each comparison alone.
    nis : float
        Sum of the normalised innovations squared.
    nis_dof : int
        Their degrees of freedom.
    """

    data: KiwiData
    settings: Settings
    times: Array
    pairs: Mapping[tuple[int, int], PairResult]
    estimate: Array
    covariance: Array
    singly: Array
    nis: float
    nis_dof: int

    def true_difference(self, pair: tuple[int, int]) -> float:
        """Return the TDOA of a pair by the straight lines from the mast [s]."""
        distance = np.linalg.norm(self.data.stations[list(pair)] - self.data.mast, axis=-1)
        return float((distance[1] - distance[0]) / SPEED_OF_LIGHT)

    def local(self, position: Array) -> Array:
        """Return east, north, up [m] from the mast of positions (..., 3)."""
        turn = enu_rotation(*ecef_to_geodetic(self.data.mast)[:2])
        return np.einsum("ij,...j->...i", turn, position - self.data.mast)

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

    def _median(self, pair: tuple[int, int]) -> float:
        found = self.pairs[pair]
        return float(np.median(found.tdoa[found.good])) if found.good.any() else math.nan

    def table(self) -> Table:
        """See `Replay.table`."""
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
        """See `Replay.notes`."""
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
        lines += [
            f"{found.auxiliary} - {found.main}: flagged: {reasons}"
            for found in self.pairs.values()
            if (reasons := found.reasons())
        ]
        return lines

    def summary(self) -> dict[str, Any]:
        """See `Replay.summary`."""
        latitude, longitude, _ = ecef_to_geodetic(self.estimate[-1])
        covariance = self.horizontal_covariance()
        numbers = {
            "latitude_deg": math.degrees(latitude),
            "longitude_deg": math.degrees(longitude),
            "horizontal_error_m": self.error,
            "sigma_horizontal_m": self.sigma,
            "sigma_east_m": math.sqrt(covariance[0, 0]),
            "sigma_north_m": math.sqrt(covariance[1, 1]),
            "nis_per_dof": self.nis / max(self.nis_dof, 1),
        }
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
            "fix": {key: _finite(float(value)) for key, value in numbers.items()},
        }

    def draw(self, folder: Path) -> list[Path]:
        """See `Replay.draw`: time differences against time, and the map."""
        from diagrams.figures.kiwisdr import draw_differences, draw_map
        from diagrams.figures.style import save

        return [
            save(draw_differences(self), folder / "time_differences.png"),
            save(draw_map(self), folder / "map.png"),
        ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _run(folder: Path, progress: bool, settings: Settings) -> KiwiReplay:
    return locate(read_folder(folder), settings)


DATASET = Dataset(
    name="kiwisdr", folder="kiwisdr_dcf77", source=_SOURCE, run=_run, holds="stations.csv", settings=Settings
)
