"""`quietfix plot` draws the same figures again; `quietfix export` writes the same numbers."""

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import xarray as xr

from quietfix.diagrams.commands.results import exporting
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.results import open_result
from tests.results.made import dataset, quietfix, refused, told, write


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A run of two chunks, a comparison and a sweep, as the commands write them."""
    root = tmp_path_factory.mktemp("real")
    short = ["three_satellite", "--estimator", "iekf", "--set", "duration_s=4", "--trials", "4"]
    assert quietfix("run", *short, "--chunk", "2", "--out", root / "run") == 0
    assert quietfix("compare", *short, "--estimator", "ekf", "--out", root / "compare") == 0
    assert quietfix("sweep", *short, "--vary", "truth.sigma_tdoa_ns=log:10:40:2", "--out", root / "sweep") == 0
    return root


def drawn(folder):
    """Figures and the block diagram of a folder, by name."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".png", ".svg")}


@pytest.mark.parametrize("name", ["run", "compare", "sweep"])
def test_figures_are_the_same_again_to_the_last_byte(real, name, capsys):
    found = told(capsys, "plot", real / name, "--out", real / f"{name}-again")
    pictures = drawn(real / name)
    assert pictures and found["left_out"] == {}
    assert drawn(real / f"{name}-again") == pictures
    assert ("diagram.svg" in found["figures"]) == (real / name / "diagram.svg").exists()
    assert "holds an earlier result" in refused(capsys, "plot", real / name, "--out", real / f"{name}-again")


@pytest.mark.parametrize("name", ["run", "compare"])
def test_every_command_reads_every_kind_of_result(real, name, capsys):
    assert told(capsys, "inspect", real / name)["command"] == name
    row = told(capsys, "diff", real / name, real / "run")["estimators"]["iekf"]
    assert row["identical"] and row["ratio"] == {"value": 1.0, "low": 1.0, "high": 1.0} and row["b_closer"] is None


def test_a_sweep_is_inspected_and_told_apart_point_by_point(real, tmp_path, capsys):
    path = real / "sweep"
    stored = open_result(path).load()
    points = told(capsys, "inspect", path, "--worst", "1")["estimators"]["iekf"]["points"]
    assert [point["value"] for point in points] == [10.0, 40.0]
    for k, point in enumerate(points):
        assert point["trials"][0]["position_error_m"] == stored["position_error"].values[k, 0].max()
    rows = told(capsys, "diff", path, path)["estimators"]["iekf"]
    assert [row["identical"] for row in rows] == [True, True]
    assert "one is a sweep" in refused(capsys, "diff", path, real / "run")
    told(capsys, "export", path, tmp_path / "s.csv")
    table = pyarrow.csv.read_csv(tmp_path / "s.csv")
    np.testing.assert_array_equal(table["position_error"], stored["position_error"].values.ravel())


@pytest.fixture
def result(tmp_path):
    """A result with a lost trial and one that is not known."""
    made = dataset()
    estimate = made["estimate"].values.copy()
    estimate[0, 1, 3] = np.nan
    made = made.assign(estimate=(made["estimate"].dims, estimate))
    made = made.assign(bound_position=(("estimator", "time"), np.full((2, 21), 7.0)))
    return tmp_path, write(tmp_path / "r", made)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_table_has_every_number(result, kind, capsys, monkeypatch):
    root, made = result
    monkeypatch.setattr(exporting, "_ROWS", 50)  # several tables of a chunk
    found = told(capsys, "export", root / "r", root / f"t.{kind}")
    table = (pyarrow.csv.read_csv if kind == "csv" else pyarrow.parquet.read_table)(root / f"t.{kind}")
    assert table.num_rows == found["rows"] == 2 * 8 * 21 and table.column_names == found["columns"]
    rows = table.to_pandas().set_index(["estimator", "trial", "time_s"]).sort_index()
    one = rows.loc[("ukf", 6)]
    there = made.sel(estimator="ukf", trial=6)
    np.testing.assert_array_equal(one.index, made["time"])
    np.testing.assert_array_equal(one["estimate_vy"], there["estimate"].sel(state="vy"))
    np.testing.assert_array_equal(one["truth_x"], made["truth"].sel(state="x"))
    np.testing.assert_array_equal(one["platforms_two_z"], made["platforms"].sel(platform="two", coordinate="z"))
    np.testing.assert_array_equal(one["bound_position"], 7.0)
    # a block of trials rounds the sum of three squares otherwise than the whole
    expected = errors(made)["position"].sel(estimator="ukf", trial=6)
    np.testing.assert_allclose(one["position_error_m"], expected, rtol=1e-9)
    lost = rows.loc[("iekf", 1, made["time"].values[3])]
    assert np.isnan(lost["estimate_x"]) and np.isinf(lost["position_error_m"])


def test_netcdf_is_read_back_as_it_was(result, capsys):
    root, made = result
    told(capsys, "export", root / "r", root / "t.nc")
    with xr.open_dataset(root / "t.nc", engine="scipy") as read:
        for name in made.variables:
            np.testing.assert_array_equal(read[name].values.astype(made[name].dtype), made[name].values, str(name))
        assert read.attrs["system"] == "three_satellite" and read.attrs["scenario"] == "a: 1\n"


def test_a_file_that_is_there_stays(result, capsys):
    root, _ = result
    (root / "t.csv").write_text("mine")
    assert "t.csv exists" in refused(capsys, "export", root / "r", root / "t.csv")
    assert (root / "t.csv").read_text() == "mine"
    assert "a name that ends in .nc, .csv, .parquet" in refused(capsys, "export", root / "r", root / "t.xlsx")
    assert "cannot be written" in refused(capsys, "export", root / "r", root / "none" / "t.csv")
    assert {path.name for path in root.iterdir()} == {"r", "t.csv"}
    assert quietfix("export", root / "r", root / "t.csv", "--overwrite") == 0
    assert (root / "t.csv").read_text().startswith('"estimator"')
