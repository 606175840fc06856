"""Sensors that measure several kinds together, and wrapped phases that are resolved."""

from pathlib import Path

import numpy as np
import pytest

from quietfix.diagrams import run_study
from quietfix.diagrams.own.system import own_system
from quietfix.diagrams.paths.functions import paths_of
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.trajectories.gravity import GravityConstants

HERE = Path(__file__).parent
FILE = HERE / "three_satellite.yaml"
KINDS = "sensors.sensor.kinds"
PHASE = f"{KINDS}.phase"
SHORT = {"duration_s": 20}


def study(changes=None, trials=2, estimators=("iekf",), **options):
    return run_study(str(FILE), trials=trials, set=SHORT | (changes or {}), estimators=list(estimators), **options)


# ------------------------------------------------------------------------------------------------ one stream


def test_rows_are_in_the_order_of_the_file():
    kinds = "{b: !Fdoa {carrier_mhz: 3000}, a: !Tdoa {}}"
    result = study({KINDS: kinds, "estimators": "{iekf: !Iekf {}}"}, keep="measurements")
    assert list(result["row"].values) == ["fdoa_s1_s0", "fdoa_s2_s0", "tdoa_s1_s0", "tdoa_s2_s0"]


def test_one_of_a_joint_sensor_is_that_sensor():
    """The same block, rows and clock: the same numbers, whether there is a !Joint around it or not."""
    alone = "{sensor: !Tdoa {reference: s0, sigma_ns: 20, minimum_elevation_deg: 0, elevation_at: target}}"
    changes = {"estimators": "{iekf: !Iekf {}}"}
    joint = study({KINDS: "{tdoa: !Tdoa {reference: s0, sigma_ns: 20}}"} | changes)
    np.testing.assert_array_equal(study({"sensors": alone} | changes)["estimate"], joint["estimate"])


def test_estimators_choose_sensors_kinds_and_rows():
    chosen = {
        "whole": "!Iekf {measurements: [sensor]}",
        "all": "!Iekf {}",
        "kinds": "!Iekf {measurements: [phase, fdoa, tdoa]}",
        "rows": "!Iekf {measurements: [tdoa_s2_s0, phase_b_s0, tdoa_s1_s0, fdoa, phase_a_s0]}",
        "few": "!Iekf {measurements: [tdoa_s2_s0]}",
    }
    estimate = study({f"estimators.{k}": v for k, v in chosen.items()}, estimators=chosen)["estimate"]
    for same in ("whole", "kinds", "rows"):
        np.testing.assert_array_equal(estimate.sel(estimator=same), estimate.sel(estimator="all"))
    assert np.abs(estimate.sel(estimator="few") - estimate.sel(estimator="all")).max() > 10


def test_errors_of_a_joint_sensor_are_common_to_its_kinds():
    right = study(keep="measurements")["measurement"]
    turned = study({"sensors.sensor.errors.attitude_roll_deg": 0.05}, keep="measurements")["measurement"]
    late = study({"sensors.sensor.errors.clock_offset_ns": 50}, keep="measurements")["measurement"]
    gone = study({"sensors.sensor.errors.drop_out_rate": 0.5}, keep="measurements")["measurement"]
    rows = [f"tdoa_s{i}_s0" for i in (1, 2)]
    np.testing.assert_array_equal(turned.sel(row=rows), right.sel(row=rows))
    # 0.05 deg about the track turns the phase across it by 2 pi 30 * 0.05 deg = 9.4 deg near nadir
    off = (turned - right).sel(row="phase_b_s0").values
    assert np.median(np.abs((off + np.pi) % (2 * np.pi) - np.pi)) == pytest.approx(np.radians(9.4), rel=0.2)
    np.testing.assert_allclose((late - right).sel(row=rows), -50e-9, rtol=1e-5)
    assert 0.4 < float(np.isnan(gone).mean()) < 0.6


# ------------------------------------------------------------------------------------------------ orbits


