"""Tables of platforms: what stands, what moves, and what is refused."""

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.paths.functions import path_of
from quietfix.diagrams.paths.movers import Geodetic, Platform, Track
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.paths.tables import doubtful_table
from quietfix.diagrams.quantities.frame import EARTH_FIXED, INERTIAL, LOCAL
from quietfix.diagrams.readers.platforms import read_platforms
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.recordings import with_platforms
from quietfix.systems.earth.time_scales import to_tai
from quietfix.systems.trajectories.gravity import GravityConstants
from tests.readers.spoiling import refused_or_read, said

STANDING = "name,latitude_deg,longitude_deg,height_m\nnorth,48.5,11,500\n17,-48.25,-170.5,0\n"
MIXED = """# a ship and two masts
Name; time; x_m; y_m; z_m; vx_mps; vy_mps; vz_mps
mast; ; 0; 0; 30; nan; nan; nan
ship; 2016-12-31T23:59:59.5Z; 0; 5; 0; 10; 0; 0
ship; 2017-01-01T00:59:60.5+01:00; 10; 5; 0; 10; 0; 0
ship; 2017-01-01T00:00:01.5Z; 30; 5; 0; 10; 0; 0
ship; 2017-01-01T00:00:00.5Z; 20; 5; 0; 10; 0; 0
ship; 2017-01-01T00:00:00.5Z; 20; 5; 0; 10; 0; 0
"""


def path(mover, folder, frame=EARTH_FIXED, duration=2.0, start=None):
    return path_of(mover, frame, Setting(duration, start, folder), GravityConstants(), "platforms.a")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "s.csv").write_text(STANDING)
    (tmp_path / "m.csv").write_text(MIXED.replace("nan", "0"))
    return tmp_path


def test_standing(folder):
    table = read_platforms(folder / "s.csv")
    assert list(table.platforms) == ["north", "17"] and table.notes == ()
    np.testing.assert_array_equal(table.platforms["17"].places, [[-48.25, -170.5, 0.0]])
    assert table.platforms["17"].line == 3 and table.platforms["17"].rest is None
    for frame in (EARTH_FIXED, INERTIAL):
        one, other = path(Platform("s.csv", "north"), folder, frame), path(Geodetic(48.5, 11, 500), folder, frame)
        np.testing.assert_array_equal(one(1.5), other(1.5))


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
def test_what_is_borne(folder, delimiter):
    plain = read_platforms(folder / "s.csv").platforms
    text = "\ufeff# mine\r\n" + STANDING.replace(",", delimiter).replace("\n", "\r\n").replace("name", " NAME ")
    (folder / "o.csv").write_bytes(text.encode())
    other = read_platforms(folder / "o.csv").platforms
    assert list(other) == list(plain)
    for name, one in plain.items():
        np.testing.assert_array_equal(other[name].places, one.places)


def test_moving(folder):
    table = read_platforms(folder / "m.csv").platforms
    ship = table["ship"]
    assert (ship.second[0], ship.rest[0]) == to_tai("2016-12-31T23:59:59.5")
    np.testing.assert_array_equal(
        np.diff(ship.second), 1
    )  # sorted, the row that is there twice is one, 60.5 is a second
    np.testing.assert_array_equal(ship.places[:, 0], [0, 10, 20, 30])
    at = path(Platform("m.csv", "ship"), folder, LOCAL, 2.5, "2016-12-31T23:59:59.5Z")
    np.testing.assert_allclose(at(1.75), [17.5, 5, 0, 10, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(path(Platform("m.csv", "mast"), folder, LOCAL)(1.0), [0, 0, 30, 0, 0, 0])
    (folder / "t.csv").write_text("name time_s latitude_deg longitude_deg height_m\na 0 10 20 0\na 1 10 20.001 0\na 2 10 20.002 0\n")  # noqa: E501  # fmt: skip
    (folder / "track.csv").write_text("time_s,latitude_deg,longitude_deg,height_m\n0,10,20,0\n1,10,20.001,0\n2,10,20.002,0\n")  # noqa: E501  # fmt: skip
    np.testing.assert_array_equal(path(Platform("t.csv"), folder)(0.7), path(Track("track.csv"), folder)(0.7))


GOOD = "name,time_s,latitude_deg,longitude_deg,height_m\na,,1,2,3\nb,0,4,5,6\nb,1,4,6,6\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "name,",
            "nam,",
            "p.csv:1: columns nam, time_s, latitude_deg, longitude_deg, height_m are not allowed",
        ),
        ("height_m", "height", "are not allowed; name, and latitude_deg, longitude_deg, height_m, or x_m"),
        ("time_s", "date", "p.csv: column date is not known; name, and latitude_deg"),
        ("time_s", "time", "p.csv:3: time: '0' is not allowed; a date with a time of day"),
        ("name,time_s", "name,time_s,time", "p.csv:2: 5 fields are not allowed; 6 as names; is the file cut?"),
        (
            "time_s,latitude_deg,longitude_deg,height_m",
            "vx_mps,x_m,y_m,z_m",
            "columns vx_mps are not allowed",
        ),
        ("a,,1", "a,,91", "p.csv:2: latitude_deg: '91' is not allowed; a number, at most 90 in size"),
        ("4,5,6", "4,361,6", "p.csv:3: longitude_deg: '361' is not allowed; a number, at most 360 in size"),
        ("4,5,6", "4,5,", "p.csv:3: height_m: '' is not allowed; a number"),
        ("4,5,6", "4,5,1_0", "p.csv:3: height_m: '1_0' is not allowed; a number"),
        ("4,5,6", "4,5,nan", "p.csv:3: height_m: 'nan' is not allowed; a number"),
        ("4,5,6", "4,5,1e11", "p.csv:3: height_m: '1e11' is not allowed; a number, at most 1e+10"),
        ("b,0", "b,noon", "p.csv:3: time_s: 'noon' is not allowed; a number"),
        ("b,0", "b,", "p.csv:3: 'b' without a time is not allowed in 2 rows; time or time_s"),
        ("b,0", ",0", "p.csv:3: name: nothing is not allowed; the name of a platform"),
        ("b,1", "b,0", "p.csv:4: 'b' is somewhere else at the same time in line 3; one of them"),
        ("a,,1,2,3\nb,0,4,5,6\nb,1,4,6,6\n", "", "p.csv: it has no rows; at least one platform"),
        (GOOD, "", "p.csv: it is empty"),
    ],
)
def test_each_field_wrong_once(tmp_path, old, new, message):
    assert old in GOOD
    assert message in said(read_platforms, tmp_path / "p.csv", GOOD.replace(old, new, 1))


