"""Workers and what may go wrong beside them: full and read-only disks, two at once, names, chunks that end workers."""

import os
import re
import shutil
import signal
import subprocess
import sys
from multiprocessing import spawn
from pathlib import Path

import pytest

from quietfix.diagrams.chunks.jobs import Job
from quietfix.diagrams.console import progress
from quietfix.diagrams.scale import crew
from quietfix.diagrams.scale.crew import Crew, Lost
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from tests.faults.cluster import Cluster, Command, spawned, until
from tests.faults.test_workers import REQUIREMENTS
from tests.faults.tree import picture, plant, quietfix, shorten

SHORT = ["--set", "duration_s=4", "--estimator", "iekf", "--chunk", "50", "--workers", "2"]
COMMANDS = {
    "run": ["run", "three_satellite", "--trials", "200", *SHORT],
    "compare": ["compare", "three_satellite", "--trials", "200", *SHORT],
    "sweep": ["sweep", "three_satellite", "--trials", "50", "--vary", "truth.sigma_tdoa_ns=10,20", *SHORT],
    "verify": ["verify", "r.yaml", "--workers", "2"],
}
DEADLY = '''
import os
from dataclasses import dataclass
from multiprocessing import parent_process
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman

@dataclass(frozen=True)
class Deadly(IteratedExtendedKalman):
    """Ends every worker that comes to one trial, which it knows by what is measured in it."""

    measured: float = 0.0

    def update(self, mean, covariance, observation, model):
        if parent_process() is not None and (observation.value[:, 0] == self.measured).any():
            os._exit(1)
        return super().update(mean, covariance, observation, model)
'''


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 700 kB, and how it is mounted anew with other options."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=700k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.decode().strip()}")
    yield disk, lambda options: subprocess.run(["mount", "-o", f"remount,{options}", str(disk)], check=True)
    subprocess.run(["umount", str(disk)], check=True)


def one_line(err):
    """See that one line tells of a mistake, after those that tell how far it is, and return it."""
    lines = [line for line in err.splitlines() if not re.match(r"quietfix: \w+: \d+ of \d+ trials", line)]
    assert len(lines) == 1 and lines[0].startswith("quietfix: "), err
    return lines[0]


