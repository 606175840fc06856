"""Aircraft located by the times at which receivers on the ground hear their messages: LocaRDS.

The receivers with GPS clocks that heard a message are its platforms: four time differences and the barometric altitude
that the message reports. Every track is a run of one and the same diagram. The aircraft's own position, which it
reports as well, is used for scoring and nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from diagrams.errors import choose
from diagrams.locards_data import LocardsSet, Track, read_sets
from diagrams.locards_scores import METHODS, Scores, score
from diagrams.locards_settings import FALLBACK_M, LEAST_M, Settings
from diagrams.locards_sigma import LEAST_MESSAGES, residual_sigma
from diagrams.progress import Progress
from diagrams.replay import Dataset
from diagrams.tables import Column, Table
from systems.constants import SPEED_OF_LIGHT
from systems.estimators.arrival_gate import REFUSED, ArrivalGate
from systems.estimators.base import Estimator, Wiring
from systems.estimators.snapshot_start import SnapshotStart
from systems.measurement.altitude import Altitude
from systems.measurement.refractivity import mean_refractivity
from systems.measurement.stack import Stack
from systems.measurement.tdoa import Tdoa
from systems.motion.constant_velocity import WhiteNoiseAcceleration
from systems.recorder import Recorder, record
from systems.registry import ESTIMATORS, object_at
from systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = [
    "DATASET",
    "Built",
    "LocardsReplay",
    "Settings",
    "build",
    "recording",
    "replay_set",
    "run",
    "run_track",
    "split",
]

Array = NDArray[np.float64]

_EVERY, _MANY = "all", "5+"
_CRUISE = 10e3  # m; for the air, where no altitude is reported


def recording(track: Track, settings: Settings, rng: np.random.Generator | None = None) -> Recording:
    """Return what a sensor would say: rows ``tdoa_10`` ... and ``altitude``.

    Parameters
    ----------
    track : Track
        Messages; what they say of the aircraft's position is not read.
    settings : Settings
        Air, faults.
    rng : numpy.random.Generator, optional
        Draws the faults; needed if there are any.
    """
    arrivals = track.arrivals[:, None].repeat(settings.trials, axis=1)
    if settings.trials > 1 and rng is not None:
        arrivals[:, 1] += _faults(track, settings, rng)
    if settings.air:
        upper = np.where(np.isfinite(track.altitude), track.altitude, _CRUISE)[:, None]
        arrivals /= 1 + np.nanmean(mean_refractivity(track.heights, upper), axis=1)[:, None, None]
    differences = arrivals[..., 1:] - arrivals[..., :1]
    altitude = np.broadcast_to(track.altitude[:, None, None], (*differences.shape[:2], 1))
    return Recording(track.times, np.concatenate([differences, altitude], axis=-1), track.platforms)


def _faults(track: Track, settings: Settings, rng: np.random.Generator) -> Array:
    messages, receivers = track.arrivals.shape
    error = settings.fault_m / SPEED_OF_LIGHT * rng.choice([-1.0, 1.0], messages)
    struck = rng.random(messages) < settings.fault_share
    chosen = rng.integers(receivers, size=(messages, 1))
    return np.where(struck, error, 0.0)[:, None] * (np.arange(receivers) == chosen)


def split(track: Track, gap: float) -> list[Track]:
    """Cut a track wherever the aircraft was silent for longer than `gap` seconds."""
    times = track.times
    cuts = [0, *(i for i in range(1, len(times)) if times[i] - times[i - 1] > gap), len(times)]
    return [track.part(slice(a, b)) for a, b in pairwise(cuts)]


@dataclass(frozen=True)
class Built:
    """The diagram of a set.

    Attributes
    ----------
    diagram : Diagram
    recorded : RecordedMeasurements
        Where a run chooses its track.
    recorder : Recorder
        Signals ``gate``, ``no_gate`` (estimates) and ``excluded``.
    sigma_tdoa : float
        What is believed of a time difference, as a length [m].
    """

    diagram: Diagram
    recorded: RecordedMeasurements
    recorder: Recorder
    sigma_tdoa: float


def build(recordings: Sequence[Recording], settings: Settings) -> Built:
    """Wire recordings, gate and two estimators, one of them without the gate.

    Parameters
    ----------
    recordings : sequence of Recording
        See `recording`.
    settings : Settings
        What is believed; where it leaves sigma open, the recordings as a whole tell it.
    """
    builder = DiagramBuilder()
    recorded = builder.AddSystem(RecordedMeasurements(recordings))
    trials, platforms = recorded.trials, recorded.platforms
    sigma = settings.sigma_tdoa_m or (
        residual_sigma(recordings, FALLBACK_M, settings.sigma_altitude_m, LEAST_M) or FALLBACK_M
    )
    tdoa = Tdoa(sigma / SPEED_OF_LIGHT, range(1, platforms), correlated=True)
    model = Stack([tdoa, Altitude(settings.sigma_altitude_m)])
    gate = builder.AddSystem(
        ArrivalGate(model, tdoa, trials, platforms, height="altitude", false_alarm=settings.false_alarm)
    )
    options = object_at(ESTIMATORS[choose("estimator", settings.estimator, ESTIMATORS)])()
    motion = WhiteNoiseAcceleration(settings.acceleration_density_m2ps3)

    def estimator(name: str, gated: bool) -> Estimator:
        start = SnapshotStart(model, model.names, settings.sigma_velocity_mps, "altitude", noise_port=gated)
        wiring = Wiring(trials, model.names, recorded.clock, platforms, noise_port=gated)
        return builder.AddSystem(options.make(name, model, motion, start, wiring))

    guarded = estimator(settings.estimator, True)
    bare = estimator(f"{settings.estimator}_no_gate", False)
    carriers = recorded.GetOutputPort("platforms")
    for block in (gate, guarded, bare):
        builder.Connect(carriers, block.GetInputPort("platforms"))
    for block in (gate, bare):
        builder.Connect(recorded.GetOutputPort("measurement"), block.GetInputPort("measurement"))
    for port in ("measurement", "noise_covariance"):
        builder.Connect(gate.GetOutputPort(port), guarded.GetInputPort(port))
    builder.Connect(gate.GetOutputPort("noise_covariance"), guarded.GetInputPort("start_noise_covariance"))
    for port in ("prediction", "prediction_covariance"):
        builder.Connect(guarded.GetOutputPort(port), gate.GetInputPort(port))
    signals = {
        "gate": guarded.GetOutputPort("estimate"),
        "no_gate": bare.GetOutputPort("estimate"),
        "excluded": gate.GetOutputPort("excluded"),
    }
    recorder = record(builder, signals, recorded.clock)
    return Built(builder.Build(), recorded, recorder, sigma)


def run_track(built: Built, track: int) -> dict[str, Array]:
    """Run one track in a context of its own; return each signal at the track's messages, (messages, trials, size)."""
    context = built.diagram.CreateDefaultContext()
    end = built.recorded.select(context, track)
    simulator = Simulator(built.diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    times, signals = built.recorder.result(context)
    clock = built.recorded.recordings[track].clock
    mine = [clock.index(time) is not None for time in times]
    return {name: values[mine] for name, values in signals.items()}


def replay_set(data: LocardsSet, settings: Settings, bar: Progress | None = None, done: int = 0) -> Scores:
    """Run all tracks of a set and score the estimates against the aircraft's own positions.

    Parameters
    ----------
    data : LocardsSet
        The set.
    settings : Settings
        What is believed, and what is tried out.
    bar : Progress, optional
        Is told how many messages are done, counted from `done`.
    """
    rng = np.random.default_rng(settings.seed)
    parts, sizes = [], []
    for track in data.tracks:
        pieces = split(track, settings.gap_s)
        parts += pieces
        sizes += [len(track.times)] * len(pieces)
    recordings = [recording(part, settings, rng) for part in parts]
    # A diagram each: sigma is estimated from what is heard in that trial, faults included.
    built = [build([_trial(one, k) for one in recordings], settings) for k in range(settings.trials)]
    sigma = np.array([one.sigma_tdoa for one in built])
    scores = []
    for i, (part, size) in enumerate(zip(parts, sizes, strict=True)):
        runs = [run_track(one, i) for one in built]
        signals = {name: np.concatenate([one[name] for one in runs], axis=1) for name in runs[0]}
        refused = signals["excluded"][..., 0] == REFUSED
        estimates = np.stack([signals["gate"], signals["no_gate"]])[..., :3]
        estimates[0][refused] = np.nan
        scores.append(score(part, size, estimates, signals["excluded"][..., 0], sigma))
        done += len(part.times)
        if bar is not None:
            bar.update(done)
    return Scores.join(scores)


def _trial(recorded: Recording, trial: int) -> Recording:
    return Recording(recorded.times, recorded.measurement[:, trial], recorded.platforms[:, 0])


@dataclass(frozen=True)
class LocardsReplay:
    """Scores of all sets; a `Replay`.

    Attributes
    ----------
    settings : Settings
    sets : list of LocardsSet
    scores : list of Scores
        One per set.
    """

    settings: Settings
    sets: list[LocardsSet]
    scores: list[Scores]

    @property
    def all(self) -> Scores:
        """The messages of all sets."""
        return Scores.join(self.scores)

    def groups(self) -> list[tuple[str, str, dict[str, Any]]]:
        """Return set, which aircraft and summary, of each row of the table."""
        parts = [(data.name, 0, scores) for data, scores in zip(self.sets, self.scores, strict=True)]
        parts.append(("all sets", 0, self.all))
        if self.settings.trials > 1:
            parts.append(("faults", 1, self.all))
        return [
            (name, who, scores.summary(trial, which))
            for name, trial, scores in parts
            for who, which in ((_EVERY, None), (_MANY, scores.many))
        ]

    def table(self) -> Table:
        """See `Replay.table`."""
        title = f"LocaRDS: horizontal error of {self.settings.estimator} in metres, with / without the gate"
        heads = ("messages", "with fix, %", "50 %", "90 %", "99 %")
        table = Table(title, [Column("set"), Column("aircraft"), *heads], keys=2)
        for name, who, row in self.groups():
            pair = [row[method] for method in METHODS]
            shares = " / ".join(
                "-" if r["share_with_fix"] is None else f"{100 * r['share_with_fix']:.3g}" for r in pair
            )
            errors = [" / ".join(_metres(r[f"p{p}_m"]) for r in pair) for p in (50, 90, 99)]
            table.add(name, who, str(row["messages"]), shares, *errors)
        return table

    def notes(self) -> list[str]:
        """See `Replay.notes`."""
        scores = self.all
        aside, ahead = (np.abs(part[0, :, 0]) for part in (scores.across, scores.along))
        lines = ["5+: aircraft with at least five messages in their set; percentiles are over the messages with a fix"]
        if np.isfinite(aside).any():
            lines.append(
                f"with the gate, across the course: {np.nanmedian(aside):.0f} m (50 %), "
                f"{np.nanpercentile(aside, 90):.0f} m (90 %); along it: {np.nanmedian(ahead):.0f} m, "
                f"{np.nanpercentile(ahead, 90):.0f} m, and {np.nanmedian(scores.along[0, :, 0]):+.0f} m in the median: "
                "the positions that aircraft report are a fraction of a second old"
            )
        lines += self._sigmas()
        if not scores.known.all():
            fixed = np.isfinite(scores.fix[~scores.known]).all(axis=-1)
            lines.append(
                f"{fixed.size} of {scores.known.size} messages report no position, which nothing here can judge; they "
                f"are not in the table. {100 * fixed.mean():.3g} % of them have a fix with the gate"
            )
        if self.settings.trials > 1:
            lines.append(
                f"faults: {self.settings.fault_m:g} m added at one receiver in "
                f"{100 * self.settings.fault_share:g} % of the messages"
            )
        return lines

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
        """See `Replay.summary`."""
        keys = {_EVERY: "all_aircraft", _MANY: "five_messages_or_more"}
        result: dict[str, Any] = {"settings": vars(self.settings), "sets": {}}
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

    def draw(self, folder: Path) -> list[Path]:
        """See `Replay.draw`."""
        from diagrams.figures.locards import draw_errors, draw_map, draw_track_errors
        from diagrams.figures.style import save

        figures = {"errors": draw_errors(self), "along_across": draw_track_errors(self), "map": draw_map(self)}
        return [save(figure, folder / f"{name}.png") for name, figure in figures.items()]


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def run(folder: Path, progress: bool = True, settings: Settings | None = None) -> LocardsReplay:
    """Replay all sets of a folder.

    Parameters
    ----------
    folder : Path
        Folder of ``sensors.csv`` and ``set_*.csv``.
    progress : bool
        Show a progress bar.
    settings : Settings, optional
        By default those documented there.
    """
    settings = settings or Settings()
    sets = read_sets(folder)
    sizes = [sum(len(track.times) for track in data.tracks) for data in sets]
    scores = []
    with Progress("locards", sum(sizes), progress) as bar:
        for i, data in enumerate(sets):
            scores.append(replay_set(data, settings, bar, sum(sizes[:i])))
    return LocardsReplay(settings, sets, scores)


DATASET = Dataset(
    name="locards",
    folder="locards_mlat",
    source="LocaRDS, doi 10.3390/s21165516, https://zenodo.org/record/4739276 (these example files: lschoe/mpyc, "
    "demos/data/mlat)",
    run=run,
    holds="set_*.csv",
    settings=Settings,
)
