"""Sensors and starts of a system of one's own."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.own.system import own_system
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import load, read_yaml
from quietfix.systems.signals import Draw, set_draw
from tests.diagrams.test_command_line import in_process

HERE = Path(__file__).parent

LOCAL = """
frame: local
duration_s: 20
platforms:
  alpha: !Fixed {east_km: -8, north_km: -5, up_m: 30}
  bravo: !Fixed {east_km: 9, north_km: -4, up_m: 120}
  charlie: !Fixed {east_km: 1, north_km: 9, up_m: 60}
  delta: !Fixed {east_km: 0, north_km: 0, up_m: 5}
target: !Straight {position_km: [-2, 3, 1], velocity_mps: [40, 10, 0]}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-6}}
start: !Prior {sigma_position_m: 300, sigma_velocity_mps: 5}
estimators: {ekf: !Ekf {}}
"""


def declared(text, folder=HERE, trials=1):
    """A system, its scenario and what is under construction."""
    (file := Path(folder) / "mine.yaml").write_text(text)
    system = own_system(file)
    scenario = load(system.scenario, [read_yaml(file)])
    builder = DiagramBuilder()
    return builder, system.build(builder, scenario, list(scenario.estimators), trials)


def end(text, folder, trials=50, name="ekf"):
    """Errors (trials, 6) and covariances of an estimator at the end of a run."""
    builder, assembly = declared(text, folder, trials)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(0, 0))
    simulator = Simulator(diagram, context)
    simulator.Initialize()
    simulator.AdvanceTo(assembly.duration)
    block = assembly.estimators[name]

    def read(port, owner):
        return port.Eval(owner.GetMyContextFromRoot(context))

    estimate = read(block.GetOutputPort("estimate"), block).reshape(trials, -1)
    truth = read(assembly.truth, assembly.truth.get_system()).reshape(-1, estimate.shape[1])
    covariance = read(block.GetOutputPort("covariance"), block).reshape(trials, *estimate.shape[1:] * 2)
    return estimate - truth, covariance


def nees(error, covariance):
    return np.mean(np.einsum("ti,tij,tj->t", error, np.linalg.inv(covariance), error)) / error.shape[1]


# ------------------------------------------------------------------------------------------------- !Custom

MODEL = """\
import numpy as np
from quietfix.systems.measurement.base import MeasurementModel


class Ranges(MeasurementModel):
    def __init__(self, sigma_m=10.0, stations=2):
        self.sigma = sigma_m
        self.names = tuple(f"distance_{i}" for i in range(stations))
        self.units = ("m",) * stations

    def predict(self, target, platforms):
        offset = target[..., None, :3] - platforms[..., :3]
        return np.sqrt((offset**2).sum(axis=-1))

    def noise_covariance(self):
        return self.sigma**2 * np.eye(self.size)


class Flat(Ranges):
    def predict(self, target, platforms):
        return super().predict(target, platforms)[..., 0]


class Broken(Ranges):
    def predict(self, target, platforms):
        raise ZeroDivisionError("nothing here")


class Bare:
    names = ("a",)


class Writes(Ranges):
    def predict(self, target, platforms):
        target[..., 0] += 1e3
        return super().predict(target, platforms)


class Rolls(Ranges):
    def predict(self, target, platforms):
        return super().predict(target, platforms) + np.random.standard_normal(self.size)


class Doubles(Ranges):
    factor = 2.0

    def jacobian(self, target, platforms):
        offset = target[..., None, :3] - platforms[..., :3]
        direction = offset / np.sqrt((offset**2).sum(axis=-1, keepdims=True))
        return self.factor * np.concatenate([direction, np.zeros_like(direction)], axis=-1)


class Right(Doubles):
    factor = 1.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("own")
    (place / "my_sensor_models.py").write_text(MODEL)
    return place


def custom(kind, options="{}", platforms="[alpha, charlie]"):
    entry = f"{{class: 'my_sensor_models:{kind}', options: {options}, platforms: {platforms}}}"
    return LOCAL + f"sensors:\n  own: !Custom {entry}\n  height: !Altitude {{}}\n"


def test_a_model_of_ones_own_without_a_jacobian_is_the_built_in_one(folder):
    ours = LOCAL + "sensors:\n  own: !Range {stations: [alpha, charlie], sigma_m: 12}\n  height: !Altitude {}\n"
    expected, expected_covariance = end(ours, folder)
    error, covariance = end(custom("Ranges", "{sigma_m: 12.0}"), folder)
    # the differences' own error, 1e-8 of the gradient, over 20 updates
    np.testing.assert_allclose(error, expected, atol=1e-4)
    np.testing.assert_allclose(covariance, expected_covariance, rtol=1e-5, atol=1e-5)