def test_orbits_of_a_file_are_integrated_together():
    """Beside one that needs short steps the others have them, too; the solution is the same to 1 mm."""
    scenario = own_system(FILE).load()
    low, high = "!Kepler {semi_major_axis_km: 6600, eccentricity: 0.01}", "!PositionVelocity {}"
    mixed = own_system(FILE).load(
        settings=[f"platforms={{low: {low}, s0: !Offset {{across_km: 69.28}}, high: {high}}}"]
    )
    setting, constants = Setting(3000.0, None, HERE, scenario.reference_orbit), GravityConstants()
    alone = paths_of({"s0": scenario.platforms["s0"]}, "earth_fixed", setting, constants)[0]
    beside = paths_of(mixed.platforms, "earth_fixed", setting, constants)[1]
    for t in (0.0, 1234.5, 3000.0):
        np.testing.assert_allclose(beside(t)[:3], alone(t)[:3], atol=1e-3)


# ------------------------------------------------------------------------------------------------ phases


IDEAL = {f"{PHASE}.wrapped": False, f"{PHASE}.resolved_by": "''"}
PHASES = ["phase_a_s0", "phase_b_s0"]


@pytest.mark.parametrize("start", [{}, {"start": "!Prior {sigma_position_m: 3000, sigma_velocity_mps: 100}"}])
def test_a_tdoa_resolves_all_cycles(start):
    """What the estimators get is what a sensor with the same noise measures that knows no cycles."""
    changes = {"duration_s": 60, **start}
    found, ideal = study(changes, keep="all"), study(changes | IDEAL, keep="all")
    # a turn is added that the sensor took away: rounding of 100 rad
    np.testing.assert_allclose(found["measurement"], ideal["measurement"], rtol=0, atol=1e-12)
    assert set(np.unique(found["integers"].sel(integers_row="phase_a_s0"))) >= {14, 15, 16}


def test_a_wrong_cycle_is_seen_where_the_noise_is_large():
    """The TDOA fix of 300 ns and more is off by more than half a cycle of a 3 m baseline, at times."""
    changes = {"duration_s": 60, f"{KINDS}.tdoa.sigma_ns": 3000}
    found, ideal = study(changes, keep="all", trials=5), study(changes | IDEAL, keep="all", trials=5)
    turns = (found["measurement"] - ideal["measurement"]).sel(row=PHASES).values / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    assert np.abs(turns).max() >= 1


def test_cycles_that_the_start_leaves_open_are_told():
    """20 km across a line of sight of 920 km, a baseline of 30 wavelengths: 0.64 cycles, 1.9 at 3 sigma."""
    wide = {"start": "!Prior {sigma_position_m: 20000, sigma_velocity_mps: 100}"}
    note = study(wide | {f"{PHASE}.resolved_by": "''"}).attrs["note"]
    assert "phase is wrapped, nothing resolves it, and the start leaves its phase open by 1.9 cycles" in note
    assert "open" not in study(wide).attrs["note"]
    near = {"start": "!Prior {sigma_position_m: 1000, sigma_velocity_mps: 100}"}
    assert "open" not in study(near | {f"{PHASE}.resolved_by": "''"}).attrs["note"]


def test_a_chain_resolves_all_cycles():
    """Ratios of 5 and 5 deg: a stage fails where the error, of 25 deg, exceeds 180 deg (7 sigma)."""
    quiet = {f"{PHASE}.sigma_deg": 5}
    chain = quiet | {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.04, 0.2, 0.9]}
    found, ideal = study(chain, keep="all"), study(quiet | IDEAL, keep="all")
    # with more rows the noise is another one: six sigma of the difference of two, far below a turn
    off = (found["measurement"] - ideal["measurement"]).sel(row=PHASES)
    assert np.abs(off).max() < 6 * np.sqrt(2) * np.radians(5)
    assert np.abs(found["integers"]).max() > 10
    assert list(found["row"].values) == list(ideal["row"].values)


def test_a_chain_resolves_phases_in_inertial_axes():
    """There is no fix in them; of the same satellites and target, the phases are those of Earth-fixed axes."""
    chain = {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.04, 0.2, 0.9], f"{PHASE}.sigma_deg": 1}
    chain |= {"sensors.sensor.minimum_elevation_deg": "null", "start": "!Prior {sigma_velocity_mps: 500}"}
    fixed, inertial = study(chain, keep="all"), study(chain | {"frame": "inertial"}, keep="all")
    for row in PHASES:
        np.testing.assert_allclose(inertial["measurement"].sel(row=row), fixed["measurement"].sel(row=row), atol=1e-6)


