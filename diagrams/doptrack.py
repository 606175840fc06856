"""Where a station stands, from the one-way Doppler of a satellite with a free-running oscillator: DopTrack.

The satellite is known (SGP4), the station is not, but for its altitude: the beacon problem the other way round. The
passes go one after the other through estimator blocks whose state is the station's position, which stays, and the
oscillator's error as range rate with its derivatives, which start anew in every pass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.optimize import least_squares

from diagrams.doptrack_data import Pass, read_passes
from diagrams.doptrack_settings import Settings
from diagrams.errors import UserError
from diagrams.replay import Dataset
from diagrams.tables import Column, Table
from systems.estimators.base import Wiring
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.start import GivenStart
from systems.filters.iterated_extended import IteratedExtendedKalman
from systems.filters.robust import StudentRows
from systems.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from systems.measurement.altitude import Altitude
from systems.measurement.range_rate import RangeRate
from systems.measurement.stack import Stack
from systems.motion.pass_oscillator import PassOscillator
from systems.recorder import record
from systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = ["DATASET", "ORDERS", "DoptrackReplay", "Settings", "batch_fix", "replay_passes"]

Array = NDArray[np.float64]

ORDERS = {"bias": 1, "bias_drift": 2, "bias_drift_rate": 3}
"""The estimators: how many states the oscillator has."""

_STATES = (("bias", "m/s"), ("drift", "m/s^2"), ("drift rate", "m/s^3"))
_FAR = 4.0  # sigmas: a Gaussian is beyond once in 16 000 times


@dataclass(frozen=True, eq=False)
class _Stream:
    """The samples that are used, of all passes in sequence."""

    times: Array
    range_rate: Array
    satellite: Array
    which: NDArray[np.int64]
    passes: list[Pass]
    left_out: int


def _stream(passes: Sequence[Pass], settings: Settings) -> _Stream:
    used = [one for one in passes if settings.selection.takes(one)]
    if not used:
        raise UserError("doptrack: the selection takes no pass; lower its elevation, span or samples")
    parts: list[tuple[Array, Array, Array, NDArray[np.int64]]] = []
    for i, one in enumerate(used):
        # The first sample in each interval of `every_s`.
        _, first = np.unique(np.floor(one.times / settings.every_s), return_index=True)
        stamp = (one.start - used[0].start) * 86400.0 + one.times[first] - used[0].times[0]
        parts.append((stamp, one.range_rate[first], one.satellite[first], np.full(first.size, i)))
    times, rates, satellites, which = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Stream(times, rates, satellites, which, used, len(passes) - len(used))


def _start(passes: Sequence[Pass], settings: Settings) -> Array:
    """Return the start: `offset_km` from the station, at the known altitude."""
    latitude, longitude, height = ecef_to_geodetic(passes[0].station)
    course, angle = np.radians(settings.offset_course_deg), settings.offset_km / 6371.0
    moved = latitude + angle * np.cos(course), longitude + angle * np.sin(course) / np.cos(latitude)
    return geodetic_to_ecef(*moved, height)


def _local(position: Array, station: Array) -> Array:
    """Return east, north, up [m] of positions (..., 3) from the station."""
    latitude, longitude, _ = ecef_to_geodetic(station)
    return np.einsum("ij,...j->...i", enu_rotation(latitude, longitude), position - station)


def replay_passes(passes: Sequence[Pass], settings: Settings | None = None) -> DoptrackReplay:
    """Run the estimators over the passes, in one diagram on one stream of measurements."""
    settings = settings or Settings()
    stream = _stream(passes, settings)
    count = stream.times.size
    # What is known of the altitude is spread over all samples: linearised at each of them, and once in the whole.
    altitude = Altitude(settings.sigma_altitude_m * np.sqrt(count))
    known = np.full(count, stream.passes[0].altitude)

    builder = DiagramBuilder()
    rows = ("range_rate_0", "altitude")
    recording = Recording(stream.times, np.stack([stream.range_rate, known], axis=1), stream.satellite[:, None])
    recorded = builder.AddSystem(RecordedMeasurements([recording]))
    wiring = Wiring(1, rows, recorded.clock, platforms=1)
    start = _start(stream.passes, settings)
    blocks, ports = {}, {}
    for name, order in ORDERS.items():
        sigmas = settings.sigmas[:order]
        spread = np.diag(np.square([1e3 * settings.offset_km] * 3 + list(sigmas)))
        block = builder.AddSystem(
            KalmanEstimator(
                name,
                StudentRows(IteratedExtendedKalman(), settings.freedom, rows=[0]),
                Stack([RangeRate(settings.sigma_mps[order - 1], [0], bias=3, at_rest=True), altitude]),
                PassOscillator(sigmas, settings.pause_s),
                GivenStart(np.concatenate([start, np.zeros(order)]), spread),
                wiring,
            )
        )
        for port in ("measurement", "platforms"):
            builder.Connect(recorded.GetOutputPort(port), block.GetInputPort(port))
        blocks[name] = block
        ports[name] = block.GetOutputPort("estimate")
        ports[f"{name}/covariance"] = block.GetOutputPort("covariance")
    recorder = record(builder, ports, recorded.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    end = recorded.select(context, 0)
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    times, logs = recorder.result(simulator.get_context())
    estimates = {name: logs[name][:, 0, :3] for name in ORDERS}
    sigmas_h = {}
    for name, order in ORDERS.items():
        covariance = logs[f"{name}/covariance"][-1, 0].reshape(3 + order, 3 + order)[:3, :3]
        turn = enu_rotation(*ecef_to_geodetic(estimates[name][-1])[:2])
        sigmas_h[name] = float(np.sqrt(np.trace((turn @ covariance @ turn.T)[:2, :2])))
    return DoptrackReplay(settings, stream, times, estimates, sigmas_h)


def _polynomial(times: Array, order: int) -> Array:
    scaled = (times - times.mean()) / 100.0
    return np.stack([scaled**k for k in range(order)], axis=1)


def _misfit(stream: _Stream, position: Array) -> Array:
    """Return measured minus predicted range rate at a station [m/s], shape (samples,)."""
    offset = position - stream.satellite[:, :3]
    distance = np.linalg.norm(offset, axis=-1)
    left: Array = stream.range_rate + np.einsum("ki,ki->k", offset, stream.satellite[:, 3:]) / distance
    return left


def _far_off(stream: _Stream, position: Array, sigmas: Sequence[float]) -> list[tuple[float, str]]:
    """Return what lies far outside its prior, the worst first: number of sigmas, and it in words.

    The oscillator's states at the start of each pass by least squares of the misfit at a station: the estimator's own
    are drawn to the prior, and its weights take what the prior cannot be for outliers.
    """
    left, far = _misfit(stream, position), []
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


def _residual(stream: _Stream, position: Array, order: int, scale: float) -> Array:
    """Return measured minus predicted range rate at a station, after the best oscillator of each pass (robust)."""
    left = _misfit(stream, position)
    for i in range(len(stream.passes)):
        rows = stream.which == i
        basis = _polynomial(stream.times[rows], order)
        weight = np.ones(basis.shape[0])
        for _ in range(20):
            fit = np.linalg.lstsq(weight[:, None] * basis, weight * left[rows], rcond=None)[0]
            rest = left[rows] - basis @ fit
            weight = 1 / np.sqrt(1 + (rest / (2 * scale)) ** 2)
        left[rows] = rest
    return left


def batch_fix(passes: Sequence[Pass], order: int, settings: Settings | None = None) -> Array:
    """Return the station by least squares over all samples at once, Earth-fixed [m]: the oracle of the replay.

    Robust (soft L1) in latitude, longitude and height; each pass's oscillator is fitted in closed form at every step.
    """
    settings = settings or Settings()
    stream, sigma = _stream(passes, settings), settings.sigma_mps[order - 1]
    begin = np.array(ecef_to_geodetic(_start(stream.passes, settings)))
    altitude = stream.passes[0].altitude
    reach = np.array([1e-3, 1e-3, 100.0])

    def misfit(x: Array) -> Array:
        place = begin + reach * x
        left = _residual(stream, geodetic_to_ecef(*place), order, sigma) / sigma
        robust = np.sign(left) * np.sqrt(2 * (np.sqrt(1 + left**2) - 1))
        return np.append(robust, (place[2] - altitude) / settings.sigma_altitude_m)

    found = least_squares(misfit, np.zeros(3), diff_step=1e-4)
    return geodetic_to_ecef(*(begin + reach * found.x))


@dataclass(frozen=True, eq=False)
class DoptrackReplay:
    """What came out of the passes.

    Attributes
    ----------
    settings : Settings
    stream : _Stream
        The samples that were used.
    times : ndarray, shape (samples,)
        Since the first sample [s].
    estimates : mapping of str to ndarray, shape (samples, 3)
        Earth-fixed position of the station, per estimator.
    sigmas : mapping of str to float
        Horizontal standard deviation that each estimator believes in at the end [m].
    """

    settings: Settings
    stream: _Stream
    times: Array
    estimates: Mapping[str, Array]
    sigmas: Mapping[str, float]

    def errors(self, name: str) -> Array:
        """Return east, north, up errors at every sample [m], shape (samples, 3)."""
        return _local(self.estimates[name], self.stream.passes[0].station)

    def horizontal_error(self, name: str) -> float:
        """Return the horizontal error at the end [m]."""
        return float(np.hypot(*self.errors(name)[-1, :2]))

    def robust_sigma(self, name: str) -> float:
        """Return 1.4826 times the median absolute residual at the final position [m/s]."""
        left = _residual(self.stream, self.estimates[name][-1], ORDERS[name], self.settings.sigma_mps[ORDERS[name] - 1])
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
        sigmas = self.settings.sigmas
        found = {
            name: _far_off(self.stream, self.estimates[name][-1], sigmas[: ORDERS[name]]) for name in self.estimates
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
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 4), layout="constrained")
        axes = figure.add_subplot()
        ends = np.flatnonzero(np.diff(self.stream.which, append=-1))
        for name in self.estimates:
            error = np.hypot(*self.errors(name)[ends, :2].T)
            axes.semilogy(np.arange(1, ends.size + 1), 1e-3 * error, marker="o", label=name.replace("_", " + ", 1))
        axes.set(xlabel="passes used", ylabel="horizontal error of the station [km]")
        axes.grid(True, which="both", alpha=0.3)
        axes.legend()
        path = folder / "station_error.png"
        figure.savefig(path, dpi=120)
        return [path]


def _run(folder: Path, progress: bool, settings: Settings) -> DoptrackReplay:
    return replay_passes(read_passes(folder), settings)


DATASET = Dataset(
    name="doptrack",
    folder="doptrack_delfic3",
    source="DopTrack/estimate at cd28508, sod_assignments/{data,metadata}.tar.xz (TU Delft)",
    run=_run,
    holds="*.yml",
    settings=Settings,
)