@pytest.mark.slow
def test_a_full_disk_keeps_what_workers_have_finished(small_disk, tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    disk, mount = small_disk
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("quietfix.diagrams.commands.running._illustrate", lambda *arguments: None)
    study = [*COMMANDS["run"][:2], "--trials", "1000", "--keep", "all", *SHORT]
    assert quietfix(*study, "--out", "disk/d") == 2
    told = one_line(capsys.readouterr().err)
    assert "No space left on device" in told and "trials are kept in disk/d.partial" in told
    mount("size=40m")
    assert quietfix(*study[:-2], "--resume", "disk/d") == 0, capsys.readouterr().err
    assert quietfix(*study[:-2], "--out", "whole") == 0
    assert picture(disk / "d" / "results.zarr") == picture(tmp_path / "whole" / "results.zarr")


@pytest.mark.parametrize("command", COMMANDS)
def test_where_nothing_can_be_written_no_worker_is_asked(command, small_disk, tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    disk, mount = small_disk
    monkeypatch.setattr(Crew, "_begin", lambda *arguments: pytest.fail("a cluster was made"))
    with pytest.MonkeyPatch.context() as short:
        shorten(short)
        plant(tmp_path / "tree")
    (tmp_path / "tree" / "r.yaml").write_text(REQUIREMENTS)
    monkeypatch.chdir(tmp_path / "tree")
    before = picture(tmp_path / "tree")
    mount("ro")
    refused = {str(disk / "d"): "Read-only file system", "loop/inside": "", "to_result": "link", "thesis": "thesis"}
    for option in ("--out", "--resume"):
        for where, words in refused.items():
            assert quietfix(*COMMANDS[command], option, where) == 2, (option, where)
            assert words in one_line(capsys.readouterr().err), (option, where)
        assert quietfix(*COMMANDS[command], option, os.fsdecode(b"\xff")) == 2
        assert r"\udcff" in one_line(capsys.readouterr().err)
    assert picture(tmp_path / "tree") == before


@pytest.mark.slow
def test_a_chunk_that_ends_workers_is_named(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "deadly.py").write_text(DEADLY)
    short = ["duration_s=3"]
    (measured,) = Study("three_satellite", estimators=["iekf"], set=short, trials=12, keep="measurements").chunks()
    value = float(measured["measurement"].values[7, 1, 0])
    own = f"estimators.deadly=!Custom {{class: deadly:Deadly, options: {{measured: {value!r}}}}}"
    deadly = ["--trials", "12", "--chunk", "2", "--estimator", "deadly", "--set", *short, "--set", own]
    assert quietfix("run", "three_satellite", *deadly, "--workers", "2", "--out", "d") == 2
    told = one_line(capsys.readouterr().err)
    words = "quietfix: --workers: chunk 3 of three_satellite (trials 6 to 7) has ended 4 workers, one after the other"
    assert told.startswith(words)
    finished = {int(path.stem) for path in Path("d.partial", ".quietfix-chunks").glob("*.npz")}
    assert finished and 3 not in finished
    assert f"{2 * len(finished)} trials are kept in d.partial" in told


@pytest.mark.slow
def test_the_last_worker_of_this_machine_is_gone_for_good(monkeypatch):
    """The first is killed, and what is started in its place ends at once, however often."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(crew, "_GONE", 3.0)
    study = Study("three_satellite", estimators=["iekf"], set=["duration_s=3"], trials=12, chunk=2)
    job = Job(study, study.plan(command="run"), range(6))
    python = spawn.get_executable()
    finished = []
    try:
        with Crew(workers=1, progress=False) as workers, pytest.raises(Lost, match="the last worker of this machine"):
            for _, part in workers.run([job]):
                finished.append(part.number)
                spawn.set_executable(shutil.which("false"))
                for pid in spawned(os.getpid()):
                    os.kill(pid, signal.SIGKILL)
    finally:
        spawn.set_executable(python)
    assert 1 <= len(finished) < 6
    until(lambda: not spawned(os.getpid()), "workers that end with the run")


@pytest.mark.slow
def test_the_last_worker_of_a_cluster_is_gone_for_good(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(crew, "_GONE", 3.0)
    study = Study("three_satellite", estimators=["iekf"], set=["duration_s=3"], trials=24, chunk=2)
    job = Job(study, study.plan(command="run"), range(12))
    cluster = Cluster(tmp_path)
    finished = []
    try:
        address = cluster.start().address
        with Crew(scheduler=address, progress=False) as workers, pytest.raises(Lost) as raised:
            for _, part in workers.run([job]):
                if not finished:
                    cluster.end_workers()
                finished.append(part.number)
    finally:
        cluster.stop()
    assert str(raised.value) == f"--scheduler: the last worker of {address} is lost"
    assert 1 <= len(finished) < 12


@pytest.mark.slow
def test_workers_that_end_while_they_start_are_one_line(tmp_path):
    """A worker imports the script that asks for workers, which would ask for workers."""
    pytest.importorskip("distributed")
    arguments = [*COMMANDS["run"], "--out", "d"]
    program = "from quietfix.diagrams.commands.command_line import main\n"
    (tmp_path / "script.py").write_text(f"{program}main({arguments!r})\n")
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2, done.stderr
    told = one_line(done.stderr)
    assert told.startswith("quietfix: --workers: no worker has started") and '`if __name__ == "__main__":`' in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["script.py"]


@pytest.mark.slow
def test_the_second_of_two_runs_into_one_folder_is_one_line(tmp_path, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("quietfix.diagrams.commands.running._illustrate", lambda *arguments: None)
    # long enough to be at work as long as the others are tried
    study = [*COMMANDS["run"][:2], "--trials", "400", *SHORT[:-4], "--chunk", "2", "--workers", "2"]
    first = Command(tmp_path / "first.log", *study, "--out", "d")
    chunks = Path("d.partial", ".quietfix-chunks")
    try:
        until(lambda: not first.running() or list(chunks.glob("*.npz")), "a chunk")
        monkeypatch.setattr(Crew, "_begin", lambda *arguments: pytest.fail("a cluster was made"))
        for option in (["--out", "d"], ["--out", "d", "--overwrite"], ["--resume", "d"]):
            assert quietfix(*study, *option) == 2
            assert "another run is writing in d.partial" in one_line(capsys.readouterr().err)
        assert first.wait() == 0, first.said()
    finally:
        first.end()
    assert quietfix(*study[:-2], "--out", "whole") == 0
    assert picture(tmp_path / "d" / "results.zarr") == picture(tmp_path / "whole" / "results.zarr")


def test_an_address_at_which_nobody_answers_is_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(crew, "_PATIENCE", 0.5)
    study = Study("three_satellite", estimators=["iekf"], trials=2, set=["duration_s=2"])
    job = Job(study, study.plan(command="run"), (0,))
    with (
        Crew(scheduler="tcp://127.0.0.1:9", progress=False) as nobody,
        pytest.raises(UserError, match="--scheduler: tcp"),
    ):
        list(nobody.run([job]))


def test_a_line_a_minute_where_there_is_no_terminal(monkeypatch, capsys):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.Progress("three_satellite", 1000, True, "trials") as bar:
        for _ in range(13):  # every ten seconds
            bar.update(4 * (now[0] - 100), 2)
            now[0] += 10
        bar.update(1000 * 0.5)
    assert capsys.readouterr().err.splitlines() == [
        "quietfix: three_satellite: 240 of 1000 trials, 4 a second, 3:10 left, 2 workers",
        "quietfix: three_satellite: 480 of 1000 trials, 4 a second, 2:10 left, 2 workers",
    ]
    with progress.Progress("three_satellite", 1000, False, "trials") as bar:
        now[0] += 100
        bar.update(10)
    assert capsys.readouterr().err == ""
