"""A study's chunks run by several processes through `dask.distributed`, which is imported here and only when asked for.

A task is a chunk. What goes to a worker is what a result says of itself, as text: it builds the study from that as
``--from`` does, once, and keeps it. Chunks come back to the process that was started, which alone writes.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.console.progress import Progress
from quietfix.diagrams.scale.asked import built
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.tally import tally_of
from quietfix.diagrams.studies.rerun import ask_as
from quietfix.diagrams.studies.study import Study

__all__ = ["check_workers", "parts_by", "run_chunk"]

_PATIENCE = 10  # s, for a scheduler to answer and for a first worker
_AHEAD = 2  # chunks per worker that are handed out: one that runs, one that waits, so that none is idle
_STUDIES: dict[str, Study] = {}


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
    if workers is not None and not 1 <= workers <= 1024:
        raise UserError(f"--workers: {workers} is not allowed; a whole number from 1 to 1024")
    if scheduler is not None and not scheduler.startswith(("tcp://", "tls://")):
        raise UserError(f"--scheduler: {scheduler} is not allowed; tcp://HOST:PORT, as `dask scheduler` prints it")
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        option = "--workers" if scheduler is None else "--scheduler"
        raise UserError(f"{option}: it needs dask.distributed; `pip install quietfix[workers]`") from error


def run_chunk(plan: str, number: int) -> Part:
    """Run a chunk in a worker.

    Parameters
    ----------
    plan : str
        The plan of the study as text.
    number : int
        Which chunk.

    Raises
    ------
    UserError
        If what is built here is not what was asked for: another version, other files.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", UserWarning)
        if plan not in _STUDIES:
            asked = Plan.read(plan)
            also = {key: asked.asked[key] for key in ("command", "write_measurements")}
            found, options = ask_as(asked.asked, "--workers: the study", None, {"chunk": asked.chunk}, True)
            study = built(found, options, also["write_measurements"])
            asked.refuse_other(study.plan(**also), "--workers", "what was asked for")
            _STUDIES.clear()
            _STUDIES[plan] = study
        (part,) = _STUDIES[plan].parts(numbers=(number,))
    words = tuple(str(one.message) for one in told if one.category is UserWarning)
    return replace(part, told=words, tally=tally_of(part.dataset))


def parts_by(
    study: Study, plan: Plan, numbers: Collection[int], progress: bool, workers: int | None, scheduler: str | None
) -> Iterator[Part]:
    """Yield chunks of a study in the order in which they are finished.

    Parameters
    ----------
    study : Study
    plan : Plan
        Of the study.
    numbers : collection of int
        Which chunks are run.
    progress : bool
        Show a progress bar.
    workers : int, optional
        So many processes of this machine.
    scheduler : str, optional
        The address of a cluster instead; with neither this process runs them.
    """
    if workers is None and scheduler is None:
        for part in study.parts(progress, numbers=numbers):
            yield replace(part, tally=tally_of(part.dataset))
            del part
        return
    if not numbers:
        return
    said: set[str] = set()
    with (
        _client(workers, scheduler) as client,
        Progress(f"{study.system.name}, {plan.trials} trials", plan.trials, progress) as bar,
    ):
        done = plan.trials - sum(end - begin for begin, end in map(plan.place, numbers))
        for part in _finished(client, plan, sorted(numbers)):
            done += part.end - part.begin
            bar.update(done)
            for message in part.told:
                if message not in said:
                    warnings.warn(message, stacklevel=1)
                    said.add(message)
            yield part
            del part


def _finished(client: Any, plan: Plan, numbers: list[int]) -> Iterator[Part]:
    from distributed import as_completed

    text = plan.text()
    ahead = _AHEAD * len(client.scheduler_info(n_workers=-1)["workers"])
    waiting = iter(numbers)

    def submit() -> Any:
        number = next(waiting, None)
        return None if number is None else client.submit(run_chunk, text, number, pure=False)

    running = as_completed([future for _ in range(ahead) if (future := submit()) is not None])
    for future in running:
        part = future.result()
        if (further := submit()) is not None:
            running.add(further)
        del future  # the worker may forget it
        yield part
        del part


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """Yield a client of a cluster; a cluster of this machine ends with it."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.scheduler import KilledWorker

    option = "--workers" if scheduler is None else "--scheduler"
    with tempfile.TemporaryDirectory(prefix="quietfix-") as folder, dask.config.set(temporary_directory=folder):
        try:
            if scheduler is None:
                local = {"threads_per_worker": 1, "processes": True, "memory_limit": 0, "dashboard_address": None}
                with LocalCluster(n_workers=workers, silence_logs=50, **local) as cluster, Client(cluster) as client:
                    yield client
            else:
                with Client(scheduler, timeout=_PATIENCE) as client:
                    client.wait_for_workers(1, timeout=_PATIENCE)
                    yield client
        except KilledWorker as error:
            raise UserError(
                f"{option}: a chunk has ended {error.allowed_failures + 1} workers; is the memory enough?"
            ) from error
        except TimeoutError as error:
            raise UserError(f"{option}: {scheduler or 'this machine'} has no worker that answers") from error
        except UserError:
            raise
        except OSError as error:
            if error.filename is not None:
                raise
            raise UserError(f"{option}: {scheduler or 'the workers'} cannot be reached ({error})") from error
