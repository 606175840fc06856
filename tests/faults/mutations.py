"""Inputs that are spoilt at random, each with a seed: run as a module, it judges some of them and prints JSON.

``python -m tests.faults.mutations KIND FIRST COUNT FOLDER``: mutations FIRST to FIRST + COUNT - 1 of a KIND of `KINDS`,
in FOLDER.
A fault is an exception that is no user's mistake, a message of several lines, or ten seconds of processor time.
"""

import contextlib
import copy
import io
import json
import os
import random
import resource
import shutil
import signal
import sys
import traceback
from pathlib import Path

import numpy as np
import yaml

from tests.faults import formats
from tests.peak_memory import peak_bytes
from tests.readers import test_iq_wav

MOST_SECONDS = 10  # of processor time, so that a busy machine makes no fault
MOST_BYTES = 3_000_000_000  # of data, where a run ends by force; what is asked for is `MOST_RESIDENT`
MOST_RESIDENT = 1_000_000_000

VALUES = [0, -1, 1, 1e300, -1e300, 1e-300, 10**400, float("nan"), float("inf"), "", "x", "1e400", None, True, [], {}]
VALUES += [[1, 2], {1: 2}, "\x1b[31m", "é" * 40, [[[]]], -(2**63), 2**31, 0.5, "../..", "a/b", {"a": {"b": None}}]
BYTES = [b"\x00", b"\xff\xfe", b"\n", b'"', b"{", b"[" * 200, b"1e300", b"nan", b"-", b"&a *a", b",", b"9" * 5000]


class Slow(BaseException):
    """Too much processor time."""


# ----------------------------------------------------------------------------------------------------- mutations


def places(data, path=()):
    """Return the paths of everything in nested lists and mappings."""
    found = [path] if path else []
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inner:
        found += places(value, (*path, key))
    return found


def spoil(data, rng):
    """Return nested data with one place replaced, scaled, removed, renamed or doubled."""
    data = copy.deepcopy(data)
    *way, last = rng.choice(places(data))
    holder = data
    for key in way:
        holder = holder[key]
    kind, old = rng.randrange(10), holder[last]
    if kind == 0:
        del holder[last]
    elif kind == 1 and isinstance(holder, dict):
        holder[rng.choice([1, None, True, "", "x", "truth", f"{last}x"])] = holder.pop(last)
    elif kind == 2 and isinstance(holder, list):
        holder.append(old)
    elif kind < 7 and isinstance(old, int | float) and not isinstance(old, bool):
        holder[last] = old * rng.choice([-1, 1e-6, 0.1, 10, 1e6, 1e12])
    else:
        holder[last] = rng.choice(VALUES)
    return data


def spoil_bytes(content, rng):
    """Return bytes with some removed, put in, doubled or cut off."""
    begin = rng.randrange(len(content))
    end = begin + rng.choice([1, 5, 40])
    kind = rng.randrange(4)
    if kind == 0:
        return content[:begin]
    if kind == 1:
        return content[:begin] + rng.choice(BYTES) + content[begin:]
    if kind == 2:
        return content[:begin] + content[end:]
    return content[:end] + content[begin:]


def spoil_table(text, rng):
    """Return lines of cells with one cell replaced."""
    lines = [line.split(",") for line in text.splitlines()]
    line = rng.choice(lines)
    line[rng.randrange(len(line))] = str(rng.choice([*VALUES, "1" * 140_000]))
    return "\n".join(",".join(cells) for cells in lines) + "\n"


class _Tagged(yaml.SafeDumper):
    """Writes mappings with ``_tag`` as they were read."""


def _mapping(dumper, data):
    tag = data.get("_tag")
    if not isinstance(tag, str) or not tag.startswith("!"):
        return dumper.represent_mapping("tag:yaml.org,2002:map", data, flow_style=True)
    return dumper.represent_mapping(tag, {k: v for k, v in data.items() if k != "_tag"}, flow_style=True)


_Tagged.add_representer(dict, _mapping)
_Tagged.ignore_aliases = lambda self, data: True


def written(data):
    return yaml.dump(data, Dumper=_Tagged, allow_unicode=True, sort_keys=False)


# --------------------------------------------------------------------------------------------------------- kinds


