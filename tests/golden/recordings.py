"""The record of what the recordings give: ``python -m tests.golden.recordings`` writes it anew.

Kept of every array: its hash, its shape, how much of it is missing, two weighted sums, and some of its elements.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from quietfix.diagrams.readers.bearings_file import read_bearings
from quietfix.diagrams.readers.doptrack_data import read_passes
from quietfix.diagrams.readers.kiwisdr.folder import read_folder
from quietfix.diagrams.readers.locards_data import read_sets
from quietfix.diagrams.recorded.bearings import Settings as BearingsSettings
from quietfix.diagrams.recorded.bearings import declare_bearings
from quietfix.diagrams.recorded.doptrack import ORDERS, declare_passes
from quietfix.diagrams.recorded.doptrack import Settings as DoptrackSettings
from quietfix.diagrams.recorded.kiwisdr import declare_data
from quietfix.diagrams.recorded.locards import Settings as LocardsSettings
from quietfix.diagrams.recorded.locards import declare_sets
from quietfix.diagrams.recorded.settings.kiwisdr_settings import Settings as KiwiSettings
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from tests.golden.record import _array, machine

__all__ = ["FAST", "FILE", "SLOW", "read", "recorded_case", "report_of"]

FILE = Path(__file__).with_name("recordings.json")
_KEPT = 60  # elements of each array


def report_of(system, model, settings):
    """Return the report of a recording whose model is declared already."""
    study = Study(system, scenario=settings, model=model)
    return study.report(join(list(study.chunks())))


def _locards(folder, **settings):
    chosen = LocardsSettings(**settings)
    scores = report_of("locards", declare_sets(read_sets(folder), chosen), chosen).all
    return {
        "fix": scores.fix,
        "error_gate": scores.error[0],
        "error_no_gate": scores.error[1],
        "excluded": scores.excluded,
        "sigma": scores.sigma,
    }


def _doptrack(folder, which=slice(None)):
    settings = DoptrackSettings()
    found = report_of("doptrack", declare_passes(read_passes(folder)[which], settings), settings)
    arrays = {name: found.estimates[name] for name in ORDERS}
    sigmas = np.array([found.sigmas[name] for name in ORDERS])
    return arrays | {"sigmas": sigmas, "time": found.times}


def _kiwisdr(folder):
    settings = KiwiSettings()
    found = report_of("kiwisdr", declare_data(read_folder(folder), settings), settings)
    pairs = {f"tdoa_{j}{i}": one.tdoa for (i, j), one in found.pairs.items()}
    sigmas = {f"sigma_tdoa_{j}{i}": one.sigma_tdoa for (i, j), one in found.pairs.items()}
    return (
        {
            "estimate": found.fix.estimate,
            "covariance": found.fix.covariance,
            "singly": found.singly,
            "nis": np.array([found.fix.nis, found.fix.nis_dof]),
            "time": found.times,
        }
        | pairs
        | sigmas
    )


def _bearings():
    rng = np.random.default_rng(5)
    place = rng.uniform(-3e3, 3e3, (40, 2))
    degrees = np.degrees(np.arctan2(*(np.array([6e3, 9e3]) - place).T)) + rng.normal(0, 3, 40)
    rows = [f"{i},{x},{y},{b % 360},3" for i, ((x, y), b) in enumerate(zip(place, degrees, strict=True))]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bearings.csv"
        file.write_text("\n".join(["time_s,x_m,y_m,bearing_deg,sigma_deg", *rows]) + "\n")
        model = declare_bearings(read_bearings(file))
    fixes = report_of("bearings", model, BearingsSettings()).fixes
    positions = np.array([fix.position for fix in fixes.values()])
    return {"position": positions, "covariance": np.array([fix.covariance for fix in fixes.values()])}


FAST = {
    "locards unseen": ("locards_mlat_unseen", _locards),
    "doptrack of six passes": ("doptrack_delfic3", lambda folder: _doptrack(folder, slice(4, 10))),
    "kiwisdr": ("kiwisdr_dcf77", _kiwisdr),
    "bearings": (None, lambda folder: _bearings()),
}
"""By title: the folder of the recording, and what gives its numbers."""

SLOW = {
    "locards": ("locards_mlat", _locards),
    "locards with faults": ("locards_mlat", lambda folder: _locards(folder, fault_m=3000.0)),
    "doptrack": ("doptrack_delfic3", _doptrack),
    "kiwisdr 2017": ("kiwisdr_dcf77_2017", _kiwisdr),
}
"""Likewise; half a minute each."""


def recorded_case(title, data):
    """Return the arrays of a case by name, from the data folder."""
    folder, numbers = (FAST | SLOW)[title]
    return numbers(None if folder is None else Path(data) / folder)


def _kept(values):
    flat = np.ravel(values).astype(float)
    return [None if np.isnan(v) else float(v) for v in flat[:: max(1, flat.size // _KEPT)]]


def read():
    """Return the record: ``machine`` and ``cases``."""
    return json.loads(FILE.read_text())


if __name__ == "__main__":
    cases = read()["cases"] if FILE.exists() else {}
    for title in sys.argv[2:] or [*FAST, *SLOW]:
        arrays = recorded_case(title, sys.argv[1])
        now = {name: _array(values) | {"elements": _kept(values)} for name, values in arrays.items()}
        print(title, "as it was" if cases.get(title) == now else "new" if title not in cases else "changed", flush=True)
        cases[title] = now
        FILE.write_text(json.dumps({"machine": machine(), "cases": cases}, indent=0, separators=(",", ":")) + "\n")
