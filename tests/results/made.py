"""Results on disk that are made by hand, and the command that is run on them."""

import json
import shutil

import numpy as np
import pytest

from quietfix.diagrams.commands import command_line
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION
from tests.diagrams.results import result

ATTRIBUTES = {
    "schema_version": SCHEMA_VERSION,
    "variant": "",
    "version": "0.1.0",
    "scenario": "a: 1\n",
    "note": "",
    "first_trial": 0,
    "trials": 8,
    "keep": "estimates",
    "every": 1,
}


def quietfix(*arguments):
    """Run the command in this process and return its exit status."""
    with pytest.raises(SystemExit) as ended:
        command_line.main([str(argument) for argument in arguments])
    return ended.value.code or 0


def told(capsys, *arguments):
    """Run the command with --json and return what it prints."""
    capsys.readouterr()
    assert quietfix(*arguments, "--json") == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def refused(capsys, *arguments):
    """Run a command that is refused, and return its one line."""
    capsys.readouterr()
    assert quietfix(*arguments) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("quietfix: ") and said.err.count("\n") == 1, said
    return said.err


def write(folder, dataset, chunk=3, kind="run", along="trial"):
    """Write a result chunk by chunk; return it."""
    with OutputFolder(folder, kind=kind) as output:
        for begin in range(0, dataset.sizes[along], chunk):
            output.append(dataset.isel({along: slice(begin, begin + chunk)}), along)
        output.finish()
    return dataset


def dataset(**options):
    """Return a result of eight trials, with platforms and all attributes."""
    made = result(**options)
    times = made.sizes["time"]
    places = np.arange(times * 12.0).reshape(times, 2, 6)
    made = made.assign(platforms=(("time", "platform", "coordinate"), places))
    made = made.assign_coords(
        platform=["one", "two"],
        coordinate=["x", "y", "z", "vx", "vy", "vz"],
        measured_rows=("trial", np.full(made.sizes["trial"], 3), {"rows": 5}),
    )
    return made.assign_attrs(ATTRIBUTES | {"trials": made.sizes["trial"]})


def damaged(result, copy, marked=True):
    """Copy a result to `copy`, with one chunk of its estimates spoilt; without its marker unless `marked`."""
    shutil.copytree(result, copy)
    part = next(path for path in sorted((copy / "results.zarr" / "estimate" / "c").rglob("*")) if path.is_file())
    part.write_bytes(b"not what was written")
    if not marked:
        (copy / MARKER).unlink()
    return copy
