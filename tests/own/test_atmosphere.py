"""Air and ionosphere as truth and as belief: what they do to a fix, and that a filter that knows them is consistent."""

import numpy as np
import pytest
from scipy.stats import chi2

from quietfix.diagrams import run_study
from quietfix.diagrams.assembly.find import find
from quietfix.systems.atmosphere.delayed import excess
from quietfix.systems.atmosphere.ionosphere import ThinShell
from quietfix.systems.atmosphere.troposphere import Troposphere
from quietfix.systems.earth.geodetic import geodetic_state
from tests.diagrams.test_command_line import in_process

C, CARRIER = 299_792_458.0, 400e6
STATIONS = geodetic_state(
    *np.radians([[48, 48.6, 48.1, 48.5], [11, 11.2, 12.1, 12]]), np.array([500, 400, 600, 450]), 0.0, 0.0
)
AIRCRAFT = """
frame: earth_fixed
duration_s: 20
platforms:
  a: !Geodetic {latitude_deg: 48, longitude_deg: 11, height_m: 500}
  b: !Geodetic {latitude_deg: 48.6, longitude_deg: 11.2, height_m: 400}
  c: !Geodetic {latitude_deg: 48.1, longitude_deg: 12.1, height_m: 600}
  d: !Geodetic {latitude_deg: 48.5, longitude_deg: 12.0, height_m: 450}
target: !RandomMotion
  start: !StraightLine {latitude_deg: 48.9, longitude_deg: 12.8, height_m: 9000, course_deg: 250, speed_mps: 220}
  sigma_position_m: 300
  sigma_velocity_mps: 10
atmosphere: {troposphere: {}}
sensors:
  toa: !Toa {sigma_ns: 3}
  range_rate: !RangeRate {sigma_mps: 0.05, stations: [a, c]}
  barometer: !Altitude {sigma_m: 10}
belief:
  motion: !WhiteNoiseAcceleration {density_m2ps3: 0.1}
start: !Prior {sigma_position_m: 300, sigma_velocity_mps: 10}
estimators:
  iekf: !Iekf {}
  ukf: !Ukf {}
"""
SATELLITES = """
frame: earth_fixed
duration_s: 20
reference_orbit: {altitude_km: 700, inclination_deg: 60}
platforms:
  s0: !Offset {along_km: 0, across_km: 400}
  s1: !Offset {along_km: -400}
  s2: !Offset {along_km: 400}
target: !Geodetic {latitude_deg: 2.47, longitude_deg: 14.9, height_m: 1000}
atmosphere: {troposphere: {}, ionosphere: {tec_tecu: 40, carrier_mhz: 400}}
sensors:
  tdoa: !Tdoa {sigma_ns: 20}
  fdoa: !Fdoa {sigma_hz: 1, carrier_mhz: 400}
belief:
  motion: !ConstantVelocity {acceleration_mps2: 0.01}
start: !KnownHeight {sigma_height_m: 100, sigma_velocity_mps: 10}
estimators:
  iekf: !Iekf {}
"""


