"""Memory: a diagram that runs again and again does not grow; one that is no longer needed goes."""

import subprocess
import sys
from importlib.metadata import version

import pytest

from tests.laws.packaged import EVERYTHING

OLD_DRAKE = tuple(int(n) for n in version("drake").split(".")[:2]) < (1, 58)

BUILD = """
import gc, sys, weakref
from pathlib import Path
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.commands.catalogue import load_scenario
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.recorder import record
from quietfix.systems.signals import Draw, leaf_systems, set_draw

def build(name="three_satellite", trials=20, settings=()):
    head, _, variant = name.partition(":")
    scenario = load_scenario(head, variant or None, settings=settings)
    builder = DiagramBuilder()
    wired = find(head).system.build(builder, scenario, select_estimators(scenario, None), trials)
    ports = {"truth": wired.truth}
    for estimator, block in wired.estimators.items():
        ports |= {f"{estimator}/{port}": block.GetOutputPort(port) for port in ("estimate", "covariance", "nis")}
    recorder = record(builder, ports, wired.clock)
    return builder.Build(), recorder

def run(diagram, recorder, simulator, seed, end=2.0):
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(seed))
    simulator.reset_context(context)
    simulator.Initialize()
    simulator.AdvanceTo(end)
    return recorder.result(context)[1]["truth"].sum()

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096
"""

GROWTH = (
    BUILD
    + """
diagram, recorder = build(settings=["duration_s=2"])
simulator = Simulator(diagram)
warm, counted = map(int, sys.argv[1:])
for seed in range(warm + counted):
    run(diagram, recorder, simulator, seed)
    if seed == warm - 1:
        gc.collect()
        before = resident()
gc.collect()
print((resident() - before) / 2**20)
"""
)

ALIVE = (
    BUILD
    + """
for name in sys.argv[1:]:
    references = []
    for seed in range(3):
        try:
            diagram, recorder = build(name, trials=2)
        except UserError as error:
            assert "QUIETFIX_DATA" in str(error)
            break
        run(diagram, recorder, Simulator(diagram), seed)
        references += [(block.get_name(), weakref.ref(block)) for block in leaf_systems(diagram)]
        references.append(("diagram", weakref.ref(diagram)))
        del diagram, recorder
    gc.collect()
    alive = sorted({block for block, reference in references if reference() is not None})
    print(name, len(references), alive)
"""
)


def python(code, project_root, *arguments):
    """Run code in a fresh interpreter and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=project_root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize(("warm", "counted"), [(30, 70), pytest.param(50, 200, marks=pytest.mark.slow)])
def test_runs_of_one_diagram_leave_nothing(project_root, warm, counted):
    """After the first runs less than 2 MB more, with a new context each."""
    growth = float(python(GROWTH, project_root, str(warm), str(counted)))
    # 70 logs of this run are 70 x 3 epochs x 20 trials x 5 x 43 numbers = 7 MB, the contexts 5 MB
    print(growth)
    assert growth < 2.0, f"{growth:.2f} MB"


@pytest.mark.skipif(OLD_DRAKE, reason="Drake before 1.58 keeps every diagram that was ever built, whatever is in it")
def test_no_block_outlives_its_diagram(project_root):
    """Built, run and dropped three times: every packaged scenario."""
    lines = [line.split(maxsplit=2) for line in python(ALIVE, project_root, *EVERYTHING).splitlines()]
    assert [name for name, _, _ in lines] == EVERYTHING
    assert dict((name, alive) for name, _, alive in lines) == dict.fromkeys(EVERYTHING, "[]")
    # and there was something to drop: at least a plant, a sensor, an estimator and a recorder in each diagram
    assert all(int(count) >= 3 * 5 for name, count, _ in lines if int(count) > 0)
    assert int(lines[0][1]) >= 3 * 10
