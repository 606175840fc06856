"""Aircraft located by the times at which receivers on the ground hear their messages: LocaRDS.

The receivers with GPS clocks that heard a message are its platforms: four time differences and the barometric altitude
that the message reports; where it reports none, one is assumed. Every track is a run of one and the same diagram. The
aircraft's own position, if it reports one, is used for scoring and nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.recorded import RecordedStream
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.readers.data import Source, data_folder
from quietfix.diagrams.readers.locards_data import AircraftTrack, LocardsSet, holds_messages, read_sets
from quietfix.diagrams.recorded.reports.locards_report import Piece, report
from quietfix.diagrams.recorded.settings.locards_settings import FALLBACK_M, LEAST_M, Settings
from quietfix.diagrams.recorded.settings.locards_sigma import residual_sigma
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.estimators.arrival_gate import ArrivalGate
from quietfix.systems.geometry.refractivity import mean_refractivity
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.sensors.recorded import Recording
from quietfix.systems.starts.snapshot_start import SnapshotStart

__all__ = ["SOURCE", "SYSTEM", "Settings", "declare", "declare_sets", "recording", "split"]

Array = NDArray[np.float64]

SOURCE = Source(
    folder="locards_mlat",
    origin="LocaRDS, doi 10.3390/s21165516, https://zenodo.org/record/4739276 (these example files: lschoe/mpyc, "
    "demos/data/mlat)",
    holds="set_*.csv",
)

_CRUISE = 10e3  # m; for the air, where no altitude is reported


def recording(track: AircraftTrack, settings: Settings, rng: np.random.Generator | None = None) -> Recording:
    """Return what a sensor would say: rows ``tdoa_10`` ... and ``altitude``.

    Parameters
    ----------
    track : AircraftTrack
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


def _faults(track: AircraftTrack, settings: Settings, rng: np.random.Generator) -> Array:
    messages, receivers = track.arrivals.shape
    error = settings.fault_m / SPEED_OF_LIGHT * rng.choice([-1.0, 1.0], messages)
    struck = rng.random(messages) < settings.fault_share
    chosen = rng.integers(receivers, size=(messages, 1))
    return np.where(struck, error, 0.0)[:, None] * (np.arange(receivers) == chosen)


def split(track: AircraftTrack, gap: float) -> list[AircraftTrack]:
    """Cut a track wherever the aircraft was silent for longer than `gap` seconds."""
    times = track.times
    cuts = [0, *(i for i in range(1, len(times)) if times[i] - times[i - 1] > gap), len(times)]
    return [track.part(slice(a, b)) for a, b in pairwise(cuts)]


def declare(settings: Settings) -> Model:
    """Return the tracks of all sets and what the estimators are given; see `quietfix.diagrams.assembly`."""
    named = Path(settings.data)
    folder = named if settings.data and holds_messages(named) else data_folder(SOURCE, settings.data)
    return declare_sets(read_sets(folder), settings)


def declare_sets(sets: Sequence[LocardsSet], settings: Settings) -> Model:
    """Return the same of sets that were read already."""
    pieces, tracks = _tracks(sets, settings)
    played = RecordedStream(tracks, [_truth(piece.track) for piece in pieces])
    receivers = tracks[0].platforms.shape[2]
    # R comes with the messages, whose sigma is that of their set
    model, tdoa = _measured(pieces[0].sigma, receivers, settings)
    motion = WhiteNoiseAcceleration(settings.acceleration_density_m2ps3)

    def assume(bus: Bus, name: str, options: Any) -> Assumed:
        start = SnapshotStart(model, model.names, settings.sigma_velocity_mps, "altitude", noise_port=True)
        gate = "" if name in settings.without_gate else f"gate_{name}."
        if gate:
            block = ArrivalGate(
                model,
                tdoa,
                bus.trials,
                receivers,
                height="altitude",
                false_alarm=settings.false_alarm,
                name=gate[:-1],
                noise_port=True,
            )
            bus.add(block, feedback={port: f"{name}.{port}" for port in ("prediction", "prediction_covariance")})
        noise = f"{gate}noise_covariance"
        takes = {"measurement": f"{gate}measurement", "noise_covariance": noise, "start_noise_covariance": noise}
        return Assumed(model, motion, start, model.names, takes)

    gated = {name: f"gate_{name}.excluded" for name in settings.estimators if name not in settings.without_gate}
    return Model(
        clock=played.clock,
        duration=played.duration,
        divergence=1e3 * settings.divergence_km,
        parts=[played],
        assume=assume,
        truth_states=POSITION,
        platforms=[f"receiver_{i}" for i in range(receivers)],
        signals={f"excluded_{name}": signal for name, signal in gated.items()},
        rows=model.names,
        recorded=Recorded(
            tracks=[piece.name for piece in pieces],
            clocks=played.clocks,
            times=played.times,
            report=partial(report, sets=sets, pieces=pieces, settings=settings),
            keeps=["covariance", *(f"excluded_{name}" for name in gated)],
            truth=any(np.isfinite(_truth(piece.track)).any() for piece in pieces),
        ),
    )