def command(*arguments):
    from quietfix.diagrams.commands.command_line import main

    main([str(one) for one in arguments])


SYSTEMS = ["three_satellite", "bearing_crossing", "beacon_rocket", "satellite_ranging", "dual_satellite"]


def scenario(rng, folder):
    from quietfix.diagrams.commands.catalogue import load_scenario
    from quietfix.diagrams.schema.scenario import dump
    from quietfix.diagrams.schema.yaml_text import load_yaml

    name = rng.choice(SYSTEMS)
    data = load_yaml(dump(load_scenario(name), comments=False))
    if "stop_s" in data:
        data["start_s"], data["stop_s"] = 100.0, 100.2
    else:
        data["duration_s"] = 200.0 if name == "satellite_ranging" else 2 * data["period_s"]
    for options in data["estimators"].values():
        if "particles" in options:
            options["particles"] = 200
    text = written(spoil(data, rng)).encode()
    (folder / "s.yaml").write_bytes(spoil_bytes(text, rng) if rng.random() < 0.2 else text)
    command("run", name, "--scenario", folder / "s.yaml", "--trials", 2)


REQUIREMENTS = {
    "system": "three_satellite",
    "trials": 60,
    "trial_limit": 60,
    "looks": 1,
    "seed": 1,
    "set": ["duration_s=2"],
    "cases": {"a": {"set": ["truth.cross_km=100"]}},
    "requirements": [
        {
            "name": "position",
            "case": "a",
            "estimator": "iekf",
            "metric": {"_tag": "!Rmse", "of": "position", "time_s": 2.0},
            "at_most": 1e4,
            "confidence": 0.9,
        },
        {"name": "n", "case": "a", "estimator": "ekf", "metric": {"_tag": "!Nees", "time_s": 1.0}, "at_most": 99.0},
    ],
}


def requirements(rng, folder):
    text = written(spoil(REQUIREMENTS, rng)).encode()
    (folder / "r.yaml").write_bytes(spoil_bytes(text, rng) if rng.random() < 0.2 else text)
    command("verify", folder / "r.yaml")


def bearings(rng, folder):
    lines = ["time_s,x_m,y_m,bearing_deg,sigma_deg"]
    lines += [f"{i},{100 * i},{10 * i},{40 - 2 * i},1" for i in range(8)]
    text = "\n".join(lines) + "\n"
    content = spoil_table(text, rng).encode() if rng.random() < 0.6 else spoil_bytes(text.encode(), rng)
    (folder / "b.csv").write_bytes(content)
    command("replay", "bearings", folder / "b.csv")


def locards(rng, folder):
    from quietfix.diagrams.readers.locards_data import read_sets

    sensors = "serial,latitude,longitude,height\n1,50,8,100\n2,50.5,8.5,200\n3,50.2,8.9,150\n"
    head = "aircraft,latitude,longitude,baroAltitude,geoAltitude,measurements\n"
    lines = [f'7,50,8,9000,9100,"[[1,{10**9 * i},20],[2,{10**9 * i + 500},21],[3,{10**9 * i + 90},3]]"' for i in (1, 2)]
    texts = {"sensors.csv": sensors, "set_1.csv": head + "\n".join(lines) + "\n"}
    name = rng.choice(list(texts))
    if rng.random() < 0.6:
        texts[name] = spoil_table(texts[name], rng)
    for one, text in texts.items():
        content = text.encode()
        (folder / one).write_bytes(spoil_bytes(content, rng) if one == name and rng.random() < 0.5 else content)
    read_sets(folder)


META = {
    "global": {
        "core:datatype": "cf32_le",
        "core:sample_rate": 1000.0,
        "core:version": "1.2.0",
        "core:num_channels": 2,
        "core:offset": 0,
        "core:dataset": "a.sigmf-data",
        "core:trailing_bytes": 3,
        "core:metadata_only": False,
        "core:geolocation": {"type": "Point", "coordinates": [11.5, 48.1, 500.0]},
    },
    "captures": [
        {"core:sample_start": 0, "core:frequency": 1e6, "core:datetime": "2026-03-01T12:00:00.5Z"},
        {
            "core:sample_start": 800,
            "core:global_index": 900,
            "core:header_bytes": 5,
            "core:frequency": 1e6,
            "core:datetime": "2026-03-01T12:00:01.400Z",
            "core:geolocation": {"type": "Point", "coordinates": [11.6, 48.1]},
        },
    ],
    "annotations": [{"core:sample_start": 2, "core:sample_count": 4}],
}


