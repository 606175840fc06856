"""Tracking Data Messages: the standard's examples, times to the last digit, and what is refused."""

import numpy as np
import pytest

from quietfix.diagrams.readers.ccsds.tdm import read_tdm
from quietfix.diagrams.readers.ccsds.tdm_observations import message_of, observations
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.writers.tdm import tdm_text
from quietfix.systems.earth.time_scales import from_tai, to_tai
from tests.readers import tdm_examples
from tests.readers.spoiling import refused_or_read, said


@pytest.fixture
def read(tmp_path):
    def one(text):
        (tmp_path / "a.tdm").write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_tdm(tmp_path / "a.tdm")

    return one


@pytest.mark.parametrize("text", tdm_examples.ALL.values(), ids=tdm_examples.ALL)
def test_round_trips(read, text):
    message = read(text)
    assert read(tdm_text(message)) == message
    table = observations(message)
    again = observations(read(tdm_text(message_of(table, message.header, "GPS"))))
    assert again.links == table.links
    for name in ("link", "second", "rest", "value"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))


def test_one_way_frequency(read):
    message = read(tdm_examples.ONE_WAY)
    assert message.version == "1.0" and message.header["ORIGINATOR"] == "NASA/JPL"
    assert message.comments[1] == "StarTrek 1-way data, Ka band down"
    segment = message.segments[0]
    assert segment.records.keywords == ("TRANSMIT_FREQ_2", *["RECEIVE_FREQ_1"] * 3)
    np.testing.assert_array_equal(segment.records.value, [32023442781.733, -409.2735, -371.1568, -333.0551])
    table = observations(message)
    (link,) = table.links
    assert (link.kind, link.transmitter, link.receiver, link.unit) == ("frequency", "yyyy-nnnA", "DSS-25", "Hz")
    assert (link.interval, link.middle) == (1.0, 0.0)
    np.testing.assert_array_equal(table.value, 32021035200.0 + np.array([-409.2735, -371.1568, -333.0551]))
    assert from_tai(table.second[0], table.rest[0]) == "2005-06-08T17:41:00"  # day 159
    np.testing.assert_array_equal(np.diff(table.second), 1)
    assert table.left_out == {"TRANSMIT_FREQ_2": 1}


def test_two_segments_of_doppler_and_angles(read):
    message = read(tdm_examples.TWO_SEGMENTS)
    assert [segment.metadata["PARTICIPANT_1"] for segment in message.segments] == ["HBSTK", "WHM1"]
    table = observations(message)
    found = {(link.kind, link.receiver): (link, table.value[table.link == i]) for i, link in enumerate(table.links)}
    np.testing.assert_array_equal(found["mean_range_rate", "HBSTK"][1], [-1.498776048, 0.929545817])
    assert found["mean_range_rate", "HBSTK"][0].middle == -0.5  # tagged at its end, over 1 s
    np.testing.assert_array_equal(found["x_south", "HBSTK"][1], [67.01312389, -89.35626083])
    np.testing.assert_array_equal(found["elevation", "WHM1"][1], [1.26724167])
    link, value = found["range", "WHM1"]
    assert (link.path, link.unit, link.modulus) == (("WHM1", "SAT", "WHM1"), "km", 1e7)  # km by default
    np.testing.assert_array_equal(value, [40016.5248953670])


def test_differences_and_corrections(read):
    (link,) = observations(read(tdm_examples.DELTA_DOR)).links
    assert (link.kind, link.receiver, link.reference, link.unit) == ("tdoa", "DSS-25", "DSS-55", "s")
    table = observations(read(tdm_examples.ANGLES))
    # the file says -0.09 and 0.18 deg that are not applied
    np.testing.assert_allclose(table.value[table.link == 0], [-23.71012, -23.13004], rtol=1e-15)
    np.testing.assert_allclose(table.value[table.link == 1], [-72.93035, -72.56316], rtol=1e-15)
    applied = observations(read(tdm_examples.ANGLES.replace("APPLIED = NO", "APPLIED = YES")))
    np.testing.assert_array_equal(applied.value[applied.link == 0], [-23.62012, -23.04004])