def _measured(sigma: float, receivers: int, settings: Settings) -> tuple[MeasurementModel, Tdoa]:
    """Return what is measured, and the part of it that is time differences of so large a sigma [m]."""
    tdoa = Tdoa(sigma / SPEED_OF_LIGHT, range(1, receivers), correlated=True)
    return Stack([tdoa, Altitude(settings.sigma_altitude_m)]), tdoa


def _tracks(sets: Sequence[LocardsSet], settings: Settings) -> tuple[list[Piece], list[Recording]]:
    """Return the tracks, first as recorded, then with faults, and what was measured on them."""
    width = max(track.arrivals.shape[1] for data in sets for track in data.tracks)
    heard: list[list[tuple[Piece, Recording]]] = [[] for _ in range(settings.trials)]
    for i, data in enumerate(sets):
        rng = np.random.default_rng(settings.seed)
        parts = [(track, n, part) for track in data.tracks for n, part in enumerate(split(track, settings.gap_s))]
        recordings = [recording(part, settings, rng) for _, _, part in parts]
        for k, found in enumerate(heard):
            # sigma is estimated from what is heard in that trial, faults included
            ones = [_trial(one, k) for one in recordings]
            assumed = settings.assumed_altitude_m, settings.sigma_assumed_altitude_m
            sigma = settings.sigma_tdoa_m or (
                residual_sigma(ones, FALLBACK_M, settings.sigma_altitude_m, LEAST_M, assumed) or FALLBACK_M
            )
            noise = _measured(sigma, width, settings)[0].noise_covariance()
            for (track, n, part), one in zip(parts, ones, strict=True):
                name = f"{data.name}/{track.aircraft}" + f".{n}" * (n > 0) + ", faults" * (k > 0)
                widened = _assumed(_widened(one, width, noise), settings)
                found.append((Piece(name, i, part, track.times.size, sigma), widened))
    every = [one for found in heard for one in found]
    return [piece for piece, _ in every], [one for _, one in every]


def _trial(recorded: Recording, trial: int) -> Recording:
    return Recording(recorded.times, recorded.measurement[:, trial], recorded.platforms[:, 0])


def _widened(recorded: Recording, receivers: int, noise: Array) -> Recording:
    """Return a recording with room for so many receivers, and with R."""
    samples, _, had, _ = recorded.platforms.shape
    measurement = np.insert(recorded.measurement[:, 0], [had - 1] * (receivers - had), np.nan, axis=1)
    platforms = np.pad(recorded.platforms, [(0, 0), (0, 0), (0, receivers - had), (0, 0)], constant_values=np.nan)
    return Recording(recorded.times, measurement, platforms, np.broadcast_to(noise, (samples, *noise.shape)))


def _assumed(recorded: Recording, settings: Settings) -> Recording:
    r"""Return a recording with an altitude for every message that reports none.

    The altitude that is assumed is one fact, not one a message: the first of n messages has it with its standard
    deviation s, each of the others with :math:`s \sqrt{n - 1}`, so that all together tell no more than two do.
    """
    silent = np.flatnonzero(np.isnan(recorded.measurement[:, 0, -1]))
    if not silent.size:
        return recorded
    assert recorded.noise_covariance is not None
    measurement, noise = recorded.measurement.copy(), recorded.noise_covariance.copy()
    measurement[silent, 0, -1] = settings.assumed_altitude_m
    noise[silent, ..., -1, -1] = settings.sigma_assumed_altitude_m**2 * max(silent.size - 1, 1)
    noise[silent[0], ..., -1, -1] = settings.sigma_assumed_altitude_m**2
    return Recording(recorded.times, measurement, recorded.platforms, noise)


def _truth(track: AircraftTrack) -> Array:
    """Return where the aircraft says it is, shape (messages, 3); NaN where it does not say it.

    Without a geometric height its barometric one stands for it, as in the scores.
    """
    latitude, longitude, height = track.reported.T
    return geodetic_to_ecef(latitude, longitude, np.where(np.isfinite(height), height, track.altitude))


SYSTEM = System(
    name="locards",
    title="recording: aircraft located by the arrival times of their messages at receivers on the ground (LocaRDS)",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
)
