"""Chunks run by other processes: the same bits, whoever runs them, and one that loses its worker is run again."""

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.scale.crew import check_workers, parts_by
from quietfix.diagrams.scale.resuming import joined
from quietfix.diagrams.scale.workers import run_chunk
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import run_study

OPTIONS = {"trials": 8, "seed": 2, "set": ["duration_s=4"], "estimators": ["iekf", "ukf"], "chunk": 2}


def asked():
    """A study in four chunks, and its plan."""
    study = Study("three_satellite", **OPTIONS)
    return study, study.plan(command="run", write_measurements=False)


def check_same(result):
    """Compare with one process, to the last bit."""
    whole = run_study("three_satellite", **OPTIONS)
    assert set(result) == set(whole)
    for name in whole.variables:
        np.testing.assert_array_equal(result[name].values, whole[name].values, err_msg=str(name))


@pytest.mark.slow
def test_a_worker_builds_what_is_asked_for_and_refuses_what_is_not_that():
    study, plan = asked()
    check_same(joined(study, [run_chunk(plan.text(), number) for number in (3, 1, 0, 2)]))
    other = replace(plan, asked=plan.asked | {"version": "0.0.1"})
    with pytest.raises(UserError, match=r"--workers: version: .* what was asked for has '0\.0\.1'"):
        run_chunk(other.text(), 0)
    assert Plan.read(other.text()) == other


def test_options_that_make_no_sense_are_one_line():
    for workers, scheduler, words in (
        (0, None, "--workers: 0 is not allowed; a whole number from 1"),
        (2, "tcp://127.0.0.1:1", "--workers: 2 is not allowed with --scheduler"),
        (None, "localhost", "--scheduler: localhost is not allowed; tcp://HOST:PORT"),
    ):
        with pytest.raises(UserError, match=words):
            check_workers(workers, scheduler)


REQUIREMENTS = """
system: three_satellite
set: [duration_s=2]
trials: 60
trial_limit: 60
looks: 1
requirements:
  - {metric: !Rmse {of: position, time_s: 2}, estimator: iekf, at_most: 1000000.0}
"""


@pytest.mark.slow
def test_nothing_of_dask_is_imported_without_the_options(tmp_path):
    """Of itself xarray imports it wherever it is installed; see that it can be, and that later code can have it."""
    program = (
        "import sys\nfrom quietfix.diagrams.commands.command_line import main\n"
        "for arguments in (line.split() for line in sys.stdin):\n"
        "    try: main(arguments)\n"
        "    except SystemExit as ended: assert not ended.code, (arguments, ended.code)\n"
        "print([name for name in sys.modules if name.split('.')[0] in ('dask', 'distributed')])\n"
        "import distributed\nprint('it is there')"
    )
    pytest.importorskip("distributed")
    (tmp_path / "r.yaml").write_text(REQUIREMENTS)
    short = "--trials 4 --set duration_s=2 --estimator iekf"
    commands = [f"run three_satellite {short} --out r", "verify r.yaml", f"compare three_satellite {short}"]
    commands.append(f"sweep three_satellite {short} --vary truth.sigma_tdoa_ns=10,20")
    done = subprocess.run(
        [sys.executable, "-c", program], input="\n".join(commands), capture_output=True, text=True, cwd=tmp_path
    )
    assert done.stdout.rstrip().endswith("\n[]\nit is there"), done.stdout + done.stderr
    assert done.returncode == 0


@pytest.mark.slow
def test_workers_of_this_machine_and_one_that_is_killed():
    pytest.importorskip("distributed")
    import psutil

    study, plan = asked()
    parts = []
    for part in parts_by(study, plan, range(4), False, 2, None):
        if not parts:
            children = psutil.Process().children(recursive=True)
            workers = [one for one in children if "spawn_main" in " ".join(one.cmdline())]
            assert workers
            os.kill(workers[0].pid, signal.SIGKILL)
        parts.append(part)
    assert sorted(part.number for part in parts) == [0, 1, 2, 3]
    check_same(joined(study, parts))


@pytest.mark.slow
def test_a_cluster_that_is_there(tmp_path):
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    begin = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    begin += ["--no-dashboard", "--scheduler-file", str(file)]
    work = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    work += ["--no-dashboard", "--local-directory", str(tmp_path)]
    with ExitStack() as stack:
        for command in (begin, work, work):
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            stack.callback(process.wait)
            stack.callback(process.terminate)
        from distributed import Client

        with Client(scheduler_file=str(file), timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            address = client.scheduler.address
        study, plan = asked()
        check_same(joined(study, parts_by(study, plan, range(4), False, None, address)))
    with pytest.raises(UserError, match="--scheduler"):
        list(parts_by(study, plan, (0,), False, None, address))