def test_what_is_borne(read):
    plain = read(tdm_examples.FOUR_WAY)
    for other in (
        "\ufeff" + tdm_examples.FOUR_WAY.replace("\n", "\r\n"),
        tdm_examples.FOUR_WAY.replace("\n", "\r"),
        tdm_examples.FOUR_WAY.replace("\n", "\n \n\n"),
        tdm_examples.FOUR_WAY.replace("ANGLE_TYPE = AZEL", "angle_type=azel").replace("RANGE ", "range "),
        tdm_examples.FOUR_WAY.replace("80452.7542", "80452.7542 [km]").replace("INTERVAL = 1.0", "INTERVAL = 1.0 [s]"),
        tdm_examples.FOUR_WAY.replace("1,2,3,2,1", "1, 2, 3, 2, 1").rstrip("\n"),
        tdm_examples.FOUR_WAY.replace("80452.7542", "8.04527542D+04"),
    ):
        assert read(other) == plain


def test_phase_counts_keep_their_digits(read):
    digits = "123456789012345678901234567890.123456789"
    text = tdm_examples.ONE_WAY.replace(
        "RECEIVE_FREQ_1 = 2005-159T17:41:00 -409.2735", f"RECEIVE_PHASE_CT_1 = 2005-159T17:41:00 {digits}"
    )
    message = read(text)
    assert message.segments[0].records.digits == {1: digits} and digits in tdm_text(message)
    assert read(tdm_text(message)) == message


@pytest.mark.parametrize(
    ("scale", "written", "utc"),
    [
        ("UTC", "2016-12-31T23:59:60.123456789012345", "2016-12-31T23:59:60.123456789012345"),
        ("UTC", "2016-366T23:59:59.9Z", "2016-12-31T23:59:59.9"),
        ("TAI", "2017-01-01T00:00:36.5", "2016-12-31T23:59:60.5"),
        ("TAI", "2017-01-01T00:00:37", "2017-01-01T00:00:00"),
        ("GPS", "2017-01-01T00:00:18.25", "2017-01-01T00:00:00.25"),
        ("GPS", "1980-01-06T00:00:00", "1980-01-06T00:00:00"),  # where GPS time was set to UTC
        ("TT", "2017-01-01T00:01:09.184", "2017-01-01T00:00:00"),
        ("TT", "2017-01-01T00:01:09.100", "2016-12-31T23:59:60.916"),
        ("TAI", "1972-01-01T00:00:10", "1972-01-01T00:00:00"),
    ],
)
def test_time_systems_and_leap_seconds(read, scale, written, utc):
    text = tdm_examples.ONE_WAY.replace("SYSTEM = UTC", f"SYSTEM = {scale}").replace("2005-159T17:41:02", written)
    message = read(text)
    records = message.segments[0].records
    assert from_tai(records.second[-1], records.rest[-1]) == utc
    assert to_tai(utc) == (records.second[-1], records.rest[-1])
    assert read(tdm_text(message)) == message


def test_every_second_of_a_leap_second_is_its_own():
    seconds = [to_tai(f"2015-06-30T23:59:{s}")[0] for s in (58, 59, 60)] + [to_tai("2015-07-01T00:00:00")[0]]
    assert np.diff(seconds).tolist() == [1, 1, 1]
    assert to_tai("2015-07-01T01:59:60.5+02:00", offsets=True) == (seconds[2], 0.5)


