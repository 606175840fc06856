"""Files of other programs that are spoilt: what is read of them is also used, written and read again."""

import re

from tests.readers import oem_examples, tdm_examples

WORDS = ["nan", "-inf", "1e999", "9" * 400, "", "=", "[km]", "0", "-1", "1e-320", "é", "\x00", "a" * 9000]
WORDS += ["2026-02-30T00:00:00", "2016-12-31T23:59:60", "2016-366T23:59:59.99999999999999999999"]
WORDS += ["0001-01-01T00:00:00", "9999-12-31T23:59:59.9", "UTC", "TT", "GPS", "1,2", "360"]
WORDS += ["META_START", "DATA_STOP", "COMMENT x", "&lt;", "<trkpt>", "\u2028", "\x85"]

PLATFORMS = """name;time;latitude_deg;longitude_deg;height_m
mast;;48.1;11.5;500
ship;2016-12-31T23:59:59Z;54;8;0
ship;2016-12-31T23:59:60Z;54.0001;8.0001;0
ship;2017-01-01T00:00:00Z;54.0002;8.0002;0
ship;2017-01-01T00:00:01Z;54.0003;8.0003;0
"""
TRACK = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk><name>a</name><trkseg>
<trkpt lat="48.1" lon="11.5"><ele>520.5</ele><time>2016-12-31T23:59:59.125Z</time></trkpt>
<trkpt lat="48.2" lon="11.6"><ele>521.5</ele><time>2016-12-31T23:59:60Z</time></trkpt>
<trkpt lat="48.3" lon="11.7"><ele>522.5</ele><time>2017-01-01T00:00:01Z</time></trkpt>
<trkpt lat="48.3" lon="11.7"><ele>522.5</ele><time>2017-01-01T00:00:04Z</time></trkpt>
</trkseg></trk></gpx>
"""
ORBIT = """CCSDS_OEM_VERS = 3.0
CREATION_DATE = 2026-001T00:00:00
ORIGINATOR = ME
META_START
OBJECT_NAME = A
OBJECT_ID = B
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 2026-01-01T00:00:00
STOP_TIME = 2026-01-01T00:00:04
META_STOP
2026-01-01T00:00:00 7000.0 0.0 0.0 0.0 7.5 0.0
2026-01-01T00:00:02 6999.983731 15.0 0.0 -0.016269 7.499983 0.0
2026-01-01T00:00:04 6999.934925 29.999884 0.0 -0.032538 7.49993 0.0
"""


def spoilt(text, rng, spoil_bytes):
    """Return a file's bytes with some words replaced, a line gone or doubled, or bytes changed."""
    kind = rng.randrange(4)
    if kind == 0:
        return spoil_bytes(text.encode(), rng)
    lines = text.splitlines(keepends=True)
    at = rng.randrange(len(lines))
    if kind == 1:
        other = rng.randrange(len(lines))
        lines[at : at + 1] = rng.choice([[], [lines[at]] * 2, [lines[other]], [lines[at], lines[other]]])
        return "".join(lines).encode()
    parts = re.split(r'([\s=;,<>"]+)', text)
    for _ in range(rng.choice([1, 1, 3])):
        parts[2 * rng.randrange((len(parts) + 1) // 2)] = rng.choice(WORDS)
    return "".join(parts).encode()


def _file(text, name, rng, folder):
    from tests.faults.mutations import spoil_bytes

    (folder / name).write_bytes(spoilt(text, rng, spoil_bytes))
    return folder / name


def _path(mover, folder):
    from quietfix.diagrams.paths.functions import path_of
    from quietfix.diagrams.paths.records import Setting
    from quietfix.diagrams.quantities.frame import EARTH_FIXED
    from quietfix.systems.trajectories.gravity import GravityConstants

    setting = Setting(2.0, None, folder)
    path_of(mover, EARTH_FIXED, setting, GravityConstants(), "target")(1.0)


def tdm(rng, folder):
    from quietfix.diagrams.readers.ccsds.tdm import read_tdm
    from quietfix.diagrams.readers.ccsds.tdm_observations import observations
    from quietfix.diagrams.readers.ccsds.tdm_table import tdm_measurements
    from quietfix.diagrams.writers.tdm import tdm_text
    from quietfix.diagrams.writers.tdm_table import message_of_table

    text = rng.choice(list(tdm_examples.ALL.values())).replace("PATH = 1,2,1", "PATH = 2,1").replace("1,2,3,2,1", "2,1")
    file = _file(text, "a.tdm", rng, folder)
    message = read_tdm(file)
    file.write_text(tdm_text(message))
    assert read_tdm(file) == message
    observations(message)
    table = tdm_measurements(file)
    message_of_table(table, None, message.header)


def oem(rng, folder):
    from quietfix.diagrams.paths.movers import Oem
    from quietfix.diagrams.readers.ccsds.oem import read_oem
    from quietfix.diagrams.writers.oem import oem_text

    text = rng.choice([ORBIT, ORBIT, oem_examples.COVARIANCES, oem_examples.TWO_SEGMENTS])
    file = _file(text, "a.oem", rng, folder)
    message = read_oem(file)
    file.write_text(oem_text(message))
    assert read_oem(file) == message
    if text == ORBIT:
        _path(Oem("a.oem"), folder)


def gpx(rng, folder):
    from quietfix.diagrams.paths.movers import Gpx
    from quietfix.diagrams.readers.gpx import read_gpx
    from quietfix.diagrams.writers.gpx import gpx_text

    file = _file(TRACK, "a.gpx", rng, folder)
    tracks = read_gpx(file)
    file.write_text(gpx_text(tracks))
    assert read_gpx(file) == tracks
    _path(Gpx("a.gpx"), folder)


def platforms(rng, folder):
    from quietfix.diagrams.paths.movers import Platform
    from quietfix.diagrams.readers.platforms import read_platforms

    file = _file(PLATFORMS, "p.csv", rng, folder)
    for name in read_platforms(file).platforms:
        _path(Platform("p.csv", name), folder)
