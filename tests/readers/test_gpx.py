"""GPX: what is read of a receiver's file, round trips, and what is refused."""

import numpy as np
import pytest

from quietfix.diagrams.readers.gpx import read_gpx
from quietfix.diagrams.writers.gpx import gpx_text
from quietfix.systems.earth.time_scales import to_tai
from tests.readers.spoiling import refused_or_read, said

GPX = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="hand" xmlns="http://www.topografix.com/GPX/1/1" xmlns:x="http://www.x.org/x">
<metadata><name>not a track</name></metadata>
<wpt lat="1" lon="2"><name>home</name></wpt>
<trk>
<name>Walk &amp; talk</name>
<trkseg>
<trkpt lat="48.1" lon="11.5"><ele>520.5</ele><time>2016-12-31T23:59:59.123456789Z</time>
<geoidheight>46</geoidheight></trkpt>
<trkpt lat="48.2" lon="11.6"><ele>521.5</ele><time>2016-12-31T23:59:60Z</time>
<extensions><x:hr><x:time>1</x:time>60</x:hr></extensions></trkpt>
<trkpt lat="48.2" lon="11.6"><ele>521.5</ele><time>2016-12-31T23:59:60Z</time></trkpt>
</trkseg>
<trkseg>
<trkpt lat="-48.3" lon="-180"><time>2017-01-01T02:00:00+02:00</time></trkpt>
</trkseg>
</trk>
<trk><trkseg/></trk>
</gpx>
"""


@pytest.fixture
def read(tmp_path):
    def one(text):
        (tmp_path / "a.gpx").write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_gpx(tmp_path / "a.gpx")

    return one


def test_a_track(read):
    (track,) = read(GPX)
    assert track.name == "Walk & talk"
    np.testing.assert_array_equal(track.latitude, [48.1, 48.2, -48.3])
    np.testing.assert_array_equal(track.longitude, [11.5, 11.6, -180])
    np.testing.assert_array_equal(track.elevation, [520.5, 521.5, np.nan])
    np.testing.assert_array_equal(track.geoid, [46, np.nan, np.nan])
    np.testing.assert_array_equal(track.part, [0, 0, 1])
    np.testing.assert_array_equal(np.diff(track.second), 1)  # the leap second is one of its own
    assert (track.second[0], track.rest[0]) == to_tai("2016-12-31T23:59:59.123456789")


def test_round_trip(read):
    tracks = read(GPX)
    assert read(gpx_text(tracks)) == tracks
    two = [*tracks, *read(GPX.replace("Walk &amp; talk", '&lt;"é日&gt;'))]
    assert two[1].name == '<"é日>' and read(gpx_text(two, creator='a "b" & c')) == two


def test_what_is_borne(read):
    plain = read(GPX)
    prefixed = GPX.replace("<", "<g:").replace("<g:/", "</g:").replace("<g:?", "<?")
    for other in (
        "\ufeff" + GPX.replace("\n", "\r\n"),
        GPX.replace("UTF-8", "UTF-16").encode("utf-16"),
        GPX.replace("UTF-8", "ISO-8859-1"),
        prefixed.replace("g:x:", "x:").replace("xmlns=", "xmlns:g="),
    ):
        assert read(other) == plain


BILLION = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]>\n<gpx>&b;</gpx>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('lat="48.1"', 'lat="91"', "line 8: lat '91' is not allowed; -90 to 90"),
        ('lat="48.1"', 'lat="nan"', "line 8: lat 'nan' is not allowed; -90 to 90"),
        ('lat="48.1"', 'lat="1_0"', "line 8: lat '1_0' is not allowed"),
        ('lat="48.1" ', "", "line 8: lat is missing in <trkpt>; -90 to 90"),
        ('lon="11.5"', 'lon="181"', "line 8: lon '181' is not allowed; -180 to 180"),
        ("520.5", "high", "line 8: ele 'high' is not allowed; metres"),
        (">46<", ">1e300<", "line 9: geoidheight '1e300' is not allowed; metres"),
        (
            "23:59:59.123456789Z",
            "25:59:59Z",
            "line 8: time '2016-12-31T25:59:59Z' is not allowed; 00:00:00 to 23:59:60",
        ),
        ("<time>2016-12-31T23:59:59.123456789Z</time>", "", "line 8: a <trkpt> without <time> is not allowed"),
        ("2017-01-01T02:00:00+02:00", "2016-01-01T02:00:00Z", "line 15: its time is before that of the point before"),
        ("2016-12-31T23:59:59.123456789Z", "2016-12-31T23:59:60Z", "line 10: its time is that of the point before it"),
        ("<gpx ", "<kml ", "line 2: <kml> is not allowed; a GPX file begins with <gpx>"),
        ("</gpx>", "", "line 20: it is no XML (no element found)"),
        ("</trkseg>", "</trksegment>", "line 13: it is no XML (mismatched tag)"),
        ("UTF-8", "KOI-99", "line 1: it is no XML (unknown encoding"),
        ("Walk", "<a>" * 40, "line 6: elements more than 32 deep are not allowed"),
        (GPX, BILLION, "line 1: a DTD is not allowed"),
        (GPX, "", "it is no XML (no element found)"),
        (GPX, "<gpx/>", "a.gpx: it has no track; <trk> with <trkpt lat=... lon=...> and <time>"),
    ],
)
def test_each_field_wrong_once(tmp_path, old, new, message):
    assert old in GPX
    assert message in said(read_gpx, tmp_path / "a.gpx", GPX.replace(old, new, 1))


def test_what_is_no_text(tmp_path):
    assert "it is no XML" in said(read_gpx, tmp_path / "a.gpx", GPX.encode().replace(b"Walk", b"W\xffk"))


def test_files_that_are_cut_are_refused(tmp_path):
    content = GPX.encode()
    for end in range(0, len(content) - 1, 10):
        assert refused_or_read(read_gpx, tmp_path / "a.gpx", content[:end]) is None, end


def test_what_cannot_be_written():
    for name in ("\x00", "a\ud800"):
        with pytest.raises(ValueError, match="is no character of XML"):
            gpx_text([replaced(name)])


def replaced(name):
    from quietfix.diagrams.readers.gpx import GpxTrack

    one = np.zeros(1)
    return GpxTrack(name, np.array([10**9]), one, one, one, one, one, np.zeros(1, dtype=np.int64))


def test_heights_above_the_geoid_are_said(tmp_path):
    """EGM96 is between -107 m south of India and 86 m in New Guinea (NIMA TR8350.2)."""
    from quietfix.diagrams.paths.movers import Gpx
    from quietfix.diagrams.paths.receivers import doubtful_heights
    from quietfix.diagrams.paths.records import Setting

    head = '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    points = [
        f'<trkpt lat="48" lon="11"><ele>500</ele><time>2026-01-01T00:00:0{i}Z</time>{more}</trkpt>'
        for i, more in enumerate(("<geoidheight>47</geoidheight>", ""))
    ]
    (tmp_path / "a.gpx").write_text(f"{head}{''.join(points)}</trkseg></trk></gpx>")
    setting = Setting(1.0, None, tmp_path)
    said = doubtful_heights(Gpx("a.gpx"), setting, "target")
    assert said.startswith("target.file: a.gpx: <ele> is above the geoid, and taken as above the ellipsoid at 1 points")
    assert not doubtful_heights(Gpx("a.gpx", geoid_m=47.0), setting, "target")
    assert not doubtful_heights(Gpx("a.gpx", height_m=547.0), setting, "target")