HEAD = "CCSDS_TDM_VERS = 2.0\nCREATION_DATE = 2026-001T00:00:00\nORIGINATOR = ME\n"
META = "META_START\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = A\nPARTICIPANT_2 = B\nMODE = SEQUENTIAL\nPATH = 2,1\n"
DATA = "DATA_START\n{}\nDATA_STOP\n"
RECORD = "RANGE = 2026-01-01T00:00:00 12.5"
GOOD = f"{HEAD}{META}ANGLE_TYPE = AZEL\nRANGE_UNITS = km\nMETA_STOP\n{DATA.format(RECORD)}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("CCSDS_TDM_VERS = 2.0", "CCSDS_OEM_VERS = 2.0", "line 1: 'CCSDS_OEM_VERS = 2.0' is not allowed"),
        ("VERS = 2.0", "VERS = 3.0", "line 1: CCSDS_TDM_VERS '3.0' is not allowed; 1.0, 2.0"),
        ("2026-001T00:00:00\n", "2026-366T00:00:00\n", "line 2: CREATION_DATE '2026-366' is not allowed; day 366"),
        ("ORIGINATOR = ME", "ORIGINATOR =", "line 3: ORIGINATOR '' is not allowed; ORIGINATOR = value"),
        ("ORIGINATOR = ME\n", "", "line 3: ORIGINATOR is missing in the header"),
        ("ORIGINATOR", "ORIGINATER", "line 3: 'ORIGINATER' is not allowed in the header (did you mean ORIGINATOR?)"),
        ("SYSTEM = UTC", "SYSTEM = TDB", "line 5: TIME_SYSTEM 'TDB' is not allowed; UTC, TAI, GPS, TT: it departs"),
        ("SYSTEM = UTC", "SYSTEM = CET", "line 5: TIME_SYSTEM 'CET' is not allowed; UTC, TAI, GPS, TT"),
        ("TIME_SYSTEM = UTC\n", "", "line 4: TIME_SYSTEM is missing in the metadata from line 4"),
        ("PATH = 2,1", "PATH = 2,3", "line 4: PATH '2,3' is not allowed; there is no PARTICIPANT_3"),
        ("PATH = 2,1", "PATH = 1", "line 9: PATH '1' is not allowed; numbers of participants such as 1,2,1"),
        ("PATH = 2,1", "PATH = 1,1", "line 9: PATH '1,1' is not allowed"),
        ("PATH = 2,1\n", "", "line 4: MODE SEQUENTIAL needs PATH, and no other path"),
        ("MODE = SEQUENTIAL", "MODE = SINGLE_DIFF", "line 4: MODE SINGLE_DIFF needs PATH_1 and PATH_2"),
        ("TYPE = AZEL", "TYPE = AZIMUTH", "line 10: ANGLE_TYPE 'AZIMUTH' is not allowed; AZEL, RADEC, XEYN, XSYE"),
        ("UNITS = km", "UNITS = m", "line 11: RANGE_UNITS 'm' is not allowed; km, s, RU"),
        ("UNITS = km", "INTERVAL = 1", "line 11: 'RANGE_INTERVAL' is not allowed in the metadata"),
        ("RANGE_UNITS = km", "INTEGRATION_INTERVAL = 0", "INTEGRATION_INTERVAL '0' is not allowed; a number > 0"),
        ("RANGE_UNITS = km", "RANGE_MODULUS = -1", "line 11: RANGE_MODULUS '-1' is not allowed; a number >= 0"),
        ("RANGE_UNITS = km", "FREQ_OFFSET = nan", "line 11: FREQ_OFFSET 'nan' is not allowed; a number [Hz]"),
        ("RANGE_UNITS = km", "FREQ_OFFSET = 1 [kHz]", "FREQ_OFFSET '1 [kHz]' is not allowed; its unit is [Hz]"),
        ("RANGE_UNITS = km", "TURNAROUND_NUMERATOR = 2.5", "TURNAROUND_NUMERATOR '2.5' is not allowed; a whole"),
        ("RANGE_UNITS = km", "START_TIME = noon", "START_TIME 'noon' is not allowed; a date with a time"),
        ("RANGE_UNITS = km", "CORRECTION_RANGE = 1", "line 4: CORRECTIONS_APPLIED is missing"),
        ("RANGE_UNITS = km", "ANGLE_TYPE = AZEL", "line 11: ANGLE_TYPE is there twice; once is allowed"),
        ("META_STOP\n", "", "line 12: 'DATA_START' is not allowed in the metadata"),
        ("DATA_START\n", "", "line 13: 'RANGE = 2026-01-01T00:00:00 12.5' is not allowed; DATA_START"),
        ("RANGE = ", "DISTANCE = ", "line 14: 'DISTANCE' is not allowed in the data"),
        ("T00:00:00 12.5", "T00:00:00", "line 14: RANGE '2026-01-01T00:00:00' is not allowed; a time tag, a blank"),
        ("T00:00:00 12.5", "T24:00:00 12.5", "line 14: RANGE '2026-01-01T24:00:00' is not allowed; 00:00:00 to"),
        ("T00:00:00 12.5", "T00:00:60 12.5", "RANGE '2026-01-01T00:00:60' is not allowed; second 60 is only where UTC"),
        ("T00:00:00 12.5", "T00:00:00+01:00 12.5", "RANGE '2026-01-01T00:00:00+01:00' is not allowed; no offset"),
        ("2026-01-01T00:00:00 12.5", "2026-02-29T00:00:00 12.5", "RANGE '2026-02-29' is not allowed; day"),
        ("2026-01-01T00:00:00 12.5", "1969-12-31T00:00:00 12.5", "RANGE '1969-12-31T00:00:00' is not allowed; UTC"),
        ("00:00 12.5", "00:00 12,5", "line 14: RANGE '12,5' is not allowed; a number [km]"),
        ("00:00 12.5", "00:00 1e999", "line 14: RANGE '1e999' is not allowed; a number [km]"),
        ("00:00 12.5", "00:00 inf", "line 14: RANGE 'inf' is not allowed; a number [km]"),
        ("00:00 12.5", "00:00 12.5 13", "line 14: RANGE '12.5 13' is not allowed; a number [km]"),
        (RECORD, "ANGLE_1 = 2026-01-01T00:00:00 360", "ANGLE_1 '360' is not allowed; -180 to 360"),
        (RECORD, "RHUMIDITY = 2026-01-01T00:00:00 101", "RHUMIDITY '101' is not allowed; 0 to 100"),
        ("RANGE =", "RECEIVE_FREQ_3 =", "RECEIVE_FREQ_3 is not allowed; there is no PARTICIPANT_3"),
        ("12.5\n", "12.5\nRANGE = 2026-01-01T00:00:00 12.6\n", "line 15: RANGE of this time is in line 14 too; once"),
        ("RANGE = 2026-01-01T00:00:00 12.5\n", "", "line 13: a data section without a record is not allowed"),
        ("DATA_STOP\n", "", "a.tdm: it ends before the DATA_STOP of line 13's DATA_START"),
        ("DATA_STOP\n", "DATA_STOP\nMETA_STRT\n", "line 16: 'META_STRT' is not allowed; META_START"),
        ("ORIGINATOR = ME", "ORIGINATOR = ME\x00\nME", "line 4: 'ME' is not allowed in the header"),
    ],
)  # fmt: skip
def test_each_field_wrong_once(tmp_path, old, new, message):
    assert old in GOOD
    assert message in said(read_tdm, tmp_path / "a.tdm", GOOD.replace(old, new, 1))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "a.tdm: it is empty; CCSDS_TDM_VERS = 2.0"),
        (b"\xff\xfeC\x00C\x00", "a.tdm cannot be read (not utf-8: byte 0"),
        (GOOD.encode().replace(b"ME", b"M\xe9"), "cannot be read (not utf-8: byte "),
        (
            b'<?xml version="1.0"?><tdm/>',
            "line 1: '<?xml version=\"1.0\"?><tdm/>' is not allowed; CCSDS_TDM_VERS = 2.0",
        ),
        (GOOD.encode().replace(b"12.5", b"9" * 20_000), "line 14: a line of 20028 characters is not allowed"),
        (HEAD.encode(), "a.tdm: it ends before the first META_START"),
    ],
)
def test_what_is_no_message_at_all(tmp_path, content, message):
    assert message in said(read_tdm, tmp_path / "a.tdm", content)


