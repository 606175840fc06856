"""Raw arrival times of a system of one's own: any station may be deaf, counters are large, and nothing is lost."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join
from quietfix.systems.constants import SPEED_OF_LIGHT

PLACES = {"a": (-8, -5, 30), "b": (9, -4, 120), "c": (1, 9, 60), "d": (0, 0, 5), "e": (-6, 7, 300)}
SIGMA = 30e-9
SYSTEM = """
duration_s: 100
platforms:
{platforms}
target: null
sensors:
  toa: !Toa {{sigma_ns: {sigma}}}
  altitude: !Altitude {{sigma_m: 20}}
start: !Snapshot {{sensors: [toa, altitude], height_m: 1000}}
belief: {{motion: !WhiteNoiseAcceleration {{density_m2ps3: 0.1}}}}
estimators: {{iekf: !Iekf {{}}}}
"""


def system(folder, sigma=30):
    stations = "\n".join(f"  {n}: !Fixed {{east_km: {x}, north_km: {y}, up_m: {z}}}" for n, (x, y, z) in PLACES.items())
    (folder / "mine.yaml").write_text(SYSTEM.format(platforms=stations, sigma=sigma))
    return folder / "mine.yaml"


def table(folder, messages, unit="ns"):
    """Write messages of (target, time, {station: arrival in ns}, altitude); stations in any order."""
    rows = ["value;kind;unit;receiver;target;time_s"]
    for target, time, arrivals, altitude in messages:
        rows += [f"{v};toa;{unit};{n};{target};{time}" for n, v in arrivals.items()]
        rows.append(f"{altitude};altitude;m;;{target};{time}")
    (folder / "log.csv").write_text("\n".join(rows) + "\n")
    return folder / "log.csv"


def scene(count=30, seed=1):
    """One message of each of many targets, heard by four of five stations: the first one is deaf to a fifth."""
    rng = np.random.default_rng(seed)
    stations = {name: np.array([1e3, 1e3, 1]) * place for name, place in PLACES.items()}
    messages, truth = [], {}
    for k in range(count):
        x = np.array([*rng.uniform(-6e3, 6e3, 2), rng.uniform(500, 4000)])
        heard = rng.permutation(list(PLACES))[:4]
        delay = {n: np.linalg.norm(x - stations[n]) / SPEED_OF_LIGHT + rng.normal(0, SIGMA) for n in heard}
        # a counter that has run for nine days: a double still has every nanosecond
        arrivals = {str(n): 777_000_000_000_000 + 10**6 * k + round(1e9 * one) for n, one in delay.items()}
        messages.append((f"f-{k}", k, arrivals, round(x[2] + rng.normal(0, 20), 3)))
        truth[f"f-{k}"] = x
    return stations, messages, truth


def run(yaml, file, *settings):
    study = Study(find(str(yaml)), set=[f"measurements.file={file}", *settings])
    return join(list(study.chunks())), study


def test_every_message_is_located_whoever_is_deaf(tmp_path):
    stations, messages, truth = scene()
    result, study = run(system(tmp_path), table(tmp_path, messages))
    assert any(row.startswith("toa_") and not row.endswith("_a") for row in study.model.rows)
    nees = []
    for k, (name, _, arrivals, altitude) in enumerate(messages):
        one = result.isel(trial=k, estimator=0, epoch=0)
        assert str(one["track"].values) == name
        found, spread = one["estimate"].values[:3], one["covariance"].values[:3, :3]
        stamps = np.array(list(arrivals.values()))
        ranges = (stamps - stamps.min()) * 1e-9 * SPEED_OF_LIGHT
        where = np.array([stations[n] for n in arrivals])

        def residuals(x, where=where, ranges=ranges, altitude=altitude):
            off = np.linalg.norm(1e3 * x[:3] - where, axis=1) - ranges - 1e3 * x[3]
            return np.append(off / (SIGMA * SPEED_OF_LIGHT), (1e3 * x[2] - altitude) / 20)

        expected = least_squares(residuals, [*(truth[name] / 1e3), 5.0], xtol=1e-14, ftol=1e-14, x_scale="jac")
        np.testing.assert_allclose(found, 1e3 * expected.x[:3], atol=0.05)
        inverse = np.linalg.inv(expected.jac.T @ expected.jac)[:3, :3] * 1e6
        np.testing.assert_allclose(spread, inverse, rtol=1e-3, atol=1e-2 * np.abs(inverse).max())
        nees.append((found - truth[name]) @ np.linalg.solve(spread, found - truth[name]))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high


def test_sigma_of_a_row_is_that_of_an_arrival(tmp_path):
    _, messages, _ = scene(6)
    file = table(tmp_path, messages)
    plain, _ = run(system(tmp_path, 60), file)
    lines = file.read_text().splitlines()
    told = [lines[0] + ";sigma", *(line + (";60" if ";toa;" in line else ";") for line in lines[1:])]
    file.write_text("\n".join(told) + "\n")
    scaled, _ = run(system(tmp_path, 30), file)
    np.testing.assert_allclose(scaled["covariance"].values, plain["covariance"].values, rtol=1e-6, atol=1e-6)


def test_what_is_wrong_or_left_out_is_said(tmp_path):
    _, messages, _ = scene(5)
    yaml = system(tmp_path)
    target, time, arrivals, altitude = messages[0]
    messages[0] = (target, time, dict(list(arrivals.items())[:1]), altitude)
    _, study = run(yaml, table(tmp_path, messages))
    assert "1 of 5 messages were heard by one station only" in study.model.note
    file = table(tmp_path, messages)
    file.write_text(file.read_text() + f"5;toa;ns;{next(iter(messages[1][2]))};f-1;1\n")
    with pytest.raises(UserError, match=r"log.csv:\d+: toa [a-e] is there twice at one time; line \d+ has it already"):
        run(yaml, file)
    file.write_text("value,kind,unit,receiver,time_s\n5,toa,ns,z,0\n6,toa,ns,a,0\n")
    with pytest.raises(UserError, match=r"log.csv:2: receiver"):
        run(yaml, file)
    file.write_text("value,kind,unit,receiver,time_s\n5,toa,ns,b,0\n6,toa,ns,a,1\n")
    with pytest.raises(UserError, match="no message was heard by two stations"):
        run(yaml, file)
    file.write_text("value,kind,unit,receiver,time_s\n5,toa,ns,b,0\n6,toa,m,a,0\n")
    with pytest.raises(UserError, match=r"log.csv:.: unit: m is not allowed"):
        run(yaml, file)
