"""Where a station stands, from the one-way Doppler of a satellite with a free-running oscillator: DopTrack.

The satellite is known (SGP4), the station is not, but for its altitude: the beacon problem the other way round. The
passes go one after the other through estimator blocks whose state is the station's position, which stays, and the
oscillator's error as range rate with its derivatives, which start anew in every pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.recorded import RecordedStream
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.readers.data import Source, data_folder
from quietfix.diagrams.readers.doptrack_data import Pass, read_passes
from quietfix.diagrams.recorded.reports.doptrack_report import report
from quietfix.diagrams.recorded.settings.doptrack_settings import ORDERS, Settings
from quietfix.diagrams.recorded.settings.doptrack_stream import batch_fix, read_stream, start_at
from quietfix.systems.estimators.wiring import Tails
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.pass_oscillator import PassOscillator
from quietfix.systems.sensors.recorded import Recording
from quietfix.systems.starts.start import GivenStart

__all__ = ["ORDERS", "SOURCE", "SYSTEM", "Settings", "batch_fix", "declare", "declare_passes"]

SOURCE = Source(
    folder="doptrack_delfic3",
    origin="DopTrack/estimate at cd28508, sod_assignments/{data,metadata}.tar.xz (TU Delft)",
    holds="*.yml",
)

_ROWS = ("range_rate_0", "altitude")


def declare(settings: Settings) -> Model:
    """Return recorded range rates and what the estimators are given; see `quietfix.diagrams.assembly`."""
    return declare_passes(read_passes(data_folder(SOURCE, settings.data)), settings)


def declare_passes(passes: Sequence[Pass], settings: Settings) -> Model:
    """Return the same of passes that were read already.

    Raises
    ------
    UserError
        If the settings take no pass.
    """
    stream = read_stream(passes, settings)
    count = stream.times.size
    # What is known of the altitude is spread over all samples: linearised at each of them, and once in the whole.
    altitude = Altitude(settings.sigma_altitude_m * np.sqrt(count))
    known = np.full(count, stream.passes[0].altitude)
    recording = Recording(stream.times, np.stack([stream.range_rate, known], axis=1), stream.satellite[:, None])
    played = RecordedStream([recording], [np.tile(stream.passes[0].station, (count, 1))])
    start = start_at(stream.passes, settings)

    def assume(bus: Bus, name: str, options: Any) -> Assumed:
        order = settings.order(name)
        sigmas = settings.sigmas[:order]
        spread = np.diag(np.square([1e3 * settings.offset_km] * 3 + list(sigmas)))
        return Assumed(
            Stack([RangeRate(settings.sigma_mps[order - 1], [0], bias=3, at_rest=True), altitude]),
            PassOscillator(sigmas, settings.pause_s),
            GivenStart(np.concatenate([start, np.zeros(order)]), spread),
            _ROWS,
            tails=Tails(_ROWS[:1], settings.freedom),
        )

    return Model(
        clock=played.clock,
        duration=played.duration,
        divergence=1e3 * settings.divergence_km,
        parts=[played],
        assume=assume,
        truth_states=POSITION,
        platforms=("Delfi-C3",),
        recorded=Recorded(report=partial(report, stream=stream, settings=settings), keeps=["covariance"], bounds=True),
    )


SYSTEM = System(
    name="doptrack",
    title="recording: a station located by the one-way Doppler of Delfi-C3, 30 passes (DopTrack, TU Delft)",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
)