def test_differences_are_said_once(folder):
    _, assembly = declared(custom("Ranges"), folder)
    assert assembly.note == "Jacobian of own: central differences, as the class has none of its own."


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("Ranges", "{stations: 3}", r"Ranges.predict: an array of shape \(2, 2\) is not allowed .*; \(2, 3\)"),
        ("Flat", "{}", r"Flat.predict: an array of shape \(2,\) is not allowed .*; \(2, 2\)"),
        (
            "Broken",
            "{}",
            r"Broken.predict failed with ZeroDivisionError: nothing here \(my_sensor_models.py, line 26\)",
        ),
        ("Writes", "{}", r"Writes.predict failed with ValueError: .*read-only \(my_sensor_models.py, line 35\)"),
        ("Rolls", "{}", r"Rolls.predict: two calls with the same arguments give different numbers"),
        ("Bare", "{}", r"my_sensor_models:Bare is not allowed; a subclass of"),
        ("Ranges", "{sigma: 1.0}", r"options: my_sensor_models:Ranges says: TypeError"),
        ("Ranges", "{sigma_m: 0.0}", r"Ranges.noise_covariance: it must be symmetric and finite"),
        ("Rangs", "{}", r"module my_sensor_models has no Rangs"),
    ],
)
def test_a_model_that_is_wrong_is_refused_by_name(folder, kind, options, words):
    with pytest.raises(UserError, match=r"sensors\.own[.:].*" + words) as caught:
        end(custom(kind, options), folder, 1)
    assert "\n" not in str(caught.value)


def test_a_jacobian_that_is_none_is_told(folder):
    assert declared(custom("Right"), folder)[1].note == ""
    note = declared(custom("Doubles"), folder)[1].note
    assert note == "sensors.own: my_sensor_models:Doubles.jacobian is 0.5 of the gradient off that of predict."


def test_what_fails_in_a_run_is_told_with_its_line(capsys, folder, monkeypatch):
    """Far from where the model was asked once."""
    monkeypatch.chdir(folder)
    (folder / "my_late_models.py").write_text(
        "from my_sensor_models import Ranges\n"
        "class Late(Ranges):\n"
        "    def predict(self, target, platforms):\n"
        "        assert (abs(target[..., 0]) < 1e5).all(), 'too far'\n"
        "        return super().predict(target, platforms)\n"
    )
    text = custom("Ranges").replace("my_sensor_models:Ranges", "my_late_models:Late")
    (folder / "late.yaml").write_text(text)
    line = 1 + next(i for i, one in enumerate(text.splitlines()) if "own: !Custom" in one)
    status, _, err = in_process(capsys, "run", "late.yaml", "--trials", "2", "--set", "start.sigma_position_m=1e7")
    assert status == 2 and err.startswith(f"quietfix: late.yaml:{line}: sensors.own: my_late_models:Late.predict ")
    assert err.count("\n") == 1 and err.endswith("AssertionError: too far (my_late_models.py, line 4)\n")


def test_a_row_that_two_sensors_have_is_refused(folder):
    text = LOCAL + "sensors:\n  one: !Altitude {}\n  two: !Altitude {every_s: 2}\n"
    with pytest.raises(UserError, match=r"sensors.two: row altitude is not allowed; sensors.one has it already"):
        declared(text, folder)


# ------------------------------------------------------------------------------------------------- starts

RANGES = "sensors:\n  range: !Range {sigma_m: 20}\n  height: !Altitude {sigma_m: 15}\n"
SATELLITES = """
frame: earth_fixed
duration_s: 20
constants: {j2: 0}
platforms:
  a: !Kepler {semi_major_axis_km: 7078, inclination_deg: 60, true_anomaly_deg: 2}
  b: !Kepler {semi_major_axis_km: 7078, inclination_deg: 60, true_anomaly_deg: 3}
  c: !Kepler {semi_major_axis_km: 7078, inclination_deg: 60, raan_deg: 1, true_anomaly_deg: 2}
target: !GreatCircle {latitude_deg: 3, longitude_deg: 3, height_m: 8000, speed_mps: 200}
belief: {motion: !WhiteNoiseAcceleration {density_m2ps3: 1.0e-3}}
estimators: {ekf: !Iekf {}}
"""


def started(text, start):
    kept = "".join(line + "\n" for line in text.splitlines() if not line.startswith("start:"))
    return kept + f"start: {start}\n"


