"""Statistics and figures of a result read no more than a chunk at once: four times the trials take no more memory."""

import json
import subprocess
import sys

import numpy as np

from quietfix.diagrams.studies.output import OutputFolder
from tests.results.made import dataset

CHUNK = 2000
EPOCHS = 20

SCRIPT = """
import contextlib, io, json, sys
from pathlib import Path
from quietfix.diagrams.commands.command_line import main
from quietfix.diagrams.statistics import quantiles
from quietfix.diagrams.statistics.metrics import summarise
from quietfix.diagrams.studies.results import open_result
from tests.peak_memory import peak_bytes

quantiles._AT_ONCE = 1 << 20  # what is sorted at once is small, too
folder = Path(sys.argv[1])
said = io.StringIO()
for command in (["inspect", "r"], ["plot", "r"], ["diff", "r", "r"]):
    words = [str(folder / word) if word == "r" else word for word in command]
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main(words)
rows = summarise(open_result(folder / "r"))
figures = len(list((folder / "r-figures").glob("*.png")))
print(json.dumps({"peak": peak_bytes(), "rmse": rows["ukf"]["rmse_position_m"][-1], "figures": figures,
                  "said": said.getvalue()}))
"""


def measured(folder, chunks):
    """Write a result of so many chunks, and return what a process of its own tells of it."""
    squares = 0.0
    with OutputFolder(folder / "r") as output:
        for k in range(chunks):
            made = dataset(trials=CHUNK, epochs=EPOCHS, seed=k)
            error = (made["estimate"] - made["truth"]).sel(estimator="ukf", state=["x", "y", "z"])
            squares += float((error.isel(time=-1) ** 2).sum())
            made = made.assign_coords(trial=np.arange(k * CHUNK, (k + 1) * CHUNK))
            output.append(made.assign_attrs(trials=chunks * CHUNK, seed=0))
        output.finish()
    run = [sys.executable, "-c", SCRIPT, str(folder)]
    found = json.loads(subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True).stdout)
    assert found["figures"] == 9, found["said"]
    # some 1e4 squares in another order
    np.testing.assert_allclose(found["rmse"], np.sqrt(squares / (chunks * CHUNK)), rtol=1e-9)
    return found["peak"]


def test_four_times_the_trials_take_no_more_memory(tmp_path):
    few, many = (tmp_path / name for name in ("few", "many"))
    few.mkdir()
    many.mkdir()
    more = measured(many, 12) - measured(few, 3)
    estimates = 9 * CHUNK * 2 * EPOCHS * 6 * 8  # bytes: 35 MB; what is worked out of them all at once is ten times that
    # the position errors, which percentiles need, are a sixth, and are copied once as they grow; as much again for what
    # the allocator keeps, which differs by 15 MB from run to run
    print(f"{more / 1e6:.1f} MB more")
    assert more < 2 * estimates, more
