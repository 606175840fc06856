"""A cluster of two workers on loopback, as a user starts it, and commands in processes of their own."""

import os
import signal
import subprocess
import sys
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import psutil

from quietfix.diagrams.commands import command_line

_PATIENCE = 120  # s, of a machine that has much else to do


def until(true, what, patience=_PATIENCE):
    """Wait until something is true."""
    end = time.monotonic() + patience
    while not (found := true()):
        assert time.monotonic() < end, f"{what}: not within {patience} s"
        time.sleep(0.02)
    return found


class Cluster:
    """`dask scheduler` and two `dask worker`."""

    def __init__(self, folder):
        self.folder, self.processes, self.begun = Path(folder), [], 0
        self.address = ""

    def start(self):
        """Begin, and wait for both workers."""
        self.begun += 1
        self.where.mkdir(parents=True)
        file = self.where / "scheduler.json"
        options = ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)]
        self.processes = [self._run("scheduler", *options)]
        until(lambda: file.exists() and file.read_text().strip().endswith("}"), "a scheduler")
        self.address = file.read_text().split('"address": "')[1].split('"')[0]
        self.processes += [self._work(name) for name in "ab"]
        for name in "ab":
            self._wait_for(name)
        return self

    def mend(self):
        """Start workers in place of those that have ended for good, which they do of Ctrl-C."""
        for k, name in enumerate("ab", 1):
            if self.processes[k].poll() is not None:
                self.processes[k] = self._work(name)
                self._wait_for(name)

    @property
    def where(self):
        """The folder of the last one that was begun."""
        return self.folder / f"cluster{self.begun}"

    def _work(self, name):
        options = ["--nthreads", "1", "--local-directory", str(self.where), "--name", name]
        return self._run("worker", self.address, *options, "--preload", "quietfix.diagrams.scale.workers", log=name)

    def _wait_for(self, name):
        until(lambda: "Registered to" in (self.where / f"{name}.log").read_text(), "a worker")

    def _run(self, what, *arguments, log="scheduler"):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *arguments]
        with (self.where / f"{log}.log").open("w") as stream:
            return subprocess.Popen(command, stdout=stream, stderr=stream, cwd=self.where)

    @property
    def scheduler(self):
        """Number of the scheduler's process."""
        return self.processes[0].pid

    def workers(self):
        """Numbers of the processes that run chunks, which are children of those that were started."""
        return [pid for process in self.processes[1:] for pid in spawned(process.pid)]

    def end_workers(self):
        """End the workers and what would start them again."""
        for one in [one for process in self.processes[1:] for one in _family(process.pid)]:
            one.kill()  # those that were started before their children

    def stop(self):
        """End all that were started, with their children."""
        family = [one for process in self.processes for one in _family(process.pid)]
        for one in family:
            if one.is_running():
                one.kill()
        for process in self.processes:
            process.wait()
        psutil.wait_procs(family, 10)
        self.processes = []


def _family(pid):
    try:
        process = psutil.Process(pid)
        return [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def spawned(pid):
    """Return the numbers of the workers among the children of a process."""
    found = []
    for child in _family(pid)[1:]:
        try:
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child.pid)
        except psutil.Error:  # it has just ended
            continue
    return found


def _without_threads_of_before():
    """Let a forked process start threads of its own where dask keeps one that is in the process before only."""
    if "distributed.utils" in sys.modules:
        sys.modules["distributed.utils"]._offload_executor = ThreadPoolExecutor(1)


class Command:
    """A command in a forked process, which need not import all again; what it says goes to a file."""

    def __init__(self, log, *arguments):
        self.log = Path(log)
        ready, say = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            status = 70
            try:
                os.close(ready)
                os.setsid()
                stream = self.log.open("w", buffering=1)
                os.dup2(stream.fileno(), 1), os.dup2(stream.fileno(), 2)
                sys.stdout = sys.stderr = stream
                signal.signal(signal.SIGINT, signal.default_int_handler)
                signal.signal(signal.SIGTERM, signal.SIG_DFL)
                _without_threads_of_before()
                os.write(say, b"x")
                command_line.main([str(argument) for argument in arguments])
            except SystemExit as ended:
                status = ended.code or 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(status)
        os.close(say)
        assert os.read(ready, 1) == b"x"
        os.close(ready)
        self.began = time.monotonic()
        self.status = None

    def running(self):
        """Return whether it has not ended."""
        if self.status is None:
            pid, ended = os.waitpid(self.pid, os.WNOHANG)
            self.status = os.waitstatus_to_exitcode(ended) if pid else None
        return self.status is None

    def wait(self):
        """Wait for its end, and return its status: negative for a signal."""
        try:
            until(lambda: not self.running(), self.log.name)
        except AssertionError as error:
            raise AssertionError(f"{error}: {self.said()}") from None
        finally:
            self.end()
        return self.status

    def end(self):
        """End it with its workers, if it has not ended."""
        if self.running():
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            until(lambda: not self.running(), self.log.name)

    def said(self):
        """Return what it has said."""
        return self.log.read_text()

    def kill(self, number, pid=None):
        """Send a signal to it, or to a process of its; return whether that was there."""
        if not self.running():
            return False
        try:
            os.kill(pid or self.pid, number)
        except ProcessLookupError:
            return False
        return True
