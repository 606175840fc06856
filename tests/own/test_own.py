"""Systems of a user's own, as a user writes them: each a YAML file beside this one."""

import dataclasses
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams import run_study
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.trajectories.kepler import KeplerElements, state_of

HERE = Path(__file__).parent
FILES = sorted(path.name for path in HERE.glob("*.yaml") if not path.name.endswith(".requirements.yaml"))
C = 299_792_458.0

# Truth from the filter's own motion, started about where the file's target starts; what leaves the estimators the
# nominal case (a mirror image that one linearisation takes for the truth) is left out.
OWN_MOTION = {
    "drone.yaml": {
        "target": "!RandomMotion {start: !Straight {position_km: [-5, 2, 0.9], velocity_mps: [40, 5, 0]}}",
    },
    "ship.yaml": {
        "target": "!RandomMotion {start: !GreatCircle {latitude_deg: 12, longitude_deg: 14, speed_mps: 8}}",
        "start": "!Prior {sigma_position_m: 2000, sigma_velocity_mps: 1}",
    },
    "geostationary.yaml": {"target": "!RandomMotion {start: !Geodetic {latitude_deg: 48, longitude_deg: 11}}"},
    "beacon.yaml": {
        "target": "!RandomMotion {start: !Geodetic {latitude_deg: 46, longitude_deg: 14, height_m: 300}}",
        "start": "!Prior {sigma_position_m: 2000, sigma_velocity_mps: 0.1, sigma_offset_hz: 300}",
    },
    # as the rocket is 100 s after its launch
    "rocket.yaml": {
        "target": "!RandomMotion {start: !Straight {position_km: [-1840, 4653, 3979], velocity_mps: [-212, 852, -210]}}"
    },
}


def study(name, trials, changes=None, **options):
    return run_study(str(HERE / name), trials=trials, set=changes or {}, **options)


@pytest.mark.parametrize("name", FILES)
def test_as_it_stands(name):
    result = study(name, 2, {"duration_s": 30}, keep="all")
    assert np.isfinite(result["estimate"].isel(time=-1)).all()
    assert result["row"].size == result["measurement"].shape[-1]


@pytest.mark.parametrize("name", OWN_MOTION)
def test_consistent(name):
    """A tenth of the trials of the slow test: bands three times as wide."""
    check_consistent(name, 40, (0.75, 1.35), ["ukf"])


@pytest.mark.slow
@pytest.mark.parametrize("name", OWN_MOTION)
def test_consistent_and_at_the_bound(name):
    check_consistent(name, 400, (0.93, 1.12), ["ukf", "iekf"])