def test_two_interferometers_and_an_oscillator():
    """Each is resolved by the fix; the state that is fed back has seven components."""
    second = "!Phase {platform: s1, sigma_deg: 15, baseline_m: 2, carrier_mhz: 3000, wrapped: true, resolved_by: tdoa}"
    changes = {
        "oscillator": "{carrier_mhz: 3000, offset_hz: 100}",
        "sensors.doppler": "!Frequency {sigma_hz: 1, carrier_mhz: 3000}",
        f"{KINDS}.other": second,
        "start": "!Prior {sigma_position_m: 3000, sigma_velocity_mps: 100, sigma_offset_hz: 200}",
    }
    ideal = changes | IDEAL | {f"{KINDS}.other.wrapped": False, f"{KINDS}.other.resolved_by": "''"}
    found, expected = study(changes, keep="all"), study(ideal, keep="all")
    assert found.sizes["state"] == 7 and {"integers_phase", "integers_other"} <= set(found)
    np.testing.assert_allclose(found["measurement"], expected["measurement"], rtol=0, atol=1e-12)


MISTAKES = {
    "nothing in it": ({KINDS: "{}"}, "sensors.sensor.kinds: none is given"),
    "a clock of its own": ({f"{KINDS}.tdoa.every_s": 2}, "sensors.sensor.kinds.tdoa.every_s"),
    "no such kind": ({f"{KINDS}.tdoa": "!Smell {}"}, "sensors.sensor.kinds.tdoa: !Smell"),
    "a joint one in it": ({f"{KINDS}.tdoa": "!Joint {}"}, "sensors.sensor.kinds.tdoa: !Joint"),
    "a row twice": ({f"{KINDS}.again": "!Tdoa {}"}, "sensors.sensor.kinds.again: row tdoa_s1_s0 is not allowed"),
    "the sensor's own name": (
        {f"{KINDS}.sensor": "!Altitude {}"},
        "sensors.sensor.kinds.sensor: the name sensor is not allowed; the sensor has it itself",
    ),
    "another sensor's name": (
        {"sensors.tdoa": "!Altitude {}"},
        "sensors.tdoa: the name tdoa is not allowed; sensors.sensor.kinds.tdoa has it already",
    ),
    "no name": ({f"{KINDS}.a b": "!Altitude {}"}, "sensors.sensor.kinds: the name 'a b' is not allowed"),
    "a choice of nothing": ({"estimators.iekf.measurements": "[phase_c]"}, "estimators.iekf.measurements: phase_c"),
    "a belief in nothing": ({"belief.sensors": "{smell: !Altitude {}}"}, "belief.sensors: smell"),
    "half a belief": (
        {"belief.sensors": "{sensor: !Joint {kinds: {tdoa: !Tdoa {}}}}"},
        "belief.sensors.sensor: it is not as sensors.sensor; a !Joint of tdoa, fdoa, phase",
    ),
    "another belief": ({"belief.sensors": "{sensor: !Tdoa {}}"}, "belief.sensors.sensor: it is not as sensors.sensor"),
    "a joint belief in one": (
        {"belief.sensors": "{tdoa: !Joint {}}"},
        "belief.sensors.tdoa: !Joint is not allowed; sensors.sensor.kinds.tdoa is a !Tdoa",
    ),
    "a belief in another rate": (
        {"belief.sensors": "{tdoa: !Tdoa {every_s: 7}}"},
        "belief.sensors.tdoa.every_s: another one than the sensor's is not allowed",
    ),
    "a belief in errors": (
        {"belief.sensors": "{tdoa: !Tdoa {errors: {drop_out_rate: 0.5}}}"},
        "belief.sensors.tdoa.errors: another one than the sensor's is not allowed",
    ),
    "a belief in other rows": (
        {"belief.sensors": "{tdoa: !Tdoa {receivers: [s2]}}"},
        "belief.sensors.tdoa: rows ['tdoa_s2_s0'] are not allowed",
    ),
    "a belief in another way": (
        {"belief.sensors": "{phase: !Phase {chain_m: [0.01]}}"},
        "belief.sensors.phase.chain_m: [0.01] is not allowed; how phases are resolved is said in",
    ),
    "errors that it has not": (
        {KINDS: "{fdoa: !Fdoa {}}", "start": "!Prior {}", "sensors.sensor.errors.attitude_yaw_deg": 1},
        "sensors.sensor.errors.attitude_yaw_deg: 1 is not allowed; only a !Bearing",
    ),
    "resolved by nobody": (
        {f"{PHASE}.resolved_by": "smell"},
        f"{PHASE}.resolved_by: smell is not known; there are tdoa",
    ),
    "resolved by an FDOA": ({f"{PHASE}.resolved_by": "fdoa"}, f"{PHASE}.resolved_by: fdoa is not known"),
    "resolved without a TDOA": (
        {f"{KINDS}.tdoa.receivers": "[s1]", "start": "!Prior {}"},
        f"{PHASE}.resolved_by: tdoa is not allowed; there is no !Tdoa of two rows",
    ),
    "what is not wrapped": (
        {f"{PHASE}.wrapped": False},
        f"{PHASE}.resolved_by: tdoa is not allowed; the phase is not wrapped",
    ),
    "a chain of what is not wrapped": (
        {f"{PHASE}.wrapped": False, f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.04]},
        f"{PHASE}.chain_m: [0.04] is not allowed; the phase is not wrapped",
    ),
    "both ways": (
        {f"{PHASE}.chain_m": [0.04]},
        f"{PHASE}.resolved_by: tdoa is not allowed beside chain_m",
    ),
    "a chain that falls": (
        {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.04, 0.03]},
        f"{PHASE}.chain_m: [0.04, 0.03] is not allowed; rising lengths > 0, below baseline_m 3",
    ),
    "a chain that is ambiguous": (
        {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.06]},
        f"{PHASE}.chain_m.0: 0.06 is not allowed; at most half a wavelength, 0.0499654 m",
    ),
    "a chain of nothing": (
        {f"{PHASE}.resolved_by": "''", f"{PHASE}.chain_m": [0.0]},
        f"{PHASE}.chain_m: [0.0] is not allowed",
    ),
    "a TDOA that comes too rarely": (
        {
            "sensors": "{tdoa: !Tdoa {reference: s0, every_s: 2}, "
            "phase: !Phase {carrier_mhz: 3000, wrapped: true, resolved_by: tdoa}}",
            "estimators": "{iekf: !Iekf {}}",
        },
        "sensors.phase.resolved_by: tdoa is not allowed; at 1 s the phase is measured, and it is not",
    ),
    "inertial": (
        {"frame": "inertial", "sensors.sensor.minimum_elevation_deg": "null", "start": "!Prior {}"},
        f"{PHASE}.resolved_by: it is for frame earth_fixed only, this is inertial",
    ),
    "a start from what is resolved later": (
        {"start": "!Snapshot {sensors: [tdoa, phase], height_m: 10000}"},
        "start.sensors: phase is not allowed; its phases are resolved by a prediction",
    ),
    "wrapped phases for a start from resolved ones": (
        {
            f"{PHASE}.resolved_by": "''",
            f"{PHASE}.chain_m": [0.04, 0.4],
            "start": "!Snapshot {sensors: [tdoa, phase], height_m: 10000}",
            "estimators.iekf": "!IekfHypotheses {}",
        },
        "estimators.iekf: it takes wrapped phases; start.sensors: phase is not allowed",
    ),
    "no closed form": (
        {"platforms.s0": "!Offset {}", "start.method": "closed_form"},
        "start.method: closed_form is not allowed for these platforms (collinear",
    ),
    "an offset on a flat Earth": ({"frame": "local"}, "platforms.s0: !Offset is not allowed in frame local"),
    "a satellite that falls": (
        {"platforms.s1": "!PositionVelocity {position_km: [6478, 0, 0], velocity_kmps: [-8, 0, 0]}"},
        "platforms.s1: orbit of platforms.s1: the satellite falls onto the Earth after 1",
    ),
    "one that starts in the ground": (
        {"platforms.s2": "!PositionVelocity {position_km: [6000, 0, 0]}"},
        "platforms.s2: orbit initial state: the satellite starts below the Earth's surface",
    ),
}


@pytest.mark.parametrize("title", MISTAKES)
def test_mistakes_are_one_clear_line(title):
    changes, words = MISTAKES[title]
    with pytest.raises(UserError) as caught:
        study(changes, 1)
    assert words in str(caught.value) and "\n" not in str(caught.value)