def hear(folder, name):
    """Read a recording, and prepare its comparison with itself, 2 ms of a kilohertz."""
    from quietfix.diagrams.readers.iq.any_file import read_iq
    from quietfix.diagrams.recorded.iq_compared import compared
    from quietfix.diagrams.recorded.settings.iq_settings import Settings

    found = read_iq(folder / name)
    compared([found[0], *found], Settings(integration_s=0.1, half_delay_us=2000.0, half_frequency_hz=50.0))


def sigmf(rng, folder):
    body = np.random.default_rng(1).standard_normal(2 * 2 * 1600).astype("<f4").tobytes()
    (folder / "a.sigmf-data").write_bytes(body[:12800] + bytes(5) + body[12800:] + bytes(3))
    if rng.random() < 0.1:
        about = {"collection": {"core:version": "1.2.0", "core:streams": [{"name": "a"}]}}
        (folder / "a.sigmf-meta").write_text(json.dumps(META))
        (folder / "b.sigmf-collection").write_text(json.dumps(spoil(about, rng)))
        hear(folder, "b.sigmf-collection")
        return
    text = json.dumps(spoil(META, rng)).encode()
    (folder / "a.sigmf-meta").write_bytes(spoil_bytes(text, rng) if rng.random() < 0.3 else text)
    hear(folder, "a.sigmf-meta")


def wav(rng, folder):
    kind, bits = rng.choice([(1, 8), (1, 16), (1, 24), (1, 32), (3, 32), (3, 64)])
    samples = np.random.default_rng(2).uniform(-0.5, 0.5, (400, 2)).view(complex)
    content = test_iq_wav.wav(samples, kind, bits, test_iq_wav.auxi(), rng.random() < 0.5, rate=1000)
    head = content.index(b"data") + 8
    spoilt = bytearray(content)
    for _ in range(rng.choice([0, 1, 2])):
        at = rng.randrange(head)
        spoilt[at] = rng.choice([0, 1, 2, 255, 128, rng.randrange(256)])
    content = bytes(spoilt)
    if rng.random() < 0.4:
        content = spoil_bytes(content[:head], rng) + content[head:]
    (folder / "a.wav").write_bytes(spoil_bytes(content, rng) if rng.random() < 0.2 else content)
    hear(folder, "a.wav")


def iq(rng, folder):
    """The whole way: SigMF metadata spoilt, compared and located by the command."""
    sigmf_files = ["a.sigmf-meta", "b.sigmf-meta", "c.sigmf-meta"]
    both = np.random.default_rng(3).standard_normal(4000).astype("<f4")
    for i, name in enumerate(sigmf_files):
        (folder / name.replace("meta", "data")).write_bytes(both.tobytes())
        place = {"type": "Point", "coordinates": [11.5 + 0.1 * i, 48.1 + 0.1 * i * i, 500.0]}
        about = {"core:datatype": "cf32_le", "core:sample_rate": 1e5, "core:geolocation": place}
        when = {"core:sample_start": 0, "core:frequency": 1e6, "core:datetime": "2026-03-01T12:00:00.500000Z"}
        meta = {"global": about, "captures": [when], "annotations": []}
        (folder / name).write_text(json.dumps(spoil(meta, rng) if i == 1 else meta))
    command("replay", "iq", *(folder / name for name in sigmf_files), "--set", "integration_s=0.005")


def sp3_text(epochs=14):
    """Return a short SP3-c file of one satellite in a circular orbit at 7700 km."""
    radius, rate = 7700.0, 9.3e-4
    head = [
        f"#cV2026  3  1  0  0  0.00000000 {epochs:7d} ORBIT IGS14 FIT  TST",
        "## 2408      0.00000000    60.00000000 61100 0.0000000000000",
        "+    1   L27" + "  0" * 16,
        "%c L  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
    ]
    for i in range(epochs):
        c, s = np.cos(60 * rate * i), np.sin(60 * rate * i)
        head.append(f"*  2026  3  1  0 {i:2d}  0.00000000")
        head.append("PL27" + "".join(f"{v:14.6f}" for v in (radius * c, radius * s, 0.0)) + f"{0.0:14.6f}")
        speed = 1e4 * radius * rate
        head.append("VL27" + "".join(f"{v:14.6f}" for v in (-speed * s, speed * c, 0.0)) + f"{0.0:14.6f}")
    return "\n".join([*head, "EOF"]) + "\n"


