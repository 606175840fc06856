"""Runs that are killed, run twice at once, or find the disk full: old or new is there, and the next run goes on."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import warnings
from types import SimpleNamespace

import pytest

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER, read_mark
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result
from tests.faults.tree import ShortStudy, chunk, picture, quietfix, shorten, write_result

RUN = ["run", "three_satellite", "--out", "d", "--overwrite"]
EVENTS = ("open", "os.rename", "os.mkdir", "os.remove", "os.rmdir")
UNMARKED = "was not made by this program"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shorten(monkeypatch)
    (tmp_path / "mine.txt").write_text("mine")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def child(work):
    """Do something in a forked process and return how that ended, as `os.waitpid` gives it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # other threads do not matter to what the child does
        process = os.fork()
    if process == 0:
        with contextlib.suppress(BaseException):
            work()
        os._exit(0)
    return os.waitpid(process, 0)[1]


def run_killed(step):
    """Run, killed before the `step`-th change on disk; return whether it came so far."""

    def work():
        left = [step]

        def hook(event, arguments):
            if event in EVENTS and (event != "open" or (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR)):
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        quietfix(*RUN)

    return os.WIFSIGNALED(child(work))


def whole(path):
    """Return how many trials a finished result has."""
    mark = read_mark(path)
    assert mark is not None and mark.finished
    assert (path / "nees.png").exists() or (path / ".quietfix-making").exists()
    return open_result(path).sizes["trial"]


def check_kills(folder, capsys, steps):
    """Kill at each step; return how many there were and how often the next run had to be helped."""
    done, helped = 0, 0
    for step in steps:
        with OutputFolder(folder / "d") as output:  # an old result of one trial; a new one has four
            output.append(chunk(0, 1))
            (output.work / "nees.png").touch()
            output.finish()
        if not run_killed(step):
            break
        done += 1
        assert (folder / "mine.txt").read_text() == "mine"
        if (folder / "d").exists():
            assert whole(folder / "d") in (1, 4), step
        else:
            assert whole(folder / "d.partial") == 4, step
        capsys.readouterr()
        if quietfix(*RUN) == 2:  # killed between making the folder and marking it
            assert UNMARKED in capsys.readouterr().err
            left = list((folder / "d.partial").iterdir())
            assert all(path.name.startswith(MARKER) for path in left) and read_mark(folder / "d.partial") is None
            for path in left:
                path.unlink()
            (folder / "d.partial").rmdir()
            assert quietfix(*RUN) == 0
            helped += 1
        assert {path.name for path in folder.iterdir()} == {"mine.txt", "d"}, step
        assert whole(folder / "d") == 4
        assert {path.name for path in (folder / "d").iterdir()} == {
            *[MARKER, "results.zarr", "summary.json", "nees.png", "diagram.svg"]
        }
        subprocess.run(["rm", "-r", "d"], check=True)
    return done, helped


def test_a_kill_leaves_the_old_or_the_new_result(folder, capsys):
    done, _ = check_kills(folder, capsys, (2, 30, 60))
    assert done >= 2


@pytest.mark.slow
def test_a_kill_at_every_change_on_disk_leaves_the_old_or_the_new_result(folder, capsys):
    done, helped = check_kills(folder, capsys, range(1, 1000))
    print(f"killed at each of {done} steps; {helped} times the next run had to be helped")
    assert done > 60 and helped <= 3


def test_a_kill_between_the_two_renames_loses_nothing(folder, capsys, monkeypatch):
    write_result(folder / "d")
    monkeypatch.setattr(ShortStudy, "request", SimpleNamespace(trials=3, system="three_satellite", threads=1))

    def work():
        def hook(event, arguments):
            if event == "os.rename" and str(arguments[0]) == "d.partial":
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        quietfix(*RUN)

    assert os.WIFSIGNALED(child(work))
    assert not (folder / "d").exists() and whole(folder / "d.partial") == 3
    assert open_result(folder / "d.partial" / ".quietfix-replaced").sizes["trial"] == 4
    assert quietfix("run", "three_satellite", "--out", "d") == 2  # not asked to overwrite what it has just found
    said = capsys.readouterr().err
    assert "finished by an earlier run" in said and "holds an earlier result" in said
    assert whole(folder / "d") == 3 and {path.name for path in folder.iterdir()} == {"mine.txt", "d"}
    assert not (folder / "d" / ".quietfix-replaced").exists()


def test_two_runs_at_once_and_a_lock_that_dies_with_its_holder(folder, capsys):
    ready, say = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process == 0:
        with contextlib.suppress(BaseException), OutputFolder("d") as output:
            output.append(chunk(0, 2))
            os.write(say, b"x")
            signal.pause()
        os._exit(0)
    assert os.read(ready, 1) == b"x"
    os.close(ready), os.close(say)
    for _ in range(2):
        assert quietfix("run", "three_satellite", "--out", "d") == 2
        err = capsys.readouterr().err
        assert "another run is writing" in err and err.count("\n") == 1
    assert open_result("d.partial").sizes["trial"] == 2  # the first one's work is untouched
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    assert quietfix("run", "three_satellite", "--out", "d") == 0
    assert open_result("d").sizes["trial"] == 4


