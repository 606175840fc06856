"""Readers of recorded data: what is no file, too large, or holds numbers beyond reason is one line."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams.readers.bearings_file import read_bearings
from quietfix.diagrams.readers.ccsds.oem import read_oem
from quietfix.diagrams.readers.ccsds.tdm import read_tdm
from quietfix.diagrams.readers.doptrack_data import read_passes
from quietfix.diagrams.readers.falcon9 import falcon9_flight
from quietfix.diagrams.readers.gpx import read_gpx
from quietfix.diagrams.readers.iq.sigmf_file import read_sigmf
from quietfix.diagrams.readers.locards_data import read_sets
from quietfix.diagrams.readers.platforms import read_platforms
from quietfix.diagrams.recorded.kiwisdr import read_folder
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.plants.sp3 import read_sp3

BEARINGS = "time_s,x_m,y_m,bearing_deg,sigma_deg\n0,0,0,45,1\n{},{},0,135,1\n"


def sigmf(folder: Path, samples: int = 4, **about) -> Path:
    """Write a recording whose metadata are `about`, and return its path."""
    meta = {
        "global": {"core:datatype": "cf32_le", "core:sample_rate": 1e3, "core:version": "1.2.0"},
        "captures": [{"core:sample_start": 0}],
        "annotations": [],
    }
    meta["global"].update(about.pop("general", {}))
    np.zeros(samples, np.complex64).tofile(folder / "a.sigmf-data")
    (folder / "a.sigmf-meta").write_text(json.dumps({**meta, **about}))
    return folder / "a.sigmf-meta"


@pytest.mark.parametrize("kind", ["fifo", "zero"])
def test_what_is_no_regular_file_is_not_read(tmp_path, kind):
    if kind == "fifo":
        os.mkfifo(tmp_path / "a.sigmf-meta")
    else:
        (tmp_path / "a.sigmf-meta").symlink_to("/dev/zero")
    for read in (read_bearings, read_sp3, read_sigmf, read_tdm, read_oem, read_gpx, read_platforms):
        with pytest.raises(ValueError, match="it is not a regular file"):
            read(tmp_path / "a.sigmf-meta")
    for read, names in (
        (read_sets, ["sensors.csv"]),
        (read_passes, ["Delfi-C3_1.yml"]),
        (read_folder, ["stations.csv"]),
        (lambda folder: falcon9_flight(folder, "a", 10.0, 1.0, 1.0, 6e6), ["a__stage2_raw.json"]),
    ):
        for name in names:
            shutil.move(tmp_path / "a.sigmf-meta", tmp_path / name)
            with pytest.raises(UserError, match=rf"{name}.*it is not a regular file"):
                read(tmp_path)
            shutil.move(tmp_path / name, tmp_path / "a.sigmf-meta")


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        (("1", "1e300"), "line 3: x_m '1e300' is not allowed; a number, at most 1e"),
        (("1e300", "100"), "line 3: time_s '1e300' is not allowed"),
        (("1", "1" * 131_073), r"line 3: it cannot be read \(field larger than field limit"),
    ],
)
def test_bearings(tmp_path, cells, said):
    (tmp_path / "b.csv").write_text(BEARINGS.format(*cells))
    with pytest.raises(UserError, match=said):
        read_bearings(tmp_path / "b.csv")
    (tmp_path / "b.csv").write_text(BEARINGS.format("1", "100"))
    assert read_bearings(tmp_path / "b.csv").time.size == 2


@pytest.mark.parametrize(
    ("about", "said"),
    [
        ({"general": {"core:num_channels": 0}}, "core:num_channels: 0 is not allowed; 1"),
        ({"captures": [None]}, r"captures: \[null\] is not allowed; a list of objects"),
        ({"captures": None}, "captures: null is not allowed; a list of objects"),
        ({"global": None}, "global is not allowed as it is"),
        ({"general": {"core:sample_rate": 10**400}}, "core:sample_rate"),
        ({"general": {"core:sample_rate": 1e-300}}, "core:sample_rate 1e-300 is not allowed; a number >= 0.001"),
        ({"captures": [{"core:sample_start": 0, "core:frequency": 1e300}]}, "core:frequency: 1e.300 is not allowed"),
        ({"captures": [{"core:sample_start": 10**400}]}, "cut off|cannot be read"),
    ],
)
def test_sigmf(tmp_path, about, said):
    with pytest.raises(UserError, match=said) as caught:
        read_sigmf(sigmf(tmp_path, **about))
    assert "\n" not in str(caught.value)
    assert read_sigmf(sigmf(tmp_path))[0].sample_rate == 1e3


def test_locards(tmp_path):
    (tmp_path / "sensors.csv").write_text("serial,latitude,longitude,height\n1,1,1,0\n2,2,2,0\n")
    head = "aircraft,latitude,longitude,baroAltitude,geoAltitude,measurements\n"
    for cell, said in (
        ("[[1,1" + "0" * 400 + ",1],[2,5,1]]", "is not allowed; .receiver, arrival in ns"),
        ("[" * 100_000, "is not a list"),
        ("[[1,1" + "0" * 5000 + ",1],[2,5,1]]", "is not a list .*integer string"),
    ):
        (tmp_path / "set_1.csv").write_text(f'{head}1,1,1,,,"{cell}"\n')
        with pytest.raises(UserError, match=said):
            read_sets(tmp_path)