@pytest.mark.parametrize(
    ("text", "start"),
    [
        (LOCAL + RANGES, "!Snapshot {sigma_velocity_mps: 40}"),
        (SATELLITES + RANGES, "!Snapshot {sensors: [range], height_m: 9000, sigma_velocity_mps: 150}"),
        (SATELLITES + "sensors:\n  tdoa: !Tdoa {}\n", "!KnownHeight {sigma_height_m: 500, sigma_velocity_mps: 150}"),
    ],
    ids=["snapshot, local", "snapshot, earth_fixed", "known height"],
)
def test_a_start_by_a_fix_is_as_good_as_it_says(folder, text, start):
    _, assembly = declared(started(text, start), folder)
    prior, spent = assembly.estimators["ekf"].bound_prior(
        *(
            port.Eval(port.get_system().CreateDefaultContext()).reshape(shape)
            for port, shape in ((assembly.truth, (1, -1)), (assembly.platforms, (1, -1, 6)))
        )
    )
    assert spent and np.linalg.eigvalsh(prior[0])[0] > 0
    # so soon after the fix its covariance is all that there is
    brief = started(text, start).replace("duration_s: 20", "duration_s: 0.001")
    error, covariance = end(brief, folder, 200)
    position = slice(0, 3)
    # the mean of 200 chi-square of 3, over 3: standard deviation 0.058; four of them
    assert abs(nees(error[:, position], covariance[:, position, position]) - 1) < 0.23
    ratio = np.trace(np.mean(covariance, axis=0)[position, position]) / np.trace(prior[0, position, position])
    assert 0.8 < ratio < 1.25


@pytest.mark.parametrize(
    ("text", "start", "words"),
    [
        (LOCAL + RANGES, "!KnownHeight {}", "start: !KnownHeight is for frame earth_fixed only, this is local"),
        (SATELLITES + RANGES, "!KnownHeight {}", "start: !KnownHeight needs a !Tdoa of two rows; there is none"),
        (
            SATELLITES.replace("c: !Kepler {", "c: !Geodetic {latitude_deg: 2, longitude_deg: 4} #")
            + "sensors: {tdoa: !Tdoa {}}\n",
            "!KnownHeight {}",
            "start: !KnownHeight is for receivers above the target's horizon, such as satellites; c never is;",
        ),
        (LOCAL + RANGES, "!Snapshot {sensors: [height]}", r"start.sensors: \['altitude'\] are not enough"),
        (LOCAL + RANGES, "!Snapshot {sensors: [rangy]}", r"start.sensors: rangy is not known \(did you mean range"),
        (LOCAL + "sensors: {doppler: !RangeRate {}}\n", "!Snapshot {}", "doppler is not allowed; a fix is of rows"),
        (
            LOCAL + "sensors: {r: !Range {}, h: !Altitude {offset_s: 2}}\n",
            "!Snapshot {}",
            "h is not allowed; it measures from 2 s on, the first measurement is at 0 s",
        ),
        (
            LOCAL + RANGES + "oscillator: {}\n",
            "!Snapshot {}",
            "start.sensors: a fix knows nothing of the oscillator",
        ),
    ],
)
def test_a_start_that_does_not_fit_is_refused(folder, text, start, words):
    with pytest.raises(UserError, match=words):
        declared(started(text, start), folder)


# ------------------------------------------------------------------------------------------------- sensors