@pytest.fixture
def own(tmp_path):
    def make(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return str(path)

    return make


def biases(result, estimator="iekf"):
    """Mean error of the last epoch (3,) [m], and the standard deviation of that mean."""
    at = result.sel(estimator=estimator).isel(time=-1)
    error = (at["estimate"] - at["truth"]).values[:, :3]
    return error.mean(axis=0), error.std(axis=0) / np.sqrt(len(error))


def test_a_filter_that_knows_the_air_is_consistent(own):
    """Truth and belief are one model: NEES in its 95 % band at every epoch together, RMSE at the bound."""
    trials = 60
    result = run_study(own(AIRCRAFT), trials=trials, seed=3)
    last = result.isel(time=-1)
    # six states; of two estimators and one epoch
    low, high = chi2.ppf([0.0125, 0.9875], 6 * trials) / trials
    error = (last["estimate"] - last["truth"]).values[..., :3]
    for i, name in enumerate(result["estimator"].values):
        assert low < float(last["nees"].sel(estimator=name).mean()) < high, name
        rmse = np.sqrt((error[i] ** 2).sum(axis=-1).mean())
        bound = float(last["bound_position"].sel(estimator=name))
        # the error's three axes differ, so that the RMSE of n trials spreads by up to 1/sqrt(2 n): three of them
        assert rmse / bound == pytest.approx(1.0, abs=3 / np.sqrt(2 * trials)), name


def test_air_that_is_not_believed_is_a_bias_of_the_size_of_its_delays(own):
    """Least squares of the unmodelled delays, which grow with the distance by 0.2 m/km, at the last place."""
    result = run_study(
        own(AIRCRAFT), trials=40, seed=4, estimators=["iekf"], set={"belief.atmosphere": "{troposphere: null}"}
    )
    mean, deviation = biases(result)
    state = result["truth"].isel(time=-1).mean("trial").values.squeeze()[:6]
    late = excess([Troposphere()], state, STATIONS).path
    offset = state[:3] - STATIONS[:, :3]
    unit = offset / np.linalg.norm(offset, axis=1)[:, None]
    up = (
        geodetic_state(np.radians(48.9), np.radians(12.8), 1.0, 0, 0)[:3]
        - geodetic_state(np.radians(48.9), np.radians(12.8), 0.0, 0, 0)[:3]
    )
    # differences to the first station, whose errors are correlated as times of arrival are; and the height
    rows = np.vstack([unit[1:] - unit[0], up])
    weight = np.linalg.inv(
        np.block(
            [
                [(3e-9 * C) ** 2 * (np.eye(3) + 1), np.zeros((3, 1))],
                [np.zeros((1, 3)), np.full((1, 1), 100.0)],
            ]
        )
    )
    expected = np.linalg.solve(rows.T @ weight @ rows, rows.T @ weight @ np.append(late[1:] - late[0], 0.0))
    assert np.linalg.norm(expected) > 20
    # range rates, prior and motion of the filter pull it less than a quarter off that of the delays alone
    assert np.linalg.norm(mean - expected) < 0.25 * np.linalg.norm(expected) + 3 * np.linalg.norm(deviation)


def test_from_orbit(own):
    """A fix on the ground at known height, air and ionosphere in truth: believed, ignored, and half the electrons."""
    file = own(SATELLITES)
    error = {}
    for name, setting in {
        "believed": {},
        "ignored": {"belief.atmosphere": "{}"},
        "half": {"belief.atmosphere": "{troposphere: {}, ionosphere: {tec_tecu: 20, carrier_mhz: 400}}"},
    }.items():
        error[name] = biases(run_study(file, trials=30, seed=5, set=setting))
    mean, deviation = error["believed"]
    assert np.all(np.abs(mean) < 4 * deviation)
    whole, half = (np.linalg.norm(error[name][0]) for name in ("ignored", "half"))
    assert whole > 10 * np.linalg.norm(deviation) and half == pytest.approx(whole / 2, rel=0.15)


def test_what_each_row_gets(own):
    """The first measurement, noise of 1e-3: of all kinds that have a path, by hand."""
    text = AIRCRAFT.split("sensors:")[0].replace("troposphere: {}", "ionosphere: {tec_tecu: 30, carrier_mhz: 300}")
    text = text.split("target:")[0] + (
        "target: !Kepler {semi_major_axis_km: 7078, inclination_deg: 60, argument_of_latitude_deg: 60, raan_deg: -18}\n"
        "atmosphere: {troposphere: {humidity_percent: 80}, ionosphere: {tec_tecu: 30, carrier_mhz: 300}}\n"
        "belief: {atmosphere: {}}\n"
        "sensors:\n"
        "  tdoa: !Tdoa {sigma_ns: 1.0e-6}\n"
        "  fdoa: !Fdoa {sigma_hz: 1.0e-6, carrier_mhz: 400, paper_sign: true}\n"
        "  distance: !Range {sigma_m: 1.0e-6}\n"
        "  speed: !RangeRate {sigma_mps: 1.0e-8}\n"
        "  received: !Frequency {sigma_hz: 1.0e-6, carrier_mhz: 400}\n"
        "start: !Prior {}\n"
        "estimators: {iekf: !Iekf {}}\n"
    )
    text = text.replace("argument_of_latitude_deg: 60, ", "true_anomaly_deg: 60, ")
    result = run_study(own(text), trials=1, seed=1, keep="all", set={"duration_s": "2"})
    bare = run_study(
        own(text), trials=1, seed=1, keep="all", set={"duration_s": "2", "atmosphere": "{}", "belief.atmosphere": "{}"}
    )
    added = (result["measurement"] - bare["measurement"]).isel(trial=0, time=0).values
    state = result["truth"].isel(time=0).values.reshape(-1)[:6]
    air = Troposphere(humidity=0.8)
    group = excess([air, ThinShell(30, 350e3, 300e6)], state, STATIONS).path
    carried = excess([air, ThinShell(30, 350e3, 300e6)], state, STATIONS, phase=True).rate
    doppler = excess([air, ThinShell(30, 350e3, CARRIER)], state, STATIONS, phase=True).rate * CARRIER / C
    expected = np.concatenate([(group[1:] - group[0]) / C, doppler[1:] - doppler[0], group, carried, -doppler])
    assert np.abs(group).min() > 1 and np.abs(doppler).min() > 1e-6
    np.testing.assert_allclose(added, expected, rtol=1e-6, atol=1e-12)


REFUSED = {
    "frame": (
        {"frame: earth_fixed": "frame: inertial"},
        "atmosphere: it is for frame earth_fixed only, this is inertial",
    ),
    "carrier": (
        {", carrier_mhz: 400}}": "}}"},
        "atmosphere.ionosphere.carrier_mhz: none is given; sensors.tdoa needs it",
    ),
    "belief": (
        {"belief:\n": "belief:\n  atmosphere: {ionosphere: {}}\n"},
        "belief.atmosphere.ionosphere.carrier_mhz: none is given; sensors.tdoa needs it",
    ),
    "electrons": ({"tec_tecu: 40": "tec_tecu: -1"}, "tec_tecu"),
    "shell": ({"tec_tecu: 40": "shell_km: 20"}, "shell_km"),
    "pressure": ({"troposphere: {}": "troposphere: {pressure_hpa: 2000}"}, "pressure_hpa"),
    "word": ({"troposphere: {}": "troposphere: saastamoinen"}, "troposphere"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_one_line(case, own, capsys):
    changes, message = REFUSED[case]
    text = SATELLITES
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    status, out, err = in_process(capsys, "run", own(text), "--trials", "2")
    assert status == 2 and not out and err.count("\n") == 1 and message in err, err


def test_what_is_measured_as_in_vacuum_is_said(own):
    system = find(own(SATELLITES.replace("sensors:\n", "sensors:\n  phase: !Phase {platform: s0}\n"))).system
    assert "atmosphere: phase is as in vacuum" in system.declare(system.resolve(None, None, {})).note
    system = find(own(SATELLITES)).system
    assert "vacuum" not in system.declare(system.resolve(None, None, {})).note
