"""Tracking Data Messages as tables of measurements, and back."""

import numpy as np
import pytest

from quietfix.diagrams.readers.ccsds.tdm_table import tdm_measurements
from quietfix.diagrams.readers.measurements import read_measurements
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.tdm import tdm_text
from quietfix.diagrams.writers.tdm_table import message_of_table
from quietfix.systems.earth.time_scales import to_tai
from tests.readers import tdm_examples

HEADER = {"CREATION_DATE": "2026-01-01T00:00:00", "ORIGINATOR": "ME"}


@pytest.fixture
def read(tmp_path):
    def one(text, two_way=""):
        (tmp_path / "a.tdm").write_text(text)
        return tdm_measurements(tmp_path / "a.tdm", two_way)

    return one


def test_one_way_frequency(read):
    table = read(tdm_examples.ONE_WAY)
    (series,) = table.series
    assert series == ("yyyy-nnnA", "received_frequency", "DSS-25", "", "Hz")
    np.testing.assert_array_equal(table.value, 32021035200.0 + np.array([-409.2735, -371.1568, -333.0551]))
    assert np.isnan(table.sigma).all() and table.lines.tolist() == [23, 24, 25]
    assert (table.whole[0], table.rest[0]) == to_tai("2005-159T17:41:00")
    left, delays = table.notes
    assert left.endswith("left out: 1 TRANSMIT_FREQ_2.")
    assert delays.endswith("RECEIVE_DELAY_1, TRANSMIT_DELAY_1 are not applied.")


def test_differences_and_angles(read):
    (series,) = read(tdm_examples.DELTA_DOR).series
    assert series == ("VOYAGER1", "tdoa", "DSS-25", "DSS-55", "s")
    text = tdm_examples.FOUR_WAY
    with pytest.raises(
        UserError, match="range of NORTH over 4 legs is not allowed: the standard leaves open whether it is"
    ):
        read(text)
    rows = [line for line in text.splitlines() if not line.startswith(("RANGE ", "RECEIVE_FREQ"))]
    table = read("\n".join(rows))
    assert [(one.kind, one.target, one.receiver, one.unit) for one in table.series] == [
        ("bearing", "F07R07", "NORTH", "deg"),
        ("elevation", "F07R07", "NORTH", "deg"),
    ]


def two_way(units, kind="RANGE", path="1,2,1", value=2000.5):
    return f"""CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-01-02T00:00:00
ORIGINATOR = ME
META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = dish
PARTICIPANT_2 = moon
PARTICIPANT_3 = south
MODE = SEQUENTIAL
PATH = {path}
RANGE_UNITS = {units}
TIMETAG_REF = RECEIVE
META_STOP
DATA_START
{kind} = 2026-01-01T00:00:00 {value}
DATA_STOP
"""


@pytest.mark.parametrize(
    ("units", "kind", "value", "said", "expected", "unit"),
    [
        ("km", "RANGE", 2000.5, "half", 2000.5, "km"),
        ("km", "RANGE", 2000.5, "whole", 1000.25, "km"),
        ("s", "RANGE", 0.01, "whole", 0.005 * 299_792_458.0, "m"),
        ("s", "RANGE", 0.01, "half", 0.01 * 299_792_458.0, "m"),
        ("km", "DOPPLER_INSTANTANEOUS", -3.5, "whole", -1.75, "km/s"),
        ("km", "DOPPLER_INSTANTANEOUS", -3.5, "half", -3.5, "km/s"),
    ],
)
def test_two_way_as_its_parties_agree(read, units, kind, value, said, expected, unit):
    text = two_way(units, kind, value=value)
    table = read(text, said)
    assert table.value == pytest.approx([expected], rel=1e-15)
    ((_, _, receiver, reference, found),) = table.series
    assert (receiver, reference, found) == ("dish", "", unit)
    assert table.series[0].target == "moon"
    assert f"taken as of {said} of the way there and back" in " ".join(table.notes)
    with pytest.raises(UserError, match=r"over 2 legs .* PATH = 2,1, or measurements\.two_way"):
        read(text)


def test_three_way_is_refused_whatever_is_said(read):
    for path in ("1,2,3", "1,2,1,2,1"):
        with pytest.raises(UserError, match="legs is not allowed: the standard leaves open"):
            read(two_way("km", path=path), "half")
    one = read(two_way("km", path="2,1"), "whole")
    assert one.value.tolist() == [2000.5] and not one.notes


def test_integrated_is_of_the_middle(read):
    text = tdm_examples.TWO_SEGMENTS.partition("\nMETA_START\nTIME_SYSTEM = UTC\nSTART_TIME = 2007-08-29T06")[0]
    table = read(text.replace("PATH = 1,2,1", "PATH = 2,1").replace("INTERVAL = 1.0", "INTERVAL = 5.0"))
    rates = np.array([one.kind == "range_rate" for one in table.series])[table.which]
    assert (table.whole[rates][0], table.rest[rates][0]) == to_tai("2007-08-29T06:59:59.5")  # 2.5 s before its end
    np.testing.assert_array_equal(table.value[rates], [-1.498776048, 0.929545817])
    assert table.notes[0].endswith("left out: 2 x_south, 2 y_east.")
    assert table.notes[1].endswith("mean range rates over 5 s are taken as of the middle of that.")


