"""A transmitter located by three or more receivers of hobbyists: I/Q samples from KiwiSDRs with GPS stamps.

The cross-ambiguity block compares the receivers pair by pair, once a second; an estimator makes a fix on the ground of
the time differences against the first receiver, the way of the wave following the ground. Where the transmitter stands,
if anybody knows, is used for scoring and nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.model import Assumed, Model
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.parts.iq_pairs import IqPairs
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.readers.kiwisdr.folder import SOURCE, KiwiData, read_folder
from quietfix.diagrams.recorded.reports.kiwisdr_report import AS_WELL, report
from quietfix.diagrams.recorded.settings.kiwisdr_settings import Settings
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.fixes.snapshot import starts_on_ground
from quietfix.systems.iq.kiwi import common_base
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import GroundTdoa
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration
from quietfix.systems.sensors.joined import JoinedMeasurements, JoinedPart
from quietfix.systems.signals import Constant, components_of
from quietfix.systems.starts.snapshot_start import SnapshotStart

__all__ = ["SOURCE", "SYSTEM", "KiwiData", "Settings", "declare", "declare_data", "read_folder"]

_AT_REST = 1e-3  # m/s; how fast a mast may be
_ALL_PAIRS = 6  # receivers up to which all pairs are compared, not only those with the first one
_POOR = 10.0  # times the variance of the best receiver's pairs, beyond which the first one is no reference


@dataclass(frozen=True, eq=False)
class _Surroundings:
    """Receivers and mast, which stand still."""

    data: KiwiData

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        bus.add(Constant("stations", self.data.still.reshape(1, -1)), gives={"platforms": "state"})
        bus.add(Constant("mast", self.data.mast[None]), gives={"truth": "state"})


@dataclass(frozen=True, eq=False)
class _Joined:
    """The pairs that are used, and the ellipsoid's surface as the height of the transmitter."""

    used: Sequence[tuple[int, int]]
    altitude: Altitude

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        bus.add(Constant("surface", [[0.0]]))
        parts = {f"pair_{j}{i}": JoinedPart(2, components=IqPairs.rows((i, j))) for i, j in self.used}
        parts["altitude"] = JoinedPart(1, self.altitude.noise_covariance(), components_of(self.altitude))
        takes = {"altitude": "surface.state"}
        for i, j in self.used:
            takes |= {f"pair_{j}{i}": f"measurement_{j}{i}"}
            takes |= {f"pair_{j}{i}_noise_covariance": f"noise_covariance_{j}{i}"}
        joined = JoinedMeasurements(parts, 1)
        bus.add(joined, gives={port: port for port in ("measurement", "noise_covariance")}, takes=takes)


def declare(settings: Settings) -> Model:
    """Return recorded samples, their comparison and what the estimators are given; see `quietfix.diagrams.assembly`."""
    folder = data_folder(SOURCE, settings.data)
    return declare_data(read_folder(folder, settings.platforms, settings.carrier_hz), settings)


def _compared(data: KiwiData, settings: Settings) -> tuple[KiwiData, IqPairs]:
    """Return the pairs, and the data with the receiver first that the others are compared with."""
    rate, length = settings.rate([one.sample_rate for one in data.recordings]), settings.integration_s
    blocks, _ = common_base(data.parts, rate, data.frequency)
    count, window, function = len(data.names), settings.window(data.stations), settings.function(rate)

    def pairs_of(order: Sequence[int], pairs: Sequence[tuple[int, int]]) -> IqPairs:
        streams = {data.names[i]: blocks[i] for i in order}
        return IqPairs(streams, pairs, function, window, length, length)

    everything = list(combinations(range(count), 2))
    best = pairs_of(range(count), everything).clearest(_POOR)
    order = [best, *(i for i in range(count) if i != best)]
    pairs = everything if count <= _ALL_PAIRS else [(0, j) for j in range(1, count)]
    return data.reordered(order), pairs_of(order, pairs)


def declare_data(data: KiwiData, settings: Settings) -> Model:
    """Return the same of recordings that were read already.

    Raises
    ------
    UserError
        If the recordings have nothing in common.
    """
    try:
        data, compared = _compared(data, settings)
    except ValueError as error:
        raise UserError(f"kiwisdr: {error}") from error
    used = [pair for pair in compared.pairs if pair[0] == 0]
    known = bool(data.transmitter)
    epochs = compared.plan.clock.ticks(compared.plan.end).size
    # what is known of the altitude is spread over all epochs: in the whole it is known once
    altitude = Altitude(settings.sigma_altitude_m * math.sqrt(epochs))
    tdoa = GroundTdoa(1e-6, [j for _, j in used], path=settings.path)
    model = Stack([tdoa, altitude])
    rows = [*(row.name for pair in used for row in IqPairs.rows(pair)), *altitude.names]

    def assume(bus: Bus, name: str, options: Any) -> Assumed:
        start = SnapshotStart(model, rows, _AT_REST, 0.0, noise_port=True, places=starts_on_ground, as_well=AS_WELL)
        takes = dict.fromkeys(("noise_covariance", "start_noise_covariance"), "noise_covariance")
        return Assumed(model, WhiteNoiseAcceleration(1e-12), start, rows, takes)

    alone = Stack([tdoa, Altitude(settings.sigma_altitude_m)])
    return Model(
        clock=compared.plan.clock,
        duration=compared.plan.end,
        divergence=1e3 * settings.divergence_km,
        parts=[_Surroundings(data), compared, _Joined(used, altitude)],
        assume=assume,
        truth_states=POSITION,
        platforms=data.names,
        signals={name: name for name in (*compared.signals, "noise_covariance")},
        rows=rows,
        recorded=Recorded(
            report=partial(report, data=data, settings=settings, pairs=compared.pairs, rows=rows, model=alone),
            keeps=["covariance", "measurement", "noise_covariance", *compared.signals],
            truth=known,
        ),
    )


SYSTEM = System(
    name="kiwisdr",
    title="recording: a transmitter located by the I/Q samples of three or more receivers with GPS (KiwiSDR)",
    scenario=Settings,
    declare=declare,
    recording=SOURCE,
)
