"""The command ``quietfix live``; see its ``--help``."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.live.session import Session
from quietfix.diagrams.live.sources import Datagrams, Followed, Source, StandardInput
from quietfix.diagrams.live.state_file import digest_of, read_state, restore, write_state
from quietfix.diagrams.own.fed.measured import setting_of
from quietfix.diagrams.own.fields.measurements import Measurements
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.parts.latency import LateBelief
from quietfix.diagrams.schema.errors import UserError, in_users_words
from quietfix.diagrams.schema.origins import origins_of
from quietfix.diagrams.studies.recordings import with_platforms

__all__ = ["Asked", "live_command", "with_buffer"]

_SHORTEST = 0.01  # s; of a look at the source
_WAKE = 0.2  # s; a signal is seen after that
_SAVE = 10.0  # s between two writings of the state


@dataclass(frozen=True)
class Asked:
    """What a command line asks for.

    Attributes
    ----------
    stdin : str, optional
        ``-``, or nothing.
    udp : str, optional
        ``HOST:PORT``.
    follow, state : Path, optional
    wait : float
        How long a tick waits for further rows [s].
    lag, jump : float
        See `quietfix.diagrams.live.session.Session`.
    """

    stdin: str | None = None
    udp: str | None = None
    follow: Path | None = None
    state: Path | None = None
    wait: float = 0.5
    lag: float = 0.0
    jump: float = 3600.0

    def check(self) -> None:
        """Refuse what cannot be.

        Raises
        ------
        UserError
            Naming the option.
        """
        if self.stdin not in (None, "-"):
            raise UserError(
                f"source: {self.stdin} is not allowed; - (standard input), --udp HOST:PORT or --follow FILE"
            )
        sources = [self.stdin, self.udp, self.follow]
        if sum(one is not None for one in sources) > 1:
            raise UserError("source: one of - (standard input), --udp and --follow is allowed, not several")
        for name, least in (("wait", 0.0), ("lag", 0.0), ("jump", 0.0)):
            value = getattr(self, name)
            if not (least <= value < float("inf")):
                raise UserError(f"--{name}: {value:g} is not allowed; seconds, >= {least:g}")


def live_command(
    system: str,
    asked: Asked,
    estimators: Sequence[str] | None,
    settings: Sequence[str] | None,
    scenario: Path | None,
    platforms: Path | None = None,
) -> None:
    """Run estimators on lines of measurements until these end, or a signal comes."""
    asked.check()
    found = find(system)
    if platforms is not None:
        settings = with_platforms(found, settings, platforms)
    resolved = _scenario(found, settings, scenario)
    chosen = select_estimators(resolved, estimators)
    asked = with_buffer(asked, resolved.belief.late)
    digest = digest_of(resolved, chosen)
    saved = None if asked.state is None else read_state(asked.state, digest)
    assert found.system.file is not None
    folder = found.system.file.resolve().parent
    zero = setting_of(resolved, folder, None).began()
    with found.blaming(resolved.estimators):
        with origins_of(resolved).placing(), in_users_words():
            told: list[str] = []
            session = Session(Bench(resolved, folder, chosen), told.append, zero, asked.lag, asked.jump)
        if saved is not None and asked.state is not None:
            restore(session, saved, asked.state)
        if session.bench.model.note:
            print(f"quietfix: live: {session.bench.model.note}", file=sys.stderr, flush=True)
    source = _source(asked, None if saved is None else saved.get("place"))
    try:
        stopped = _Loop(session, source, asked, digest, told, lambda: found.blaming(resolved.estimators)).run()
    finally:
        source.close()
    if stopped:
        raise KeyboardInterrupt


def with_buffer(asked: Asked, late: LateBelief) -> Asked:
    """Return how late a row may be: what the command line says, else the belief."""
    if late.times != "made":
        raise UserError(f"belief.late.times: {late.times} is not allowed live, where rows have their own times; made")
    return asked if asked.lag or late.buffer_s is None else replace(asked, lag=late.buffer_s)


def _scenario(found: Found, settings: Sequence[str] | None, scenario: Path | None) -> OwnScenario:
    if found.source != "yaml":
        raise UserError(f"live: {found.title} is not allowed; a system of one's own in YAML")
    resolved = found.system.load(found.variant, scenario, settings or [])
    assert isinstance(resolved, OwnScenario)
    if resolved.measurements is None:
        origins = origins_of(resolved)
        resolved = replace(resolved, measurements=Measurements())
        origins.remember(resolved)
    return resolved


def _source(asked: Asked, place: dict[str, int] | None) -> Source:
    if asked.udp is not None:
        return Datagrams(asked.udp)
    if asked.follow is not None:
        return Followed(asked.follow, place)
    return StandardInput()


class _Loop:
    """Reads, runs and tells until the end; a signal is looked at between two lines, where all is as it should be."""

    def __init__(
        self,
        session: Session,
        source: Source,
        asked: Asked,
        digest: str,
        told: list[str],
        blaming: Callable[[], AbstractContextManager[None]],
    ) -> None:
        self._session, self._source, self._asked, self._digest, self._told = session, source, asked, digest, told
        self._blaming = blaming  # of what the user's own classes do, and not of files and pipes
        self._stopped = False

    def run(self) -> bool:
        """Return whether a signal has ended it."""
        began = time.monotonic()
        try:
            with self._listening():
                self._read(began)
                self._end()
        except OSError:  # nobody reads any more, or the disk is full
            self._save()
            raise
        finally:
            self._summary(time.monotonic() - began)
        return self._stopped

    def _read(self, saved: float) -> None:
        session, wait = self._session, self._asked.wait
        complained = False
        while not self._stopped:
            lines = self._source.read(min(_WAKE, max(_SHORTEST, wait / 2)))
            if lines is None:
                return
            now = time.monotonic()
            with self._blaming():
                for line in lines:
                    session.hear(line, now)
                if not lines:  # all that has come is heard
                    session.idle(now - wait)
                session.settle()
            self._write()
            if now - saved > _SAVE:
                saved = now
                try:
                    self._save()
                except UserError as error:  # a full disk: it may be better at the next time
                    if not complained:
                        print(f"quietfix: live: {error}", file=sys.stderr, flush=True)
                    complained = True

    def _end(self) -> None:
        """Write the state with what still waits for others of its instant, then tell that as it is."""
        with self._blaming():
            self._session.settle()
        self._save()
        with self._blaming():
            self._session.finish(time.monotonic())
        self._write()

    def _write(self) -> None:
        """Print what was told, when all that had been read is heard: the state is then whole whatever happens."""
        if self._told:
            text = "".join(f"{line}\n" for line in self._told)
            self._told.clear()
            sys.stdout.write(text)
            sys.stdout.flush()

    def _save(self) -> None:
        if self._asked.state is not None:
            write_state(self._asked.state, self._session, self._digest, self._source.place())

    def _summary(self, took: float) -> None:
        session = self._session
        left_out, doubtful = session.refusals.summary(), session.doubts.summary()
        parts = [
            f"{session.lines} lines, {session.ticks} ticks, {session.begun} targets in {took:.1f} s",
            *([f"{session.given_up} targets given up"] if session.given_up else []),
            *([left_out] if left_out else []),
            *([doubtful] if doubtful else []),
        ]
        print(f"quietfix: live: {'; '.join(parts)}", file=sys.stderr, flush=True)

    @contextmanager
    def _listening(self) -> Iterator[None]:
        def stop(number: int, frame: FrameType | None) -> None:
            if self._stopped:
                raise KeyboardInterrupt  # the second one does not wait
            self._stopped = True

        before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
