"""Results in an object store: written chunk by chunk, resumed elsewhere, read again; the same bytes as on disk."""

import importlib.util
from pathlib import Path

import fsspec
import numpy as np
import pytest

from quietfix.diagrams.chunks.ledger import CHUNKS
from quietfix.diagrams.cloud.place import Place, is_url
from quietfix.diagrams.studies.marker import MARKER
from quietfix.diagrams.studies.results import open_result
from tests.faults.tree import ShortStudy, shorten
from tests.results.made import dataset, quietfix, refused, told, write

URL = "memory://bucket/d"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty store, an empty folder to work in, and studies of two chunks that are short."""
    monkeypatch.chdir(tmp_path)
    shorten(monkeypatch)
    fsspec.filesystem("memory").store.clear()
    return Place(URL, "--out")


def content(place):
    """What lies there, by name; the marker lists it, and the summary has the time it took."""
    files = fsspec.filesystem("memory")
    return {name: files.cat_file(f"/bucket/d/{name}") for name in place.names() if name not in (MARKER, "summary.json")}


def on_disk(folder):
    names = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    return {name: (folder / name).read_bytes() for name in names if name not in (MARKER, "summary.json")}


def test_a_run_into_a_store_has_the_bytes_of_one_on_disk(place, tmp_path, capsys):
    assert quietfix("run", "three_satellite", "--out", URL) == 0
    assert f"wrote {URL}: results.zarr" in capsys.readouterr().out
    assert quietfix("run", "three_satellite", "--out", "local") == 0
    assert content(place) == on_disk(tmp_path / "local") and place.finished
    assert {path.name for path in tmp_path.iterdir()} == {"local"}
    assert "holds an earlier result" in refused(capsys, "run", "three_satellite", "--out", URL)
    assert "nothing there is replaced" in refused(capsys, "run", "three_satellite", "--out", URL, "--overwrite")


def test_an_interrupted_run_goes_on_from_what_is_in_the_store(place, tmp_path, capsys, monkeypatch):
    ran, parts = [], ShortStudy.parts

    def interrupted(self, *arguments):
        yield next(parts(self, *arguments))
        raise KeyboardInterrupt

    def counted(self, *arguments):
        for part in parts(self, *arguments):
            ran.append(part.number)
            yield part

    monkeypatch.setattr(ShortStudy, "parts", interrupted)
    assert quietfix("run", "three_satellite", "--out", URL) == 130
    assert f"2 of 4 trials are kept in {URL}; `quietfix run --resume {URL}` goes on" in capsys.readouterr().err
    assert f"{CHUNKS}/0.npz" in place.names() and MARKER not in place.names() and not place.finished
    assert "holds an interrupted run" in refused(capsys, "run", "three_satellite", "--out", URL)
    monkeypatch.setattr(ShortStudy, "parts", counted)
    assert quietfix("run", "three_satellite", "--resume", URL) == 0
    assert ran == [1]
    monkeypatch.setattr(ShortStudy, "parts", parts)
    assert quietfix("run", "three_satellite", "--out", "local") == 0
    assert content(place) == on_disk(tmp_path / "local") and place.finished


def test_a_chunk_that_was_lost_in_the_store_is_run_again(place, tmp_path, capsys, monkeypatch):
    """The record of a chunk says what its files are; one that is short is not it."""
    parts = ShortStudy.parts

    def interrupted(self, *arguments):
        yield next(parts(self, *arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(ShortStudy, "parts", interrupted)
    assert quietfix("run", "three_satellite", "--out", URL) == 130
    fsspec.filesystem("memory").pipe_file("/bucket/d/results.zarr/estimate/c/0/0", b"short")
    monkeypatch.setattr(ShortStudy, "parts", parts)
    assert quietfix("run", "three_satellite", "--resume", URL) == 0
    assert quietfix("run", "three_satellite", "--out", "local") == 0
    assert content(place) == on_disk(tmp_path / "local")


def test_results_are_read_from_a_store(place, tmp_path, capsys):
    write(tmp_path / "r", dataset())
    place.put(
        tmp_path / "r",
        [path.relative_to(tmp_path / "r").as_posix() for path in (tmp_path / "r").rglob("*") if path.is_file()],
    )
    here, there = told(capsys, "inspect", "r"), told(capsys, "inspect", URL)
    assert there["result"] == URL and here["estimators"] == there["estimators"]
    assert told(capsys, "diff", "r", URL)["estimators"]["iekf"]["identical"]
    assert told(capsys, "export", URL, "t.csv")["rows"] == 2 * 8 * 21


@pytest.mark.usefixtures("place")
def test_what_cannot_be_reached_is_one_line(tmp_path, capsys):
    assert "there is nothing" in refused(capsys, "inspect", "memory://bucket/none")
    assert "there is nothing" in refused(capsys, "run", "--resume", "memory://bucket/none")
    assert "nowhere://a/b is not allowed" in refused(capsys, "run", "three_satellite", "--out", "nowhere://a/b")
    fsspec.filesystem("memory").pipe_file("/bucket/d/mine.txt", b"mine")
    assert "holds other files (mine.txt)" in refused(capsys, "run", "three_satellite", "--out", URL)
    if importlib.util.find_spec("s3fs") is None:
        line = refused(capsys, "run", "three_satellite", "--out", "s3://bucket/d")
        assert "`pip install quietfix[cloud]`" in line
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_no_url(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s3:").mkdir()
    assert is_url(Path("memory://a/b")) and is_url(Path("gs:/a")) and not is_url(Path("s3:/a"))
    assert not is_url(Path("/a/b")) and not is_url(Path("a:b")) and not is_url(None)


@pytest.fixture
def s3(monkeypatch):
    """A server of S3 on loopback with a bucket."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ACCESS_KEY_ID": "testing",
        "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_EC2_METADATA_DISABLED": "true",
    }.items():
        monkeypatch.setenv(name, value)
    fsspec.filesystem("s3").mkdir("bucket")
    yield "s3://bucket/d"
    server.stop()


def test_s3(s3, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shorten(monkeypatch)
    parts = ShortStudy.parts

    def interrupted(self, *arguments):
        yield next(parts(self, *arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(ShortStudy, "parts", interrupted)
    assert quietfix("run", "three_satellite", "--out", s3) == 130
    monkeypatch.setattr(ShortStudy, "parts", parts)
    assert quietfix("run", "three_satellite", "--resume", s3) == 0
    assert quietfix("run", "three_satellite", "--out", "local") == 0
    place = Place(s3, "--out")
    place.get(tmp_path / "got", place.names())
    assert on_disk(tmp_path / "got") == on_disk(tmp_path / "local") and place.finished
    np.testing.assert_array_equal(open_result(tmp_path / "got")["trial"], np.arange(4))
    assert "cannot be reached" in refused(capsys, "run", "three_satellite", "--out", "s3://no-such-bucket/d")