def check_consistent(name, trials, ratio, estimators):
    """RMSE over bound, and mean NEES, at five times, of every estimator."""
    result = study(name, trials, OWN_MOTION[name], estimators=estimators)
    last = result.sizes["time"] - 1
    at_five = result.isel(time=[last * k // 5 for k in range(1, 6)])
    error = (at_five["estimate"] - at_five["truth"]).sel(state=["x", "y", "z"])
    rmse = np.sqrt((error**2).sum("state").mean("trial"))
    relative = rmse / at_five["bound_position"]
    assert relative.sizes == {"estimator": len(estimators), "time": 5}
    assert ((relative > ratio[0]) & (relative < ratio[1])).all(), relative.values
    # The sum of the trials' NEES is chi-square. Five systems at five times are 25 looks: 5 % among all of them.
    freedom = trials * result.sizes["state"]
    low, high = chi2.ppf([0.025 / 25, 1 - 0.025 / 25], freedom) / freedom
    mean = at_five["nees"].mean("trial") / result.sizes["state"]
    assert ((mean > low) & (mean < high)).all(), (mean.values, low, high)


def test_short_files_are_short():
    lines = {name: len((HERE / name).read_text().splitlines()) for name in ("drone.yaml", "altitude.yaml")}
    assert lines["drone.yaml"] <= 25 and lines["altitude.yaml"] == 13


@pytest.mark.slow
def test_thirteen_lines_to_a_table(record_property):
    """From the command to its table, Python's own start included; the time is in the JUnit record, and printed."""
    began = time.monotonic()
    command = [sys.executable, "-m", "quietfix", "run", str(HERE / "altitude.yaml")]
    found = subprocess.run(command, capture_output=True, text=True, check=True, cwd=HERE.parents[1])
    seconds = time.monotonic() - began
    record_property("seconds", f"{seconds:.2f}")
    print(f"altitude.yaml, 100 trials of 100 s: {seconds:.2f} s")
    assert "RMSE of position" in found.stdout and "ekf" in found.stdout


def test_rows_are_named_after_platforms():
    result = study("drone.yaml", 1, {"duration_s": 4}, keep="measurements")
    rows = ["tdoa_alpha_delta", "tdoa_bravo_delta", "tdoa_charlie_delta", "azimuth_alpha", "altitude"]
    assert list(result["row"].values) == rows


def test_each_sensor_measures_at_its_own_rate():
    measured = study("drone.yaml", 1, {"duration_s": 12}, keep="measurements")["measurement"].isel(trial=0)
    seen = {
        row: measured["time"].values[np.isfinite(measured.sel(row=row).values)].tolist()
        for row in measured["row"].values
    }
    assert seen["tdoa_alpha_delta"] == list(range(13))
    assert seen["azimuth_alpha"] == [2, 6, 10] and seen["altitude"] == [0, 5, 10]


def test_rates_that_do_not_coincide_make_ticks_of_their_own():
    result = study("drone.yaml", 1, {"duration_s": 2, "sensors.bearing.every_s": 0.7, "sensors.bearing.offset_s": 0.1})
    np.testing.assert_allclose(result["time"], [0, 0.1, 0.8, 1, 1.5, 2], atol=1e-12)


def test_measurements_are_those_of_the_geometry():
    """Of the drone: every row without its noise, by formulae written out here."""
    quiet = {"sensors.tdoa.sigma_ns": 1e-3, "sensors.bearing.sigma_deg": 1e-9, "sensors.barometer.sigma_m": 1e-6}
    result = study("drone.yaml", 1, quiet | {"duration_s": 20}, estimators=["ekf"], keep="measurements")
    at = result.isel(trial=0).sel(time=10.0)
    truth, measured = result["truth"].sel(time=10.0).values, at["measurement"]
    places = {"alpha": (-8e3, -5e3, 30), "bravo": (9e3, -4e3, 120), "charlie": (1e3, 9e3, 60), "delta": (0, 0, 5)}
    distance = {name: np.linalg.norm(truth[:3] - place) for name, place in places.items()}
    for name in ("alpha", "bravo", "charlie"):
        delay = (distance[name] - distance["delta"]) / C
        assert float(measured.sel(row=f"tdoa_{name}_delta")) == pytest.approx(delay, abs=1e-11)  # ten sigmas
    azimuth = np.arctan2(truth[1] + 5e3, truth[0] + 8e3)
    assert float(measured.sel(row="azimuth_alpha")) == pytest.approx(azimuth, abs=1e-9)
    assert float(measured.sel(row="altitude")) == pytest.approx(900.0, abs=1e-4)


def test_a_geostationary_platform_hears_no_doppler():
    """In the equator's plane, two bodies: FDOA of a fixed emitter below 1e-4 Hz at 6 GHz."""
    rate, mu = 7.292115e-5, 3.986004418e14
    axis = (mu / rate**2) ** (1 / 3) / 1e3
    # satellites and their phases alone, so that nothing else is in it
    changes = {
        f"platforms.{name}": f"!Kepler {{semi_major_axis_km: {axis!r}, inclination_deg: 0, true_anomaly_deg: {u}}}"
        for name, u in (("a", 10), ("b", 16), ("c", -35))
    }
    quiet = changes | {"sensors.fdoa.sigma_hz": 1e-9, "duration_s": 300}
    result = study("geostationary.yaml", 1, quiet, estimators=["ukf"], keep="measurements")
    fdoa = result["measurement"].sel(row=[row for row in result["row"].values if row.startswith("fdoa")])
    assert np.abs(fdoa).max() < 1e-4


def test_frequency_is_that_of_the_range_rate_and_the_oscillator():
    """Of the beacon: by a difference of ranges over a second, to first order in v/c."""
    quiet = {"sensors.doppler.sigma_hz": 1e-6, "oscillator.sigma_offset_hz": 0, "oscillator.walk_hz2ps": 0}
    quiet |= {"sensors.doppler.minimum_elevation_deg": -90}
    result = study(
        "beacon.yaml", 1, quiet | {"duration_s": 60, "constants.j2": 0}, estimators=["ukf"], keep="measurements"
    )
    elements = KeplerElements(6978e3, 0.0, np.radians(82), np.radians(10), 0.0, np.radians(30))
    ground = geodetic_to_ecef(np.radians(46), np.radians(14), 300.0)
    motion = np.sqrt(3.986004418e14 / 6978e3**3)

    def distance(t):
        there = dataclasses.replace(elements, mean_anomaly=elements.mean_anomaly + motion * t)
        return np.linalg.norm(inertial_to_earth_fixed(state_of(there, 3.986004418e14), t)[:3] - ground)

    rate = (distance(30.1) - distance(29.9)) / 0.2
    expected = -401.65e6 / C * rate + 1200
    # a difference over 0.2 s: jerk of 1e-3 m/s^3 times 0.1^2/6
    found = float(result["measurement"].isel(trial=0).sel(time=30.0, row="frequency_satellite"))
    assert found == pytest.approx(expected, abs=1e-3)


def test_what_is_believed_may_differ():
    """A sigma that is believed three times too large lowers the NIS ninefold."""
    own = "!Tdoa {reference: delta, sigma_ns: 90}"
    right = study("drone.yaml", 20, {"duration_s": 60}, estimators=["ukf"])
    wrong = study("drone.yaml", 20, {"duration_s": 60, "belief.sensors": f"{{tdoa: {own}}}"}, estimators=["ukf"])
    assert float(wrong["nis"].mean()) < 0.4 * float(right["nis"].mean())


MISTAKES = {
    "unknown kind": ({"sensors.tdoa": "!Smell {}"}, "Smell"),
    "unknown frame": ({"frame": "galactic"}, "frame: 'galactic' is not allowed; one of local, earth_fixed, inertial"),
    "another frame's platform": (
        {"platforms.alpha": "!Kepler {}"},
        "platforms.alpha: !Kepler is not allowed in frame local",
    ),
    "a platform that is not there": ({"sensors.bearing.platform": "echo"}, "sensors.bearing.platform: echo"),
    "a receiver that is not there": ({"sensors.tdoa.receivers": "[bravo, echo]"}, "sensors.tdoa.receivers.1: echo"),
    "its own reference": ({"sensors.tdoa.receivers": "[bravo, delta]"}, "sensors.tdoa.receivers: delta is not allowed"),
    "a receiver twice": ({"sensors.tdoa.receivers": "[bravo, bravo]"}, "a platform is named twice"),
    "no estimator": ({"estimators": "{}"}, "estimators: none is given"),
    "no sensor": ({"sensors": "{}"}, "sensors: none is given"),
    "no platform": ({"platforms": "{}"}, "platforms: none is given"),
    "a belief in no sensor": ({"belief.sensors": "{smell: !Altitude {}}"}, "belief.sensors: smell"),
    "a belief that lacks a row": (
        {"belief.sensors": "{tdoa: !Tdoa {reference: delta, receivers: [bravo]}}"},
        "belief.sensors.tdoa: rows",
    ),
    "a sensor's name": ({"sensors": "{known: !Altitude {}}"}, "sensors.known: the name known is not allowed"),
    "a sensor named as an estimator": ({"sensors": "{ekf: !Altitude {}}"}, "sensors.ekf: the name ekf is not allowed"),
    "a name for a file": ({"platforms": "{a b: !Fixed {}}"}, "platforms: the name 'a b' is not allowed"),
    "a mask on a flat Earth": ({"sensors.tdoa.minimum_elevation_deg": 5}, "it is for frame earth_fixed only"),
    "light time on a flat Earth": ({"sensors.tdoa.light_time": True}, "light_time: true is for frame earth_fixed only"),
    "too late": ({"sensors.bearing.offset_s": 1e4}, "sensors.bearing.offset_s: 10000 is not allowed"),
    "a kind that is not measured": ({"estimators.ekf.measurements": "[smell]"}, "estimators.ekf.measurements: smell"),
    "a late clock that nobody has": (
        {"sensors.tdoa.errors.clock_offset_ns": 5, "sensors.tdoa.errors.clock_offset_platform": "echo"},
        "sensors.tdoa.errors.clock_offset_platform: echo is not known; there are alpha, bravo, charlie, delta",
    ),
    "a late clock that is not compared": (
        {
            "sensors.tdoa.receivers": "[bravo, charlie]",
            "sensors.tdoa.errors.clock_offset_ns": 5,
            "sensors.tdoa.errors.clock_offset_platform": "alpha",
        },
        "sensors.tdoa.errors.clock_offset_platform: alpha is not known; there are bravo, charlie, delta",
    ),
    "clock of a bearing": (
        {"sensors.bearing.errors.clock_offset_ns": 5},
        "sensors.bearing.errors.clock_offset_ns: 5 is not allowed",
    ),
    "orbit on a flat Earth": ({"belief.motion": "!Orbital {}"}, "belief.motion: !Orbital is for frame inertial only"),
    "a target on a station": (
        {"target": "!Fixed {up_m: 5}"},
        "target: at 0 s it is where platforms.delta is, which has no direction to it",
    ),
    "a target that starts on a station": (
        {"target": "!RandomMotion {start: !Fixed {up_m: 5}}"},
        "target: at 0 s it is where platforms.delta is",
    ),
    "a way there and back": (
        {"target.points_km": "[[0, 0], [5, 0], [0, 0]]"},
        "target: waypoints: at 1 the course is reversed; a turn of less than 180 deg is needed",
    ),
    "too few numbers": (
        {"target": "!Straight {position_km: [1, 2]}"},
        "target.position_km: [1.0, 2.0] is not allowed; 3 finite",
    ),
}


@pytest.mark.parametrize("title", MISTAKES)
def test_mistakes_are_one_clear_line(title):
    changes, words = MISTAKES[title]
    with pytest.raises(UserError) as caught:
        study("drone.yaml", 1, changes)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_target_beside_a_station_and_one_that_leaves_it_at_random():
    near = study("drone.yaml", 2, {"duration_s": 2, "target": "!Fixed {up_m: 5.1}"}, estimators=["ukf"])
    random = {"target": "!RandomMotion {start: !Fixed {up_m: 5}, sigma_position_m: 10}", "duration_s": 2}
    for result in (near, study("drone.yaml", 2, random, estimators=["ukf"])):
        assert (result["bound_position"] < 200).all()  # of a prior of 1386 m


def test_a_straight_course_does_not_begin_inside_the_earth():
    with pytest.raises(UserError, match=r"target\.position_km: \[0\.0, 0\.0, 0\.0\] is not allowed.* inside the Earth"):
        study("ship.yaml", 1, {"target": "!Straight {velocity_mps: [8, 0, 0]}"})


def test_a_target_that_nobody_sees():
    with pytest.raises(
        UserError, match=r"sensors\.doppler\.minimum_elevation_deg: 5 is not allowed; no platform ever sees"
    ):
        study("beacon.yaml", 1, {"target.longitude_deg": -160})


S2S = """
frame: inertial
duration_s: 300
platforms: {watcher: !Kepler {semi_major_axis_km: 7000, inclination_deg: 50}}
target: !Kepler {semi_major_axis_km: 7100, inclination_deg: 51, true_anomaly_deg: 2}
sensors:
  rel: !Relative {sigma_azimuth_rate_degps: 0.001, sigma_elevation_rate_degps: 0.001,
    sigma_radial_velocity_mps: 1, sigma_radial_acceleration_mps2: 0.01, every_s: 10}
belief: {motion: !Orbital {}}
start: !Prior {sigma_position_m: 5000, sigma_velocity_mps: 10}
estimators: {bank: !Bank {}}
"""


def test_the_bank_of_roots_takes_the_six_rows_by_their_names(tmp_path):
    (tmp_path / "s2s.yaml").write_text(S2S)
    result = run_study(str(tmp_path / "s2s.yaml"), trials=8)
    nees = result["nees"].sel(estimator="bank").values[:, 1:]
    assert 0.3 < np.median(nees) / 5.35 < 3.0  # median of chi2(6) is 5.35; 8 trials of the root that is right
    with pytest.raises(UserError, match="ra_paper: it needs preview, which nothing in this system gives"):
        run_study(str(tmp_path / "s2s.yaml"), estimators=["ra_paper"], trials=2)
