"""Forty kills at any moment, of the command, its workers, their scheduler: the result, resumed, is the same."""

import json
import shutil
import signal
import time

import numpy as np
import pytest

from quietfix.diagrams.commands import running
from quietfix.diagrams.studies.marker import MARKER, read_mark
from tests.faults.cluster import Cluster, Command, spawned, until
from tests.faults.test_workers import REQUIREMENTS
from tests.faults.tree import illustrate, picture, plant, shorten

KILL, TERM, INT = signal.SIGKILL, signal.SIGTERM, signal.SIGINT
SHORT = ["--set", "duration_s=3", "--estimator", "iekf", "--chunk", "2"]
COMMANDS = {
    "run": ["run", "three_satellite", "--trials", "24", *SHORT],
    "compare": ["compare", "three_satellite", "--trials", "24", *SHORT],
    "sweep": ["sweep", "three_satellite", "--trials", "6", "--vary", "truth.sigma_tdoa_ns=10,20,30,40", *SHORT],
    "verify": ["verify", "r.yaml", "--chunk", "5"],
}
NAMES = list(COMMANDS)
_NOT_THE_SAME = (MARKER, "summary.json", "comparison.json")  # they say how long it took

# whose process gets which signal, how often: 40 in all
PARENT_ALONE = [(NAMES[k % 4], (KILL, TERM, INT)[k // 4]) for k in range(12)]
PARENT_OF_CLUSTER = [(NAMES[k % 4], (KILL, TERM, INT)[k % 3]) for k in range(12)]
WORKER_OF_CLUSTER = [(NAMES[k % 4], (KILL, TERM, INT)[k % 3]) for k in range(9)]
SCHEDULER = [("run", KILL), ("sweep", TERM), ("compare", INT)]
OF_OWN_WORKERS = [("run", KILL, "parent"), ("verify", INT, "parent"), ("run", TERM, "parent"), ("run", KILL, "worker")]


def test_forty_are_forty():
    assert sum(map(len, (PARENT_ALONE, PARENT_OF_CLUSTER, WORKER_OF_CLUSTER, SCHEDULER, OF_OWN_WORKERS))) == 40


class Tried:
    """A folder with a user's files, in which commands are killed and resumed."""

    expected, seconds = {}, {}  # the same for all tests

    def __init__(self, root, logs):
        self.root, self.logs, self.count = root, logs, 0
        plant(root / "canaries")
        (root / "r.yaml").write_text(REQUIREMENTS)
        self.before = picture(root)

    def command(self, name, *options):
        self.count += 1
        return Command(self.logs / f"{self.count}.log", *COMMANDS[name], *options)

    def learn(self, name, *options):
        """Run a command that is let be: what comes out, and how long it takes; once of this process alone."""
        if not options and name in self.expected:
            return
        whole = self.command(name, "--out", "whole", *options)
        status = whole.wait()
        assert status in (0, 3 if name == "verify" else 0), whole.said()
        self.seconds[name, bool(options)] = time.monotonic() - whole.began
        found = arrays(self.root / "whole")
        assert self.expected.setdefault(name, found) == found
        shutil.rmtree(self.root / "whole")
        self.check_untouched()

    def moment(self, name, options, chance):
        """Wait for a random moment of a run."""
        time.sleep(self.seconds[name, bool(options)] * chance.uniform(0.02, 0.95))

    def middle(self, command, chance):
        """Wait until a run is at work: until some of its chunks are finished, and a bit."""
        chunks, some = self.root / "d.partial" / ".quietfix-chunks", chance.integers(1, 6)
        until(lambda: not command.running() or len(list(chunks.glob("*.npz"))) >= some, command.log.name)
        time.sleep(0.1 * chance.uniform())

    def check_untouched(self):
        """See that nothing but the run's own folder is changed, and that is whole if it has its final name."""
        now = picture(self.root)
        own = {name for name in now if name.split("/")[0] in ("d", "d.partial")}
        assert {name: what for name, what in now.items() if name not in own} == self.before
        if (self.root / "d").exists():
            mark = read_mark(self.root / "d")
            assert mark is not None and mark.finished
            return True
        return False

    def resume(self, name, *options):
        """Go on with a command to its end, and compare."""
        self.check_untouched()
        partial = self.root / "d.partial"
        if partial.exists() and not (partial / MARKER).exists():  # killed before it is known as Quietfix's
            shutil.rmtree(partial)
        again = self.command(name, "--resume", "d", *options)
        status = again.wait()
        assert status in (0, 3 if name == "verify" else 0), again.said()
        assert self.check_untouched()
        assert not partial.exists()
        assert arrays(self.root / "d") == self.expected[name], again.said()
        shutil.rmtree(self.root / "d")


def arrays(result):
    """Everything below a result but what says how long it took."""
    found = {name: what for name, what in picture(result).items() if name not in _NOT_THE_SAME}
    if (result / "comparison.json").exists():
        told = json.loads((result / "comparison.json").read_text())
        del told["run_seconds"]
        for row in told["estimators"].values():
            del row["cost_us"]
        found["comparison.json"] = told
    assert len(found) > (0 if (result / "verification.json").exists() else 5)
    return found


@pytest.fixture
def tried(tmp_path, monkeypatch):
    """Figures are left out: they are the slowest, and written at the end into the folder that is not finished."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(running, "_illustrate", illustrate)
    for name in ("shared.style.save", "comparison.draw_comparison", "sweep.draw_sweep", "study_figures"):
        monkeypatch.setattr(f"quietfix.diagrams.figures.{name}", lambda *arguments: None)
    monkeypatch.setattr("quietfix.diagrams.commands.judging.verifying.save", lambda *arguments: None)
    (tmp_path / "logs").mkdir()
    (tmp_path / "root" / "canaries").mkdir(parents=True)
    with pytest.MonkeyPatch.context() as short:
        shorten(short)  # results among the canaries
        made = Tried(tmp_path / "root", tmp_path / "logs")
    monkeypatch.chdir(tmp_path / "root")
    return made


@pytest.fixture(scope="module")
def clusters(tmp_path_factory):
    pytest.importorskip("distributed")
    made = Cluster(tmp_path_factory.mktemp("clusters"))
    yield made
    made.stop()


@pytest.fixture
def cluster(clusters):
    """One for all tests, whose workers need to import all but once."""
    if clusters.processes and clusters.processes[0].poll() is None:
        clusters.mend()
    else:
        clusters.stop()
        clusters.start()
    return clusters


def check_parent(command, number, was_there):
    """See how a killed command ended: as such, or whole before it heard of it."""
    status = command.wait()
    said = command.said()
    assert "Traceback" not in said, said
    if number == INT:
        assert status in (130, 0, 3) and (status != 130 or said.endswith("quietfix: interrupted\n")), (status, said)
    else:
        assert status in ((-number, 0, 3) if was_there else (0, 3)), (status, said)


@pytest.mark.slow
def test_the_command_is_killed(tried):
    chance = np.random.default_rng(1)
    for name in NAMES:
        tried.learn(name)
    for name, number in PARENT_ALONE:
        command = tried.command(name, "--resume", "d")
        tried.moment(name, (), chance)
        check_parent(command, number, command.kill(number))
        tried.resume(name)


@pytest.mark.slow
def test_the_command_is_killed_and_the_cluster_stays(tried, cluster):
    chance = np.random.default_rng(2)
    options = ["--scheduler", cluster.address]
    for name in NAMES:
        tried.learn(name)
        tried.learn(name, *options)  # the same, to the bit
        tried.learn(name, *options)  # how long it takes workers that have built it
    for name, number in PARENT_OF_CLUSTER:
        command = tried.command(name, "--resume", "d", *options)
        tried.moment(name, options, chance)
        check_parent(command, number, command.kill(number))
        tried.resume(name, *options)


@pytest.mark.slow
def test_workers_are_killed_and_nothing_is_seen_of_it(tried, cluster):
    chance = np.random.default_rng(3)
    options = ["--scheduler", cluster.address]
    for name in NAMES:
        tried.learn(name)
    for name, number in WORKER_OF_CLUSTER:
        command = tried.command(name, "--resume", "d", *options)
        tried.middle(command, chance)
        command.kill(number, chance.choice(until(cluster.workers, "a worker")))
        status = command.wait()
        assert status in (0, 3 if name == "verify" else 0), command.said()
        tried.resume(name, *options)  # which says that it is finished
        cluster.mend()


@pytest.mark.slow
def test_the_scheduler_is_killed(tried, cluster):
    chance = np.random.default_rng(4)
    for name, number in SCHEDULER:
        options = ["--scheduler", cluster.address]
        tried.learn(name)
        command = tried.command(name, "--resume", "d", *options)
        tried.middle(command, chance)
        command.kill(number, cluster.scheduler)
        status, said = command.wait(), command.said()
        lines = [line for line in said.splitlines() if line.startswith("quietfix: ")]
        assert status in (0, 2) and "Traceback" not in said, said
        assert status == 0 or (len(lines) >= 1 and lines[-1].startswith("quietfix: --scheduler: tcp://")), said
        cluster.stop()
        cluster.start()
        tried.resume(name, "--scheduler", cluster.address)


@pytest.mark.slow
def test_workers_of_its_own(tried):
    chance = np.random.default_rng(5)
    options = ["--workers", "2"]
    for name in ("run", "verify"):
        tried.learn(name)
    for name, number, whose in OF_OWN_WORKERS:
        command = tried.command(name, "--resume", "d", *options)
        tried.middle(command, chance)
        workers = spawned(command.pid)
        if whose == "parent":
            check_parent(command, number, command.kill(number))
        elif workers:
            command.kill(number, workers[0])
            assert command.wait() == 0, command.said()
        until(lambda workers=workers: not alive(workers), "workers that end with the command")
        tried.resume(name)


def alive(pids):
    """Return those processes that run."""
    import psutil

    return [pid for pid in pids if psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE]
