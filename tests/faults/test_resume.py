"""Runs that are killed anywhere and resumed: nothing is lost but the chunk in flight, and the result is the same."""

import contextlib
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from quietfix.diagrams.chunks.ledger import CHUNKS, Ledger, read_plan
from quietfix.diagrams.chunks.part import Part, added
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.rerun import ask_as
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study
from tests.faults.test_kill import EVENTS, child, random_row
from tests.faults.tree import ShortStudy, chunk, picture, quietfix, shorten

RESUME = ["run", "three_satellite", "--resume", "d"]
SIX = SimpleNamespace(trials=6, system="three_satellite", threads=1)
SHORT = ["duration_s=4"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Six trials in three chunks; each that is run is told in the file `ran`."""
    shorten(monkeypatch)
    monkeypatch.setattr(ShortStudy, "request", SIX)

    def noisy(self, begin, count):
        with open("ran", "a") as ran:
            ran.write(f"{begin}\n")
        rows = np.concatenate([random_row(k) for k in range(begin, begin + count)])
        return chunk(begin, count).assign(noise=(["trial", "time"], rows))

    monkeypatch.setattr(ShortStudy, "chunk", noisy)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    return tmp_path


def arrays(result):
    """Everything below a result but its marker, which lists it, and its summary, which has the time it took."""
    return {name: what for name, what in picture(result).items() if name not in (MARKER, "summary.json")}


def killed(step):
    """Run, killed before the `step`-th change on disk; return whether it came so far."""

    def work():
        left = [step]

        def hook(event, arguments):
            writes = event != "open" or ((arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR) and arguments[0] != "ran")
            if event in EVENTS and writes:
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        quietfix(*RESUME)

    return os.WIFSIGNALED(child(work))


def check_kills(folder, capsys, steps):
    """Kill at each step, resume, and compare with a run that was let be; return the number of kills."""
    assert quietfix("run", "three_satellite", "--out", "whole") == 0
    expected, done = arrays(folder / "whole"), 0
    for step in steps:
        (folder / "ran").write_text("")
        if not killed(step):
            break
        done += 1
        before = len((folder / "ran").read_text().split())
        plan = read_plan(folder / "d.partial")
        finished = 0 if plan is None else len(Ledger(folder / "d.partial", plan).finished())
        marked = (folder / "d" / MARKER).exists() or (folder / "d.partial" / MARKER).exists()
        capsys.readouterr()
        if not marked and (folder / "d.partial").exists():  # killed before it is known as Quietfix's
            subprocess.run(["rm", "-r", "d.partial"], check=True)
        assert quietfix(*RESUME) == 0, (step, capsys.readouterr().err)
        assert len((folder / "ran").read_text().split()) <= max(before, finished) + 3 - finished, step
        assert arrays(folder / "d") == expected, step
        assert {path.name for path in folder.iterdir()} == {"mine.txt", "ran", "whole", "d"}
        assert (folder / "mine.txt").read_text() == "mine"
        subprocess.run(["rm", "-r", "d"], check=True)
    return done


def test_a_run_that_was_killed_goes_on_to_the_same_result(folder, capsys):
    assert check_kills(folder, capsys, (130,)) == 1


@pytest.mark.slow
def test_a_kill_at_any_change_on_disk_is_mended(folder, capsys):
    done = check_kills(folder, capsys, range(1, 1000, 3))
    print(f"killed at {done} steps")
    assert done > 40


def test_only_what_is_not_finished_is_run(folder, capsys):
    plan = ShortStudy("").plan(command="run", write_measurements=False)
    with pytest.raises(KeyboardInterrupt), OutputFolder("d", plan=plan) as output:
        for part in ShortStudy("").parts(numbers=(2, 0)):
            output.write(part)
        raise KeyboardInterrupt
    kept = open_result("d.partial").load()
    np.testing.assert_array_equal(kept["trial"], [0, 1, 4, 5])  # and not the empty places between them
    for k in kept["trial"].values:
        np.testing.assert_array_equal(kept["noise"].sel(trial=k), random_row(k)[0])
    (folder / "ran").unlink()
    assert quietfix(*RESUME) == 0
    assert "2 of 6 trials are left to run" in capsys.readouterr().out
    assert (folder / "ran").read_text() == "2\n"
    assert quietfix("run", "three_satellite", "--out", "whole") == 0
    assert arrays(folder / "d") == arrays(folder / "whole")
    result = open_result("d")
    np.testing.assert_array_equal(result["trial"], np.arange(6))
    np.testing.assert_array_equal(result["bound_sum"], np.full(3, (1 / 3 + 1 / 4) + 1 / 5))
    capsys.readouterr()
    before = picture(folder)
    assert quietfix(*RESUME) == 0 and "nothing is left to run" in capsys.readouterr().out
    assert picture(folder) == before


def test_a_chunk_that_the_disk_has_lost_is_run_again(folder, capsys):
    """After a power cut a file may be shorter than what was written, and its record is there."""
    plan = ShortStudy("").plan(command="run", write_measurements=False)
    with contextlib.suppress(KeyboardInterrupt), OutputFolder("d", plan=plan) as output:
        for part in ShortStudy("").parts():
            output.write(part)
        lost = output.store / "noise" / "c" / "1" / "0"
        lost.write_bytes(lost.read_bytes()[:10])
        (output.partial / CHUNKS / "2.npz").write_bytes(b"PK")
        raise KeyboardInterrupt
    (folder / "ran").unlink()
    assert quietfix(*RESUME) == 0
    assert (folder / "ran").read_text() == "2\n4\n"
    assert quietfix("run", "three_satellite", "--out", "whole") == 0
    assert arrays(folder / "d") == arrays(folder / "whole")


def test_another_run_is_refused_by_the_field_and_changes_nothing(folder, capsys):
    plan = ShortStudy("").plan(command="run", write_measurements=False)
    with contextlib.suppress(KeyboardInterrupt), OutputFolder("d", plan=plan) as output:
        output.write(next(ShortStudy("").parts()))
        raise KeyboardInterrupt
    before = picture(folder)
    other = ShortStudy("").plan(command="compare", write_measurements=False)
    with pytest.raises(UserError, match=r"--resume: command: 'compare' is not allowed; .* has 'run'"):
        OutputFolder("d", plan=other, resume=True)
    for arguments, words in (
        (["--resume", "d", "--out", "e"], "--out: e is not allowed with --resume d"),
        (["--resume", "nowhere"], "--resume: nowhere is not allowed"),
    ):
        assert quietfix("run", *arguments) == 2
        assert words in capsys.readouterr().err
    assert picture(folder) == before


def test_every_field_of_a_study_that_differs_is_named(tmp_path):
    options = {"trials": 6, "set": SHORT, "estimators": ["iekf"], "chunk": 2}
    plan = Study("three_satellite", **options).plan()
    plan.refuse_other(Study("three_satellite", **options).plan())
    found, again = ask_as(Plan.read(plan.text()).asked, "--resume: d", None, {"chunk": 2}, False)
    plan.refuse_other(Study(found, **again).plan())  # what is not named again is taken from there
    for changes, words in (
        ({"trials": 7}, "trials: 7 is not allowed; the run that was interrupted has 6"),
        ({"seed": 1}, "seed: 1 is"),
        ({"chunk": 3}, "chunk: 3 is"),
        ({"every": 2}, "every: 2 is"),
        ({"keep": "all"}, "keep: 'all' is"),
        ({"first_trial": 5}, "first_trial: 5 is"),
        ({"estimators": ["ekf"]}, r"estimators\.iekf: nothing is"),
        ({"set": [*SHORT, "truth.sigma_tdoa_ns=31"]}, r"truth\.sigma_tdoa_ns: 31\.0 is not allowed; .* has 20\.0"),
    ):
        with pytest.raises(UserError, match=f"--resume: {words}"):
            plan.refuse_other(Study("three_satellite", **options | changes).plan())


def test_chunks_in_any_order_are_the_study_bit_for_bit(tmp_path):
    """Each chunk is run by a study of its own, last one first, as separate processes would."""
    options = {"trials": 5, "seed": 2, "set": SHORT, "estimators": ["iekf", "ukf"], "chunk": 2}
    whole = run_study("three_satellite", **options)
    plan = Study("three_satellite", **options).plan()
    with OutputFolder(tmp_path / "d", plan=plan) as output:
        for number in (2, 0, 1):
            (part,) = Study("three_satellite", **options).parts(numbers=(number,))
            assert isinstance(part, Part) and part.begin == 2 * number
            output.write(part)
        bounds = Study("three_satellite", **options).bounds(added(output.ledger.sums()), whole["time"].values)
        stored = open_result(output.store).load()
    for name in stored:
        np.testing.assert_array_equal(stored[name].values, whole[name].values, err_msg=name)
    assert len(bounds) == 10
    for name, (_, values) in bounds.items():
        np.testing.assert_array_equal(values, whole[name].values, err_msg=name)