def test_two_rows_without_a_column_of_times(tmp_path):
    text = STANDING + "north,48.6,11,500\n"
    assert "p.csv:4: 'north' without a time is not allowed in 2 rows" in said(read_platforms, tmp_path / "p.csv", text)


def test_files_that_are_cut(tmp_path):
    content = GOOD.encode()
    for end in range(len(content)):
        table = refused_or_read(read_platforms, tmp_path / "p.csv", content[:end])
        assert table is None or table.notes or content[end - 1 : end] == b"\n", (
            end
        )  # it is said, or whole rows are there
    assert "its last line has no end" in doubtful_table(Platform("p.csv"), Setting(1.0, None, tmp_path), "target")


@pytest.mark.parametrize(
    ("field", "frame", "said_"),
    [
        (
            Platform("s.csv", "nort"),
            EARTH_FIXED,
            "platforms.a.name: nort is not known (did you mean north?)",
        ),
        (Platform("s.csv"), EARTH_FIXED, "platforms.a.name:  is not known; there are north, 17"),
        (Platform("s.csv", "17"), LOCAL, "platforms.a.file: s.csv: latitude_deg is not allowed in frame local; x_m"),
        (
            Platform("m.csv", "mast"),
            INERTIAL,
            "platforms.a.file: m.csv: line 3: x, y, z of what stands are not",
        ),
        (Platform("none.csv", "a"), EARTH_FIXED, "platforms.a.file: "),
        (Platform("m.csv", "ship"), EARTH_FIXED, "platforms.a.file: m.csv: ship: a run from 0 to 4 s is not allowed"),
    ],
)
def test_what_cannot_be_used_is_refused(folder, field, frame, said_):
    with pytest.raises(UserError) as caught:
        path(field, folder, frame, 4.0)
    assert str(caught.value).startswith(said_) and "\n" not in str(caught.value)


SYSTEM = """frame: local
duration_s: 3
platforms:
  d: !Fixed {east_km: 0.5, north_km: 0.5}
target: !Straight {position_km: [0, 1, 0.2], velocity_mps: [10, 0, 0]}
sensors: {ranges: !Range {sigma_m: 1, every_s: 1}}
start: !Prior {sigma_position_m: 30, sigma_velocity_mps: 3}
estimators: {ekf: !Ekf {}}
"""


def test_platforms_by_the_command_line(tmp_path):
    (tmp_path / "m.yaml").write_text(SYSTEM)
    (tmp_path / "p.csv").write_text("name,time_s,x_m,y_m,z_m\na,,0,0,30\ny,,900,0,10\nship,0,0,5,0\nship,9,90,5,0\n")
    found = find(str(tmp_path / "m.yaml"))
    settings = with_platforms(found, ["duration_s=2"], tmp_path / "p.csv")
    scenario = found.system.load(settings=settings)
    assert list(scenario.platforms) == ["d", "a", "y", "ship"] and scenario.duration_s == 2
    result = run_study(str(tmp_path / "m.yaml"), trials=2, set=settings)
    assert result["platform"].values.tolist() == ["d", "a", "y", "ship"]
    (tmp_path / "p.csv").write_text("name,x_m,y_m,z_m\na.b,0,0,30\n")
    with pytest.raises(
        UserError, match=r"p\.csv:2: name: 'a\.b' is not allowed; letters, digits and _, a letter first"
    ):
        with_platforms(found, [], tmp_path / "p.csv")
    with pytest.raises(UserError, match=r"--platforms: .*p\.csv is not allowed for .*; for a system of one's own"):
        with_platforms(find("three_satellite"), [], tmp_path / "p.csv")