def test_files_that_are_cut_are_refused(tmp_path):
    content = GOOD.encode()
    for end in range(0, len(content), 10):
        assert refused_or_read(read_tdm, tmp_path / "a.tdm", content[:end]) is None, end
    for text in (tdm_examples.TWO_SEGMENTS, tdm_examples.DELTA_DOR):
        whole = refused_or_read(read_tdm, tmp_path / "a.tdm", text.encode())
        for end in range(0, len(text) - 1, 10):
            left = refused_or_read(read_tdm, tmp_path / "a.tdm", text[:end].encode())
            assert left is None or left.segments == whole.segments[:-1], end  # the cut is where a segment ends


@pytest.mark.parametrize(
    ("text", "said_"),
    [
        (tdm_examples.ANGLES.replace("XSYE", "RADEC"), "segment 1: ANGLE_1 needs a REFERENCE_FRAME"),
        (GOOD.replace("MODE = SEQUENTIAL\nPATH = 2,1\n", ""), "segment 1: RANGE has no receiver; MODE and PATH"),
        (
            tdm_examples.ANGLES.replace("CORRECTION_ANGLE_1", "CORRECTION_ABERRATION_YEARLY"),
            "segment 1: ANGLE_1 without its aberration is not allowed",
        ),
    ],
)
def test_what_cannot_be_observed_is_said(read, text, said_):
    with pytest.raises(UserError) as caught:
        observations(read(text))
    assert str(caught.value).startswith(said_)
