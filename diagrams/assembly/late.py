"""Measurements that are late: how late, and whether the estimators know when each was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Clock
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.late.delay import Delay, Latency, ages
from quietfix.systems.late.rollback import Rollback

__all__ = ["Late", "LateRows"]


class LateRows(NamedTuple):
    """Rows that come together, so late.

    Attributes
    ----------
    names : sequence of str
        Of the rows.
    mean, jitter : float
        [s]; see `Latency`.
    where : str
        The field that says it, for messages.
    """

    names: Sequence[str]
    mean: float
    jitter: float
    where: str


@dataclass(frozen=True)
class Late:
    """What of the measurements is late, and what the estimators make of that.

    Attributes
    ----------
    rows : sequence of LateRows
    stream : sequence of str
        All rows, in the order of the signal ``measurement``.
    known : bool
        Whether the estimators go back to when a measurement was made; else they take it for one of the instant at which
        it comes.
    buffer : float, optional
        How far back they can go [s]; None: as far as needed.
    """

    rows: Sequence[LateRows]
    stream: Sequence[str]
    known: bool = True
    buffer: float | None = None

    def add(self, bus: Bus, clock: Clock, end: float) -> None:
        """Put the delay behind the measurement; what it was is the signal ``raw`` from then on.

        Raises
        ------
        UserError
            For a jitter larger than the mean, and where phases are resolved by a prediction for another instant.
        """
        for one in self.rows:
            if one.jitter > one.mean:
                raise UserError(f"{one.where}.jitter: {one.jitter:g} is not allowed; at most the mean, {one.mean:g} s")
        if "raw" in bus and bus["raw"] is not bus["measurement"]:
            raise UserError(
                f"{self.rows[0].where}.mean: {self.rows[0].mean:g} is not allowed where wrapped phases are resolved by "
                "a prediction, which is for another instant; unambiguous phases"
            )
        places = [[list(self.stream).index(name) for name in one.names] for one in self.rows]
        latencies = [Latency(at, one.mean, one.jitter) for at, one in zip(places, self.rows, strict=True)]
        bus.publish(raw=bus["measurement"])
        gives = {port: port for port in ("measurement", "arrivals", "measured_at", "arrival")}
        delay = Delay(latencies, len(self.stream), clock, end, bus.trials)
        bus.add(delay, gives=gives, takes={"measurement": "raw"})

    def going_back(self, block: Estimator, takes: Mapping[str, str], bus: Bus, clock: Clock, end: float) -> Estimator:
        """Return an estimator that uses late measurements for when they were made; `takes`: signals by their ports.

        Raises
        ------
        UserError
            If it cannot.
        """
        if not self.known:
            return block
        other = next((port for port in ("measurement", "noise_covariance") if port in takes), None)
        if other is not None or block.smoother is not None:
            why = "a smoother looks back itself" if other is None else f"its {other} is {takes[other]}"
            raise UserError(
                f"estimators.{block.get_name()}: late measurements are not allowed; {why}. With belief.late.times: "
                "arrival it takes them as they come"
            )
        ticks = clock.ticks(end)
        most = max(one.mean + one.jitter for one in self.rows)
        count = ages(ticks, most if self.buffer is None else min(self.buffer, ticks[-1]))
        return Rollback(block, bus.shape("measured_at")[1], count)
