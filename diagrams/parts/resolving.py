"""The part that resolves wrapped phases, put in where an estimator needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from quietfix.diagrams.assembly.bus import Bus
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.estimators.phase_resolver import PhaseCycles, PhaseResolver
from quietfix.systems.measurement.tdoa import Tdoa

__all__ = ["PhaseResolution"]


@dataclass(frozen=True)
class PhaseResolution:
    """Behind ``raw``: publishes ``measurement`` with unambiguous phases. Without a chain the prediction is fed back.

    Attributes
    ----------
    rows : sequence of str
        What is on the signal that comes in.
    phase : InterferometerPhase
        The long baseline.
    tdoa : Tdoa, optional
        For the fix; without a chain only.
    chain : sequence of InterferometerPhase
        Shorter baselines, from the shortest.
    states : int
        Components of the prediction that is fed back.
    takes : str
        The signal that comes in.
    name : str
        Of the block.
    """

    rows: Sequence[str]
    phase: InterferometerPhase
    tdoa: Tdoa | None = None
    chain: Sequence[InterferometerPhase] = ()
    states: int = 6
    takes: str = "raw"
    name: str = "phase_resolver"

    def on(self, bus: Bus) -> list[str]:
        """Return the names of the rows that come out of the resolver, which is added if it is not there yet.

        Where estimators go back to when a late measurement was made, they resolve it themselves, and none is added.
        """
        if f"{self.name}.measurement" not in bus and not bus.goes_back:
            self(bus)
        return list(self.cycles.stream)

    @property
    def cycles(self) -> PhaseCycles:
        """What it does."""
        return PhaseCycles(self.rows, self.phase, self.tdoa, self.chain, self.name)

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        known_trials, numbers = bus.shape("known")
        block = PhaseResolver(
            self.rows,
            self.phase,
            self.tdoa,
            bus.trials,
            numbers // 6,
            self.chain,
            known_trials,
            self.states,
            self.name,
        )
        bus.add(
            block,
            gives={"measurement": "measurement"},
            takes={"measurement": self.takes, "platforms": "known"},
            feedback={} if self.chain else {"prediction": "prediction"},
        )
