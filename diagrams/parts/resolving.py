"""The part that resolves wrapped phases, put in where an estimator needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from diagrams.assembly.bus import Bus
from systems.estimators.phase_resolver import PhaseResolver
from systems.measurement.base import MeasurementModel
from systems.measurement.phase import InterferometerPhase
from systems.measurement.tdoa import Tdoa

__all__ = ["PhaseResolution"]


@dataclass(frozen=True)
class PhaseResolution:
    """Behind ``raw``: publishes ``measurement`` with unambiguous phases. Without a chain the prediction is fed back.

    Attributes
    ----------
    model : MeasurementModel
        What is on ``raw``.
    phase : InterferometerPhase
        The long baseline.
    tdoa : Tdoa
        For the fix.
    chain : sequence of InterferometerPhase
        Shorter baselines, from the shortest.
    """

    model: MeasurementModel
    phase: InterferometerPhase
    tdoa: Tdoa
    chain: Sequence[InterferometerPhase] = ()

    def on(self, bus: Bus) -> list[str]:
        """Return the names of the rows that come out of the resolver, which is added if it is not there yet."""
        if "phase_resolver.measurement" not in bus:
            self(bus)
        block = bus["phase_resolver.measurement"].get_system()
        assert isinstance(block, PhaseResolver)
        return list(block.stream)

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        known_trials, numbers = bus.shape("known")
        block = PhaseResolver(
            self.model.names, self.phase, self.tdoa, bus.trials, numbers // 6, self.chain, known_trials
        )
        bus.add(
            block,
            gives={"measurement": "measurement"},
            takes={"measurement": "raw", "platforms": "known"},
            feedback={} if self.chain else {"prediction": "prediction"},
        )
