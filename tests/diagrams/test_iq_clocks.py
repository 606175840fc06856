"""Sample clocks that drift, and channels that were sampled together, in I/Q recordings of a known place."""

import csv
import json
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from quietfix.diagrams.commands.replay import replay
from quietfix.diagrams.readers.iq.any_file import read_iq
from quietfix.diagrams.recorded.iq_compared import with_rates
from tests.diagrams.iq_site import CARRIER, HEIGHT, RECEIVERS, Clock, heard, record, times_of
from tests.diagrams.test_iq_position import estimate

SETTINGS = ["integration_s=0.05", *HEIGHT]
run = partial(replay, "iq", progress=False)
DRIFT = {"bravo": Clock(ppm=1.0), "delta": Clock(rate=202e3, ppm=-0.4, begin=0.01)}


def test_a_drift_is_said_and_only_that(tmp_path):
    report = run(file=record(tmp_path, 1, seconds=0.6, clocks=DRIFT), settings=SETTINGS)
    lines = [line for line in report.gaps if "clock" in line]
    assert len(lines) == 2
    for line, name, ppm, word in zip(lines, ("bravo", "delta"), (1.0, 0.4), ("faster", "slower"), strict=True):
        assert line.startswith(f"{name}: its sample clock runs ") and word in line
        rate, sigma = (float(line.split()[i]) for i in (5, 7))
        assert abs(rate - ppm) < 4 * sigma and sigma < 0.1
    assert not [line for line in run(file=record(tmp_path, 1), settings=SETTINGS).gaps if "clock" in line]


def test_where_nobody_knows_what_moves_fdoa_tells(tmp_path):
    """Without places the same drift is what FDOA does not explain."""
    paths = record(tmp_path, 2, seconds=0.6, clocks=DRIFT, located=False)
    lines = [line for line in run(file=paths, settings=["integration_s=0.05"]).gaps if "clock" in line]
    assert len(lines) == 2 and all("FDOA does not explain it" in line for line in lines)


@pytest.mark.slow
def test_corrected_the_covariance_is_honest(tmp_path):
    """20 seeds, 1 ppm: mean normalised squared error in its 99.8 % band, none beyond the 99.99 % ellipse."""
    squared = []
    for seed in range(20):
        paths = record(tmp_path, 300 + seed, seconds=0.6, clocks=DRIFT)
        error, covariance = estimate(run(file=paths, settings=[*SETTINGS, "clocks=corrected"]))
        squared.append(error @ np.linalg.solve(covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 2 * len(squared)) / len(squared)
    print(np.mean(squared), np.max(squared))
    assert low < np.mean(squared) < high
    assert max(squared) < chi2.ppf(0.9999, 2)


def test_what_is_counted_runs_with_the_clock(tmp_path):
    """A second part that is counted in samples begins earlier by a clock that was fast; one with a date does not."""
    gap = {"alpha": Clock(gap=(0.1, 0.2))}
    (one,) = read_iq(record(tmp_path, 3, clocks=gap)[0])
    (fast,) = with_rates([one], ["a"], {"a": 1e-3})
    assert_allclose(fast.sample_rate, 1.001 * one.sample_rate)
    assert_allclose(fast.segments[1].begin, 0.2 / 1.001)
    meta = json.loads((tmp_path / "alpha.sigmf-meta").read_text())
    del meta["captures"][1]["core:global_index"]
    meta["captures"][1]["core:datetime"] = "2026-03-01T12:00:00.200000000Z"
    (tmp_path / "alpha.sigmf-meta").write_text(json.dumps(meta))
    (fast,) = with_rates(read_iq(tmp_path / "alpha.sigmf-meta"), ["a"], {"a": 1e-3})
    assert_allclose(fast.segments[1].begin, 0.2)


PHASES = (0.0, 0.8, -2.0)


def array(folder, name, seed, kind="<c8", datatype="cf32_le"):
    """Write a recording of three channels that hear the emitter with these phases."""
    rng = np.random.default_rng([seed, len(name)])
    rate = 400e3 if datatype.startswith("r") else 200e3  # real samples hold 0 to 200 kHz
    times, _ = times_of(Clock(rate=rate), 0.3)
    all_ = [heard(RECEIVERS[name], times, seed, 10.0, rng) * np.exp(1j * phase) for phase in PHASES]
    if datatype.startswith("r"):
        all_ = [2 * (one * np.exp(0.5j * np.pi * np.arange(times.size))).real for one in all_]
    np.stack(all_, axis=-1).astype(kind).tofile(folder / f"{name}.sigmf-data")
    about = {"core:datatype": datatype, "core:sample_rate": rate, "core:num_channels": 3}
    capture = {"core:sample_start": 0, "core:frequency": CARRIER, "core:datetime": "2026-03-01T12:00:00.000000000Z"}
    path = folder / f"{name}.sigmf-meta"
    path.write_text(json.dumps({"global": about, "captures": [capture], "annotations": []}))
    return path


@pytest.mark.parametrize(("kind", "datatype"), [("<c8", "cf32_le"), (">f4", "rf32_be")])
def test_channels_give_phases(tmp_path, kind, datatype):
    """Phases within five sigmas, in the table, beside time differences of the first channels."""
    paths = [array(tmp_path, name, 7, kind, datatype) for name in ("alpha", "bravo")]
    report = run(file=paths, settings=["integration_s=0.05"], out=tmp_path / "out")
    assert [(one.receiver, one.reference) for one in report.phases] == [
        (f"{name}_ch{i}", f"{name}_ch1") for name in ("alpha", "bravo") for i in (2, 3)
    ]
    for one, phase in zip(report.phases, PHASES[1:] * 2, strict=True):
        error = np.angle(np.exp(1j * (one.value - phase)))
        assert (np.abs(error) < 5 * one.sigma).all() and one.sigma.max() < 0.02
    rows = list(csv.DictReader((tmp_path / "out" / "measurements.csv").open()))
    phases = [row for row in rows if row["kind"] == "phase"]
    assert len(phases) == 4 * report.times.size and phases[0]["unit"] == "rad"
    assert any(line.startswith("alpha_ch2: phase against alpha_ch1 45.") for line in report.notes())
    assert report.pairs[0].good.all()
