"""Who runs the chunks of a command: this process, or others through `dask.distributed`, imported here when asked for.

A task is a chunk, whichever study it is of. Chunks come back to the process that was started, which alone writes.
"""

from __future__ import annotations

import logging
import tempfile
import time
import warnings
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any

from quietfix.diagrams.chunks.jobs import Job, run_here
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.console.progress import Progress
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.scale.workers import run_chunk
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.tally import tally_of
from quietfix.diagrams.studies.study import Study

__all__ = ["Crew", "Lost", "check_workers", "parts_by"]

_MOST = 1024
_PATIENCE = 10.0  # s, for a scheduler to answer and for a first worker
_STARTING = 300.0  # s, for a process of this machine to become a worker, however much else there is to do
_GONE = 60.0  # s without any worker, after which none is expected to come back; one that is restarted takes some
_TICK = 1.0  # s, between looks at who is there
_TRANSFER = 60.0  # s, for a chunk to come over before it is looked who is there
_AHEAD = 2  # chunks per worker that are handed out: one that runs, one that waits, so that none is idle
_LOGGERS = ("distributed", "distributed.client", "distributed.scheduler", "distributed.nanny", "distributed.core")
_DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""Ctrl-C goes to all processes of a terminal; workers end when the one that was started does."""


def check_workers(workers: int | None, scheduler: str | None, threads: int = 1) -> None:
    """Refuse numbers of workers and addresses that are none.

    Raises
    ------
    UserError
        Naming the option; also where `dask.distributed` is not installed.
    """
    if workers is None and scheduler is None:
        return
    if workers is not None and scheduler is not None:
        raise UserError(f"--workers: {workers} is not allowed with --scheduler, whose workers are those it has")
    if threads != 1:
        raise UserError(f"--threads: {threads} is not allowed with --workers or --scheduler; 1 in each")
    if workers is not None and not 1 <= workers <= _MOST:
        raise UserError(f"--workers: {workers} is not allowed; a whole number from 1 to {_MOST}")
    if scheduler is not None and not scheduler.startswith(("tcp://", "tls://")):
        raise UserError(f"--scheduler: {scheduler} is not allowed; tcp://HOST:PORT, as `dask scheduler` prints it")
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        option = "--workers" if scheduler is None else "--scheduler"
        raise UserError(f"{option}: it needs dask.distributed; `pip install quietfix[workers]`") from error


class Lost(UserError):
    """Workers or their scheduler are gone; what was finished is not."""


@dataclass(frozen=True)
class _Task:
    order: int
    which: int
    number: int
    job: Job


class Crew:
    """Whoever runs the chunks of a command; a cluster of this machine lasts as long as this context.

    Parameters
    ----------
    workers : int, optional
        So many processes of this machine.
    scheduler : str, optional
        The address of a cluster instead; with neither this process runs them.
    threads : int
        That share the trials of a chunk, for messages.
    progress : bool
        Show how far it is.

    Raises
    ------
    UserError
        For numbers of workers and addresses that are none.
    """

    def __init__(
        self, workers: int | None = None, scheduler: str | None = None, threads: int = 1, progress: bool = True
    ) -> None:
        check_workers(workers, scheduler, threads)
        self._workers, self._scheduler, self._progress = workers, scheduler, progress
        self._option = "--workers" if scheduler is None else "--scheduler"
        self._where = scheduler or "this machine"
        self._stack = ExitStack()
        self._client: Any = None
        self._said: set[str] = set()

    def __enter__(self) -> Crew:
        """Begin; a cluster is made when there is something to run."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the workers go."""
        with suppress(Exception):  # a scheduler that is lost cannot be told so
            self._stack.close()

    def run(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Part]]:
        """Yield the chunks of jobs as they are finished, each with the number of its job.

        Raises
        ------
        UserError
            Of what a worker says; `Lost` if the workers or their scheduler are gone, or a chunk has ended several.
        """
        total = sum(job.trials for job in jobs)
        if not total:
            return
        kinds = {job.study.system.name for job in jobs}
        label = next(iter(kinds)) if len(kinds) == 1 else f"{len(kinds)} systems"
        alone = self._workers is None and self._scheduler is None
        with Progress(label, total, self._progress, "trials") as bar:
            yield from run_here(jobs, bar.update) if alone else self._scattered(jobs, bar)

    # ---- by others

    def _scattered(self, jobs: Sequence[Job], bar: Progress) -> Iterator[tuple[int, Part]]:
        chunks = [(which, number, job) for which, job in enumerate(jobs) for number in sorted(job.numbers)]
        waiting = deque(_Task(order, *chunk) for order, chunk in enumerate(chunks))
        self._begin(len(waiting))
        running: dict[Any, _Task] = {}
        ended: SimpleQueue[Any] = SimpleQueue()
        texts = [job.plan.text() for job in jobs]
        done, seen = 0.0, time.monotonic()
        while waiting or running:
            threads = self._look(seen)
            seen = time.monotonic() if threads else seen
            bar.update(done, threads)
            while waiting and len(running) < _AHEAD * max(threads, 1):
                task = waiting.popleft()
                future = self._submit(texts[task.which], task)
                running[future] = task
                future.add_done_callback(ended.put)
            with suppress(Empty):
                future = ended.get(timeout=_TICK)
                part = self._result(future, running, ended)
                if part is not None:
                    task = running.pop(future)
                    del future  # the worker may forget it
                    done += part.end - part.begin
                    self._tell(part)
                    yield task.which, part
                    del part

    def _submit(self, text: str, task: _Task) -> Any:
        job = task.job
        beside = None if job.beside is None else str(job.beside.resolve())
        return self._client.submit(
            run_chunk, text, task.number, job.first, job.count, job.width, beside, pure=False, priority=-task.order
        )

    def _look(self, seen: float) -> int:
        """Return how many chunks can run at once, which is one for each thread of the workers that are there."""
        from distributed.comm import CommClosedError

        try:
            if self._client.status != "running":
                raise CommClosedError(self._client.status)
            there = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, TimeoutError, KeyError) as error:
            raise self._scheduler_lost() from error
        if not there and time.monotonic() - seen > _GONE:
            raise Lost(f"{self._option}: the last worker of {self._where} is lost")
        return sum(worker["nthreads"] for worker in there.values())

    def _scheduler_lost(self) -> Lost:
        return Lost(f"{self._option}: {self._where} does not answer any more")

    def _result(self, future: Any, running: dict[Any, _Task], ended: SimpleQueue[Any]) -> Part | None:
        """Return what a chunk has come to; None: it is on its way."""
        from concurrent.futures import CancelledError

        from distributed.scheduler import KilledWorker

        try:
            part: Part = future.result(timeout=_TRANSFER)
            return part
        except TimeoutError:
            ended.put(future)
            return None
        except (UserError, KeyboardInterrupt, MemoryError):
            raise
        except KilledWorker as error:
            raise self._deadly(future, running, ended, error.allowed_failures + 1) from error
        except (CancelledError, OSError) as error:
            if isinstance(error, OSError) and self._client.status == "running" and error.filename is not None:
                raise self._failed(running[future], error) from error
            raise self._scheduler_lost() from error
        except Exception as error:
            raise self._failed(running[future], error) from error

    def _failed(self, task: _Task, error: BaseException) -> Lost:
        words = " ".join(str(error).split())
        return Lost(
            f"{self._option}: {self._named(task)} cannot be run by a worker ({type(error).__name__}: {words}); is the "
            "same Quietfix installed there?"
        )

    def _deadly(self, future: Any, running: dict[Any, _Task], ended: SimpleQueue[Any], workers: int) -> Lost:
        """Return that a chunk has ended several workers, one after the other.

        Those that only wait on a worker that ends are blamed by the scheduler like the one that runs, which is the one
        that was handed out first.
        """
        blamed = [running[future]]
        until = time.monotonic() + _TICK
        while (left := until - time.monotonic()) > 0:
            with suppress(Empty):
                other = ended.get(timeout=left)
                if other in running and other.status == "error":
                    blamed.append(running[other])
        first = min(blamed, key=lambda task: task.order)
        ended_by = f"has ended {workers} workers, one after the other; is the memory enough?"
        return Lost(f"{self._option}: {self._named(first)} {ended_by}")

    @staticmethod
    def _named(task: _Task) -> str:
        begin, end = task.job.place(task.number)
        begin, end = begin + task.job.first, end + task.job.first
        return f"chunk {task.number} of {task.job.study.system.name} (trials {begin} to {end - 1})"

    def _tell(self, part: Part) -> None:
        for message in part.told:
            if message not in self._said:
                warnings.warn(message, stacklevel=1)
                self._said.add(message)

    # ---- a cluster

    def _begin(self, chunks: int) -> None:
        """Connect to the cluster, or make one; once for all jobs."""
        if self._workers is not None and chunks < self._workers:
            few = f"{chunks} chunk{'s' * (chunks != 1)} for {self._workers} workers"
            say(f"--workers: {few}; a smaller --chunk makes more of them")
        if self._client is not None:
            return
        import dask
        from distributed import Client, LocalCluster

        for name in _LOGGERS:  # what they have to say is said here, in one line
            self._stack.callback(logging.getLogger(name).setLevel, logging.getLogger(name).level)
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="quietfix-", ignore_cleanup_errors=True))
        self._stack.enter_context(dask.config.set(temporary_directory=folder))
        try:
            if self._scheduler is None:
                local: dict[str, Any] = {"threads_per_worker": 1, "processes": True, "memory_limit": 0}
                local |= {"dashboard_address": None, "silence_logs": logging.CRITICAL + 1, "preload": [_DEAF]}
                local |= {"death_timeout": _STARTING, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
                cluster = self._stack.enter_context(LocalCluster(n_workers=self._workers, **local))
                self._client = self._stack.enter_context(Client(cluster, direct_to_workers=True))
            else:
                self._client = self._stack.enter_context(Client(self._scheduler, timeout=_PATIENCE))
                self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError as error:
            raise UserError(f"{self._option}: {self._where} has no worker that answers") from error
        except OSError as error:
            if error.filename is not None:
                raise
            raise UserError(f"{self._option}: {self._where} cannot be reached ({error})") from error
        except RuntimeError as error:  # of a cluster whose workers end before they are there
            raise UserError(
                f"{self._option}: no worker has started on {self._where}; is the memory enough? A script that gives "
                'commands must do so below `if __name__ == "__main__":`, as workers import it'
            ) from error


def parts_by(
    study: Study, plan: Plan, numbers: Collection[int], progress: bool, workers: int | None, scheduler: str | None
) -> Iterator[Part]:
    """Yield chunks of one study in the order in which they are finished; arguments as of `Job` and `Crew`."""
    with Crew(workers, scheduler, study.request.threads, progress) as crew:
        for _, part in crew.run([Job(study, plan, numbers)]):
            yield part if part.tally else replace(part, tally=tally_of(part.dataset))
            del part
