"""What is heard is sorted by target, run tick by tick, and told."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable

from quietfix.diagrams.live.bench import Bench, Runner
from quietfix.diagrams.live.lines import Heard, LineReader
from quietfix.diagrams.live.lines import Moment as Zero
from quietfix.diagrams.live.refused import Counted, Refused
from quietfix.diagrams.live.told import lines_of
from quietfix.diagrams.live.track import FollowedTarget, Outcome

__all__ = ["MOST_TARGETS", "Session"]

MOST_TARGETS = 1000
"""That are followed at once; of more, the one of which nothing came for the longest time is given up."""


class Session:
    """A stream of rows and what is made of it.

    Parameters
    ----------
    bench : Bench
        What runs; another one, as soon as the noise of rows comes with them.
    write : callable
        Gets lines of JSON.
    zero : (int, float), optional
        t = 0 in seconds of TAI since 1970; None: the first row with a date.
    lag : float
        How late a row may be [s].
    jump : float
        A row later than all before by more than this waits for the next one to be as late [s].
    """

    def __init__(
        self,
        bench: Bench,
        write: Callable[[str], object],
        zero: Zero | None = None,
        lag: float = 0.0,
        jump: float = 3600.0,
    ) -> None:
        self.bench = bench
        self.refusals, self.doubts = Counted("left out"), Counted("doubtful")
        self.reader = LineReader(self.bench.handed, self.doubts, zero)
        self.tracks: dict[str, FollowedTarget] = {}
        self.begun = 0  # targets, those that were given up too
        self.lines = self.ticks = self.given_up = 0
        self.latest = 0.0
        self.held: Heard | None = None
        self.first: bytes | None = None
        self._write, self._lag, self._jump = write, lag, jump

    @property
    def scaled(self) -> bool:
        """Whether the noise of rows is handed over with them."""
        return self.bench.handed.scaled

    def hear(self, line: bytes, now: float) -> None:
        """Take a line.

        Parameters
        ----------
        line : bytes
        now : float
            By a clock that never goes back [s].
        """
        if not line.strip():
            return
        self.lines += 1
        for one in self._begun(line) if self.reader.begins else [line]:
            self._hear(one, now)

    def _hear(self, line: bytes, now: float) -> None:
        try:
            for one in self._believable(self.reader.read(line)):
                self._take(one, now)
        except Refused as refused:
            self.refusals.add(refused.kind, f"line {self.lines}: {refused}")

    def _begun(self, line: bytes) -> list[bytes]:
        """Return the lines that are to be heard, when t = 0 is the first date: two have to agree on it."""
        stamp = self.reader.stamp(line)
        if stamp is None:
            return [line]
        first, self.first = self.first, line
        if first is None:
            return []
        before = self.reader.stamp(first)
        assert before is not None
        if abs((stamp[0] - before[0]) + (stamp[1] - before[1])) > self._jump:
            words = "the first date and the one after it are apart by more than --jump; the first line is left out"
            self.refusals.add("apart", f"line {self.lines - 1}: {words}")
            return []
        self.first = None
        self.reader.zero = min(before, stamp)
        return [first, line]

    def _believable(self, heard: Heard) -> Iterable[Heard]:
        """Yield rows whose time can be: one false stamp far ahead would make all after it late."""
        if heard.time <= self.latest + self._jump:
            self._give_up_held()
            self.latest = max(self.latest, heard.time)
            return [heard]
        held, self.held = self.held, heard
        if held is None:
            return []
        if heard.time < held.time:
            self._ahead(held)
            return []
        self.held = None
        words = f"nothing from {self.latest:.10g} s to {held.time:.10g} s"
        print(f"quietfix: live: {words}", file=sys.stderr, flush=True)
        self.latest = heard.time
        return [held, heard]

    def _give_up_held(self) -> None:
        if self.held is not None:
            self._ahead(self.held)
            self.held = None

    def _ahead(self, held: Heard) -> None:
        message = f"{held.target} at {held.time:.10g} s: the rows after it are earlier by more than --jump"
        self.refusals.add("ahead", message)

    def _take(self, heard: Heard, now: float) -> None:
        if heard.scale != 1.0 and not self.scaled:
            self.scale()
        track = self.tracks.get(heard.target) or self._begin(heard.target)
        track.add(heard, now)
        if len(track.pending) > 1:
            self._tell(track.ready())

    def _begin(self, target: str) -> FollowedTarget:
        if self.bench.handed.drawn and not self.bench.knows(target):
            raise Refused(
                "target", f"target: nobody knows where {target} was at t = 0, about which the start is drawn; !Given"
            )
        if len(self.tracks) >= MOST_TARGETS:
            oldest = min(self.tracks, key=lambda name: self.tracks[name].heard)
            self._tell(self.tracks.pop(oldest).ready(everything=True))
            self.given_up += 1
        track = self.follow(target, self.begun)
        self.begun += 1
        return track

    def follow(self, target: str, number: int) -> FollowedTarget:
        """Begin to follow a target; see `quietfix.diagrams.live.bench.Runner`."""
        track = FollowedTarget(
            Runner(self.bench, target, number), len(self.bench.handed.rows), self._lag, self.refusals
        )
        self.tracks[target] = track
        return track

    def scale(self) -> None:
        """Go on with a diagram in which the noise of rows is handed over with them."""
        self.bench = self.bench.with_scales()
        for name, track in self.tracks.items():
            moment, runner = track.runner.moment(), Runner(self.bench, name, track.runner.number)
            runner.go_back(moment)
            track.runner = runner

    def idle(self, before: float) -> None:
        """Run ticks of which nothing came since a time."""
        for track in self.tracks.values():
            self._tell(track.ready(before))

    def settle(self) -> None:
        """Run ticks again to which late rows were added."""
        for track in self.tracks.values():
            self._tell(track.again())

    def finish(self, now: float) -> None:
        """Run all that is left: nothing more will come."""
        if self.first is not None:
            first, self.first = self.first, None
            self.reader.zero = self.reader.stamp(first)
            self._hear(first, now)
        if self.held is not None:
            held, self.held = self.held, None
            try:
                self._take(held, now)
            except Refused as refused:
                self.refusals.add(refused.kind, str(refused))
        for track in self.tracks.values():
            self._tell(track.ready(everything=True))

    def _tell(self, outcomes: Iterable[Outcome]) -> None:
        zero = self.reader.zero if self.reader.dates else None
        for outcome in outcomes:
            self.ticks += not outcome.revised
            for line in lines_of(outcome, self.bench, zero, {"left_out": self.refusals.total}):
                self._write(line)
