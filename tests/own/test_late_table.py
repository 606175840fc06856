"""A table whose lines are in the order in which they came: late rows go back to when they were made, or are counted."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError

YAML = """
frame: local
duration_s: 30
platforms:
  a: !Fixed {east_km: -5, north_km: -5}
  b: !Fixed {east_km: 5, north_km: -4}
  c: !Fixed {east_km: 0, north_km: 6}
target: !Straight {position_km: [1, 0, 1], velocity_mps: [50, 20, 0]}
sensors:
  range: !Range {stations: [a, b, c], sigma_m: 10}
belief:
  motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0}
start: !Given
  at: !Straight {position_km: [1.1, 0.1, 1], velocity_mps: [50, 20, 0]}
  sigma_position_m: 200
  sigma_velocity_mps: 10
estimators:
  ekf: !Ekf {}
  gated: !Ekf {gate: {probability: 0.999}}
measurements: {file: rows.csv}
"""
PLACES = {"a": (-5e3, -5e3, 0.0), "b": (5e3, -4e3, 0.0), "c": (0.0, 6e3, 0.0)}


def rows(target="", sigma=None):
    """Return lines by (time, station): range, kind, and sigma where it is wanted."""
    rng = np.random.default_rng(1)
    found = {}
    for t in range(31):
        place = np.array([1e3 + 50 * t, 20.0 * t, 1e3])
        for station, own in PLACES.items():
            value = np.linalg.norm(place - own) + 10 * rng.normal()
            more = "" if sigma is None else f",{sigma * (1 + t % 3):g}"
            found[t, station] = f"{t},{target},range,{station},{value:.6f},m{more}"
    return found


def study(folder, lines, sets=(), scaled=False):
    (folder / "own.yaml").write_text(YAML)
    head = "time_s,target,kind,receiver,value,unit" + (",sigma" if scaled else "")
    (folder / "rows.csv").write_text("\n".join([head, *lines]) + "\n")
    return run_study((folder / "own.yaml").as_posix(), set=list(sets))


def delayed(found, station="c", by=4):
    """Return lines in the order in which they come if one station is late; what comes after the end comes last."""
    order = sorted(found, key=lambda key: (key[0] + (by + 0.5 if key[1] == station else 0.0), key[0]))
    return [found[key] for key in order]


@pytest.mark.parametrize("sigma", [None, 8.0])
def test_late_rows_go_back(tmp_path, sigma):
    """In between they are not there; when all has come it is, to the bit, as if they had been in time."""
    found = rows(sigma=sigma)
    in_time = study(tmp_path, list(found.values()), scaled=sigma is not None)
    late = study(tmp_path, delayed(found), ["belief.late.buffer_s=5"], scaled=sigma is not None)
    np.testing.assert_array_equal(late["time"], in_time["time"])
    a, b = (one["estimate"].values for one in (in_time, late))
    np.testing.assert_array_equal(a[:, :, -1], b[:, :, -1])
    assert np.abs(a - b)[:, :, 2:26].max() > 1.0
    assert not late["dropped_rows"].any() and "left out" not in late.attrs["note"]
    without = [line for (_, station), line in found.items() if station != "c"]
    other = study(tmp_path, without, scaled=sigma is not None)["estimate"].values
    np.testing.assert_array_equal(other[:, :, 3], b[:, :, 3])  # nothing of the late station has come by 3 s
    assert (late["bound_position"].values[:, 3:20] > in_time["bound_position"].values[:, 3:20]).all()


def test_later_than_the_buffer(tmp_path):
    found = rows()
    short = study(tmp_path, delayed(found), ["belief.late.buffer_s=2"])
    assert "rows came later than belief.late.buffer_s (2 s), and are left out" in short.attrs["note"]
    without = [line for (_, station), line in found.items() if station != "c"]
    other = study(tmp_path, without)["estimate"].values
    # the last rows of the late station come with the newest one there is: not late by more than that
    np.testing.assert_array_equal(other[:, :, :26], short["estimate"].values[:, :, :26])


def test_as_they_come_is_the_wrong_belief(tmp_path):
    """Three ranges fix a place whatever they are: that one is 12 s old shows in the error, and not in the NIS."""
    found = rows()
    naive = study(tmp_path, delayed(found, by=12), ["belief.late.times=arrival"])
    right = study(tmp_path, list(found.values()))
    off = [np.abs((one["estimate"] - one["truth"]).values[0, 0, 18:28, :2]).mean() for one in (naive, right)]
    assert off[0] > 3 * off[1]


def test_tracks_have_latenesses_of_their_own(tmp_path):
    """Two targets in one table, one of them with a late station: the other one is as it is alone."""
    first, second = rows("one"), rows("two")
    lines = [*first.values(), *delayed(second)]
    both = study(tmp_path, lines, ["belief.late.buffer_s=5"])
    plain = study(tmp_path, [*first.values(), *second.values()])
    np.testing.assert_array_equal(both["estimate"].values[:, 0], plain["estimate"].values[:, 0])
    np.testing.assert_array_equal(both["estimate"].values[:, 1, -1], plain["estimate"].values[:, 1, -1])
    assert (both["estimate"].values[:, 1, 10] != plain["estimate"].values[:, 1, 10]).any()


def test_unasked_rows_are_put_in_order(tmp_path):
    found = rows()
    late, plain = study(tmp_path, delayed(found)), study(tmp_path, list(found.values()))
    np.testing.assert_array_equal(late["estimate"], plain["estimate"])


@pytest.mark.parametrize("value", ["-1", ".nan", "much"])
def test_refused(tmp_path, value):
    with pytest.raises(UserError, match=r"belief\.late\.buffer_s"):
        study(tmp_path, list(rows().values()), [f"belief.late.buffer_s={value}"])
