"""Small files of every format that goes in, spoilt anywhere, and what the command makes of them.

``python -m tests.faults.anywhere WHAT KIND EXAMPLES FOLDER``: `cut` ends the file of a KIND at every tenth byte,
`changed` lets hypothesis change it EXAMPLES times; prints JSON. A fault is an exception, a status that is neither 0 nor
2, a refusal that is not one line, or ten seconds of processor time.
"""

import contextlib
import io
import json
import os
import re
import resource
import signal
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.faults import formats, mutations
from tests.identification.doppler import lines_of
from tests.peak_memory import peak_bytes

WORDS = [b"nan", b"-inf", b"1e999", b"9" * 400, b"-1", b"0", b"3", b"0.5", b"1e12", b"1e-320", b"True", b"1_000"]
WORDS += [b"\xff\xfe", b"\x00", b"\n\n", b"\r", b"\t", b",", b";", b"=", b"<", b'"', b"&#0;", b"]]>", b"a" * 9000]
WORDS += [b"[km]", b"GPS", b"UTC", b"META_START", b"DATA_STOP", "\u00e9\u2028".encode()]
WORDS += [b"2016-12-31T23:59:60Z", b"0001-01-01", b"9999-12-31T23:59:59.9Z"]

TABLE = b"""time_s,kind,receiver,reference,value,unit,sigma
0,tdoa,alpha,delta,7.4,us,30e-3
0,tdoa,bravo,delta,32.6,us,
0,tdoa,charlie,delta,12.7,us,
2,azimuth,alpha,,60,deg,
5,altitude,,,0.9,km,
"""
MESSAGE = b"""CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2026-01-02T00:00:00
ORIGINATOR = ME
META_START
TIME_SYSTEM = GPS
PARTICIPANT_1 = a
PARTICIPANT_2 = plane
PARTICIPANT_3 = b
MODE = SEQUENTIAL
PATH = 2,1
RANGE_UNITS = km
ANGLE_TYPE = AZEL
META_STOP
DATA_START
RANGE = 2026-01-01T00:00:18.000 52.1
ANGLE_1 = 2026-01-01T00:00:18.000 61.5
ANGLE_2 = 2026-01-01T00:00:18.000 4.5
RANGE = 2026-01-01T00:00:19.000 52.2
DATA_STOP
"""
TRACKING = """frame: earth_fixed
duration_s: 5
platforms:
  a: !Geodetic {latitude_deg: 48, longitude_deg: 11, height_m: 500}
  b: !Geodetic {latitude_deg: 48.2, longitude_deg: 11, height_m: 520}
sensors:
  range: !Range {stations: [a], sigma_m: 20}
  eyes: !Bearing {platform: a, sigma_deg: 0.5, sigma_elevation_deg: 0.5}
start: !Given {at: !Geodetic {latitude_deg: 48.2, longitude_deg: 11.6, height_m: 4000}}
estimators: {ekf: !Ekf {}}
"""
CARRIED = """frame: earth_fixed
duration_s: 1
platforms:
  s: MOVER
  g: !Geodetic {latitude_deg: 1, longitude_deg: 1}
target: !Geodetic {latitude_deg: 0.5, longitude_deg: 0.5, height_m: 500}
sensors: {range: !Range {sigma_m: 20}}
start: !Prior {}
estimators: {ekf: !Ekf {}}
"""