def test_arrival_times_weigh_as_least_squares_over_the_emission(folder):
    _, assembly = declared(LOCAL + "sensors: {toa: !Toa {sigma_ns: 40}}\n", folder)
    model = assembly.estimators["ekf"].model
    assert model.names == ("toa_bravo_alpha", "toa_charlie_alpha", "toa_delta_alpha")
    target = np.array([[-2e3, 3e3, 1e3, 40.0, 10.0, 0.0]])
    carriers = np.zeros((1, 4, 6))
    carriers[0, :, :3] = [[-8e3, -5e3, 30], [9e3, -4e3, 120], [1e3, 9e3, 60], [0, 0, 5]]
    rows = model.jacobian(target, carriers)[0, :, :3]
    information = rows.T @ np.linalg.solve(model.noise_covariance(), rows)
    # the other way: four independent arrival times, the emission a fourth unknown, which is marginalised
    offset = target[0, :3] - carriers[0, :, :3]
    gradient = offset / np.linalg.norm(offset, axis=1)[:, None] / 299792458.0
    both = np.concatenate([gradient, np.ones((4, 1))], axis=1) / 40e-9
    full = both.T @ both
    expected = full[:3, :3] - np.outer(full[:3, 3], full[3, :3]) / full[3, 3]
    np.testing.assert_allclose(information, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


INERTIAL = """
frame: inertial
duration_s: 120
constants: {j2: 0}
platforms:
  high: !Kepler {semi_major_axis_km: 12000, inclination_deg: 50, true_anomaly_deg: 2}
target: !Kepler {semi_major_axis_km: 7400, inclination_deg: 62, true_anomaly_deg: 4}
belief: {motion: !Orbital {density_m2ps3: 1.0e-8}}
start: !Prior {sigma_position_m: 300, sigma_velocity_mps: 5}
estimators: {ekf: !Iekf {}}
"""
FINE = "sigma_azimuth_deg: 0.002, sigma_elevation_deg: 0.002"
SIX = (
    "sigma_azimuth_rate_degps: 0.001, sigma_elevation_rate_degps: 0.001, sigma_radial_velocity_mps: 0.5, "
    "sigma_radial_acceleration_mps2: 0.01"
)


@pytest.mark.parametrize(
    ("text", "sensors", "rows"),
    [
        (
            LOCAL,
            "toa: !Toa {sigma_ns: 40}, h: !Altitude {}",
            "toa_bravo_alpha toa_charlie_alpha toa_delta_alpha altitude",
        ),
        (LOCAL, "rss: !Rss {stations: [bravo, delta], sigma_db: 0.5}, h: !Altitude {}", "rss_bravo rss_delta altitude"),
        (SATELLITES, "tdoa: !Tdoa {}, phase: !Phase {platform: b}", "tdoa_b_a tdoa_c_a phase_a_b phase_b_b"),
        (
            SATELLITES,
            "phase: !Phase {wrapped: true, axes: [b], baseline_m: 0.6}, h: !Altitude {}",
            "phase_b_a altitude",
        ),
        (
            INERTIAL,
            "see: !Relative {sigma_azimuth_deg: 0.002, sigma_elevation_deg: 0.002}",
            "azimuth_high elevation_high",
        ),
        (
            INERTIAL,
            f"see: !Relative {{{SIX}, every_s: 5}}",
            "azimuth_high elevation_high azimuth_rate_high elevation_rate_high radial_velocity_high "
            "radial_acceleration_high",
        ),
    ],
    ids=["toa", "rss", "phase", "wrapped phase", "angles between satellites", "six rows between satellites"],
)
def test_a_sensor_is_consistent(folder, text, sensors, rows):
    text = text if "start:" in text else text + "start: !Prior {sigma_position_m: 300, sigma_velocity_mps: 5}\n"
    text += f"sensors: {{{sensors}}}\n"
    _, assembly = declared(text, folder)
    assert list(assembly.stream) == rows.split()
    error, covariance = end(text, folder, 100)
    # the mean of 100 chi-square of 6, over 6: standard deviation 0.058; the truth has no process noise
    assert 0.7 < nees(error, covariance) < 1.25
    prior = np.diag([300.0**2] * 3 + [5.0**2] * 3)
    assert np.linalg.slogdet(np.mean(covariance, axis=0))[1] < np.linalg.slogdet(prior)[1] - 2


@pytest.mark.parametrize(
    ("text", "sensor", "words"),
    [
        (LOCAL, "!Phase {}", "sensors.one: !Phase is not allowed in frame local; earth_fixed or inertial"),
        (SATELLITES, "!Phase {axes: [c]}", r"sensors.one: phase axes: \['c'\] is not allowed"),
        (SATELLITES, "!Phase {axes: [a, a]}", "sensors.one.axes: .* an axis is named twice"),
        (SATELLITES, "!Relative {}", "sensors.one: !Relative is for frame inertial only, this is earth_fixed"),
        (INERTIAL, "!Relative {sigma_azimuth_deg: null, sigma_elevation_deg: null}", "nothing is measured"),
        (LOCAL, "!Toa {stations: [delta]}", r"sensors.one.stations: \['delta'\] is not allowed; at least two"),
        (LOCAL, "!Rss {exponent: 0}", "sensors.one.exponent: 0 is not allowed; a finite number > 0"),
        (LOCAL, "!Toa {light_time: true}", "sensors.one.light_time: true is for frame earth_fixed only"),
    ],
)
def test_a_sensor_that_does_not_fit_is_refused(folder, text, sensor, words):
    with pytest.raises(UserError, match=words):
        declared(text + f"sensors: {{one: {sensor}}}\n", folder)