def sp3(rng, folder):
    from quietfix.systems.plants.sp3 import read_sp3

    text = sp3_text()
    if rng.random() < 0.5:
        lines = text.splitlines()
        at = rng.randrange(len(lines))
        column = rng.randrange(max(1, len(lines[at])))
        filling = rng.choice(["1e300", "nan", "inf", "-", "999999999", "0", "é", " " * 14])
        lines[at] = lines[at][:column] + filling + lines[at][column + len(filling) :]
        text = "\n".join(lines) + "\n"
        content = text.encode()
    else:
        content = spoil_bytes(text.encode(), rng)
    (folder / "o.sp3").write_bytes(content)
    read_sp3(folder / "o.sp3").inertial()


def attributes(rng, folder):
    if not (folder / "result").exists():
        command_quietly("run", "three_satellite", "--trials", 2, "--estimator", "iekf", "--set", "duration_s=2", folder)
    shutil.rmtree(folder / "spoilt", ignore_errors=True)
    shutil.copytree(folder / "result", folder / "spoilt")
    file = folder / "spoilt" / "results.zarr" / "zarr.json"
    about = json.loads(file.read_text())
    about["attributes"] = spoil(about["attributes"], rng)
    file.write_text(json.dumps(about))
    command("run", "--from", folder / "spoilt", "--trials", 2)


def command_quietly(*arguments):
    *arguments, folder = arguments
    with contextlib.suppress(SystemExit):
        command(*arguments, "--out", folder / "result")


FORMATS = (formats.tdm, formats.oem, formats.gpx, formats.platforms)
KINDS = {
    one.__name__: one for one in (scenario, requirements, bearings, locards, sigmf, wav, iq, sp3, *FORMATS, attributes)
}


# ------------------------------------------------------------------------------------------------------- judging


def judged(kind, number, folder):
    """Return what came of a mutation, and None or the fault."""
    said, out = io.StringIO(), io.StringIO()
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_SECONDS)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
            KINDS[kind](random.Random(f"{kind} {number}"), folder)
        return "ran", None
    except SystemExit as end:
        lines = [line for line in said.getvalue().splitlines() if not line.startswith("quietfix: warning: ")]
        if end.code == 2:
            return "refused", None if len(lines) == 1 else f"{len(lines)} lines: {said.getvalue()[:500]}"
        # verify: 1 and 3 are verdicts
        return "ran", None if end.code in (0, 1, 3) else f"status {end.code}: {said.getvalue()[:500]}"
    except ValueError as error:  # of a reader
        readers = ("locards", "sigmf", "wav", "sp3", *(one.__name__ for one in FORMATS))
        good = kind in readers and "\n" not in str(error)
        return "refused", None if good else traceback.format_exc()[-1500:]
    except Slow:
        return "slow", f"{MOST_SECONDS} s: {traceback.format_exc()[-1500:]}"
    except BaseException:
        return "failed", traceback.format_exc()[-1500:]
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _slow(number, frame):
    raise Slow


def _main(kind, first, count, folder):
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    signal.signal(signal.SIGVTALRM, _slow)
    os.chdir(folder)
    if kind == "attributes":  # what all of its mutations begin with
        with contextlib.redirect_stdout(io.StringIO()):
            command_quietly(
                "run", "three_satellite", "--trials", 2, "--estimator", "iekf", "--set", "duration_s=2", folder
            )
    outcomes, faults = {}, {}
    for number in range(first, first + count):
        outcome, fault = judged(kind, number, folder)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if fault is not None:
            faults[number] = fault
    print(json.dumps({"outcomes": outcomes, "faults": faults, "resident": peak_bytes()}))


if __name__ == "__main__":
    _main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