def test_what_appears_during_a_run_is_not_replaced(folder, capsys):
    kept = r"thesis\.tex.*the finished result is kept in d\.partial"
    with pytest.raises(UserError, match=kept), OutputFolder("d") as output:
        output.append(chunk(0, 2))
        (folder / "d").mkdir()
        (folder / "d" / "thesis.tex").write_text("years of work")
        output.finish()
    assert (folder / "d" / "thesis.tex").read_text() == "years of work"
    assert open_result("d.partial").sizes["trial"] == 2
    (folder / "d").rename(folder / "elsewhere")
    assert quietfix("run", "three_satellite", "--out", "d") == 2
    assert open_result("d").sizes["trial"] == 2


@pytest.mark.parametrize("fails", [False, True])
def test_a_file_that_is_added_during_a_run_stays(folder, fails, capsys):
    with contextlib.suppress(RuntimeError), OutputFolder("d") as output:
        (output.partial / "my.png").write_text("mine")
        if fails:
            raise RuntimeError
        output.append(chunk(0, 2))
        output.finish()
    assert (folder / ("d.partial" if fails else "d") / "my.png").read_text() == "mine"
    before = picture(folder)
    assert quietfix(*RUN) == 2 and "my.png" in capsys.readouterr().err and picture(folder) == before


def test_files_added_to_kept_chunks_are_not_removed(folder, capsys):
    with pytest.raises(KeyboardInterrupt), OutputFolder("d") as output:
        output.append(chunk(0, 2))
        raise KeyboardInterrupt
    for name in ("my.png", "results.zarr/remarks.txt", "results.zarr/estimate/c/mine", "summary.json"):
        (folder / "d.partial" / name).write_text("mine")
        before = picture(folder)
        assert quietfix("run", "three_satellite", "--out", "d") == 2 and picture(folder) == before
        assert name in capsys.readouterr().err
        (folder / "d.partial" / name).unlink()
    assert quietfix("run", "three_satellite", "--out", "d") == 0


def test_a_run_does_not_remove_what_it_reads(folder, capsys):
    with pytest.raises(KeyboardInterrupt), OutputFolder("d") as output:
        output.append(chunk(0, 2))
        raise KeyboardInterrupt
    for source in ("d.partial", "d.partial/results.zarr"):
        with pytest.raises(UserError, match="is where --out d works"):
            OutputFolder("d", reads=source)
    assert open_result("d.partial").sizes["trial"] == 2


# ---------------------------------------------------------------------------------------------------------- full disk


def test_a_chunk_that_finds_the_disk_full_leaves_those_before_it(folder, monkeypatch):
    from zarr.storage import _local

    put, puts = _local._put, [0]

    def full_after(limit):
        def full(path, value, *arguments, **options):
            puts[0] += 1
            if limit is not None and puts[0] == limit:
                raise OSError(28, "No space left on device", str(path))
            return put(path, value, *arguments, **options)

        puts[0] = 0
        monkeypatch.setattr(_local, "_put", full)

    last = chunk(2, 2).assign(bound_x=("time", [1.0, 2.0, 3.0]))
    limit, failures = 1, 0
    while True:
        try:
            with OutputFolder("d") as output:
                full_after(None)
                output.append(chunk(0, 2))
                full_after(limit)
                output.append(last)
                output.finish()
        except UserError as error:
            assert str(error) == (
                "--out: d cannot be written (No space left on device); 2 trials are kept in d.partial"
            )
            full_after(None)
            kept = open_result("d.partial")
            assert kept.identical(chunk(0, 2)) or ((kept["estimate"] == 1).all() and set(kept) == {"estimate", "truth"})
            assert kept.sizes == {"trial": 2, "time": 3}
            failures, limit = failures + 1, limit + 1
            continue
        break
    assert failures >= 5 and open_result("d").sizes["trial"] == 4 and not (folder / "d.partial").exists()


def test_files_that_may_not_grow_are_one_line(folder, capfd):
    def work():
        resource.setrlimit(resource.RLIMIT_FSIZE, (300 << 10, 300 << 10))
        rows = chunk(0, 2)
        with contextlib.suppress(UserError), OutputFolder("d") as output:
            output.append(rows)
            (output.work / "nees.png").write_bytes(os.urandom(400 << 10))

    child(work)
    assert open_result("d.partial").sizes["trial"] == 2 and not (folder / "d").exists()


def test_a_full_disk_is_one_line_and_keeps_finished_chunks(tmp_path, monkeypatch, capsys):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=700k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.decode().strip()}")
    try:
        shorten(monkeypatch)
        monkeypatch.chdir(disk)
        monkeypatch.setattr(ShortStudy, "request", SimpleNamespace(trials=1000, system="three_satellite", threads=1))
        monkeypatch.setattr(ShortStudy, "size", 1)
        monkeypatch.setattr(
            ShortStudy, "chunk", lambda self, k, n: chunk(k, n).assign(noise=(["trial", "time"], random_row(k)))
        )
        assert quietfix("run", "three_satellite", "--out", "d") == 2
        err = capsys.readouterr().err
        assert "No space left on device" in err and "trials are kept in d.partial" in err and err.count("\n") == 1
        kept = open_result("d.partial").load()
        assert f"{kept.sizes['trial']} trials are kept" in err and kept.sizes["trial"] > 5
        for k in range(kept.sizes["trial"]):
            assert (kept["noise"][k] == random_row(k)[0]).all()
        kept.close()
    finally:
        monkeypatch.chdir(tmp_path)
        subprocess.run(["umount", str(disk)], check=True)


def random_row(k):
    """Return numbers that do not compress, 3 of them per trial and time."""
    import numpy as np

    return np.random.default_rng(k).normal(size=(1, 3))