def parquet_bytes():
    """Return the table as Parquet: every column of text as it would come from others."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    head, *rows = (line.split(",") for line in TABLE.decode().splitlines())
    columns = dict(zip(head, map(list, zip(*rows, strict=True)), strict=True))
    for name in ("time_s", "value", "sigma"):
        columns[name] = [float(cell) if cell else None for cell in columns[name]]
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)
    return file.getvalue()


@dataclass(frozen=True)
class Kind:
    """A format: its file, what is in it, and the arguments of the command that reads it."""

    name: str
    content: bytes
    arguments: tuple[str, ...] = ()
    system: str = ""


DRONE = str(Path(__file__).parents[1] / "own" / "drone.yaml")
_OWN = ("run", "mine.yaml", "--trials", "2")


def _fed(name):
    return "run", DRONE, "--measurements", name, "--estimator", "ekf"


def _carried(mover):
    return CARRIED.replace("MOVER", mover)


def kinds():
    """Return every format by its name."""
    orbit = mutations.sp3_text(6).encode()
    return {
        "csv": Kind("m.csv", TABLE, _fed("m.csv")),
        "parquet": Kind("m.parquet", parquet_bytes(), _fed("m.parquet")),
        "tdm": Kind("m.tdm", MESSAGE, ("run", "mine.yaml", "--measurements", "m.tdm"), TRACKING),
        "sp3": Kind("o.sp3", orbit, _OWN, _carried("!Sp3 {file: o.sp3, satellite: L27}")),
        "oem": Kind("a.oem", formats.ORBIT.encode(), _OWN, _carried("!Oem {file: a.oem}")),
        "gpx": Kind("a.gpx", formats.TRACK.encode(), _OWN, _carried("!Gpx {file: a.gpx}")),
        "platforms": Kind("p.csv", formats.PLATFORMS.encode(), _OWN, _carried("!Platform {file: p.csv, name: ship}")),
        "tle": Kind("e.tle", "\n".join(["ONE", *lines_of(43137), *lines_of(43138, 9.0), ""]).encode()),
    }


def read(kind, content):
    """Let the command read a content; return `ran` or `refused`, and None or the fault."""
    from quietfix.diagrams.commands.command_line import main
    from quietfix.diagrams.readers.doppler.elements import read_elements
    from quietfix.diagrams.schema.errors import UserError

    Path(kind.name).write_bytes(content)
    said, out = io.StringIO(), io.StringIO()
    signal.setitimer(signal.ITIMER_VIRTUAL, mutations.MOST_SECONDS)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
            if kind.arguments:
                main(list(kind.arguments))
            else:
                read_elements(kind.name)
        return "ran", None
    except UserError as error:
        return "refused", None if "\n" not in str(error) and not kind.arguments else traceback.format_exc()[-1500:]
    except SystemExit as end:
        lines = [line for line in said.getvalue().splitlines() if not line.startswith("quietfix: warning: ")]
        if end.code == 2:
            good = len(lines) == 1 and len(lines[0]) < 1000
            return "refused", None if good else f"not one line: {said.getvalue()[:900]}"
        return "ran", None if end.code in (0, None) else f"status {end.code}: {said.getvalue()[:900]}"
    except BaseException:
        return "failed", traceback.format_exc()[-1500:]
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


@st.composite
def changes(draw, whole):
    """Bytes of a file with one to three places replaced, left out, doubled, exchanged or filled with a word."""
    if draw(st.booleans()):  # a cell, a word or a number in the place of another
        parts = re.split(rb"([\s=;,<>\"]+)", whole)
        parts[2 * draw(st.sampled_from(range((len(parts) + 1) // 2)))] = draw(st.sampled_from(WORDS))
        return b"".join(parts)
    content = whole
    for _ in range(draw(st.integers(1, 3))):
        begin = draw(st.sampled_from(range(max(len(content), 1))))
        end = begin + draw(st.sampled_from([1, 1, 2, 5, 17, 60]))
        new = draw(st.sampled_from(WORDS) | st.binary(max_size=3) | st.just(content[begin:end] * 2) | st.just(b""))
        content = content[:begin] + new + content[end:]
    return content


def judged(kind, contents):
    """Read contents, and return how many came to what, and the faults."""
    outcomes, faults = {}, {}
    for number, content in enumerate(contents):
        outcome, fault = read(kind, content)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if fault is not None:
            faults[number] = f"{content[:2000]!r}: {fault}"
    return outcomes, faults


def cut(kind):
    """End a file at every tenth byte."""
    return judged(kind, [kind.content[:end] for end in range(0, len(kind.content), 10)])


def changed(kind, examples):
    """Return a file as hypothesis changes it; the same examples every time."""
    contents = []

    @settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(changes(kind.content))
    def collect(content):
        contents.append(content)

    collect()
    return contents


def _slow(number, frame):
    raise mutations.Slow


def _main(what, name, examples, folder):
    resource.setrlimit(resource.RLIMIT_DATA, (mutations.MOST_BYTES, mutations.MOST_BYTES))
    signal.signal(signal.SIGVTALRM, _slow)
    os.chdir(folder)
    kind = kinds()[name]
    if kind.system:
        Path("mine.yaml").write_text(kind.system)
    whole = read(kind, kind.content)
    outcomes, faults = cut(kind) if what == "cut" else judged(kind, changed(kind, examples))
    print(json.dumps({"whole": whole, "outcomes": outcomes, "faults": faults, "resident": peak_bytes()}))


if __name__ == "__main__":
    _main(sys.argv[1], sys.argv[2], int(sys.argv[3]), Path(sys.argv[4]))
