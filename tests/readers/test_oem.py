"""Orbit Ephemeris Messages: the standard's examples, several segments, covariances, and what is refused."""

import numpy as np
import pytest

from quietfix.diagrams.readers.ccsds.oem import read_oem
from quietfix.diagrams.writers.oem import oem_text
from quietfix.systems.earth.time_scales import to_tai
from tests.readers import oem_examples
from tests.readers.spoiling import refused_or_read, said

ACCELERATED = oem_examples.TWO_SEGMENTS.replace("-2.49586 -1.04195", "-2.49586 -1.04195 0.008 0.001 -0.159")


@pytest.fixture
def read(tmp_path):
    def one(text):
        (tmp_path / "a.oem").write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_oem(tmp_path / "a.oem")

    return one


@pytest.mark.parametrize("text", [oem_examples.COVARIANCES, oem_examples.TWO_SEGMENTS, ACCELERATED])
@pytest.mark.parametrize("scale", ["UTC", "TAI", "GPS", "TT"])
def test_round_trips(read, text, scale):
    message = read(text.replace("= UTC", f"= {scale}"))
    assert read(oem_text(message)) == message


def test_covariances(read):
    message = read(oem_examples.COVARIANCES)
    assert message.header["MESSAGE_ID"] == "OEM 201113719185" and message.version == "3.0"
    (segment,) = message.segments
    np.testing.assert_array_equal(segment.states[0], [-2432.166, -63.042, 1742.754, 7.33702, -3.495867, -1.041945])
    assert segment.data_comments == ("This block begins after trajectory correction maneuver TCM-3.",)
    first, second = segment.covariances
    assert (first.second, first.rest) == to_tai("2019-12-28T21:29:07.267") and first.frame == "EME2000"
    np.testing.assert_array_equal(first.matrix, first.matrix.T)
    assert first.matrix[5, 1] == -4.9894969e-07 and second.matrix[2, 2] == 3.3420420e-04


def test_segments_and_accelerations(read):
    one, other = read(ACCELERATED).segments
    np.testing.assert_array_equal(one.accelerations[0], [0.008, 0.001, -0.159])
    assert np.isnan(one.accelerations[1:]).all() and np.isnan(other.accelerations).all()
    assert (other.second[0], other.rest[0]) == to_tai("1996-363T21:29:07.267")
    assert other.metadata["INTERPOLATION"] == "HERMITE"


def test_what_is_borne(read):
    text = oem_examples.COVARIANCES
    plain = read(text)
    twice = text.replace("2019-12-28T21:59", "2019-12-28T21:29:07.267 -2432.166 -063.042 1742.754 7.33702 -3.495867 -1.041945\n2019-12-28T21:59", 1)  # noqa: E501  # fmt: skip
    for other in ("\ufeff" + text.replace("\n", "\r\n"), text.replace("\n", "\n\n"), text.rstrip("\n"), twice,
                  text.replace("META_START\n", "meta_start\n").replace("EPOCH =", "epoch=")):  # fmt: skip
        assert read(other) == plain