RANGES = tdm_examples.FOUR_WAY.replace("PATH = 1,2,3,2,1", "PATH = 2,1")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("RANGE_UNITS = km", "RANGE_UNITS = RU", "range of F07R07 in RANGE_UNITS RU is not allowed"),
        ("RANGE_MODULUS = 0", "RANGE_MODULUS = 1000", "range of F07R07 is ambiguous by RANGE_MODULUS 1000 km"),
        ("MODE = SEQUENTIAL\nPATH = 2,1\n", "", "segment 1: RANGE has no receiver"),
    ],
)
def test_what_only_the_parties_know_is_refused(read, old, new, said):
    assert old in RANGES
    with pytest.raises(UserError, match=said):
        read(RANGES.replace(old, new))


def test_ranges_in_seconds(read):
    table = read(RANGES.replace("RANGE_UNITS = km", "RANGE_UNITS = s").replace("80452.7542", "0.25"))
    first = table.value[[table.series[i].kind == "range" for i in table.which]][0]
    assert first == 0.25 * 299792458.0 and table.series[0].unit == "m"


def test_nothing_for_a_table(read):
    clocks = tdm_examples.DELTA_DOR.rpartition("META_START")
    head = tdm_examples.DELTA_DOR.partition("META_START")[0]
    with pytest.raises(UserError, match="no measurements of a table are in it; it has CLOCK_BIAS"):
        read(f"{head}META_START{clocks[2]}")


CSV = """time,target,kind,receiver,reference,value,unit,sigma
2016-12-31T23:59:60.25Z,drone,range,a,,1234.5,m,1
2016-12-31T23:59:60.25Z,drone,bearing,a,,-30,deg,1
2016-12-31T23:59:60.25Z,drone,elevation,a,,12.5,deg,1
2016-12-31T23:59:59Z,drone,tdoa,b,a,-1.5,us,1
2016-12-31T23:59:59Z,drone,fdoa,b,a,3.5,Hz,1
2016-12-31T23:59:59Z,drone,received_frequency,b,,145.9,MHz,1
2016-12-31T23:59:58Z,drone,range_rate,a,,-3,m/s,1
2016-12-31T23:59:57Z,drone,range_rate,a,,,m/s,1
2016-12-31T23:59:57Z,drone,rss,a,,-80,dBm,1
"""


def test_a_table_and_back(tmp_path, read):
    (tmp_path / "m.csv").write_text(CSV)
    table = read_measurements(tmp_path / "m.csv")
    message, notes = message_of_table(table, None, HEADER)
    assert notes == ["a Tracking Data Message has no rss; left out."]
    back = read(tdm_text(message))
    found = {}
    for i, series in enumerate(back.series):
        (row,) = np.flatnonzero(back.which == i)
        found[series[:4]] = back.whole[row], back.rest[row], back.value[row], series.unit
    early, leap = (*to_tai("2016-12-31T23:59:59"),), to_tai("2016-12-31T23:59:60.25")
    assert found == {
        ("drone", "range", "a", ""): (*leap, 1.2345, "km"),
        ("drone", "bearing", "a", ""): (*leap, 330.0, "deg"),
        ("drone", "elevation", "a", ""): (*leap, 12.5, "deg"),
        ("drone", "tdoa", "b", "a"): (*early, -1.5e-6, "s"),
        ("drone", "fdoa", "b", "a"): (*early, 3.5, "Hz"),
        ("drone", "received_frequency", "b", ""): (*early, 145.9e6, "Hz"),
        ("drone", "range_rate", "a", ""): (*to_tai("2016-12-31T23:59:58"), -0.003, "km/s"),
    }
    again, _ = message_of_table(back, None, HEADER)
    assert again == message or tdm_text(again) == tdm_text(message)


def test_seconds_from_a_start_and_azimuths_from_east(tmp_path, read):
    lines = [
        "time_s,target,kind,receiver,value,unit",
        "0.75,a,azimuth,a,1.5707963267948966,rad",
        "1,a,frequency,a,2,Hz",
    ]
    (tmp_path / "m.csv").write_text("\n".join([*lines, ""]))
    table = read_measurements(tmp_path / "m.csv")
    message, notes = message_of_table(table, (10**9, 0.5), HEADER, {"a": 1e8})
    assert not notes
    back = read(tdm_text(message))
    assert back.series[0].target == "TARGET a"  # a trial may have the name of a platform
    assert (back.whole[0], back.rest[0], back.value[0]) == (10**9 + 1, 0.25, 0.0)
    assert (back.whole[1], back.value[1]) == (10**9 + 1, 100000002.0)
    with pytest.raises(ValueError, match="None is not allowed for a table with time_s"):
        message_of_table(table, None, HEADER)
