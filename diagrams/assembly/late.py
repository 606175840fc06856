"""Measurements that are late: how late, and whether the estimators know when each was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Clock
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.late.arrived import Clearing
from quietfix.systems.late.complete import Complete
from quietfix.systems.late.delay import Delay, Latency, ages
from quietfix.systems.late.rollback import Rollback, goes_back
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Late", "LateRefusal", "LateRows", "refusals"]


class LateRefusal(UserError):
    """Why one estimator cannot go back to when a late measurement was made.

    Attributes
    ----------
    estimator : str
        Its name.
    why : str
        The reason.
    """

    def __init__(self, estimator: str, why: str) -> None:
        self.estimator, self.why = estimator, why
        super().__init__(refusals([self], []))


def refusals(refused: Sequence[LateRefusal], able: Sequence[str]) -> str:
    """Return in one line which estimators cannot go back to late measurements, why, and which can."""
    reasons: dict[str, list[str]] = {}
    for one in refused:
        reasons.setdefault(one.why, []).append(one.estimator)
    said = "; ".join(f"{', '.join(names)}: {why}" for why, names in reasons.items())
    rest = f" (--estimator {' --estimator '.join(able)})" if able else ""
    return (
        f"estimators.{said}. Late measurements are not allowed there; leave it out{rest}, or take them as they come "
        "(belief.late.times: arrival)"
    )


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
        """Put the delay behind the measurement; what it was is the signal ``sensed`` from then on.

        Raises
        ------
        UserError
            For a jitter larger than the mean.
        """
        for one in self.rows:
            if one.jitter > one.mean:
                raise UserError(f"{one.where}.jitter: {one.jitter:g} is not allowed; at most the mean, {one.mean:g} s")
        bus.publish(sensed=bus["measurement"])
        bus.goes_back = self.known
        gives = {port: port for port in ("measurement", "arrivals", "measured_at", "arrival")}
        delay = self.delay(bus, clock, end)
        bus.add(delay, gives={**gives, "raw": "measurement"}, takes={"measurement": "sensed"})

    def delay(self, bus: Bus, clock: Clock, end: float) -> EnsembleBlock:
        """Return the block that holds measurements back: a `Delay`, or with the ports of one."""
        places = [[list(self.stream).index(name) for name in one.names] for one in self.rows]
        latencies = [Latency(at, one.mean, one.jitter) for at, one in zip(places, self.rows, strict=True)]
        return Delay(latencies, len(self.stream), clock, end, bus.trials)

    def check_as_they_come(self, name: str, takes: Mapping[str, str]) -> None:
        """Refuse an estimator that takes late measurements as they come with a noise that is that of now.

        Raises
        ------
        UserError
            If R comes with the measurement.
        """
        if takes.get("noise_covariance") == "noise_covariance":
            raise UserError(
                f"belief.late.times: arrival is not allowed for {name}, for the noise covariance comes with each "
                "measurement; made"
            )

    @property
    def most(self) -> float:
        """How late a row can be [s]."""
        return max(one.mean + one.jitter for one in self.rows)

    def kept(self, bus: Bus, clock: Clock, end: float) -> int:
        """Return how many instants an estimator keeps."""
        ticks = clock.ticks(end)
        return ages(ticks, self.most if self.buffer is None else min(self.buffer, ticks[-1]))

    def going_back(
        self,
        block: Estimator,
        takes: Mapping[str, str],
        clearings: Sequence[Clearing],
        bus: Bus,
        span: tuple[Clock, float],
    ) -> tuple[Estimator, dict[str, str]]:
        """Return an estimator that uses late measurements for when they were made.

        Parameters
        ----------
        block : Estimator
        takes : mapping of str to str
            Signals by its ports.
        clearings : sequence of Clearing
            See `Assumed`.
        bus : Bus
        span : (Clock, float)
            When there are measurements, and the end of the run [s].

        Returns
        -------
        block : Estimator
        takes : dict of str to str
            What it gets in the place of the measurement.

        Raises
        ------
        LateRefusal
            If it cannot.
        """
        name, (clock, end) = block.get_name(), span
        other = takes.get("measurement", "measurement")
        if other not in ("measurement", "raw"):
            raise LateRefusal(name, "what it takes is made of all measurements of an instant")
        if block.smoother is not None:
            return self._looking_back(block, clearings, bus)
        if not goes_back(block):
            raise LateRefusal(name, "it has more than what it remembers from measurement to measurement")
        return Rollback(block, bus.shape("measured_at")[1], self.kept(bus, clock, end), self.stream, clearings), {}

    def _looking_back(
        self, block: Estimator, clearings: Sequence[Clearing], bus: Bus
    ) -> tuple[Estimator, dict[str, str]]:
        """Return a smoother that is given what will have come by the end at the time that it was made."""
        name, wiring = f"complete_{block.get_name()}", block.wiring
        platforms = wiring.platforms, wiring.platform_trials, block.motion.reported.size
        complete = Complete(len(self.stream), clearings, bus.trials, *platforms, name)
        feedback = {"prediction": f"{block.get_name()}.prediction"} if clearings else {}
        bus.add(complete, takes={"measurement": "sensed", "platforms": "known"}, feedback=feedback)
        return block, {"measurement": f"{name}.measurement"}