GOOD = """CCSDS_OEM_VERS = 3.0
CREATION_DATE = 2026-001T00:00:00
ORIGINATOR = ME
META_START
OBJECT_NAME = A
OBJECT_ID = B
CENTER_NAME = EARTH
REF_FRAME = ITRF2000
TIME_SYSTEM = UTC
START_TIME = 2026-01-01T00:00:00
STOP_TIME = 2026-01-01T00:02:00
META_STOP
2026-01-01T00:00:00 7000.0 0.0 0.0 0.0 7.5 0.0
2026-01-01T00:01:00 6985.0 450.0 0.0 -0.5 7.5 0.0
2026-01-01T00:02:00 6940.0 900.0 0.0 -1.0 7.4 0.0
COVARIANCE_START
EPOCH = 2026-01-01T00:00:00
1.0
0.0 1.0
0.0 0.0 1.0
0.0 0.0 0.0 1.0
0.0 0.0 0.0 0.0 1.0
0.0 0.0 0.0 0.0 0.0 1.5
COVARIANCE_STOP
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("CCSDS_OEM_VERS", "CCSDS_TDM_VERS", "line 1: 'CCSDS_TDM_VERS = 3.0' is not allowed; CCSDS_OEM_VERS = 3.0"),
        ("VERS = 3.0", "VERS = 4.0", "line 1: CCSDS_OEM_VERS '4.0' is not allowed"),
        ("CREATION_DATE = 2026-001T00:00:00\n", "", "CREATION_DATE is missing in the header"),
        ("CREATION_DATE = 2026-001", "CREATION_DATE = 2026-000", "CREATION_DATE '2026-000' is not allowed; day 0"),
        ("ORIGINATOR = ME", "ORIGIN = ME", "line 3: 'ORIGIN' is not allowed in the header (did you mean ORIGINATOR?)"),
        ("OBJECT_ID = B\n", "", "line 4: OBJECT_ID is missing in the metadata from line 4"),
        ("OBJECT_ID = B", "OBJECT_NAME = B", "line 6: OBJECT_NAME is there twice; once is allowed"),
        ("SYSTEM = UTC", "SYSTEM = TCB", "line 9: TIME_SYSTEM 'TCB' is not allowed; UTC, TAI, GPS, TT: it gains"),
        ("START_TIME = 2026-01-01T00:00:00", "START_TIME = now", "line 10: START_TIME 'now' is not allowed; a date"),
        ("STOP_TIME = 2026-01-01", "STOP_TIME = 2025-01-01", "line 11: STOP_TIME '2025-01-01T00:02:00' is not allowed"),
        ("STOP_TIME = 2026-01-01T00:02", "STOP_TIME = 2026-01-01T00:03", "line 15: the ephemeris ends before the STOP"),
        ("START_TIME = 2026-01-01T00:00", "START_TIME = 2025-01-01T00:00", "line 13: the ephemeris begins after the"),
        ("META_STOP\n", "INTERPOLATION = HERMITE\nMETA_STOP\n", "INTERPOLATION_DEGREE is missing beside INTERPOLATION"),
        ("META_STOP\n", "INTERPOLATION_DEGREE = 0\nMETA_STOP\n", "INTERPOLATION_DEGREE '0' is not allowed; a whole"),
        ("META_STOP\n", "", "line 12: '2026-01-01T00:00:00' is not allowed in the metadata"),
        ("7000.0", "7000.0x", "line 13: X '7000.0x' is not allowed; a number [km]"),
        ("7.4 0.0", "nan 0.0", "line 15: Y_DOT 'nan' is not allowed; a number [km/s]"),
        ("7.4 0.0", "7.4 0.0 0.1", "line 15: '2026-01-01T00:02:00 6940.0 900.0 0.0 -1.0 7.4 0.0 0.1' is not allowed;"),
        ("2026-01-01T00:01:00", "2026-01-01T00:00:00", "line 14: epoch '2026-01-01T00:00:00' is not allowed; after"),
        ("2026-01-01T00:01:00", "2026-01-32T00:01:00", "line 14: epoch '2026-01-32' is not allowed; day"),
        ("EPOCH = 2026-01-01T00:00:00\n", "", "line 17: '1.0' is not allowed; EPOCH = before a covariance"),
        ("EPOCH = 2026", "EPOC = 2026", "line 17: 'EPOC' is not allowed in a covariance (did you mean EPOCH?)"),
        ("\n0.0 1.0\n", "\n0.0 -1.0\n", "line 19: variance '-1.0' is not allowed; a number >= 0"),
        ("\n0.0 1.0\n", "\n0.0 x\n", "line 19: covariance 'x' is not allowed; a number"),
        ("\n0.0 1.0\n", "\n1.0\n", "line 19: '1.0' is not allowed; row 2 of a covariance: its lower triangle"),
        ("0.0 0.0 0.0 0.0 0.0 1.5\n", "", "COVARIANCE_STOP after 5 rows is not allowed; 6"),
        ("COVARIANCE_STOP\n", "", "a.oem: it ends before the COVARIANCE_STOP"),
        ("COVARIANCE_STOP\n", "COVARIANCE_STOP\n1.0\n", "line 25: '1.0' is not allowed; META_START"),
    ],
)
def test_each_field_wrong_once(tmp_path, old, new, message):
    assert old in GOOD
    assert message in said(read_oem, tmp_path / "a.oem", GOOD.replace(old, new, 1))


def test_a_time_system_for_each_segment_is_refused(tmp_path):
    before, _, after = oem_examples.TWO_SEGMENTS.rpartition("UTC")
    assert "TIME_SYSTEM TAI is not allowed; one in all" in said(read_oem, tmp_path / "a.oem", f"{before}TAI{after}")


@pytest.mark.parametrize("text", [GOOD, GOOD.partition("COVARIANCE_START")[0], oem_examples.TWO_SEGMENTS])
def test_files_that_are_cut_are_refused(tmp_path, text):
    whole = refused_or_read(read_oem, tmp_path / "a.oem", text.encode())
    assert whole is not None
    for end in range(0, len(text) - 1, 7):
        left = refused_or_read(read_oem, tmp_path / "a.oem", text[:end].encode())
        if left is not None and left != whole:  # cut between parts: nothing is half there
            for mine, all_ in zip(left.segments, whole.segments, strict=False):
                np.testing.assert_array_equal(mine.states, all_.states)
                assert mine.covariances in ((), all_.covariances)
