"""The fingerprint of a study: a hash of every array, what stands beside them, and which blocks the diagram has."""

import hashlib
import json
import platform
from pathlib import Path

import numpy as np
import xarray as xr

from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from tests.golden.cases import CASES

__all__ = ["FILE", "fingerprint", "machine", "read", "write"]

FILE = Path(__file__).with_name("golden.json")
TRIALS, SEED = 4, 11

_ATTRIBUTES = ("system", "variant", "seed", "first_trial", "trials", "keep", "every", "frame", "note", "divergence_m")
_ATTRIBUTES += ("convergence_m",)
_FOLLOWS = "lost"  # from NIS and rows, which are recorded


def machine() -> str:
    """Return what the last bits hang on: the processor, NumPy and Python's own mathematics."""
    model = "unknown"
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = dict.fromkeys(
            line for line in cpuinfo.read_text().splitlines() if line.startswith(("model", "cpu fam"))
        )
        model = "; ".join(" ".join(line.split()) for line in lines)
    return f"{model}; Python {platform.python_version()}, NumPy {np.__version__}"


def _array(values: np.ndarray) -> dict:
    """Return hash, shape and two weighted sums of an array; the sums are for a machine that rounds otherwise."""
    values = np.ascontiguousarray(values)
    digest = hashlib.sha256(values.tobytes()).hexdigest()[:16]
    flat = values.astype(float).ravel()
    known = np.isfinite(flat)
    weights = np.cos(np.arange(flat.size))  # no two elements alike, so that an exchange is seen
    sizes = np.abs(np.where(known, flat, 0.0))
    return {
        "hash": digest,
        "shape": list(values.shape),
        "missing": int(np.count_nonzero(~known)),
        "sums": [float(sizes.sum()), float(sizes @ np.where(flat < 0, -weights, weights))],
    }


def fingerprint(title: str) -> dict:
    """Run a case of `CASES` and return its fingerprint."""
    case = CASES[title]
    study = Study(
        case.system, set=case.settings, estimators=case.estimators, trials=TRIALS, seed=SEED, keep="all", chunk=TRIALS
    )
    result = join(list(study.chunks()))
    arrays = {str(name): result[name] for name in sorted(result.data_vars, key=str) if name != _FOLLOWS}
    arrays["innovation"] = _to_the_left(result)
    names = {key: [str(v) for v in result[key].values] for key in ("estimator", "state", "state_units", "row")}
    return {
        "arrays": {
            name: {"dims": list(map(str, values.dims))} | _array(values.values) for name, values in arrays.items()
        },
        "time_s": [float(t) for t in result["time"].values],
        "names": names,
        "attributes": _attributes(result),
        "blocks": sorted(block.get_name() for block in study.diagram(TRIALS)[0].GetSystems()),
    }


def _to_the_left(result: xr.Dataset) -> xr.DataArray:
    """Return the innovations with each estimator's own rows first, as they were recorded before rows had names."""
    has = result["in_innovation"].values
    packed = np.full((*result["innovation"].shape[:-1], has.sum(axis=-1).max()), np.nan)
    for i, own in enumerate(has):
        packed[i][..., : own.sum()] = result["innovation"].values[i][..., own]
    return xr.DataArray(packed, dims=result["innovation"].dims)


def _attributes(result: xr.Dataset) -> dict:
    """Return the attributes that say what was run; who looks ahead as the text that it was when it was recorded."""
    found = {key: _plain(result.attrs[key]) for key in _ATTRIBUTES if key in result.attrs}
    ahead = [str(name) for name in result["estimator"].values[~result["causal"].values]]
    return found | ({"looks_ahead": ",".join(ahead)} if ahead else {})


def _plain(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else value


def read() -> dict:
    """Return the record: ``machine`` and, under ``cases``, a fingerprint by title."""
    return json.loads(FILE.read_text())


def write(cases: dict) -> None:
    """Write the record."""
    FILE.write_text(json.dumps({"machine": machine(), "cases": cases}, indent=0, separators=(",", ":")) + "\n")
