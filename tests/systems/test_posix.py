"""Dates in UTC, whatever their offset."""

from datetime import UTC, datetime

import pytest

from quietfix.systems.earth.time_scales import to_posix, to_tai

NOON = int(datetime(2020, 4, 1, 12, tzinfo=UTC).timestamp())


@pytest.mark.parametrize(
    "text",
    [
        "2020-04-01T12:00:00Z",
        "2020-04-01 12:00:00",
        "2020-04-01T14:00:00+02:00",
        "2020-04-01T14:00:00 +0200",
        "2020-04-01t06:30:00-05:30",
        "2020-04-02T02:00:00+14",
        "2020-04-01T12:00:00.000000000z",
    ],
)
def test_every_offset_is_honoured_and_none_is_utc(text):
    assert to_posix(text) == (NOON, 0.0)


def test_no_digit_of_a_fraction_is_lost():
    """A double of the seconds since 1970 resolves 0.24 us."""
    assert to_posix("2020-04-01T14:00:00.1234567891+02:00") == (NOON, 0.1234567891)
    assert to_posix("1969-12-31T23:59:59.75Z") == (-1, 0.75)


def test_a_leap_second_and_the_one_after_it_are_the_same():
    assert to_posix("2016-12-31T23:59:60.5Z") == to_posix("2017-01-01T00:00:00.5Z") == (1483228800, 0.5)


@pytest.mark.parametrize("text", ["soon", "2020-04-01", "2020-13-01T00:00:00Z", "2020-04-01T12:00:00+2:00", "12:00:00"])
def test_what_is_no_date_with_a_time_is_refused(text):
    with pytest.raises(ValueError, match="is not allowed"):
        to_posix(text)
    with pytest.raises(ValueError, match="is not allowed"):
        to_tai(text, offsets=True)
